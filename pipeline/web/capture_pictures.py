"""What the page of a capture shows of pairs and boards: places are shares of the image's size."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.board import Board
from calibration.sighting import Sighting
from pipeline.board_ghost import Ghost, printed
from pipeline.web.encoding import camera_jpeg, jpeg
from stereo.camera import CapturedPair

THUMBNAIL = 160  # px

Size = tuple[int, int]  # (width, height) px


def both_images(pair: CapturedPair) -> list[bytes] | None:
    """The images as JPEG, one that shows both side by side alone; None: one is damaged."""
    frames = [frame for frame in (pair.left, pair.right) if frame is not None]
    images = [image for frame in frames if (image := camera_jpeg(frame.data)) is not None]
    return images if len(images) == len(frames) else None


def corners_of(seen: Sighting | None, size: Size | None) -> bytes:
    """Corners (n, 2) float32 of a board in an image; none where there is none."""
    if seen is None or size is None:
        return b""
    return _shares(seen.corners, size).astype(np.float32).tobytes()


def outline_of(seen: Sighting | None, board: Board, size: Size) -> list[list[float]] | None:
    """Where the four corners of what is printed lie in an image."""
    if seen is None:
        return None
    H, _ = cv2.findHomography(board.points[seen.ids, :2], seen.corners)
    if H is None:
        return None
    corners, _lines = printed(board)
    return _rounded(cv2.perspectiveTransform(corners[None, :, :2], H)[0], size)


def as_values(ghost: Ghost | None, size: Size) -> dict[str, Any] | None:
    """A ghost as the page draws it."""
    if ghost is None:
        return None
    return {
        "place": ghost.wish.place,
        "edge": ghost.wish.edge,
        "words": ghost.wish.words,
        "outline": _rounded(ghost.outline, size),
        "lines": _rounded(ghost.lines, size),
    }


def thumbnails(folder: Path, first: int, last: int) -> Iterator[bytes]:
    """Of the images in a folder whose names are the numbers from `first` to `last`."""
    for number in range(first, last + 1):
        (file,) = folder.glob(f"{number:03d}.*")
        data = np.frombuffer(file.read_bytes(), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_REDUCED_COLOR_2)
        yield b"" if image is None else jpeg(image, THUMBNAIL)


def _shares(places: np.ndarray, size: Size) -> np.ndarray:
    """Pixels (..., 2), whose centres are at integers, as shares of the image's size."""
    return (places + 0.5) / size


def _rounded(places: np.ndarray, size: Size) -> Any:
    return np.round(_shares(places, size), 4).tolist()
