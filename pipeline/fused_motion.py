"""Motion from the images and the wheels together (`--motion fused`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from odometry.fusion import WINDOW, Agreement, fuse, without
from odometry.motion import Motion, compose, inverse
from odometry.source import MotionSource
from pipeline.visual_motion import VisualMotion
from stereo.pair import StereoPair
from stereo.tracking import Pyramids

# Against the wheels visual odometry must have so many points that agree, and this share of those
# found again: else it is the images that are wrong.
LEAST_INLIERS = 30
LEAST_SHARE = 0.5


@dataclass
class Slip:
    """Wheels and images disagree, and the images are believed: from first to last stamp ns;
    error: (3,) what the wheels had too much, x m, y m, theta rad."""

    first: int
    last: int
    error: np.ndarray


class FusedMotion:
    """Both, weighed by their covariances while they agree.

    Where they do not, the images are believed if enough points agree (the wheels slip), else the
    wheels. Where one is silent the other answers alone.
    """

    def __init__(self, visual: VisualMotion, wheels: MotionSource) -> None:
        self.visual, self._wheels = visual, wheels
        self._agreement = Agreement()
        self._previous: int | None = None
        self._since = Motion.none(0)  # reported since the wheels' last answer
        self.slips: list[Slip] = []
        self._counts = {"fused": 0, "wheels_alone": 0, "images_alone": 0, "images_doubted": 0}

    def prepare(self, pair: StereoPair) -> Pyramids:
        """As of `VisualMotion`."""
        return self.visual.prepare(pair)

    def step(self, stamp: int, pyramids: Pyramids | None) -> Motion | None:
        """Motion since the stamp answered before; the first answer is no motion.

        None: neither knows; the next answer then spans it.
        """
        wheels = self._wheels.until(stamp)
        if wheels is not None and self._since.first != self._since.last:
            wheels = without(wheels, self._since)
        images = self.visual.step(stamp, pyramids, wheels)
        if self._previous is None:
            if wheels is None and images is None:
                return None
            motion = Motion.none(stamp)
        else:
            # What began at another stamp than the last that was answered is of no use.
            wheels, images = (
                one if one is not None and one.first == self._previous else None
                for one in (wheels, images)
            )
            motion = self._joined(wheels, images)
        if motion is None:
            return None
        if wheels is not None or self._previous is None:
            self._since = Motion.none(stamp)
        else:
            self._since = self._since.then(motion)
        self._previous = stamp
        return motion

    def report(self) -> dict[str, int | float]:
        """Counts of both, and of what was made of them."""
        return {
            **self._wheels.report(),
            **self.visual.report(),
            **{f"steps_{name}": count for name, count in self._counts.items()},
            "slips": len(self.slips),
        }

    def _joined(self, wheels: Motion | None, images: Motion | None) -> Motion | None:
        if wheels is None or images is None:
            self._agreement.forget()
            if wheels is not None or images is not None:
                self._counts["wheels_alone" if images is None else "images_alone"] += 1
            return images if wheels is None else wheels
        apart = self._agreement.step(wheels, images)
        if apart is None:
            self._counts["fused"] += 1
            return fuse(wheels, images)
        if self._sure():
            self._slipped(*apart)
            self._counts["images_alone"] += 1
            return images
        self._counts["images_doubted"] += 1
        return wheels

    def _sure(self) -> bool:
        """Whether the images' motion can stand against the wheels'."""
        seen = self.visual.sighting
        return (
            seen is not None
            and seen.inliers >= LEAST_INLIERS
            and seen.inliers >= LEAST_SHARE * seen.found
        )

    def _slipped(self, wheels: Motion, images: Motion) -> None:
        error = compose(inverse(images.increment), wheels.increment)
        if self.slips and wheels.first - self.slips[-1].last < WINDOW:
            slip = self.slips[-1]
            slip.last, slip.error = wheels.last, slip.error + error
        else:
            self.slips.append(Slip(wheels.first, wheels.last, error))
