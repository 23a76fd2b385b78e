"""Recording: what every format is turned into, and what all formats share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pipeline.errors import InputError
from pipeline.trajectory import Trajectory
from stereo.encoded import TAIL, decode_image, is_cut_short

if TYPE_CHECKING:
    from calibration.rig import StereoRig
    from odometry.encoders import EncoderParameters
    from odometry.tick_log import TickLog
    from stereo.pair import StereoPair

# Left and right images belong together when their stamps differ by no more than this [ns].
PAIR_TOLERANCE = 10_000_000

# Reasons in `Recording.skipped` that a later stage asks for.
BROKEN_RIG = "rig that cannot be used"
BROKEN_TICKS = "wheel ticks that cannot be used"

IMAGE_ENDINGS = {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp"}


class DamagedFrameError(ValueError):
    """An image that cannot be read; the pair is skipped, counted and named."""


class Pair(Protocol):
    """One stereo pair, wherever it lies; stamp of the left image [ns]."""

    @property
    def stamp(self) -> int: ...

    @property
    def name(self) -> str:
        """What the pair is called in messages."""
        ...

    def where(self, right: bool) -> str:
        """The file of the left or right image, or what tells it from others."""
        ...

    def load(self) -> StereoPair:
        """Decode both images.

        Raises DamagedFrameError or StereoError.
        """
        ...


class RecordedPair(Pair, Protocol):
    """A pair in a recording."""

    @property
    def files(self) -> tuple[Path, ...]:
        """The image files that hold this pair and no other."""
        ...

    def load_left(self) -> np.ndarray:
        """Decode the left image. Raises DamagedFrameError."""
        ...


@dataclass(frozen=True)
class PairFiles:
    """A pair in two image files."""

    stamp: int
    left: Path
    right: Path

    @property
    def name(self) -> str:
        """The left file's, without its ending."""
        return self.left.stem

    def where(self, right: bool) -> str:
        """The file."""
        return str(self.right if right else self.left)

    @property
    def files(self) -> tuple[Path, ...]:
        """Left, right."""
        return self.left, self.right

    def load_left(self) -> np.ndarray:
        """The left image."""
        return read_image(self.left)

    def load(self) -> StereoPair:
        """Decode both images.

        Raises DamagedFrameError naming the file.
        """
        from stereo.pair import StereoPair

        return StereoPair(self.stamp, read_image(self.left), read_image(self.right))


@dataclass(frozen=True)
class HalvedPair:
    """A pair side by side in one image file."""

    stamp: int
    file: Path

    @property
    def name(self) -> str:
        """The file's, without its ending."""
        return self.file.stem

    def where(self, right: bool) -> str:
        """The file and the half."""
        return f"{self.file} ({'right' if right else 'left'} half)"

    @property
    def files(self) -> tuple[Path, ...]:
        """The one file."""
        return (self.file,)

    def load_left(self) -> np.ndarray:
        """The left half."""
        return self.load().left

    def load(self) -> StereoPair:
        """Decode and split the image.

        Raises DamagedFrameError naming the file.
        """
        from stereo.camera import halves
        from stereo.pair import StereoPair

        return StereoPair(self.stamp, *halves(read_image(self.file)))


@dataclass(frozen=True)
class ShiftedPair:
    """The left image of one pair with the right image of another."""

    first: RecordedPair
    second: RecordedPair

    @property
    def stamp(self) -> int:
        """Of the left image [ns]."""
        return self.first.stamp

    @property
    def name(self) -> str:
        """The left image's."""
        return self.first.name

    def where(self, right: bool) -> str:
        """As of the pair that the image comes from."""
        return (self.second if right else self.first).where(right)

    @property
    def files(self) -> tuple[Path, ...]:
        """None: every file holds a part of another pair, too."""
        return ()

    def load_left(self) -> np.ndarray:
        """The left image."""
        return self.first.load_left()

    def load(self) -> StereoPair:
        """Both images. Raises DamagedFrameError."""
        from stereo.pair import StereoPair

        return StereoPair(self.stamp, self.load_left(), self.second.load().right)


@dataclass
class Recording:
    """A recording opened: lists and small tables, no images.

    odometry: dead reckoning that was kept as poses; poses: the truth, or nearly so. cell: side of
    the cells of the map that was made while it was recorded [m].
    skipped: names of frames or lines that were passed over, by reason.
    """

    path: Path
    kind: str
    pairs: Sequence[RecordedPair]
    rig: StereoRig | None = None
    rig_source: str = ""
    ticks: TickLog | None = None
    encoders: EncoderParameters | None = None
    odometry: Trajectory | None = None
    poses: Trajectory | None = None
    poses_source: str = ""
    cell: float | None = None
    skipped: dict[str, list[str]] = field(default_factory=dict)

    def shift_right(self, frames: int) -> None:
        """Pair every left image with the right image so many pairs later.

        Raises:
            InputError: no pair would be left.
        """
        if frames == 0:
            return
        first, count = max(0, -frames), len(self.pairs) - abs(frames)
        if count < 1:
            raise InputError(
                f"--right-late {frames}: {self.path} holds only {len(self.pairs)} pairs"
            )
        self.pairs = [
            ShiftedPair(self.pairs[n], self.pairs[n + frames]) for n in range(first, first + count)
        ]

    def skip(self, reason: str, names: Iterable[str]) -> None:
        """Count and name what was passed over."""
        names = list(names)
        if names:
            self.skipped.setdefault(reason, []).extend(names)


def read_image(path: Path) -> np.ndarray:
    """Decode an image: uint8 (H, W), or (H, W, 3) BGR when it is in colour.

    Raises DamagedFrameError when the file is missing, cut short or no image.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DamagedFrameError(f"{path}: {error.strerror or error}") from None
    image = decode_image(data)
    if isinstance(image, str):
        raise DamagedFrameError(f"{path}: {image}")
    return image


def looks_damaged(path: Path) -> bool:
    """Whether an image is empty, cut short or gone, without decoding it."""
    try:
        with path.open("rb") as file:
            head = file.read(8)
            file.seek(max(0, path.stat().st_size - TAIL))
            return not head or is_cut_short(head, file.read())
    except OSError:
        return True


def match_pairs(
    left: list[tuple[int, Path]], right: list[tuple[int, Path]], recording: Recording
) -> list[PairFiles]:
    """Pairs of images whose stamps differ by at most PAIR_TOLERANCE, each image used once.

    Images without a partner are counted and named in `recording`.
    """
    left, right = sorted(left), sorted(right)
    pairs, lonely_left, lonely_right = [], [], []
    i = j = 0
    while i < len(left) and j < len(right):
        difference = left[i][0] - right[j][0]
        # Above 100 pairs a second the tolerance spans several frames: the nearest one counts.
        if i + 1 < len(left) and abs(left[i + 1][0] - right[j][0]) < abs(difference):
            lonely_left.append(left[i][1].name)
            i += 1
        elif j + 1 < len(right) and abs(left[i][0] - right[j + 1][0]) < abs(difference):
            lonely_right.append(right[j][1].name)
            j += 1
        elif abs(difference) <= PAIR_TOLERANCE:
            pairs.append(PairFiles(left[i][0], left[i][1], right[j][1]))
            i, j = i + 1, j + 1
        elif difference < 0:
            lonely_left.append(left[i][1].name)
            i += 1
        else:
            lonely_right.append(right[j][1].name)
            j += 1
    lonely_left += [path.name for _, path in left[i:]]
    lonely_right += [path.name for _, path in right[j:]]
    recording.skip("left image without a right one", lonely_left)
    recording.skip("right image without a left one", lonely_right)
    if not pairs:
        raise InputError(
            f"{recording.path}: none of {len(left)} left and {len(right)} right images belong "
            f"together within {PAIR_TOLERANCE / 1e6:.0f} ms: check the stamps of both cameras"
        )
    return pairs


def counted(names: list[str]) -> str:
    """How many, and the first of them, as in `5 (a.png, b.png, c.png and 2 more)`."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{len(names)} ({', '.join(names[:3])}{more})"


def image_size(pairs: Sequence[RecordedPair]) -> tuple[int, int] | None:
    """(width, height) of the first left image that can be read."""
    for pair in pairs:
        try:
            height, width = pair.load_left().shape[:2]
        except DamagedFrameError:
            continue
        return width, height
    return None
