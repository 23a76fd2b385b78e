"""Places that somebody marked by name during a run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

FILE = "places.json"


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


def write_places(folder: Path, places: Sequence[dict[str, Any]]) -> None:
    """Write `places.json` where there are any."""
    if places:
        text = json.dumps({"places": list(places)}, indent=2, ensure_ascii=False)
        (folder / FILE).write_text(text + "\n", encoding="utf-8")
