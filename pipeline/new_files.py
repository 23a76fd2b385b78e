"""Result files that appear whole, together, or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError
from pipeline.output_lock import make_folder, unmake


@contextmanager
def new_files(targets: Sequence[Path], force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder; when the block ends well, what it holds under the names of
    `targets` takes their places, the first of them last: where it stands, the others do too.

    All targets lie in one folder, which is made where it is missing. When the block fails, what
    stood there is as it was.

    Raises:
        InputError: as `check_free`; or they cannot be written.
    """
    check_free(targets, force)
    place = targets[0].parent
    made: list[Path] = []
    partial = place / f".{targets[0].name}.part-{os.getpid()}"
    try:
        made = make_folder(place)
        partial.mkdir()
        yield partial
        for target in reversed(targets):
            os.replace(partial / target.name, target)
    except OSError as error:
        raise InputError(
            f"{targets[0]}: cannot be written ({error.strerror or error}): choose another place"
        ) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        unmake(made)


def check_free(targets: Sequence[Path], force: bool) -> None:
    """Refuse targets early, before any work is spent on them.

    Raises:
        InputError: one of them is a folder, or is there and `force` is off.
    """
    for target in targets:
        try:
            if target.is_dir():
                raise InputError(f"{target}: is a folder, not a file: choose another name")
            if target.exists() and not force:
                raise InputError(f"{target}: already exists: give --force to replace it")
        except OSError as error:
            raise InputError(f"{target}: cannot be used ({error.strerror})") from None
