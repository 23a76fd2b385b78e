"""Pairs with the motion that leads to each: from a source that knows it already, or by looking.

A source that looks (`--motion visual`, `--motion fused`) needs every pair, so all are decoded,
once, in threads ahead of it; those that are due as observations are passed on as they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2

from odometry.motion import Motion
from odometry.source import MotionSource
from pipeline.frontend import IMAGE_ERRORS, ahead, damage_of
from pipeline.fused_motion import FusedMotion
from pipeline.recordings.base import DamagedFrameError, Pair
from pipeline.visual_motion import VisualMotion
from stereo.pair import StereoPair
from stereo.tracking import Pyramids

# One that is asked for a stamp, or one that is shown the pair.
AnyMotion = MotionSource | VisualMotion | FusedMotion


@dataclass(frozen=True)
class LoadedPair:
    """A pair in memory, or the reason why there is none; source: where it came from."""

    source: Pair
    pair: StereoPair | None
    damage: str = ""

    @property
    def stamp(self) -> int:
        """Of the left image [ns]."""
        return self.source.stamp

    @property
    def name(self) -> str:
        """What the pair is called in messages."""
        return self.source.name

    def where(self, right: bool) -> str:
        """Where the left or right image came from."""
        return self.source.where(right)

    def load(self) -> StereoPair:
        """The pair. Raises DamagedFrameError: it could not be read."""
        if self.pair is None:
            raise DamagedFrameError(self.damage)
        return self.pair


def moved(
    pairs: Iterable[Pair], motion: AnyMotion, threads: int
) -> Iterator[tuple[Pair, Motion | None]]:
    """Each pair with the motion since the last one that has any."""
    if not isinstance(motion, VisualMotion | FusedMotion):
        for pair in pairs:
            yield pair, motion.until(pair.stamp)
        return
    for _, (loaded, pyramids) in ahead(pairs, lambda pair: _look(pair, motion), threads):
        try:
            step = motion.step(loaded.stamp, pyramids)
        except cv2.error as error:
            loaded = LoadedPair(loaded.source, None, damage_of(loaded, error))
            step = motion.step(loaded.stamp, None)
        yield loaded, step


def move(pair: Pair, motion: AnyMotion) -> tuple[Pair, Motion | None]:
    """As `moved`, of a pair that has come just now."""
    return next(moved([pair], motion, threads=1))


def _look(pair: Pair, motion: VisualMotion | FusedMotion) -> tuple[LoadedPair, Pyramids | None]:
    try:
        loaded = pair.load()
        return LoadedPair(pair, loaded), motion.prepare(loaded)
    except IMAGE_ERRORS as error:
        return LoadedPair(pair, None, damage_of(pair, error)), None
