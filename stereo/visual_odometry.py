"""VisualOdometry: pair after pair, where the robot stands in its frame at the last key frame.

Poses refer to a key frame, not to the pair before: a robot that stands still, however long, does
not drift. A pair becomes the next key frame when too few points of the last one are left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stereo.pose import NOISE, Offset, Pose, View, find_pose
from stereo.tracking import KeyFrame, Pyramids

# A key frame with fewer points does not carry, and fewer points that agree are no pose.
LEAST_POINTS = 20
LEAST_INLIERS = 12
LEAST_SHARE = 0.3  # of the points found again
# A key frame is renewed when fewer than this share of its points agree; when hardly any do, the
# guess may have been wrong, and whole neighbourhoods are compared.
RENEW = 0.5
RELOCATE = 0.25
# Something large that moves by itself must show so many more points than what the guess explains.
HEAD_START = 1.5
# Cameras get warm: disparities shift by so much from key frame to key frame [px].
WANDER = 1e-3
# Parts of the image, in either direction, of which each has its own error of rectification; points
# that one must have.
CELLS = 4
MIN_IN_CELL = 5


class RowErrors:
    """How well the calibration rectifies, from how much rows differ between the images.

    Rows differ by noise and by what the calibration leaves, which is the same for all that is seen
    in one part of the image, pair after pair.
    """

    def __init__(self, size: tuple[float, float]) -> None:
        self._size = size
        self._sums = np.zeros((3, CELLS * CELLS))  # of ones, errors and their squares

    def add(self, pixels: np.ndarray, errors: np.ndarray) -> None:
        """Count points at pixels (n, 3) whose rows differ by errors (n,) px."""
        column, row = (
            np.clip(CELLS * pixels[:, k] / self._size[k], 0, CELLS - 1).astype(int) for k in (0, 1)
        )
        for total, part in zip(self._sums, (np.ones(len(errors)), errors, errors**2), strict=True):
            np.add.at(total, row * CELLS + column, part)

    @property
    def size(self) -> float:
        """Root mean square over the image of what is no noise [px]."""
        n, first, second = self._sums[:, self._sums[0] >= MIN_IN_CELL]
        if not n.any():
            return 0.0
        mean = first / n
        return math.sqrt(max(0.0, float(np.mean(mean**2 - (second / n - mean**2) / (n - 1.0)))))


@dataclass(frozen=True)
class Sighting:
    """What one pair told.

    pose: in the robot's frame at the key frame followed, None where it is lost;
    found: points found again; renewed: this pair is the next key frame.
    """

    pose: Pose | None
    found: int
    renewed: bool

    @property
    def inliers(self) -> int:
        """Points that agree on the pose."""
        return 0 if self.pose is None else int(self.pose.inliers.sum())


class VisualOdometry:
    """Follows a camera pair; asked once for every pair, in order."""

    def __init__(self, view: View, seed: int = 0) -> None:
        self.view = view
        self._seed = seed
        self._key: KeyFrame | None = None
        self._pose = (np.eye(3), np.zeros(3))
        self._count = 0
        self.offset = Offset()
        self.row_errors = RowErrors((2.0 * view.lens[1], 2.0 * view.lens[2]))

    @property
    def following(self) -> bool:
        """Whether there is a key frame."""
        return self._key is not None

    def start(self, pyramids: Pyramids) -> bool:
        """Make the pair the key frame; false, and nothing changes, when it shows too little."""
        fresh = KeyFrame(pyramids)
        if len(fresh) < LEAST_POINTS:
            return False
        self._renew(fresh)
        return True

    def see(self, pyramids: Pyramids, expected: np.ndarray) -> Sighting:
        """Where the robot stands now.

        expected: (3,) x m, y m, theta rad that it probably moved since the pair last seen.
        """
        assert self._key is not None, "start() comes first"
        self._count += 1
        found, pose = self._follow(self._key, pyramids, self._ahead(expected), HEAD_START)
        share = 0.0 if pose is None else np.mean(pose.inliers) * found / len(self._key)
        if share >= RENEW:
            return self._seen(pose, found, False)
        fresh = KeyFrame(pyramids)
        if share < RELOCATE:
            found, pose = max(
                ((found, pose), self._relocate(self._key, fresh, pyramids)),
                key=lambda one: 0 if one[1] is None else one[1].inliers.sum(),
            )
        if pose is None or pose.inliers.sum() < max(LEAST_INLIERS, LEAST_SHARE * found):
            return Sighting(None, found, False)
        renewed = len(fresh) >= LEAST_POINTS
        sighting = self._seen(pose, found, renewed)
        if renewed:
            self._renew(fresh)
            value, variance = pose.offset
            self.offset = Offset(value, variance + WANDER**2)
        return sighting

    def _seen(self, pose: Pose | None, found: int, renewed: bool) -> Sighting:
        assert pose is not None
        pose = replace(pose, row_error=self.row_errors.size)
        self._pose = (pose.R, pose.t)
        return Sighting(pose, found, renewed)

    def _renew(self, key: KeyFrame) -> None:
        self._key = key
        self.row_errors.add(key.pixels, key.row_errors)
        self._pose = (np.eye(3), np.zeros(3))

    def _ahead(self, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The pose last seen, moved in the robot's plane."""
        R, t = self._pose
        c, s = math.cos(motion[2]), math.sin(motion[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return R @ turn, t + R @ np.array([motion[0], motion[1], 0.0])

    def _follow(
        self,
        key: KeyFrame,
        pyramids: Pyramids,
        guess: tuple[np.ndarray, np.ndarray],
        head_start: float,
    ) -> tuple[int, Pose | None]:
        """How many points are found near where the guess has them, and the pose they give."""
        after = self.view.predict(key.pixels, *guess, self.offset.value)
        pixels, sigma, found = key.find(pyramids, after[:, :3], after[:, 3])
        return int(found.sum()), find_pose(
            key.pixels[found],
            pixels[found],
            sigma[found],
            self.view,
            guess,
            (self._seed, self._count, 0),
            head_start,
            self.offset,
        )

    def _relocate(
        self, key: KeyFrame, fresh: KeyFrame, pyramids: Pyramids
    ) -> tuple[int, Pose | None]:
        i, j = key.alike(fresh)
        rough = find_pose(
            key.pixels[i],
            fresh.pixels[j],
            np.full(len(i), NOISE),
            self.view,
            self._pose,
            (self._seed, self._count, 1),
            offset=self.offset,
        )
        if rough is None:
            return 0, None
        # The few points alike may have agreed on a false pose: all that are found say better.
        return self._follow(key, pyramids, (rough.R, rough.t), 1.0)
