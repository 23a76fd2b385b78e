"""Result folders that appear whole or not at all, and cost nothing that beemap did not make."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from pipeline.output_lock import locked

# Less than this is a full disk, for writers that do not say why they failed [bytes].
FULL = 64 * 1024
EARLIER = ".earlier"  # in a result folder: the result before, while a live run has no map yet
# What a recording's folders hold, in whatever version of it.
_RECORDED = re.compile(
    r"data\.csv|sensor\.yaml|skew\.csv|serial\.log|\d+\.\w{1,4}|"
    r"command\.txt|rig\.yaml|scans\.npz|(floorplan|seen)\.(pgm|yaml)"
)


@dataclass(frozen=True)
class Kind:
    """What beemap writes into one kind of folder; `--force` replaces that and nothing else.

    what: it is called; names: of its files and folders; made: whether a folder is of this kind;
    keeps: names that stay where a new folder holds none.
    """

    what: str
    names: tuple[str, ...]
    made: Callable[[Path], bool]
    keeps: tuple[str, ...] = ()


def has(name: str, text: str = "") -> Callable[[Path], bool]:
    """Whether a folder holds a file, with this text in it."""

    def made(folder: Path) -> bool:
        try:
            return text in (folder / name).read_text(encoding="utf-8", errors="replace")
        except OSError:
            return False

    return made


def _imported(folder: Path) -> bool:
    try:
        return "imported" in json.loads((folder / "meta.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError):
        return False


RESULT = Kind(
    "a result",
    (
        "map.pgm", "map.yaml", "map.npz", "map.png", "map.ply", "cloud.ply", "trajectory.tum",
        "online.tum", "odometry.tum", "truth.tum", "health.csv", "settings.yaml", "report.html",
        "places.json", "run.json",
    ),
    has("run.json"),
    ("places.json",),
)  # fmt: skip
RENDERED = Kind("a rendered recording", ("mav0", "truth"), has("truth/command.txt", "simulate"))
IMPORTED = Kind("an imported recording", ("mav0", "rig.yaml", "meta.json"), _imported)


@contextmanager
def new_folder(target: str | Path, force: bool = False, kind: Kind = RESULT) -> Iterator[Path]:
    """Yield a temporary folder; what it holds appears at `target` when the block ends well.

    Of what stood at `target`, the files of that kind are replaced, only then, and only with
    `force`; all else stays. When the block fails `target` is as it was.

    Raises:
        InputError: as `check_target`; another run writes there; it cannot be written, or the disk
            is full.
    """
    check_target(Path(target), force, kind)
    with locked(target):
        # The folder that a link points to is replaced, not the link.
        place = Path(target).resolve()
        partial = place.with_name(f".{place.name}.part-{os.getpid()}")
        if place.is_dir():  # in it: it may be a disk of its own
            partial = place / f".part-{os.getpid()}"
        try:
            partial.mkdir(parents=True)
            yield partial
            if place.is_dir():
                _replace(partial, place, kind)
            else:
                os.rename(partial, place)
        except OSError as error:
            raise _named(error, Path(target), partial) from None
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def check_target(target: Path, force: bool, kind: Kind = RESULT) -> None:
    """Refuse a `target` early, before any work is spent on it.

    Raises:
        InputError: it is a file; it is a folder with something in it and `force` is off, or
            what it holds is not of that kind, or has files in it that beemap does not write.
    """
    try:
        if not target.exists():
            return
        if not target.is_dir():
            raise InputError(f"{target}: is a file, not a folder: choose another name")
        # What a killed run left does not count.
        content = {e.name for e in target.iterdir() if not e.name.startswith(".part-")}
        foreign = _foreign(target, kind) if force and content else None
    except OSError as error:
        raise InputError(f"{target}: cannot be used ({error.strerror})") from None
    if content and not force:
        raise InputError(f"{target}: already exists: give --force to replace it")
    if content and not kind.made(target) and _any_file(target):
        raise InputError(
            f"{target}: holds other things than {kind.what}: choose another name, or empty it"
        )
    if foreign is not None:
        raise InputError(
            f"{foreign}: is not beemap's and would be lost: move it, or choose another output"
        )


def check_output(recording: Path, output: Path, force: bool) -> None:
    """As `check_target`, and refuse a folder for results that holds what they are made from."""
    if output.is_dir() and recording.resolve().is_relative_to(output.resolve()):
        raise InputError(f"{output}: holds the recording: choose another folder for the results")
    check_target(output, force)


def replace_files(partial: Path, folder: Path, last: str) -> None:
    """Move the files of `partial` into `folder`, each in place of an old one; `last` at the end."""
    for file in sorted(partial.iterdir(), key=lambda file: file.name == last):
        os.replace(file, folder / file.name)
    partial.rmdir()


def set_aside(folder: Path) -> None:
    """Move the result in a folder into `.earlier` in it, until it is forgotten or put back."""
    earlier = folder / EARLIER
    for name in RESULT.names:
        if os.path.lexists(folder / name):
            earlier.mkdir(exist_ok=True)
            os.replace(folder / name, earlier / name)


def put_back(folder: Path) -> None:
    """Have the result again that was set aside."""
    earlier = folder / EARLIER
    if earlier.is_dir():
        replace_files(earlier, folder, "run.json")


def forget_earlier(folder: Path) -> None:
    """Remove the result that was set aside: there is a new one."""
    shutil.rmtree(folder / EARLIER, ignore_errors=True)


def remove_result(folder: Path) -> None:
    """Remove the result in a folder, and the folder where nothing else is in it."""
    for name in RESULT.names:
        (folder / name).unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()


def _any_file(folder: Path) -> bool:
    """Whether there is anything in a folder but folders."""
    return any(place.is_symlink() or not place.is_dir() for place in folder.rglob("*"))


def _foreign(target: Path, kind: Kind) -> Path | None:
    """Something in the folders that would be replaced that no version of beemap writes there."""
    for name in kind.names:
        if (target / name).is_symlink() or not (target / name).is_dir():
            continue
        if kind is RESULT:
            return target / name
        for folder, folders, files in os.walk(target / name):
            links = [f for f in folders if (Path(folder) / f).is_symlink()]
            for file in (*links, *files):
                if not _RECORDED.fullmatch(file):
                    return Path(folder) / file
    return None


def _replace(partial: Path, place: Path, kind: Kind) -> None:
    """Files first, folders of the same name out of the way; run.json, which stands for all, last.

    What goes is removed only when all that is new is in place.
    """
    old = partial / ".old"
    new = sorted(partial.iterdir(), key=lambda entry: entry.name == "run.json")
    old.mkdir()
    for entry in new:
        if entry.is_dir() and (place / entry.name).exists():
            os.rename(place / entry.name, old / entry.name)
        os.replace(entry, place / entry.name)
    fresh = {entry.name for entry in new}
    forget_earlier(place)
    for name in kind.names:
        if name not in fresh and name not in kind.keeps and os.path.lexists(place / name):
            os.rename(place / name, old / name)


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
