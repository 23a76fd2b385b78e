"""Places that somebody marked by name during a run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pipeline.run import MapRun

FILE = "places.json"
# A place belongs to a pair of a run whose stamp is no further from its own [ns].
SAME_MOMENT = 500_000_000


@dataclass(frozen=True)
class Place:
    """Where the robot stood at its pose number `index`: the pose may still be corrected."""

    name: str
    index: int


def located(places: Sequence[Place], stamps: Sequence[int], path: np.ndarray) -> list[dict]:
    """Each place with its stamp [ns] and where it is: x, y [m], theta [rad].

    stamps (n,) and path (n, 3): of the run; places beyond its end stand at its last pose.
    """
    found = []
    for place in places:
        if not len(path):
            continue
        index = min(place.index, len(path) - 1)
        x, y, theta = (round(float(v), 4) for v in path[index])
        found.append(
            {"name": place.name, "stamp": int(stamps[index]), "x": x, "y": y, "theta": theta}
        )
    return found


def carried(
    earlier: Sequence[dict[str, Any]], stamps: Sequence[int], path: np.ndarray
) -> list[dict[str, Any]]:
    """Places of an earlier run where they are now.

    earlier: as `located` gives them. Those marked at a pair of this run, of stamps (n,) [ns] and
    path (n, 3), move with it; others, of the map that this run began in, stay where they were.
    """
    known = np.asarray(stamps, np.int64)
    found = []
    for place in earlier:
        stamp = int(place["stamp"])
        if len(known):
            index = int(np.abs(known - stamp).argmin())
            if abs(int(known[index]) - stamp) <= SAME_MOMENT:
                place = {**located([Place(place["name"], index)], stamps, path)[0], "stamp": stamp}
        found.append(place)
    return found


def run_places(run: MapRun, path: np.ndarray) -> list[dict[str, Any]]:
    """All places of a run along its path (n, 3), each name once: the one marked last."""
    stamps = run.mapper.stamps
    marked = located(run.places, stamps, path)
    names = {place["name"] for place in marked}
    earlier = {place["name"]: place for place in reversed(run.earlier_places)}
    kept = [place for name, place in earlier.items() if name not in names]
    return carried(kept[::-1], stamps, path) + marked


def read_places(folder: Path) -> list[dict[str, Any]]:
    """What `write_places` wrote there; none where there is no such file, or it is damaged."""
    try:
        places = json.loads((folder / FILE).read_text(encoding="utf-8"))["places"]
        return [
            {"name": str(p["name"]), "stamp": int(p["stamp"])}
            | {key: float(p[key]) for key in ("x", "y", "theta")}
            for p in places
        ]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def write_places(folder: Path, places: Sequence[dict[str, Any]]) -> None:
    """Write `places.json` where there are any."""
    if places:
        text = json.dumps({"places": list(places)}, indent=2, ensure_ascii=False)
        (folder / FILE).write_text(text + "\n", encoding="utf-8")
