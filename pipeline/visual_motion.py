"""Motion from the images themselves (`--motion visual`), step by step in order of time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calibration.rig import Mount, StereoRig
from odometry.motion import Motion, compose, inverse
from stereo.pair import StereoPair
from stereo.pose import Offset, Pose, View
from stereo.rectify import Rectifier
from stereo.tracking import Pyramids
from stereo.visual_odometry import Sighting, VisualOdometry
from stereo.visual_settings import VisualSettings

# Rows within so much of the horizon, rise over run, are looked at: all of any ordinary lens.
STEEPEST = 1.2
# A robot whose pose differs from the last by less than its noise (chi-square of three degrees of
# freedom, 0.1 %) has not moved as far as one can tell.
STILL = 16.3
# After so long without a match to the key frame a new one is begun [ns].
PATIENCE = 1_000_000_000
# The speed goes on for so long unseen [s]; what is not seen errs by so much [m/s, m/s, rad/s], at
# most for so long [s].
COASTING = 0.5
UNSEEN = np.array([0.3, 0.3, math.radians(30.0)])
UNSEEN_MOST = 2.0

FOUND, GUESSED, BRIDGED = "found again", "guessed", "bridged by the wheels"


@dataclass(frozen=True)
class Loss:
    """A time without visual odometry: stamps ns, and how it ended."""

    first: int
    last: int
    end: str


class VisualMotion:
    """Visual odometry of one rig as motion of its robot.

    hold: report a robot that stands as standing, not as trembling about one place.
    """

    # Since the robot was last seen to move: pairs, and the covariance (3, 3) reported with them.
    _still_pairs = 0
    _still = np.zeros((3, 3))

    def __init__(
        self, rig: StereoRig, settings: VisualSettings, seed: int, hold: bool = True
    ) -> None:
        self._rectify, view = whole_view(rig)
        self._odometry = VisualOdometry(view, seed)
        self._settings, self._hold = settings, hold
        self._stamp: int | None = None
        self._last = Pose.none()
        self._velocity = np.zeros(3)  # a second
        self._lost_since: int | None = None
        self._lost_pairs = self._key_frames = 0
        self._inliers: list[int] = []
        self._noise: list[float] = []
        self.losses: list[Loss] = []
        self.sighting: Sighting | None = None

    @property
    def offset(self) -> Offset:
        """By how much all disparities of the rectified pair are too large."""
        return self._odometry.offset

    def prepare(self, pair: StereoPair) -> Pyramids:
        """What is looked at; from any thread. Raises StereoError: the images do not fit."""
        return Pyramids.of(*self._rectify(pair.left, pair.right))

    def step(
        self, stamp: int, pyramids: Pyramids | None, wheels: Motion | None = None
    ) -> Motion | None:
        """Motion since the stamp answered before; the first answer is no motion.

        pyramids: None where the pair cannot be read; wheels: what another odometry says of the
        time since the last pair: it tells where to look, and bridges what is not seen. `sighting`
        is then what this pair told.

        Returns:
            None: not known; the next answer then spans it, or begins here after `losses`.
        """
        self.sighting = None
        if pyramids is None or (self._stamp is not None and stamp <= self._stamp):
            return None
        if self._stamp is None:
            return self._start(stamp, pyramids)
        seconds = (stamp - self._stamp) / 1e9
        expected = self._velocity * min(seconds, COASTING)
        if wheels is not None and wheels.first == self._stamp:
            expected = wheels.increment
        seen = self.sighting = self._odometry.see(pyramids, expected)
        if seen.pose is None:
            return self._lose(stamp, pyramids, wheels is not None)
        if self._lost_since is not None:
            self._found(stamp, FOUND)
        motion = self._increment(seen.pose, stamp, seen.renewed)
        self._velocity = motion.increment / seconds
        self._stamp = stamp
        if seen.renewed:
            self._last = Pose.none()
            self._key_frames += 1
        self._inliers.append(seen.inliers)
        self._noise.append(seen.pose.noise)
        return motion

    @property
    def stamp(self) -> int | None:
        """At which the next motion begins [ns]; None: nothing was seen yet."""
        return self._stamp

    def report(self) -> dict[str, int | float]:
        """Counts for the summary of a run."""
        return {
            "visual_pairs": len(self._inliers),
            "visual_lost_pairs": self._lost_pairs,
            "visual_losses": len(self.all_losses()),
            "visual_guesses": sum(loss.end == GUESSED for loss in self.all_losses()),
            "visual_key_frames": self._key_frames,
            "visual_inliers_median": float(np.median(self._inliers)) if self._inliers else 0.0,
            "visual_row_error_px": round(self._odometry.row_errors.size, 3),
            "visual_disparity_offset_px": round(self.offset.value, 3),
            "visual_noise_px": round(float(np.median(self._noise)), 3) if self._noise else 0.0,
        }

    def all_losses(self) -> list[Loss]:
        """Those that ended, and one that did not."""
        if self._lost_since is None:
            return self.losses
        return [*self.losses, Loss(self._lost_since, self._lost_since, GUESSED)]

    def _start(self, stamp: int, pyramids: Pyramids) -> Motion | None:
        if not self._odometry.start(pyramids):
            return None
        self._key_frames += 1
        self._stamp, self._last = stamp, Pose.none()
        self._still, self._still_pairs = np.zeros((3, 3)), 0
        return Motion.none(stamp)

    def _lose(self, stamp: int, pyramids: Pyramids, bridged: bool) -> Motion | None:
        """Begin again at this pair, at once if wheels tell what was missed, else after a while."""
        since = self._stamp
        assert since is not None
        self._lost_pairs += 1
        if self._lost_since is None:
            self._lost_since = since
        if not bridged and stamp - since < PATIENCE:
            return None
        if self._start(stamp, pyramids) is None:
            return None
        self._found(stamp, BRIDGED if bridged else GUESSED)
        if bridged:
            return None
        seconds = (stamp - since) / 1e9
        increment = self._velocity * min(seconds, COASTING)
        self._velocity = np.zeros(3)
        sigma = UNSEEN * min(seconds, UNSEEN_MOST)
        return Motion(increment, np.diag(sigma**2), since, stamp)

    def _found(self, stamp: int, end: str) -> None:
        first = self._lost_since
        assert first is not None
        if self.losses and self.losses[-1].last == first and self.losses[-1].end == end:
            first = self.losses.pop().first
        self.losses.append(Loss(first, stamp, end))
        self._lost_since = None

    def _increment(self, pose: Pose, stamp: int, renewed: bool = False) -> Motion:
        """Motion from the pose reported last to this one, both in the frame of the key frame.

        What both poses owe to the key frame's own pixels they share: only what the later one owes
        more counts. renewed: the pair is the next key frame; nothing can be put off any longer.
        """
        last = self._last
        assert self._stamp is not None
        increment = compose(inverse(last.planar), pose.planar)
        c, s = math.cos(last.planar[2]), math.sin(last.planar[2])
        later = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        earlier = -later.copy()
        earlier[0, 2], earlier[1, 2] = increment[1], -increment[0]
        noise = later @ pose.of_pixels @ later.T + earlier @ last.of_pixels @ earlier.T
        shared = self._of_key_frame(pose) - self._of_key_frame(last)
        covariance = noise + later @ _positive(shared) @ later.T
        if self._hold and not renewed and _squared(increment, noise) < STILL:
            return self._held(increment, covariance, stamp)
        # What moved while it was held is part of this step.
        motion = Motion(increment, covariance + self._still, self._stamp, stamp)
        self._last, self._still, self._still_pairs = pose, np.zeros((3, 3)), 0
        return motion

    def _held(self, increment: np.ndarray, covariance: np.ndarray, stamp: int) -> Motion:
        """No motion, though an increment (3,) was seen since the robot last moved.

        It is put off, not dropped: the pose reported last stays the one to compare with. The
        covariances of all pairs held so far add up to what is unknown of that increment, as their
        errors do not: standing for long is no more uncertain than standing. The share of every
        pair that is put off for nothing falls like 1 / n, as a mean's variance does.
        """
        assert self._stamp is not None
        unknown = covariance + np.outer(increment, increment)
        fresh = _positive(unknown - self._still)
        if self._still_pairs:
            fresh = fresh + covariance / (self._still_pairs + 1)
        self._still_pairs += 1
        self._still = self._still + fresh
        return Motion(np.zeros(3), fresh, self._stamp, stamp)

    def _of_key_frame(self, pose: Pose) -> np.ndarray:
        """Covariance (3, 3) of a pose by the key frame's pixels and by the calibration."""
        x, y, theta = pose.planar
        settings = self._settings
        share = pose.row_error / settings.rows
        aside = math.radians(settings.across) * np.array([-y, x])
        calibration = np.zeros((3, 3))
        calibration[:2, :2] = settings.along**2 * np.outer([x, y], [x, y]) + np.outer(aside, aside)
        calibration[2, 2] = math.radians(settings.heading) ** 2 * (x * x + y * y + theta * theta)
        return pose.covariance - pose.of_pixels + share**2 * calibration


def whole_view(rig: StereoRig) -> tuple[Rectifier, View]:
    """A rectifier of whole images, turned no more than rectification needs, and its place on the
    robot; a rig without a mount is taken as level."""
    mount = rig.mount or Mount()
    level = Mount()
    rows = (level.height - STEEPEST, level.height + STEEPEST)
    rectify = Rectifier(rig.with_mount(level), rows, nearest=1.0)
    turned = mount.rotation @ level.rotation.T
    camera = replace(
        rectify.camera, rotation=turned @ rectify.camera.rotation, position=mount.position
    )
    return rectify, View.of(camera)


def _squared(increment: np.ndarray, covariance: np.ndarray) -> float:
    return float(increment @ np.linalg.solve(covariance + np.diag([1e-12] * 3), increment))


def _positive(matrix: np.ndarray) -> np.ndarray:
    """The nearest matrix (n, n) without negative eigenvalues."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return vectors * np.maximum(values, 0.0) @ vectors.T
