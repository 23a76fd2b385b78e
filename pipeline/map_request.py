"""MapRequest: all that decides the result of `beemap map`, as it is kept in a checkpoint."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from calibration.yamlfile import YamlFileError, parse_yaml
from mapping.known_map import KnownMap
from pipeline.checkpoint import Checkpoint
from pipeline.errors import InputError
from pipeline.fitting import fitted
from pipeline.job import Job, log_job, recording_job
from pipeline.map_files import read_map
from pipeline.recordings import open_input
from pipeline.recordings.base import Recording
from pipeline.recordings.scan_log import ScanLog
from pipeline.recordings.tick_table import read_tick_table
from pipeline.rig import choose_rig
from pipeline.run_report.origin import Origin
from pipeline.settings import Settings, as_yaml, check, given_settings, sets_cell

VERSIONS_OF = ("beemap", "numpy", "opencv-contrib-python-headless")
SEED = 1  # unless given


class Ticks(msgspec.Struct, frozen=True):
    """`--ticks FILE` and what describes it; offset in seconds."""

    file: str
    columns: str
    unit: str | None = None
    offset: float = 0.0


class Begin(msgspec.Struct, frozen=True):
    """`--continue MAP`, and where in it: x m, y m, theta rad; None: to be searched."""

    map: str
    pose: tuple[float, float, float] | None = None

    def known(self) -> KnownMap:
        """The map, read. Raises InputError."""
        pose = None if self.pose is None else np.array(self.pose)
        return KnownMap(read_map(self.map), pose)


def parse_begin(file: Path | None, pose: str | None) -> Begin | None:
    """The options `--continue` and `--pose x,y,deg`.

    Raises:
        InputError: a pose without a map, or none.
    """
    if file is None:
        if pose is not None:
            raise InputError("--pose: belongs to --continue MAP")
        return None
    if pose is None:
        return Begin(str(file))
    try:
        x, y, degrees = (float(part) for part in pose.split(","))
        if not np.isfinite([x, y, degrees]).all():
            raise ValueError
    except ValueError:
        raise InputError(f"--pose {pose}: write x,y,deg in metres and degrees: 1.5,0,90") from None
    return Begin(str(file), (x, y, math.radians(degrees)))


class MapRequest(msgspec.Struct, frozen=True):
    """right_late: frames by which the right images are late; unchecked: as of `check_input`;
    settings: as YAML, complete; None before the input was opened. chosen: those that nobody set,
    with the reason. digests: of the files beside the input; versions: of what computes the
    observations."""

    input: str
    rig: str | None = None
    motion: str | None = None
    fps: float | None = None
    seed: int = SEED
    ticks: Ticks | None = None
    begin: Begin | None = None
    right_late: int = 0
    unchecked: bool = False
    settings: str | None = None
    chosen: dict[str, str] = msgspec.field(default_factory=dict)
    digests: dict[str, str] = msgspec.field(default_factory=dict)
    versions: dict[str, str] = msgspec.field(default_factory=dict)

    def prepare(
        self, settings_file: Path | None, overrides: tuple[str, ...], threads: int
    ) -> tuple[Job, Settings]:
        """Open the input; the job with its settings, which are the stored ones where there are.

        Raises:
            InputError and the stages' own errors: naming what is missing or wrong.
        """
        path, rig = Path(self.input), Path(self.rig) if self.rig else None
        if path.is_file():
            self._refuse_for_logs(path)
        opened = open_input(path, self.fps)
        if self.ticks is not None and isinstance(opened, Recording):
            opened.ticks = read_tick_table(
                Path(self.ticks.file), self.ticks.columns, self.ticks.unit, self.ticks.offset
            )
        if isinstance(opened, Recording):
            opened.shift_right(self.right_late)
        suggested = opened.fitting if isinstance(opened, ScanLog) else None
        given: dict[str, Any] = {}
        if self.settings is None:
            given = given_settings(settings_file, overrides, suggested)
            settings = check(given, "settings")
        else:
            settings = _stored(self.settings)
        begin = None if self.begin is None else self.begin.known()
        chosen = self.chosen
        if self.settings is None and isinstance(opened, Recording):
            fitting_rig, _ = choose_rig(opened, rig)
            settings, chosen = fitted(
                settings,
                not sets_cell(given),
                opened,
                fitting_rig,
                self.motion,
                self.seed,
                begin,
            )
        if isinstance(opened, ScanLog):
            return log_job(opened, settings, self.seed, begin), settings
        origin = self.origin(Path("run"), opened)
        job = recording_job(
            opened, rig, self.motion, settings, self.seed, threads, begin, origin, self.unchecked
        )
        return replace(job, chosen=chosen), settings

    def arguments(self) -> list[str]:
        """What `beemap map` was given beside settings and output."""
        words = [self.input]
        given: dict[str, Any] = {"--rig": self.rig, "--motion": self.motion, "--fps": self.fps}
        given["--seed"] = None if self.seed == SEED else self.seed
        if self.ticks is not None:
            given |= {"--ticks": self.ticks.file, "--ticks-columns": self.ticks.columns}
            given |= {"--ticks-unit": self.ticks.unit, "--ticks-offset": self.ticks.offset or None}
        if self.begin is not None:
            x, y, theta = self.begin.pose or (0.0, 0.0, 0.0)
            pose = f"{x:g},{y:g},{math.degrees(theta):g}"
            given |= {"--continue": self.begin.map, "--pose": pose if self.begin.pose else None}
        given["--right-late"] = self.right_late or None
        for option, value in given.items():
            if value is not None:
                words += [option, str(value)]
        if self.unchecked:
            words.append("--unchecked")
        return words

    def origin(self, output: Path, opened: Recording | ScanLog) -> Origin:
        """For the report of a run into `output`; opened: the input."""
        rig = Path(self.rig) if self.rig else None
        pairs = opened.pairs if isinstance(opened, Recording) else ()
        return Origin(output, Path(self.input), self.arguments(), rig, lambda: pairs)

    def complete(self, settings: Settings, chosen: dict[str, str] | None = None) -> MapRequest:
        """With all that a resumed run must find unchanged; chosen: as of the job."""
        return msgspec.structs.replace(
            self,
            input=str(Path(self.input).resolve()),
            rig=None if self.rig is None else str(Path(self.rig).resolve()),
            settings=as_yaml(settings),
            chosen=chosen or {},
            digests={file: _digest(file) for file in self._files},
            versions={name: version(name) for name in VERSIONS_OF},
        )

    def told(self) -> dict[str, Any]:
        """A complete request as run.json keeps it: with settings.yaml the run can be made again."""
        fields = msgspec.to_builtins(self)
        del fields["settings"]
        return fields

    def check_unchanged(self, where: Path) -> None:
        """Raise InputError where going on would mix what does not belong together."""
        self.check_files(where)
        if self.other_versions():
            raise InputError(f"{where}: made by other versions of beemap or OpenCV: map afresh")

    def check_files(self, where: Path) -> None:
        """Raise InputError where a file beside the input was changed."""
        for file, digest in self.digests.items():
            if _digest(file) != digest:
                raise InputError(f"{where}: {file} was changed since: map afresh")

    def other_versions(self) -> bool:
        """Whether what computes the observations is not what it was."""
        return self.versions != {name: version(name) for name in self.versions}

    def facts(self, job: Job, settings: Settings, threads: int) -> dict[str, Any]:
        """What run.json says of a run of the job with these settings."""
        return {
            "input": self.input,
            **job.facts(),
            "seed": self.seed,
            "request": self.complete(settings, job.chosen).told(),
            "notes": job.notes,
            "threads": threads,
            "recording": job.skipped,
        }

    @property
    def _files(self) -> list[str]:
        """Files beside the input that decide the result."""
        files = [self.rig, self.ticks.file if self.ticks else None]
        files.append(self.begin.map if self.begin else None)
        files.append((self.motion or "").partition(":")[2] or None)
        return [str(_content(Path(file))) for file in files if file is not None]

    def _refuse_for_logs(self, path: Path) -> None:
        from pipeline.recordings.video import is_video

        if is_video(path):
            return
        given: dict[str, Any] = {"--rig": self.rig, "--motion": self.motion, "--fps": self.fps}
        given |= {"--ticks": self.ticks, "--right-late": self.right_late or None}
        for option, value in given.items():
            if value is not None:
                raise InputError(
                    f"{path}: is a scan log, which holds its own odometry and needs no {option}: "
                    "leave it out"
                )


def checkpoint_of(output: Path) -> Path:
    """Where the checkpoint of a run into `output` lies."""
    place = output.resolve()
    return place.with_name(f"{place.name}.checkpoint")


def resumed(output: Path) -> tuple[Checkpoint, MapRequest]:
    """The checkpoint of a run of `map` or `live` into `output` that was cut off.

    Raises:
        InputError: there is none, or what it belongs to was changed.
    """
    inside = output / "checkpoint"
    path = inside if inside.is_file() else checkpoint_of(output)
    checkpoint = Checkpoint.resume(path)
    try:
        request = msgspec.convert(checkpoint.asked, MapRequest)
        request.check_unchanged(path)
    except msgspec.ValidationError as error:
        checkpoint.close()
        raise InputError(f"{path}: not a checkpoint of a run ({error}): map afresh") from None
    except BaseException:
        checkpoint.close()
        raise
    return checkpoint, request


def _stored(text: str) -> Settings:
    try:
        return check(parse_yaml(text, "checkpoint"), "checkpoint")
    except YamlFileError as error:
        raise InputError(str(error)) from None


def _content(path: Path) -> Path:
    """Of a result folder, its map."""
    return (path / "map.npz" if path.is_dir() else path).resolve()


def _digest(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return "missing"
