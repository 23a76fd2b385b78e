"""Which left image belongs to which right image, judged by the file names."""

from __future__ import annotations

import glob
import re
from dataclasses import dataclass
from pathlib import Path

from calibration.errors import CalibrationError

IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"}


@dataclass(frozen=True)
class ImagePair:
    """The files of one view of the board."""

    left: Path
    right: Path


@dataclass(frozen=True)
class PairList:
    """Image pairs in order, and the images that have no partner."""

    pairs: list[ImagePair]
    unmatched: list[Path]
    matched_by: str  # "number" in the file name, or sorted "order"


def find_pairs(left: str, right: str) -> PairList:
    """Match the images of two folders or globs.

    Pairs share a number in their file names; where the names hold no such number, two sides
    with equal counts are paired in sorted order.

    Raises:
        CalibrationError: no image on a side, the same images on both, or no way to match them.
    """
    lefts, rights = list_images(left), list_images(right)
    if set(lefts) & set(rights):
        raise CalibrationError(
            f"{left} and {right} hold the same images: name each camera's own, "
            f"as in '{lefts[0].parent}/left*' '{lefts[0].parent}/right*' (with the quotes)"
        )
    keys = _common_numbers(lefts, rights)
    if keys is not None:
        return _match(*keys)
    if len(lefts) != len(rights):
        raise CalibrationError(
            f"{left} has {len(lefts)} images and {right} has {len(rights)}, and their names share "
            "no numbers to match them by: remove the images without a partner"
        )
    return PairList([ImagePair(*pair) for pair in zip(lefts, rights, strict=True)], [], "order")


def list_images(source: str) -> list[Path]:
    """The image files in a folder or under a glob, sorted by name.

    Raises:
        CalibrationError: there is none.
    """
    folder = Path(source)
    if folder.is_dir():
        found = list(folder.iterdir())
    else:
        found = [Path(name) for name in glob.glob(source)]
    images = sorted(p for p in found if p.suffix.lower() in IMAGE_SUFFIXES and p.is_file())
    if images:
        return images
    if folder.is_dir():
        problem = "no image in this folder"
    elif glob.has_magic(source):
        problem = "no image matches"
    else:
        problem = "no such folder"
    raise CalibrationError(
        f"{source}: {problem}: give a folder of images or a quoted glob such as 'shots/left*.png'"
    )


def _common_numbers(
    lefts: list[Path], rights: list[Path]
) -> tuple[dict[int, Path], dict[int, Path]] | None:
    """Both sides by a number that tells a side's images apart and occurs on both sides.

    The last number of a name is tried first, then the one before: `pair07_cam0` is number 7.
    """
    numbers = [[re.findall(r"[0-9]+", p.stem) for p in side] for side in (lefts, rights)]
    fewest = min(len(found) for side in numbers for found in side)
    for back in range(1, fewest + 1):
        left, right = (
            {int(found[-back]): p for found, p in zip(side, paths, strict=True)}
            for side, paths in zip(numbers, (lefts, rights), strict=True)
        )
        unique = len(left) == len(lefts) and len(right) == len(rights)
        if unique and left.keys() & right.keys():
            return left, right
    return None


def _match(left: dict[int, Path], right: dict[int, Path]) -> PairList:
    pairs = [ImagePair(left[n], right[n]) for n in sorted(left.keys() & right.keys())]
    alone = {**left, **right}
    unmatched = [alone[n] for n in sorted(left.keys() ^ right.keys())]
    return PairList(pairs, unmatched, "number")
