"""PoseOdometry: known poses taken as odometry, with noise where they are too good to be so."""

from __future__ import annotations

import math

import numpy as np

from odometry.errors import OdometryError
from odometry.motion import Motion, compose, inverse, wrap_angle
from odometry.settings import OdometrySettings

# Poses are taken to answer this far beyond the first and the last of them.
TOLERANCE_NS = 1_000_000

# Doubt of poses without noise, as a random walk: 5 mm and 0.1 deg after one metre. Without it
# a filter's particles would all be one.
FLOOR_M = 0.005
FLOOR_RAD = math.radians(0.1)

# Tells this use of a run's seed from the others.
_NOISE_STREAM = 0x0D0


class PoseOdometry:
    """Poses as a `MotionSource`: increments between poses interpolated at the asked stamps.

    With `settings.noise` = [fraction, deg] and `settings.bias` each step gets an error of
    standard deviation fraction x length in x and in y, and in heading of `bias` plus deg. The
    stated covariance is that noise and a small floor; it does not know of the bias. The error
    of a step depends on the seed and the step's number alone.

    Args:
        stamps: (n,) int64 ns; poses: (n, 3) x m, y m, theta rad. Poses that are not finite or
            repeat a stamp are left out and counted.

    Raises:
        OdometryError: no pose is usable.
    """

    def __init__(
        self, stamps: np.ndarray, poses: np.ndarray, settings: OdometrySettings, seed: int
    ) -> None:
        stamps, poses = np.asarray(stamps, np.int64), np.asarray(poses, float)
        finite = np.isfinite(poses).all(axis=1)
        self._stamps, first = np.unique(stamps[finite], return_index=True)
        self._poses = poses[finite][first]
        self._skipped = len(stamps) - len(self._stamps)
        if not len(self._stamps):
            raise OdometryError(
                f"poses as odometry: none of {len(stamps)} poses is usable; "
                "choose another --motion or give poses with finite numbers"
            )
        self._settings = settings
        self._seed = seed
        self._previous: tuple[int, np.ndarray] | None = None
        self._steps = 0
        self._unanswered = 0

    def until(self, stamp: int) -> Motion | None:
        """Motion since the stamp answered before; None where no pose tells."""
        pose = self._at(stamp)
        if pose is None or (self._previous is not None and stamp < self._previous[0]):
            self._unanswered += 1
            return None
        previous, self._previous = self._previous, (stamp, pose)
        if previous is None:
            return Motion.none(stamp)
        self._steps += 1
        return self._step(compose(inverse(previous[1]), pose), previous[0], stamp)

    def report(self) -> dict[str, int | float]:
        """Poses used, poses left out, and stamps that got no answer."""
        return {
            "poses": len(self._stamps),
            "poses_skipped": self._skipped,
            "pairs_without_motion": self._unanswered,
        }

    def _at(self, stamp: int) -> np.ndarray | None:
        """Pose (3,) at a stamp: straight between its neighbours, the shorter way round."""
        first, last = int(self._stamps[0]), int(self._stamps[-1])
        if not first - TOLERANCE_NS <= stamp <= last + TOLERANCE_NS:
            return None
        stamp = min(max(stamp, first), last)
        after = int(np.searchsorted(self._stamps, stamp))
        if self._stamps[after] == stamp:
            return self._poses[after]
        t0, t1 = int(self._stamps[after - 1]), int(self._stamps[after])
        step = self._poses[after] - self._poses[after - 1]
        step[2] = wrap_angle(step[2])
        return self._poses[after - 1] + step * ((stamp - t0) / (t1 - t0))

    def _step(self, increment: np.ndarray, first: int, last: int) -> Motion:
        """The motion of one increment: here, spoiled by noise."""
        distance = float(np.hypot(increment[0], increment[1]))
        fraction, degrees = self._settings.noise
        sigma = np.array([fraction * distance, fraction * distance, math.radians(degrees)])
        rng = np.random.default_rng([self._seed, _NOISE_STREAM, self._steps])
        increment = increment + sigma * rng.standard_normal(3)
        increment[2] = wrap_angle(increment[2] + math.radians(self._settings.bias))
        floor = np.array([FLOOR_M, FLOOR_M, FLOOR_RAD]) ** 2 * distance
        return Motion(increment, np.diag(sigma**2 + floor), first, last)
