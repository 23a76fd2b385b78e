"""Plain `left/` and `right/` folders of images.

Stamps come from numeric file names (15 to 19 digits: nanoseconds; with a decimal point, or ten
digits: seconds) or, given a frame rate, from the frame numbers in the names.
"""

from __future__ import annotations

import re
from pathlib import Path

from pipeline.errors import InputError
from pipeline.recordings.base import IMAGE_ENDINGS, Recording, match_pairs
from pipeline.trajectory import seconds_to_ns

LOOKED_FOR = "left/ and right/ with images"

NANOSECONDS = re.compile(r"[0-9]{15,18}|1[0-9]{18}")
# Ten digits alone are a time since 1970.
SECONDS = re.compile(r"[0-9]{1,9}\.[0-9]+|1[0-9]{9}(\.[0-9]+)?")


def recognises(path: Path) -> bool:
    """Whether `path` holds folders named left and right."""
    return (path / "left").is_dir() and (path / "right").is_dir()


def read(path: Path, fps: float | None = None) -> Recording:
    """Open the folders; `fps` numbers the frames where the names are no times.

    Raises InputError when there is no image, or no way to tell the time.
    """
    recording = Recording(path, "left/ and right/ folders", [])
    left, right = (_images(path / side) for side in ("left", "right"))
    if fps is None:
        stamps = {image: _stamp(image) for image in left + right}
    else:
        stamps = _numbered(left + right, round(1e9 / fps))
    recording.pairs = match_pairs(
        [(stamps[image], image) for image in left],
        [(stamps[image], image) for image in right],
        recording,
    )
    return recording


def _images(folder: Path) -> list[Path]:
    images = sorted(f for f in folder.iterdir() if f.suffix.lower() in IMAGE_ENDINGS)
    if not images:
        raise InputError(f"{folder}: holds no image ({', '.join(sorted(IMAGE_ENDINGS))})")
    return images


def _numbered(images: list[Path], period: int) -> dict[Path, int]:
    """Stamps counted over the numbers in both sides' names: a missing image leaves a gap."""
    numbers = sorted({_number(image) for image in images})
    frame = {number: i for i, number in enumerate(numbers)}
    return {image: frame[_number(image)] * period for image in images}


def _number(image: Path) -> int:
    digits = re.findall(r"[0-9]+", image.stem)
    if not digits:
        raise InputError(f"{image}: has no number in its name to order the frames by: rename it")
    return int(digits[-1])


def _stamp(image: Path) -> int:
    name = image.stem
    if NANOSECONDS.fullmatch(name):
        return int(name)
    if SECONDS.fullmatch(name):
        return seconds_to_ns(name)
    raise InputError(f"{image}: the name is no time in ns or s: give --fps")
