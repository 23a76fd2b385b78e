"""The worst pairs of a run as small pictures, their images read again from the recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.health.filter_findings import FilterFigures
from pipeline.pages.render import jpeg_uri
from pipeline.recordings.base import DamagedFrameError, RecordedPair
from pipeline.run_report.reasons import reason
from pipeline.worst_pairs import Suspect
from stereo.errors import StereoError
from stereo.scan import RangeScan

SIDE = 200  # width of one image [px]
GAP = 4
STRIP = 10  # height of the bar at the foot of the left image
QUALITY = 70
EMPTY = 110  # grey of an image that cannot be read
# BGR of what a column answered: from near to far, nothing there, not known.
NEAR, FAR = np.array([50, 80, 230.0]), np.array([220, 150, 60.0])
OPEN, UNKNOWN = (235, 235, 235), (25, 25, 25)

# Left and right (H, W, 3) uint8 BGR; None where one cannot be read.
Images = tuple[np.ndarray | None, np.ndarray | None]


@dataclass(frozen=True)
class Thumbnail:
    """number: as on the map; heading, text: what is wrong; place: where and when; picture: data
    URI of the pair; scan: SVG of what was seen, where there are no images; alt: what they show;
    frame: number of the pair in the recording."""

    number: int
    heading: str
    text: str
    place: str
    picture: str
    scan: str
    alt: str
    frame: int | None


def thumbnails(
    suspects: Sequence[Suspect],
    figures: FilterFigures | None,
    sight: str,
    place: Callable[[Suspect], str],
    pairs: Sequence[RecordedPair],
) -> list[Thumbnail]:
    """One of each suspect; place: tells where and when it was; pairs: of the recording, none for a
    scan log."""
    frames = {pair.stamp: number for number, pair in enumerate(pairs)}
    found = []
    for number, suspect in enumerate(suspects, start=1):
        frame = frames.get(suspect.stamp)
        images = (None, None) if frame is None else _images(pairs[frame])
        left = images[0]
        grey = None if left is None else cv2.cvtColor(left, cv2.COLOR_BGR2GRAY)
        heading, text = reason(suspect, figures, sight, grey)
        picture = scan = ""
        if frame is not None:
            picture = jpeg_uri(_picture(images, suspect.scan), QUALITY)
        elif suspect.scan is not None:
            scan = scan_from_above(suspect.scan)
        alt = f"{suspect.name}: {heading}"
        found.append(Thumbnail(number, heading, text, place(suspect), picture, scan, alt, frame))
    return found


def _images(pair: RecordedPair) -> Images:
    try:
        loaded = pair.load()
        return _shown(loaded.left), _shown(loaded.right)
    except (DamagedFrameError, StereoError):
        pass
    try:
        return _shown(pair.load_left()), None
    except (DamagedFrameError, StereoError):
        return None, None


def _shown(image: np.ndarray) -> np.ndarray:
    if image.dtype != np.uint8:
        bits = max(8, int(image.max()).bit_length())
        image = (image >> (bits - 8)).astype(np.uint8)
    # Whatever its size and depth, one that is soon handled.
    height = max(1, round(image.shape[0] * SIDE / image.shape[1]))
    image = cv2.resize(image, (SIDE, height), interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image


def _picture(images: Images, scan: RangeScan | None) -> np.ndarray:
    """Left and right side by side, at the foot of the left one what its columns answered."""
    height = max([image.shape[0] for image in images if image is not None] or [SIDE * 3 // 4])
    canvas = np.full((height, 2 * SIDE + GAP, 3), 255, np.uint8)
    for image, left in zip(images, (0, SIDE + GAP), strict=True):
        place = canvas[:, left : left + SIDE]
        if image is None:
            place[:] = EMPTY
            cv2.line(place, (0, 0), (SIDE, height), (60, 60, 60), 2, cv2.LINE_AA)
            cv2.line(place, (SIDE, 0), (0, height), (60, 60, 60), 2, cv2.LINE_AA)
        else:
            place[: image.shape[0]] = image
    if scan is not None:
        # Bearings grow to the left, columns to the right.
        column = np.linspace(len(scan.range) - 1, 0, SIDE).round().astype(int)
        canvas[height - STRIP - 1, :SIDE] = OPEN
        canvas[height - STRIP :, :SIDE] = _colours(scan)[column]
    return canvas


def _colours(scan: RangeScan) -> np.ndarray:
    """(n, 3) BGR of the answers."""
    share = np.clip(np.nan_to_num(scan.range, posinf=0.0) / scan.max_range, 0.0, 1.0)[:, None]
    colours = NEAR + (FAR - NEAR) * share
    colours[np.isposinf(scan.range)] = OPEN
    colours[np.isnan(scan.range)] = UNKNOWN
    return colours.astype(np.uint8)


def scan_from_above(scan: RangeScan) -> str:
    """What a scan saw, its sensor below and looking up, as SVG."""
    reach = np.where(np.isfinite(scan.range), scan.range, np.nan)
    angle = scan.bearing
    hits = np.stack([-reach * np.sin(angle), -reach * np.cos(angle)], axis=1)
    hits = hits[~np.isnan(reach)]
    low, high = np.minimum(hits.min(axis=0, initial=0.0), -0.5), hits.max(axis=0, initial=0.5)
    margin = 0.05 * float((high - low).max())
    low, size = low - margin, high - low + 2 * margin
    dots = "".join(f"M{x:.2f} {y:.2f}h0" for x, y in hits)
    return (
        f'<svg viewBox="{low[0]:.2f} {low[1]:.2f} {size[0]:.2f} {size[1]:.2f}" class="scan" '
        f'aria-hidden="true"><path class="hits" d="{dots}"/><path class="eye" d="M0 0h0"/></svg>'
    )
