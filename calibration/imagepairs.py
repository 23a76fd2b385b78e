"""Which left image belongs to which right image: two folders or globs, or one argument."""

from __future__ import annotations

import glob
import re
from dataclasses import dataclass
from pathlib import Path

from calibration.errors import CalibrationError
from calibration.imagesource import ImageSource

IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"}
# Subfolders of one argument that hold the two cameras' images.
SIDES = (("left", "right"), ("cam0", "cam1"), ("image_0", "image_1"))
RECORDED = ("cam0", "image_0")
RECORDING_PAIRS = 100  # looked at in a recording, evenly spread: neighbours show the same view
SIDE_BY_SIDE = 1.9  # width over height from which one image is taken for two; single ones have less


@dataclass(frozen=True)
class ImagePair:
    """The two images of one view of the board."""

    left: ImageSource
    right: ImageSource


@dataclass(frozen=True)
class PairList:
    """Image pairs in order, and the images that have no partner.

    matched_by: "number" in the file name, sorted "order", or "halves" of side-by-side images.
    passed_over: pairs of a recording that are not among `pairs`, as these are plenty.
    """

    pairs: list[ImagePair]
    unmatched: list[Path]
    matched_by: str
    passed_over: int = 0


def find_pairs(left: str, right: str | None = None) -> PairList:
    """The image pairs in two folders or globs, or in one argument.

    One argument is a recording (`mav0/cam0`, `cam1`), a folder with the subfolders `left` and
    `right`, a folder or glob of images with left and right in their names, or one of images that
    each hold both cameras' side by side. Files that share a number in their names are pairs; where
    the names hold no such number, two sides with equal counts are paired in sorted order.

    Raises:
        CalibrationError: no image on a side, the same images on both, or no way to match them.
    """
    if right is None:
        return _in_one(left)
    lefts, rights = list_images(left), list_images(right)
    if set(lefts) & set(rights):
        raise CalibrationError(
            f"{left} and {right} hold the same images: name each camera's own, "
            f"as in '{lefts[0].parent}/left*' '{lefts[0].parent}/right*' (with the quotes)"
        )
    return _pair_up(lefts, rights, (left, right))


def _in_one(source: str) -> PairList:
    for names in SIDES:
        sides = _subfolders(Path(source), names)
        if sides is not None:
            left, right = (list_images(str(side)) for side in sides)
            found = _pair_up(left, right, (str(sides[0]), str(sides[1])))
            return _thinned(found) if names[0] in RECORDED else found
    images = list_images(source)
    lefts, rights = ([p for p in images if side in p.stem.lower()] for side in ("left", "right"))
    if lefts and rights and not set(lefts) & set(rights):
        found = _pair_up(lefts, rights, (f"{source} (left)", f"{source} (right)"))
        other = sorted(set(images) - set(lefts) - set(rights))
        return PairList(found.pairs, found.unmatched + other, found.matched_by)
    return _halves(source, images)


def _subfolders(folder: Path, names: tuple[str, str]) -> list[Path] | None:
    """The folders of these names in a folder or its `mav0`, or the `data` in them."""
    root = folder / "mav0" if (folder / "mav0").is_dir() else folder
    if not root.is_dir():
        return None
    inside = {path.name.lower(): path for path in sorted(root.iterdir()) if path.is_dir()}
    if not all(name in inside for name in names):
        return None
    sides = [inside[name] for name in names]
    return [side / "data" if (side / "data").is_dir() else side for side in sides]


def _thinned(found: PairList) -> PairList:
    """At most `RECORDING_PAIRS` of the pairs, evenly spread."""
    count = len(found.pairs)
    if count <= RECORDING_PAIRS:
        return found
    chosen = [found.pairs[n * count // RECORDING_PAIRS] for n in range(RECORDING_PAIRS)]
    return PairList(chosen, found.unmatched, found.matched_by, count - len(chosen))


def _halves(source: str, images: list[Path]) -> PairList:
    shapes = ((path, ImageSource(path).read()) for path in images)
    path, first = next(((p, image) for p, image in shapes if image is not None), (None, None))
    if path is None or first is None:
        raise CalibrationError(f"{source}: none of the {len(images)} images can be read")
    height, width = first.shape
    if width < SIDE_BY_SIDE * height:
        raise CalibrationError(
            f"{source}: {path.name} of {width}x{height} pixels does not hold two images side by "
            "side: give two folders or globs, LEFT and RIGHT"
        )
    pairs = [ImagePair(ImageSource(p, "left"), ImageSource(p, "right")) for p in images]
    return PairList(pairs, [], "halves")


def _pair_up(lefts: list[Path], rights: list[Path], names: tuple[str, str]) -> PairList:
    keys = _common_numbers(lefts, rights)
    if keys is not None:
        return _match(*keys)
    if len(lefts) != len(rights):
        raise CalibrationError(
            f"{names[0]} has {len(lefts)} images and {names[1]} has {len(rights)}, and their names "
            "share no numbers to match them by: remove the images without a partner"
        )
    pairs = [ImagePair(ImageSource(a), ImageSource(b)) for a, b in zip(lefts, rights, strict=True)]
    return PairList(pairs, [], "order")


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
    common = sorted(left.keys() & right.keys())
    pairs = [ImagePair(ImageSource(left[n]), ImageSource(right[n])) for n in common]
    alone = {**left, **right}
    unmatched = [alone[n] for n in sorted(left.keys() ^ right.keys())]
    return PairList(pairs, unmatched, "number")
