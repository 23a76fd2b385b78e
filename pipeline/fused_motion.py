"""Motion from the images and the wheels together (`--motion fused`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mapping.odometry_witness import OdometryErrors
from odometry.encoders import EncoderParameters
from odometry.fusion import GATE, Agreement, SystematicErrors, disagreement, fuse, without
from odometry.motion import Motion, compose, inverse
from odometry.poses import PoseOdometry
from odometry.source import EncoderOdometry, MotionSource
from odometry.wheel_faults import WheelFault, find_wheel_fault
from pipeline.visual_motion import COASTING, PATIENCE, UNSEEN, UNSEEN_MOST, VisualMotion
from stereo.pair import StereoPair
from stereo.tracking import Pyramids

# Against the wheels visual odometry must have so many points that agree, and this share of those
# found again: else it is the images that are wrong.
LEAST_INLIERS = 30
LEAST_SHARE = 0.5
# How far wheels and images differ, over what their covariances explain (1: they are right), is
# averaged over so many steps, each counting as at most CAP; beyond UNRELIABLE the wheels are wrong
# more often than not.
STEPS = 20
CAP = 50.0
UNRELIABLE = 10.0
FASTER = 1.5  # times the greatest speed of the wheels: no robot
# A difference that noise alone exceeds once in twenty times (chi-square, three degrees of freedom).
USUAL_DIFFERENCE = 7.8
# Wheels that went so far [m, rad] have changed the view.
FROZEN = (0.1, math.radians(10.0))
FLAT = 2.0  # grey levels: images without more contrast are all alike
# So well do images know what wheels do wrong throughout (baseline, focal length) [share, share,
# rad/m].
IMAGES = np.array([0.005, 0.005, np.radians(0.05)])


@dataclass
class Slip:
    """Wheels and images disagree, and the images are believed: from first to last stamp ns;
    error: (3,) what the wheels had too much, x m, y m, theta rad."""

    first: int
    last: int
    error: np.ndarray


class FusedMotion:
    """Both, weighed by their covariances while they agree.

    Where they do not, the images are believed if enough points agree (the wheels slip) and no more
    than `max_speed` [m/s] follows, else the wheels. Where one fails the other answers alone; images
    that can be read again after a while are held against all that was reported meanwhile. What the
    wheels do wrong throughout is learnt (`errors`) and taken off.
    """

    def __init__(self, visual: VisualMotion, wheels: MotionSource, max_speed: float) -> None:
        self.visual, self._wheels, self._max_speed = visual, wheels, max_speed
        self.errors = SystematicErrors()
        self._agreement = Agreement()
        self._excess = 1.0
        self._trusted = True  # the wheels, at the last step
        self._previous: int | None = None
        self._velocity = np.zeros(3)  # a second
        # Reported since the last answer of the wheels, and of the images.
        self._since = self._unseen = Motion.none(0)
        self._shown: Pyramids | None = None
        self._same = Motion.none(0)  # of the wheels, while the images stayed the same
        self.slips: list[Slip] = []
        self._seen: list[Motion] = []  # by the images alone
        self.counts = {
            "fused": 0,
            "wheels_alone": 0,
            "wheels_wrong": 0,
            "images_alone": 0,
            "images_doubted": 0,
            "images_frozen": 0,
            "guessed": 0,
        }

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
        if wheels is not None:
            wheels = self.errors.corrected(wheels)
        if self._frozen(pyramids, wheels):
            self.counts["images_frozen"] += 1
            pyramids = None
        images = self.visual.step(stamp, pyramids, self._expected(wheels, stamp))
        if self._previous is None:
            motion = None if wheels is None and images is None else Motion.none(stamp)
        else:
            motion = self._joined(wheels, images) or self._guessed(wheels, images, stamp)
        self._remember(stamp, motion, wheels)
        return motion

    def report(self) -> dict[str, int | float]:
        """Counts of both, and of what was made of them."""
        return {
            **self._wheels.report(),
            **self.visual.report(),
            **{f"steps_{name}": count for name, count in self.counts.items()},
            "slips": len(self.slips),
        }

    @property
    def by_ticks(self) -> bool:
        """Whether the wheels' radii and track are ours to calibrate."""
        return not isinstance(self._wheels, PoseOdometry)

    def wheel_fault(self) -> WheelFault | None:
        """A fault of recorded ticks that explains how the wheels disagree with the images."""
        if not isinstance(self._wheels, EncoderOdometry):
            return None
        return find_wheel_fault(self._wheels.ticks, self._wheels.parameters, self._seen)

    @property
    def encoders(self) -> EncoderParameters | None:
        """The wheels as stated, where ticks were recorded."""
        return self._wheels.parameters if isinstance(self._wheels, EncoderOdometry) else None

    def wheel_errors(self) -> OdometryErrors:
        """What the wheels do wrong throughout, against the images."""
        variance = self.errors.covariance.diagonal() + IMAGES**2
        return OdometryErrors(self.errors.value, np.sqrt(variance))

    def _frozen(self, pyramids: Pyramids | None, wheels: Motion | None) -> bool:
        """Whether a camera sends its last image again and again while the wheels drive on."""
        same = (
            pyramids is not None
            and self._shown is not None
            and pyramids.left[-1].std() > FLAT
            and all(map(np.array_equal, pyramids.left[::-1], self._shown.left[::-1]))
        )
        self._shown = pyramids
        if not same or wheels is None:
            self._same = Motion.none(0)
            return False
        self._same = self._same.then(wheels)
        x, y, turn = self._same.increment.tolist()
        far = math.hypot(x, y) > FROZEN[0] or abs(turn) > FROZEN[1]
        return far and disagreement(self._same, Motion.none(0)) > GATE

    def _expected(self, wheels: Motion | None, stamp: int) -> Motion | None:
        """Of the images, since they answered last; None: the wheels cannot tell."""
        if wheels is None or self._previous is None or wheels.first != self._previous:
            return None
        if not self._trusted:
            seconds = min((stamp - self._previous) / 1e9, COASTING)
            wheels = replace(wheels, increment=self._velocity * seconds)
        return self._unseen.then(wheels) if self._unseen.first != self._unseen.last else wheels

    def _joined(self, wheels: Motion | None, images: Motion | None) -> Motion | None:
        """Motion since the stamp answered before, of what tells of it."""
        begun = self._unseen
        if wheels is not None and wheels.first != self._previous:
            wheels = None
        if images is not None and images.first != (begun.first or self._previous):
            images = None
        if images is not None:
            self._seen.append(images)
        if images is None:
            if wheels is None:
                return None
            self._agreement.forget()
            self.counts["wheels_alone"] += 1
            return _scaled(wheels, max(1.0, self._excess))
        if wheels is None:
            self._agreement.forget()
            self.counts["images_alone"] += 1
            return _rest(images, begun)
        if begun.first != begun.last:
            return self._caught_up(begun, wheels, images)
        return self._weighed(wheels, images)

    def _weighed(self, wheels: Motion, images: Motion) -> Motion:
        """Of two motions over the same time."""
        likely = self.errors.uncertain(wheels)
        apart = self._agreement.step(likely, images)
        if apart is not None and not self._sure(images):
            self.counts["images_doubted"] += 1
            return wheels
        difference = disagreement(likely, images)
        self._excess += (min(difference / 3.0, CAP) - self._excess) / STEPS
        self._trusted = apart is None
        if apart is not None:
            self._slipped(apart, likely, images, difference)
            return images
        self.counts["fused"] += 1
        self.errors.learn(wheels, images)
        return fuse(_scaled(likely, max(1.0, self._excess)), images)

    def _caught_up(self, begun: Motion, wheels: Motion, images: Motion) -> Motion:
        """The rest of what the images saw from before `begun` on, held against the wheels'."""
        self._agreement.forget()
        whole = begun.then(self.errors.uncertain(wheels))
        difference = disagreement(whole, images)
        self._trusted = difference <= GATE
        if difference <= USUAL_DIFFERENCE:
            self.counts["fused"] += 1
            return without(fuse(whole, images), begun)
        # Of points seen long ago few are left, and these may agree on what is wrong: only a
        # difference that they cannot explain convicts the wheels.
        if self._trusted or not self._sure(images):
            self.counts["images_doubted"] += 1
            return wheels
        self._slipped((whole, images), whole, images, difference)
        return without(images, begun)

    def _guessed(self, wheels: Motion | None, images: Motion | None, stamp: int) -> Motion | None:
        """Motion over a time of which nobody knew the beginning."""
        assert self._previous is not None
        known = images or wheels
        if known is None or known.first <= self._previous or stamp - self._previous < PATIENCE:
            return None
        self.counts["guessed"] += 1
        seconds = (known.first - self._previous) / 1e9
        sigma = UNSEEN * min(seconds, UNSEEN_MOST)
        increment = self._velocity * min(seconds, COASTING)
        return Motion(increment, np.diag(sigma**2), self._previous, known.first).then(known)

    def _remember(self, stamp: int, motion: Motion | None, wheels: Motion | None) -> None:
        if motion is not None:
            if self._previous is not None and stamp > self._previous:
                self._velocity = motion.increment / ((stamp - self._previous) / 1e9)
            self._since = self._since.then(motion) if self._since.first else motion
            self._unseen = self._unseen.then(motion) if self._unseen.first else motion
            self._previous = stamp
        if wheels is not None:
            self._since = Motion.none(stamp)
        if self.visual.stamp in (None, stamp):
            self._unseen = Motion.none(stamp)

    def _sure(self, images: Motion) -> bool:
        """Whether the images' motion can stand against the wheels'."""
        seen, seconds = self.visual.sighting, (images.last - images.first) / 1e9
        if math.hypot(*images.increment[:2]) > FASTER * self._max_speed * seconds:
            return False
        if self._excess > UNRELIABLE:
            return True
        return (
            seen is not None
            and seen.inliers >= LEAST_INLIERS
            and seen.inliers >= LEAST_SHARE * seen.found
        )

    def _slipped(
        self, apart: tuple[Motion, Motion], wheels: Motion, images: Motion, difference: float
    ) -> None:
        """Note a step in which the images are used, as the wheels are wrong in it or just were."""
        self.counts["wheels_wrong"] += 1
        slip = self.slips[-1] if self.slips else None
        if slip is None or apart[0].first > slip.last:
            self.slips.append(Slip(apart[0].first, wheels.last, _error(*apart)))
        elif difference > USUAL_DIFFERENCE:
            slip.last, slip.error = wheels.last, slip.error + _error(wheels, images)


def _rest(whole: Motion, begun: Motion) -> Motion:
    return whole if begun.first == begun.last else without(whole, begun)


def _scaled(motion: Motion, factor: float) -> Motion:
    return replace(motion, covariance=factor * motion.covariance)


def _error(wheels: Motion, images: Motion) -> np.ndarray:
    return compose(inverse(images.increment), wheels.increment)
