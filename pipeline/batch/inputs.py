"""Which recordings a user means, and a result name for each."""

from __future__ import annotations

import glob
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError

# Names that say nothing of the recording: the folder above is called after it.
TELLING_NOTHING = {"mav0", "recording"}
LOG_ENDINGS = (".log", ".clf", ".carmen")
PACKED_ENDINGS = (".gz", ".bz2", ".xz")
# A message of a scan log, looked for in the beginning of a file [bytes].
SCAN = re.compile(rb"^(FLASER|ROBOTLASER1) [0-9]", re.MULTILINE)
BEGINNING = 1 << 16


@dataclass(frozen=True)
class Input:
    """A recording or scan log, and the name of its result folder."""

    path: Path
    name: str


def find_recordings(given: Iterable[str], output: Path) -> tuple[list[Path], list[str]]:
    """Absolute paths of the recordings, each once, in the order given; and notes on what was passed
    over, one line each.

    given: recordings, scan logs, folders of them, or patterns as `runs/2024-*`. A folder that is
    none of these is taken all the same: what is wrong with it is told of in the table.

    Raises:
        InputError: nothing is there, or no recording in it; `output` lies in a recording.
    """
    found: dict[Path, None] = {}
    notes: list[str] = []
    known = False
    for text in given:
        for path in _expanded(text):
            inside, passed = ([path], []) if _is_recording(path) else _recordings_in(path, output)
            known = known or bool(inside)
            if path.is_file() and not inside:
                passed = [str(path)]
            elif not inside:
                inside, passed = [path], []
            if passed:
                names = ", ".join(passed[:3]) + (", ..." if len(passed) > 3 else "")
                notes.append(f"{path}: passed over, no recording: {names}")
            found.update(dict.fromkeys(p.resolve() for p in inside))
    if not known:
        raise InputError(
            f"{', '.join(given)}: no recording and no folder of recordings: give some, as "
            "recordings/* ('beemap map --help' tells what a recording is)"
        )
    for path in found:
        if output.resolve().is_relative_to(path) and path.is_dir():
            raise InputError(f"{output}: lies in the recording {path}: choose another folder")
    return list(found), notes


def named(paths: Iterable[Path], output: Path) -> list[Input]:
    """Each recording with a result name of its own in the folder `output`.

    A recording keeps the name that it has there from an earlier call; one of a taken name gets
    that of the folder above in front, or a number behind.
    """
    paths = list(paths)
    owners = _owners(output)
    kept = {owner: name for name, owner in owners.items() if owner in paths}
    taken = {name.casefold() for name in kept.values()}
    inputs = []
    for path in paths:
        name = kept.get(path)
        if name is None:
            free = (n for n in _names(path) if not (output / n).exists())
            name = next(n for n in free if n.casefold() not in taken)
            taken.add(name.casefold())
        inputs.append(Input(path, name))
    return inputs


def _expanded(text: str) -> list[Path]:
    """The path itself, else what its pattern matches."""
    if Path(text).exists():
        return [Path(text)]
    matches = sorted(glob.glob(text, recursive=True))
    if not matches:
        raise InputError(f"{text}: no such recording, and no pattern that matches one")
    return [Path(match) for match in matches]


def _is_recording(path: Path) -> bool:
    from pipeline.recordings import asl, folders, kitti, mines, video

    if path.is_dir():
        return any(kind.recognises(path) for kind in (asl, kitti, folders, video))
    return video.is_video(path) or _is_log(path) or mines.recognises(path)


def _is_log(path: Path) -> bool:
    """By its name, else by what it begins with."""
    name = path.name.lower()
    for ending in PACKED_ENDINGS:
        name = name.removesuffix(ending)
    if name.endswith(LOG_ENDINGS):
        return True
    with path.open("rb") as file:
        return SCAN.search(file.read(BEGINNING)) is not None


def _recordings_in(folder: Path, output: Path) -> tuple[list[Path], list[str]]:
    """Recordings in a folder, those of live runs included, and names of what is none."""
    inside: list[Path] = []
    passed: list[str] = []
    if not folder.is_dir():
        return inside, passed
    for entry in sorted(folder.iterdir()):
        if entry.name.startswith(".") or entry.resolve() == output.resolve():
            continue
        # Of a live run; a second one into the folder has another number.
        live = [p for p in sorted(entry.glob("recording*")) if p.is_dir() and _is_recording(p)]
        if _is_recording(entry):
            inside.append(entry)
        elif live:
            inside += live
        else:
            passed.append(entry.name)
    return inside, passed


def _names(path: Path) -> Iterator[str]:
    """Result names for a recording, the best first; without end."""
    parts = [part for part in path.parts[1:] if part not in TELLING_NOTHING] or ["recording"]
    if path.is_file():
        parts[-1] = _without_endings(parts[-1])
    name = ""
    for part in reversed(parts):
        name = f"{part}-{name}" if name else part
        yield name.lstrip(".") or "recording"
    number = 2
    while True:
        yield f"{parts[-1].lstrip('.')}-{number}"
        number += 1


def _without_endings(name: str) -> str:
    """office of office.log.gz."""
    from pipeline.recordings.video import ENDINGS

    for endings in (PACKED_ENDINGS, (*LOG_ENDINGS, *ENDINGS)):
        for ending in endings:
            if name.lower().endswith(ending) and len(name) > len(ending):
                name = name[: -len(ending)]
                break
    return name


def _owners(output: Path) -> dict[str, Path]:
    """Result names in the folder, and the recordings they were made of."""
    owners = {}
    for file in sorted(output.glob("*/run.json")):
        try:
            owners[file.parent.name] = Path(json.loads(file.read_text(encoding="utf-8"))["input"])
        except (ValueError, KeyError, TypeError):
            continue
    return owners
