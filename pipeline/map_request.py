"""MapRequest: all that decides the result of `beemap map`, as it is kept in a checkpoint."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from pathlib import Path

import msgspec

from calibration.yamlfile import YamlFileError, parse_yaml
from pipeline.checkpoint import Checkpoint
from pipeline.errors import InputError
from pipeline.job import Job, log_job, recording_job
from pipeline.recordings import open_input
from pipeline.recordings.base import Recording
from pipeline.recordings.scan_log import ScanLog
from pipeline.recordings.tick_table import read_tick_table
from pipeline.settings import Settings, as_yaml, check, load_settings

VERSIONS_OF = ("beemap", "numpy", "opencv-contrib-python-headless")


class Ticks(msgspec.Struct, frozen=True):
    """`--ticks FILE` and what describes it; offset in seconds."""

    file: str
    columns: str
    unit: str | None = None
    offset: float = 0.0


class MapRequest(msgspec.Struct, frozen=True):
    """settings: as YAML, complete; None before the input was opened. rig_digest: of the rig file;
    versions: of what computes the observations."""

    input: str
    rig: str | None = None
    motion: str | None = None
    fps: float | None = None
    seed: int = 1
    ticks: Ticks | None = None
    settings: str | None = None
    rig_digest: str = ""
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
        suggested = opened.fitting if isinstance(opened, ScanLog) else None
        if self.settings is None:
            settings = load_settings(settings_file, overrides, suggested)
        else:
            settings = _stored(self.settings)
        if isinstance(opened, ScanLog):
            return log_job(opened, settings, self.seed), settings
        motion = self.motion or "encoders"
        return recording_job(opened, rig, motion, settings, self.seed, threads), settings

    def complete(self, settings: Settings) -> MapRequest:
        """With all that a resumed run must find unchanged."""
        return msgspec.structs.replace(
            self,
            input=str(Path(self.input).resolve()),
            rig=None if self.rig is None else str(Path(self.rig).resolve()),
            settings=as_yaml(settings),
            rig_digest=_digest(self.rig),
            versions={name: version(name) for name in VERSIONS_OF},
        )

    def check_unchanged(self, where: Path) -> None:
        """Raise InputError where going on would mix what does not belong together."""
        if self.rig_digest != _digest(self.rig):
            raise InputError(f"{where}: {self.rig} was changed since: map afresh")
        now = {name: version(name) for name in self.versions}
        if now != self.versions:
            raise InputError(f"{where}: made by other versions of beemap or OpenCV: map afresh")

    def _refuse_for_logs(self, path: Path) -> None:
        from pipeline.recordings.video import is_video

        if is_video(path):
            return
        given = {"--rig": self.rig, "--motion": self.motion, "--fps": self.fps}
        for option, value in {**given, "--ticks": self.ticks}.items():
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


def _digest(file: str | None) -> str:
    if file is None:
        return ""
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return "missing"
