"""One recording mapped into a result folder, as a worker does it.

A result that is there is used again when its key is wanted again: a digest of all that decides
it, the bytes of the recording included. One that is not whole goes on from its checkpoint.
"""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from pipeline.checkpoint import Checkpoint
from pipeline.errors import InputError
from pipeline.folders import new_folder
from pipeline.job import Job
from pipeline.map_request import MapRequest, checkpoint_of
from pipeline.settings import Settings
from pipeline.tasks.folder import Watch
from pipeline.tasks.identity import source_digest
from pipeline.tasks.task import place

# The source that decides what is made of a recording.
DECIDING = (
    "calibration/**/*.py",
    "stereo/*.py",
    "odometry/*.py",
    "mapping/*.py",
    "pipeline/*.py",
    "pipeline/recordings/*.py",
    "pipeline/health/*.py",
    "pipeline/run_report/*.py",
    "pipeline/run_report/*.j2",
    "pipeline/pages/*.py",
    "pipeline/pages/*.j2",
)


class MapTask(msgspec.Struct, frozen=True):
    """request: what is mapped and how, with absolute paths; settings, overrides: as on the command
    line; output: the result folder; claim: see `pipeline.tasks.folder.claimed`."""

    request: MapRequest
    output: Path
    claim: Path
    settings: Path | None = None
    overrides: tuple[str, ...] = ()


class StoppedError(Exception):
    """The folder is no longer that of the call that sent the task."""


def map_into(task: MapTask) -> bool:
    """Map into the task's folder, which stands there whole afterwards; False: it did already.

    Raises:
        InputError, StereoError, ...: what `beemap map` would say.
        StoppedError: the call that wanted it is gone.
    """
    from pipeline.commands.libraries import use_threads
    from pipeline.results import write_results

    begin = time.perf_counter()
    here = place()
    use_threads(here.threads)
    job, settings, asked = prepared(task, here.threads)
    key = key_of(asked, job)
    if finished_key(task.output) == key:
        return False
    watch = Watch(task.claim)
    with _checkpoint(task.output, key, asked) as known:
        run = job.run(lambda done, total: here.tell(done / total), watch.gone, known)
        if not run.partial:
            facts = {**task.request.facts(job, settings, here.threads), "key": key}
            with new_folder(task.output, force=True) as folder:
                run.seconds["total"] = time.perf_counter() - begin
                origin = task.request.origin(task.output, job.opened)
                write_results(folder, run, settings, job.truth, facts, origin)
            known.discard()
    if run.partial:
        raise StoppedError("stopped: another call works in this folder now")
    return True


def prepared(task: MapTask, threads: int) -> tuple[Job, Settings, MapRequest]:
    """The input opened; its settings; the request with all that must be the same again.

    Raises:
        InputError, RigError, ...: what is missing or wrong.
    """
    job, settings = task.request.prepare(task.settings, task.overrides, threads)
    return job, settings, task.request.complete(settings)


def finished_key(folder: Path) -> str | None:
    """Key of the result that stands in a folder; None: there is none that is whole."""
    try:
        run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        return None if run["partial"] else run["key"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def key_of(asked: MapRequest, job: Job) -> str:
    """16 hexadecimal digits of all that decides the result; where its files lie is not of it."""
    decides: dict[str, Any] = msgspec.to_builtins(asked)
    motion = asked.motion or ""
    decides.update(
        input=_content(Path(asked.input)),
        rig=asked.rig is not None,
        motion=motion.partition(":")[0],
        digests=list(asked.digests.values()),
        truth=None if job.truth is None else _digest(job.truth.stamps, job.truth.poses),
        source=source_digest(DECIDING),
    )
    return hashlib.sha256(msgspec.json.encode(decides, order="sorted")).hexdigest()[:16]


def _content(path: Path) -> str:
    """Digest of a recording's files: their names in it and their bytes.

    Results that were put into it, and hidden files, are not of it.
    """
    digest = hashlib.sha256()
    for file in _files(path):
        with file.open("rb") as opened:
            bytes_ = hashlib.file_digest(opened, "sha256").digest()
        digest.update(file.relative_to(path).as_posix().encode() + bytes_)
    return digest.hexdigest()


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    files: list[Path] = []
    for entry in sorted(path.iterdir()):
        if entry.name.startswith("."):
            continue
        if entry.is_file():
            files.append(entry)
        elif not (entry / "run.json").exists():
            files += _files(entry)
    return files


def _digest(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _checkpoint(output: Path, key: str, asked: MapRequest) -> Checkpoint:
    """That of an earlier try of the same task, else a new one."""
    path = checkpoint_of(output)
    try:
        begun = Checkpoint.resume(path)
    except InputError:
        begun = None
    if begun is not None:
        if begun.asked.get("key") == key:
            return begun
        begun.close()
    return Checkpoint.start(path, {**msgspec.to_builtins(asked), "key": key})
