"""What came out of a batch, one row a recording, read from the result folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import msgspec

from pipeline.batch.inputs import Input
from pipeline.errors import InputError
from pipeline.evaluate_path import evaluate_path_files
from pipeline.health import complaints


class Row(msgspec.Struct, frozen=True):
    """A recording and what became of it.

    name: of its result folder; why: it failed; verdict: good, or check where `remarks` (one line
    each) ask for something; path_m: length of the path; known_m2: area of the map's known cells;
    ate_m: RMSE against the truth after SE(2) alignment, where there is one; seconds: it took.
    """

    recording: str
    name: str
    state: Literal["mapped", "failed", "not done"]
    why: str = ""
    pairs: int | None = None
    path_m: float | None = None
    known_m2: float | None = None
    local_maps: int | None = None
    verdict: Literal["", "good", "check"] = ""
    ate_m: float | None = None
    seconds: float | None = None
    remarks: tuple[str, ...] = ()


def mapped_row(given: Input, folder: Path) -> Row:
    """Of a recording whose results stand in a folder."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    remarks = (*complaints(run["health"]), *run["notes"])
    counts = run["counts"]
    return Row(
        str(given.path),
        given.name,
        "mapped",
        pairs=counts.get("pairs used") or counts.get("scans used"),
        path_m=run["path_m"],
        known_m2=run["known_m2"],
        local_maps=run["local_maps"],
        verdict="check" if complaints(run["health"]) else "good",
        ate_m=_ate(folder),
        seconds=run["seconds"]["total"],
        remarks=remarks,
    )


def _ate(folder: Path) -> float | None:
    truth = folder / "truth.tum"
    if not truth.is_file():
        return None
    try:
        return evaluate_path_files(folder / "trajectory.tum", truth).ate_rmse
    except InputError:
        return None  # they do not meet in time
