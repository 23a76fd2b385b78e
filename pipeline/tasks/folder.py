"""A folder of results that is gone on with, and whose work it is at the moment."""

from __future__ import annotations

import json
import shutil
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError
from pipeline.folders import remove_result

# What marks a folder of ours, by a file of that name (.txt), and how it is called.
KINDS = {"experiment": "an experiment", "batch": "a batch"}
# A task looks whether its folder is still its own no more often [s].
LOOK_EVERY = 1.0


def open_folder(folder: Path, kind: str, name: str, force: bool) -> None:
    """Make a folder for results, or open it to go on; `force` starts it over.

    kind: of `KINDS`; name: what stands in the file that marks the folder.

    Raises:
        InputError: it holds something else.
    """
    mark = folder / f"{kind}.txt"
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder: choose another name")
    if folder.is_dir() and any(folder.iterdir()):
        held = mark.read_text(encoding="utf-8").strip() if mark.is_file() else None
        if held != name:
            what = f"{kind} {held}" if held else f"other things than {KINDS[kind]}"
            raise InputError(f"{folder}: holds {what}: choose another folder")
        if force:
            (folder / "rows.csv").unlink(missing_ok=True)
            for run in folder.glob("*/run.json"):
                if not run.parent.is_symlink() and _is_ours(run):
                    remove_result(run.parent)
            for log in folder.glob("*.checkpoint"):
                log.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    mark.write_text(f"{name}\n", encoding="utf-8")


def _is_ours(run: Path) -> bool:
    """Whether a batch made the result: a user's own run in the folder has no key."""
    try:
        return "key" in json.loads(run.read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError):
        return False


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """Yield a file that is there as long as the work in the folder is this call's own.

    A task stops when the file of its call is gone: an orphan, or one on a cluster whose sender
    was interrupted, must not go on beside the call that came after. What killed tasks left behind
    is taken away before and after.
    """
    for earlier in folder.glob(".claim-*"):
        earlier.unlink(missing_ok=True)
    _sweep(folder)
    claim = folder.resolve() / f".claim-{uuid.uuid4()}"
    claim.touch()
    try:
        yield claim
    finally:
        claim.unlink(missing_ok=True)
        _sweep(folder)


class Watch:
    """Tells a task when it must stop: `gone()` once its call's claim is."""

    def __init__(self, claim: Path) -> None:
        self._claim = claim
        self._looked = -LOOK_EVERY
        self._gone = False

    def gone(self) -> bool:
        """Looked at once a second: it may lie on a shared disk."""
        now = time.monotonic()
        if now - self._looked >= LOOK_EVERY:
            self._looked = now
            self._gone = not self._claim.exists()
        return self._gone


def _sweep(folder: Path) -> None:
    """Take away the temporary folders of `pipeline.folders.new_folder`."""
    for pattern in (".*.part-*", ".*.old-*"):
        for remains in folder.glob(pattern):
            shutil.rmtree(remains, ignore_errors=True)
