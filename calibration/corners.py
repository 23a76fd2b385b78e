"""What image files show of a board: several at a time, and each only once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2

from calibration.board import Board
from calibration.detection import detect
from calibration.detections_cache import cache_file, load_detection, save_detection
from calibration.imagesource import ImageSource
from calibration.sighting import Sighting


@dataclass(frozen=True, eq=False)
class BoardImage:
    """What one image shows.

    size: (width, height) px; None when the image cannot be read.
    sighting: the corners found; None when there is no board, or too little of it.
    blur: standard deviation of the blur of edges near the corners [px], about 0.8 for a perfectly
        sharp image; None without a sighting.
    half: of a side-by-side file, "left" or "right"; None: `path` is this one image.
    missing: what was looked for in vain, as in "no whole board"; None with a sighting.
    """

    path: Path
    size: tuple[int, int] | None = None
    sighting: Sighting | None = None
    blur: float | None = None
    half: str | None = None
    missing: str | None = None

    @property
    def name(self) -> str:
        """The image as a message names it."""
        return ImageSource(self.path, self.half).name

    @property
    def reason(self) -> str | None:
        """Why the image is of no use, or None."""
        if self.size is None:
            return f"{self.name} cannot be read"
        if self.sighting is None:
            return f"{self.missing or 'no board'} in {self.name}"
        return None


def look_at_all(
    sources: Sequence[Path | ImageSource],
    board: Board,
    cache_folder: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> list[BoardImage]:
    """`look` at every image, `workers` at a time (None: one a core); results in the order given.

    Args:
        progress: called with (done, total) after every image.
    """
    seen: list[BoardImage] = []
    cores = os.cpu_count() or 1
    with _one_opencv_thread(), ThreadPoolExecutor(workers or cores) as pool:
        for image in pool.map(lambda source: look(source, board, cache_folder), sources):
            seen.append(image)
            if progress:
                progress(len(seen), len(sources))
    return seen


def look(source: Path | ImageSource, board: Board, cache_folder: Path | None = None) -> BoardImage:
    """Read an image and find the board in it.

    Args:
        cache_folder: where what is found is kept (see `detections_cache`); an image found there
            is not even decoded. None: nowhere.
    """
    source = source if isinstance(source, ImageSource) else ImageSource(source)
    try:
        data = source.path.read_bytes()
    except OSError:
        return BoardImage(source.path, half=source.half)
    file = cache_file(cache_folder, data, source.half, board) if cache_folder else None
    found = load_detection(file, board) if file else None
    if found is None:
        image = source.decode(data)
        if image is None:
            return BoardImage(source.path, half=source.half)
        found = detect(image, board)
        if file:
            save_detection(file, found)
    return BoardImage(
        source.path, found.size, found.sighting, found.blur, source.half, found.missing
    )


@contextmanager
def _one_opencv_thread() -> Iterator[None]:
    """The images are shared out over threads already."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
