"""Result folders that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError

# What a folder must hold to be replaced: --force and a slip of the pen must not cost a home.
REPLACEABLE = ("run.json", "mav0", "metadata.yaml")
# Less than this is a full disk, for writers that do not say why they failed [bytes].
FULL = 64 * 1024


@contextmanager
def new_folder(target: str | Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder beside `target`; rename it to `target` when the block ends well.

    What stood at `target` is replaced only then, and only with `force`. When the block fails the
    temporary folder is removed and `target` is as it was.

    Raises:
        InputError: as `check_target`; or it cannot be written, or the disk is full.
    """
    check_target(Path(target), force)
    # The folder that a link points to is replaced, not the link.
    place = Path(target).resolve()
    partial = place.with_name(f".{place.name}.part-{os.getpid()}")
    try:
        partial.mkdir(parents=True)
        yield partial
        _replace(partial, place)
    except OSError as error:
        failure = _named(error, Path(target), partial)
        shutil.rmtree(partial, ignore_errors=True)
        raise failure from None
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def remove_remains(target: Path) -> None:
    """Take away the temporary folders of runs into `target` that were killed."""
    place = Path(target).resolve()
    for partial in place.parent.glob(f".{place.name}.part-*"):
        shutil.rmtree(partial, ignore_errors=True)


def check_target(target: Path, force: bool) -> None:
    """Refuse a `target` early, before any work is spent on it.

    Raises:
        InputError: it is a file; it is a folder with something in it and `force` is off, or
            what it holds is neither a result, a recording nor a bag.
    """
    try:
        if not target.exists():
            return
        if not target.is_dir():
            raise InputError(f"{target}: is a file, not a folder: choose another name")
        content = {entry.name for entry in target.iterdir()}
    except OSError as error:
        raise InputError(f"{target}: cannot be used ({error.strerror})") from None
    if content and not force:
        raise InputError(f"{target}: already exists: give --force to replace it")
    if content and content.isdisjoint(REPLACEABLE):
        raise InputError(
            f"{target}: holds other things than a result: choose another name, or empty it"
        )


def check_output(recording: Path, output: Path, force: bool) -> None:
    """As `check_target`, and refuse a folder for results that holds what they are made from."""
    check_target(output, force)
    if output.exists() and recording.resolve().is_relative_to(output.resolve()):
        raise InputError(f"{output}: holds the recording: choose another folder for the results")


def replace_files(partial: Path, folder: Path, last: str) -> None:
    """Move the files of `partial` into `folder`, each in place of an old one; `last` at the end."""
    for file in sorted(partial.iterdir(), key=lambda file: file.name == last):
        os.replace(file, folder / file.name)
    partial.rmdir()


def _replace(partial: Path, target: Path) -> None:
    if not target.exists():
        os.rename(partial, target)
        return
    old = target.with_name(f".{target.name}.old-{os.getpid()}")
    os.rename(target, old)
    try:
        os.rename(partial, target)
    except BaseException:
        os.rename(old, target)
        raise
    shutil.rmtree(old)


def _named(error: OSError, target: Path, partial: Path) -> InputError:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    if error.errno is None and partial.exists():
        full = shutil.disk_usage(partial).free < FULL
    if full:
        return InputError(
            f"{target}: no space left on the disk: free some or choose another folder "
            "(nothing of an earlier result was touched)"
        )
    return InputError(f"{target}: cannot be written ({error.strerror or error})")
