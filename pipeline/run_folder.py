"""RunFolder: a result folder opened again, and the run that made it made ready once more."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from mapping.grid import OccupancyGrid
from pipeline.errors import InputError
from pipeline.job import Job
from pipeline.map_files import read_map
from pipeline.map_request import MapRequest
from pipeline.settings import Settings, load_settings
from pipeline.trajectory import Trajectory, read_tum

NEEDED = ("map.npz", "trajectory.tum", "settings.yaml")
RECORDING = "recording"  # where `beemap live` records


@dataclass(frozen=True)
class RunFolder:
    """What `beemap map` or `beemap live` wrote.

    facts: the content of run.json. notes: what the user should hear of it.
    """

    path: Path
    facts: dict[str, Any]
    notes: list[str] = field(default_factory=list)

    @cached_property
    def settings(self) -> Settings:
        """Of the run."""
        return load_settings(self.path / "settings.yaml")

    @cached_property
    def grid(self) -> OccupancyGrid:
        """The map."""
        return read_map(self.path / "map.npz")

    @cached_property
    def trajectory(self) -> Trajectory:
        """The path."""
        return read_tum(self.path / "trajectory.tum")

    @cached_property
    def odometry(self) -> Trajectory | None:
        """Dead reckoning at the poses of the path, where it was kept."""
        file = self.path / "odometry.tum"
        if not file.is_file():
            return None
        odometry = read_tum(file)
        same = np.array_equal(odometry.stamps, self.trajectory.stamps)
        return odometry if same else None

    def job(self, recording: Path | None, threads: int) -> Job | None:
        """The run that made this folder, to be made or looked at again.

        recording: where its input lies now; None: where it lay then. None, with a note, when it
        is not at hand.

        Raises:
            InputError: `recording` is none; a file that the run used was changed since.
        """
        request = self._request(recording)
        if request is None:
            return None
        given = recording is not None
        request.check_files(self.path)
        if not given and not Path(request.input).exists():
            self.notes.append(
                f"its input {request.input} is not there any more (--recording says where it is): "
                "shown is what the folder holds"
            )
            return None
        job, _ = request.prepare(None, (), threads)
        if skipped := self.facts.get("pairs_skipped"):
            self.notes.append(f"{skipped} pairs were skipped live: made again, the run is another")
        if request.other_versions():
            self.notes.append(
                "made by other versions of beemap or OpenCV: made again it may differ"
            )
        return job

    def _request(self, recording: Path | None) -> MapRequest | None:
        try:
            asked = msgspec.convert(self.facts["request"], MapRequest)
        except (KeyError, msgspec.ValidationError):
            if recording is None:
                self.notes.append(
                    f"{self.path / 'run.json'} does not say what the run was asked for: shown is "
                    "what the folder holds"
                )
                return None
            asked = MapRequest(str(recording), seed=int(self.facts.get("seed", 1)))
        inside = self.path / Path(asked.input).name
        if not inside.is_dir():
            inside = self.path / RECORDING
        if recording is None and not Path(asked.input).exists() and inside.is_dir():
            recording = inside
        text = (self.path / "settings.yaml").read_text(encoding="utf-8")
        changes = {"settings": text} | ({"input": str(recording)} if recording else {})
        if asked.motion is None and isinstance(asked_for := self.facts.get("motion"), str):
            changes["motion"] = asked_for  # the default may have been another one then
        return msgspec.structs.replace(asked, **changes)


def open_run(path: Path) -> RunFolder:
    """Open a result folder.

    Raises:
        InputError: it is none, or it is not finished.
    """
    file = path / "run.json"
    if not file.is_file():
        raise InputError(f"{path}: no result folder (it has no run.json): give what map -o wrote")
    try:
        facts = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read ({error}): map afresh") from None
    missing = [
        n for n in ("map.npz", "trajectory.tum", "settings.yaml") if not (path / n).is_file()
    ]
    if not isinstance(facts, dict) or missing:
        raise InputError(f"{path}: {', '.join(missing) or 'run.json'} is missing: map afresh")
    run = RunFolder(path, facts)
    if facts.get("partial"):
        run.notes.append("the run was interrupted: its folder holds what was done until then")
    return run
