"""One run at a time into one output: a file beside it, locked as long as the run lives.

The kernel holds the lock (flock), so that one left by `kill -9` or a power cut blocks nobody.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.errors import InputError

# Outputs that this process holds already: a command locks early, what it calls may lock again.
_held: set[Path] = set()


@contextmanager
def locked(target: str | Path) -> Iterator[None]:
    """Nobody else may write to `target` within; remains of runs into it that were killed go.

    Folders that had to be made for the lock are removed again where nothing came of them.

    Raises:
        InputError: another run writes there; or the place cannot be used.
    """
    place = Path(target).resolve()
    if place in _held:
        yield
        return
    if not place.name:
        raise InputError(f"{target}: is no place for an output: choose a folder of its own")
    lock = place.with_name(f".{place.name}.lock")
    made: list[Path] = []
    try:
        made = make_folder(place.parent)
        descriptor = _acquire(lock, Path(target))
    except OSError as error:
        unmake(made)
        raise InputError(f"{target}: cannot be used ({error.strerror})") from None
    except InputError:
        unmake(made)
        raise
    _held.add(place)
    try:
        _sweep(place)
        yield
    finally:
        _held.discard(place)
        lock.unlink(missing_ok=True)
        os.close(descriptor)
        unmake(made)


def make_folder(folder: Path) -> list[Path]:
    """Make a folder with all above it; those that were missing, for `unmake`. Raises OSError."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def unmake(made: list[Path]) -> None:
    """Remove what `make_folder` made, as far as it is empty."""
    for folder in made:
        try:
            folder.rmdir()
        except OSError:
            return


def _acquire(lock: Path, target: Path) -> int:
    """The descriptor that holds the lock. Raises InputError: another run has it."""
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            process = os.read(descriptor, 20).decode("ascii", "replace").strip()
            os.close(descriptor)
            who = f" (process {process})" if process else ""
            raise InputError(
                f"{target}: another run{who} is writing there: wait for its end, or choose "
                "another output"
            ) from None
        except OSError:
            os.close(descriptor)
            raise
        # The one before may have removed the file between our opening and locking it.
        try:
            same = os.path.samestat(os.stat(lock), os.fstat(descriptor))
        except FileNotFoundError:
            same = False
        if same:
            with suppress(OSError):  # a full disk: the number is for the message alone
                os.ftruncate(descriptor, 0)
                os.write(descriptor, f"{os.getpid()}\n".encode("ascii"))
            return descriptor
        os.close(descriptor)


def _sweep(place: Path) -> None:
    """Take away the temporary folders of killed runs: nobody else works here now."""
    for folder, pattern in ((place.parent, f".{place.name}.part-*"), (place, ".part-*")):
        for remains in folder.glob(_escaped(pattern)) if folder.is_dir() else ():
            if remains.is_dir() and not remains.is_symlink():
                shutil.rmtree(remains, ignore_errors=True)


def _escaped(pattern: str) -> str:
    """The pattern with the signs of a name taken as they are, but for the star at its end."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in pattern[:-1]) + "*"
