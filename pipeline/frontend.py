"""The front end of a run: images read and matched ahead of the mapper, in threads."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

from pipeline.errors import one_line
from pipeline.recordings.base import DamagedFrameError, Pair
from stereo.errors import StereoError
from stereo.pair import StereoPair
from stereo.pair_check import RIGHT_COVERED, check_pair
from stereo.ranger import StereoFrame, StereoRanger
from stereo.scan import RangeScan

UNREADABLE = "unreadable pair"
# What one image may do to whoever looks at it: it is left out, counted and named, and the others
# go on. OpenCV throws on some images that are whole.
IMAGE_ERRORS = (DamagedFrameError, StereoError, cv2.error)

T = TypeVar("T")
U = TypeVar("U")


@dataclass(frozen=True)
class Observation:
    """What one pair yields: a scan, or the reason why it yields nothing.

    kind: of what is wrong, damage: with whose names; brightness: mean of the left image over that
    of the right one; points (n, 3) m on the robot and colours (n, 3) uint8 RGB: of key frames;
    pair, frame: raw images and what stereo made of them, where somebody watches.
    """

    scan: RangeScan | None
    kind: str = ""
    damage: str = ""
    brightness: float = 1.0
    points: np.ndarray | None = None
    colours: np.ndarray | None = None
    pair: StereoPair | None = None
    frame: StereoFrame | None = None
    seconds_reading: float = 0.0
    seconds_stereo: float = 0.0


def observe(files: Pair, ranger: StereoRanger, key_frame: bool, keep: bool = False) -> Observation:
    """Read and range one pair; one that is no use becomes a reason, never an exception.

    keep: the images and what stereo made of them come along.
    """
    start = time.perf_counter()
    try:
        pair = files.load()
        read = time.perf_counter()
        check = check_pair(pair.left, pair.right)
        if check.defect:
            name = files.where(right=check.defect == RIGHT_COVERED)
            return Observation(None, check.defect, name, seconds_reading=read - start)
        frame = ranger.frame(pair)
        points, colours = ranger.points(frame, pair.left) if key_frame else (None, None)
    except IMAGE_ERRORS as error:
        taken = time.perf_counter() - start
        return Observation(None, UNREADABLE, damage_of(files, error), seconds_reading=taken)
    return Observation(
        frame.scan,
        brightness=check.brightness,
        points=points,
        colours=colours,
        pair=pair if keep else None,
        frame=frame if keep else None,
        seconds_reading=read - start,
        seconds_stereo=time.perf_counter() - read,
    )


def damage_of(files: Pair, error: Exception) -> str:
    """What is wrong with a pair, in one line; OpenCV's errors name no file."""
    text = one_line(str(error))
    return f"{files.where(right=False)}: {text}" if isinstance(error, cv2.error) else text


def ahead(items: Iterable[T], work: Callable[[T], U], threads: int) -> Iterator[tuple[T, U]]:
    """Each item with `work(item)`, in order, computed up to two items a thread ahead.

    With one thread everything happens in the caller's. When the caller leaves early, work not
    yet begun is dropped.
    """
    if threads <= 1:
        for item in items:
            yield item, work(item)
        return
    pool = ThreadPoolExecutor(threads, thread_name_prefix="stereo")
    waiting: deque[tuple[T, Future[U]]] = deque()
    try:
        for item in items:
            waiting.append((item, pool.submit(work, item)))
            if len(waiting) > 2 * threads:
                first, future = waiting.popleft()
                yield first, future.result()
        while waiting:
            first, future = waiting.popleft()
            yield first, future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
