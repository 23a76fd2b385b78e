"""Plain `left/` and `right/` folders of images.

Stamps come from numeric file names (19 digits or so: nanoseconds; with a decimal point, or ten
digits: seconds) or, given a frame rate, from the frame numbers in the names.
"""

from __future__ import annotations

import re
from pathlib import Path

from pipeline.errors import InputError
from pipeline.recordings.base import IMAGE_ENDINGS, Recording, match_pairs
from pipeline.trajectory import seconds_to_ns

LOOKED_FOR = "left/ and right/ with images"

NS_DIGITS = 15  # a name of as many digits or more is nanoseconds
SECONDS_DIGITS = 10  # a name of as many digits is a time since 1970


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
        stamped = [[(_stamp(image), image) for image in side] for side in (left, right)]
    else:
        stamped = _numbered(left, right, round(1e9 / fps))
    recording.pairs = match_pairs(*stamped, recording)
    return recording


def _images(folder: Path) -> list[Path]:
    images = sorted(f for f in folder.iterdir() if f.suffix.lower() in IMAGE_ENDINGS)
    if not images:
        raise InputError(f"{folder}: holds no image ({', '.join(sorted(IMAGE_ENDINGS))})")
    return images


def _numbered(left: list[Path], right: list[Path], period: int) -> list[list[tuple[int, Path]]]:
    """Frames counted over the numbers in both sides' names, so that a missing image is a gap."""
    numbers = sorted({_number(image) for image in left + right})
    frame = {number: i for i, number in enumerate(numbers)}
    return [[(frame[_number(image)] * period, image) for image in side] for side in (left, right)]


def _number(image: Path) -> int:
    digits = re.findall(r"\d+", image.stem)
    if not digits:
        raise InputError(f"{image}: has no number in its name to order the frames by: rename it")
    return int(digits[-1])


def _stamp(image: Path) -> int:
    name = image.stem
    if name.isdigit() and len(name) >= NS_DIGITS:
        return int(name)
    whole, point, fraction = name.partition(".")
    is_seconds = whole.isdigit() and ((point and fraction.isdigit()) or len(name) == SECONDS_DIGITS)
    if is_seconds:
        return seconds_to_ns(name)
    raise InputError(f"{image}: the name is no time in ns or s: give --fps")
