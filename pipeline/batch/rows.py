"""What came out of a batch, one row a recording, read from the result folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import msgspec

from pipeline.batch.inputs import Input
from pipeline.errors import InputError
from pipeline.evaluate_path import evaluate_path_files


class Row(msgspec.Struct, frozen=True):
    """A recording and what became of it.

    name: of its result folder; why: it failed; verdict: of its map; remarks: what asks for
    something, one line each; path_m: length of the path; free_m2, occupied_m2: areas of the map;
    ate_m: RMSE against the truth after SE(2) alignment, where there is one; seconds: it took.
    """

    recording: str
    name: str
    state: Literal["mapped", "failed", "not done"]
    why: str = ""
    pairs: int | None = None
    path_m: float | None = None
    free_m2: float | None = None
    occupied_m2: float | None = None
    local_maps: int | None = None
    verdict: Literal["", "good", "doubtful", "broken"] = ""
    ate_m: float | None = None
    seconds: float | None = None
    remarks: tuple[str, ...] = ()


def mapped_row(given: Input, folder: Path) -> Row:
    """Of a recording whose results stand in a folder."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    remarks = (*run["to_do"], *run["notes"])
    counts = run["counts"]
    return Row(
        str(given.path),
        given.name,
        "mapped",
        pairs=counts.get("pairs used") or counts.get("scans used"),
        path_m=run["path_m"],
        free_m2=run.get("free_m2"),  # unknown to older versions
        occupied_m2=run.get("occupied_m2"),
        local_maps=run["local_maps"],
        verdict=run["verdict"]["word"],
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
