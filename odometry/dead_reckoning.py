"""DeadReckoning: the robot's own odometry, kept as poses, as a `MotionSource`.

Others keep what the wheels told as poses that drift (ROS: nav_msgs/Odometry). Their increments
are doubted as the encoders' arcs are (`walk.step_covariances`). Where the poses leap, because the
board began anew, the robot is taken as standing still, with much doubt.
"""

from __future__ import annotations

import numpy as np

from odometry.motion import Motion, compose, inverse
from odometry.poses import PoseOdometry
from odometry.settings import OdometrySettings
from odometry.walk import AFTER_LEAP, step_covariances

# No robot is so much faster than `settings.max_speed`: it is a leap.
MARGIN = 1.5
# Stamps are not so good that a step could be judged by less time than this [s].
LEAST_TIME = 0.1


class DeadReckoning(PoseOdometry):
    """Increments between odometry poses interpolated at the asked stamps.

    Args:
        stamps: (n,) int64 ns; poses: (n, 3) x m, y m, theta rad. Poses that are not finite or
            repeat a stamp are left out and counted.

    Raises:
        OdometryError: no pose is usable.
    """

    def __init__(self, stamps: np.ndarray, poses: np.ndarray, settings: OdometrySettings) -> None:
        super().__init__(stamps, poses, settings, seed=0)
        seconds = np.maximum(np.diff(self._stamps) / 1e9, LEAST_TIME)
        steps = compose(inverse(self._poses[:-1]), self._poses[1:])
        leaps = np.hypot(steps[:, 0], steps[:, 1]) > MARGIN * settings.max_speed * seconds
        self._leaps = self._stamps[1:][leaps]
        if leaps.any():
            steps[leaps] = 0.0
            self._poses = _chained(self._poses[0], steps)

    def report(self) -> dict[str, int | float]:
        """As of `PoseOdometry`, and how often the poses leapt."""
        return {**super().report(), "poses_leaps": len(self._leaps)}

    def _step(self, increment: np.ndarray, first: int, last: int) -> Motion:
        covariance = step_covariances(increment[None], self._settings)[0]
        leaps = int(((first < self._leaps) & (self._leaps <= last)).sum())
        return Motion(increment, covariance + leaps * np.diag(AFTER_LEAP**2), first, last)


def _chained(start: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Poses (n, 3) that begin at `start` (3,) and take the steps (n - 1, 3)."""
    poses = [start]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)
