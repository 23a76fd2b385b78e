"""Videos as recordings: one that shows both images side by side, or left.* and right.*.

Frame n was taken n frame periods after the first: a video's own frame rate is used unless
another one is given. What else belongs to a recording comes from files named beside it (`--rig`,
`--ticks`).
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.recordings.base import DamagedFrameError, RecordedPair, Recording
from stereo.camera import halves
from stereo.pair import StereoPair

LOOKED_FOR = "left.* and right.* videos"
ENDINGS = {".avi", ".mp4", ".mkv", ".mov", ".webm", ".mpg", ".mpeg", ".m4v", ".mjpg", ".mjpeg"}
# Frames kept after they were passed: threads do not ask strictly in order.
KEPT = 16


def is_video(path: Path) -> bool:
    """Whether the name is that of a video."""
    return path.suffix.lower() in ENDINGS


def recognises(path: Path) -> bool:
    """Whether the folder holds a left and a right video."""
    return all(_videos(path, side) for side in ("left", "right"))


def read(path: Path, fps: float | None = None) -> Recording:
    """Open a side-by-side video, or the folder of a left and a right one.

    Raises:
        InputError: no video, no frame rate, several videos of one side.
    """
    files = [path] if path.is_file() else [_only(path, side) for side in ("left", "right")]
    videos = [Video(file) for file in files]
    rate = fps or videos[0].rate
    if not rate:
        raise InputError(f"{files[0]}: does not tell its frame rate: give --fps")
    count = min(video.frames for video in videos)
    if not count:
        raise InputError(f"{files[0]}: holds no frame that can be read")
    kind = "side-by-side video" if len(files) == 1 else "left and right video"
    pairs: list[RecordedPair] = [
        VideoPair(round(n * 1e9 / rate), n, tuple(videos)) for n in range(count)
    ]
    recording = Recording(path, kind, pairs)
    for video in videos:
        surplus = range(count, video.frames)
        recording.skip("frame beyond the end of the other video", map(str, surplus))
    return recording


class Video:
    """Frames of a video file by number; decoded once as long as they are asked for in order.

    May be asked from several threads.
    """

    def __init__(self, path: Path) -> None:
        import cv2

        self.path = path
        self._lock = threading.Lock()
        self._capture = self._opened()
        self.rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.frames = max(0, int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        self._next = 0
        self._kept: OrderedDict[int, np.ndarray | None] = OrderedDict()

    def frame(self, number: int) -> np.ndarray:
        """uint8 (H, W, 3). Raises DamagedFrameError where there is none."""
        with self._lock:
            if number not in self._kept:
                self._decode_to(number)
            image = self._kept.get(number)
        if image is None:
            raise DamagedFrameError(f"{self.path}: frame {number} cannot be read")
        return image

    def _decode_to(self, number: int) -> None:
        if number < self._next:
            # Seeking is exact in few formats: begin again.
            self._capture.release()
            self._capture, self._next = self._opened(), 0
            self._kept.clear()
        while self._next <= number:
            good = self._capture.grab()
            if self._next > number - KEPT:
                image = self._capture.retrieve()[1] if good else None
                self._kept[self._next] = image
                if len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            self._next += 1

    def _opened(self):
        import cv2

        capture = cv2.VideoCapture(str(self.path))
        if not capture.isOpened():
            raise InputError(f"{self.path}: not a video that can be read")
        return capture


@dataclass(frozen=True, eq=False)
class VideoPair:
    """A pair of frames; of one video: its halves."""

    stamp: int
    number: int
    videos: tuple[Video, ...]

    @property
    def name(self) -> str:
        """The frame's number."""
        return f"frame{self.number:06d}"

    def where(self, right: bool) -> str:
        """The video and the frame."""
        return f"{self.videos[-1 if right else 0].path} frame {self.number}"

    @property
    def files(self) -> tuple[Path, ...]:
        """None: no file holds this pair alone."""
        return ()

    def load_left(self) -> np.ndarray:
        """The left image."""
        return self.load().left

    def load(self) -> StereoPair:
        """Decode the frames. Raises DamagedFrameError."""
        images = [video.frame(self.number) for video in self.videos]
        return StereoPair(self.stamp, *(images if len(images) == 2 else halves(images[0])))


def _videos(path: Path, side: str) -> list[Path]:
    return sorted(f for f in path.glob("*") if f.stem.lower() == side and is_video(f))


def _only(path: Path, side: str) -> Path:
    files = _videos(path, side)
    if len(files) > 1:
        raise InputError(f"{path}: {files[0].name} and {files[1].name}: leave one {side} video")
    return files[0]
