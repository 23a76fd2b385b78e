"""Result folders that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError


@contextmanager
def new_folder(target: str | Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder beside `target`; rename it to `target` when the block ends well.

    What stood at `target` is replaced only then, and only with `force`. When the block fails the
    temporary folder is removed and `target` is as it was.

    Raises:
        InputError: `target` exists and `force` is off; it cannot be written; the disk is full.
    """
    target = Path(target)
    check_target(target, force)
    partial = target.with_name(f".{target.name}.part-{os.getpid()}")
    try:
        partial.mkdir(parents=True)
        yield partial
        _replace(partial, target)
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise _named(error, target) from None
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def check_target(target: Path, force: bool) -> None:
    """Refuse an existing, non-empty `target` early, before any work is spent on it."""
    if target.is_dir():
        if any(target.iterdir()) and not force:
            raise InputError(f"{target}: already exists: give --force to replace it")
    elif target.exists():
        raise InputError(f"{target}: is a file, not a folder: choose another name")


def _replace(partial: Path, target: Path) -> None:
    if not target.exists():
        os.rename(partial, target)
        return
    old = target.with_name(f".{target.name}.old-{os.getpid()}")
    os.rename(target, old)
    os.rename(partial, target)
    shutil.rmtree(old)


def _named(error: OSError, target: Path) -> InputError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return InputError(
            f"{target}: no space left on the disk: free some or choose another folder "
            "(nothing of an earlier result was touched)"
        )
    where = error.filename or target
    return InputError(f"{where}: cannot be written ({error.strerror or error})")
