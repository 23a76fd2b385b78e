"""Which image is wrong? Every pair held against the rig, and each of its images by itself.

Two things go wrong with a pair, and they look different. Corners found in the wrong place bend
the board: no pose fits that image, whatever the other one shows. A board that moved between the
two exposures (or a whole image that is shifted) looks right in each image alone, yet the two do
not belong together: carried by the rig, the left image's board lands beside the right's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.lens import lens_of
from calibration.resection import misses, pose_information, resect
from calibration.rig import StereoRig
from calibration.rotation import skew, turn_matrix
from calibration.sighting import PairSighting
from calibration.solution import StereoSolution

TRIM = 0.1  # worst share of an image's corners that may be off without the image being wrong
TIMES_USUAL = 3.0  # an image or pair is wrong from so many times the usual error
LEAST_BENT = 0.35  # px, and from this error
LEAST_APART = 0.7  # px: from this distance two images do not belong together
SCATTER = 4.0  # and from so many times the usual distance


@dataclass(frozen=True, eq=False)
class Misfits:
    """How badly each view of a solution fits, in pixels.

    bent: (views, 2) error of the left and the right image with a pose of its own, over all but
        its worst tenth of corners: what is wrong within the image.
    apart: (views, 2) columns and rows by which the right image's board lies beside where the
        left image alone puts it: what is wrong between the images.
    apart_doubt: (views,) standard deviation of that, by the noise of the left image's corners.
    noise: standard deviation of a corner's coordinate, as the images by themselves show it.
    """

    bent: np.ndarray
    apart: np.ndarray
    apart_doubt: np.ndarray
    noise: float

    @property
    def is_bent(self) -> np.ndarray:
        """(views, 2) which images have corners in wrong places."""
        usual = np.median(self.bent)
        return self.bent > max(LEAST_BENT, TIMES_USUAL * usual)

    @property
    def distance(self) -> np.ndarray:
        """(views,) length of `apart`."""
        return np.hypot(*self.apart.T)

    @property
    def is_apart(self) -> np.ndarray:
        """(views,) whose images are right by themselves and do not belong together."""
        return (self.distance > self._apart_limit) & ~self.is_bent.any(axis=1)

    @property
    def _apart_limit(self) -> np.ndarray:
        usual = max(LEAST_APART, SCATTER * float(np.median(self.distance)))
        # A few corners of a small part of a board hardly tell how far away it is.
        return np.maximum(usual, SCATTER * self.apart_doubt)

    def fault(self, view: int) -> str | None:
        """What is wrong with a view, to follow "drop pair 02: "; None when nothing is."""
        left, right = self.is_bent[view]
        if left and right:
            return "its corners are wrong in both images"
        if left or right:
            return f"its corners are wrong in the {'left' if left else 'right'} image"
        if self.is_apart[view]:
            return (
                f"its images miss each other by {self.distance[view]:.1f} px "
                "(the board moved, or all corners of one image are shifted)"
            )
        return None

    @property
    def badness(self) -> np.ndarray:
        """(views,) to rank them: the worse of both faults over what is usual."""
        bent = self.bent.max(axis=1) / max(LEAST_BENT, TIMES_USUAL * np.median(self.bent))
        return np.maximum(bent, self.distance / self._apart_limit)


def find_misfits(solution: StereoSolution) -> Misfits:
    """Measure the misfits of all views of a solution."""
    bent = np.empty((len(solution.views), 2))
    apart = np.empty((len(solution.views), 2))
    doubt = np.empty(len(solution.views))
    rig, points = solution.rig, solution.points
    noise = np.empty((len(solution.views), 2))
    for index, (view, pose) in enumerate(zip(solution.views, solution.poses, strict=True)):
        R, t = turn_matrix(pose[:3]), pose[3:]
        R_left, t_left, off_left = resect(rig.left, view.left, points, R, t)
        # Where the left image alone puts the board, the right camera has to find it.
        R_right, t_right = rig.R @ R_left, rig.R @ t_left + np.ravel(rig.T)
        apart[index] = np.median(misses(rig.right, view.right, points, R_right, t_right), 0)
        off_right = resect(rig.right, view.right, points, R_right, t_right)[2]
        bent[index] = [_trimmed_rms(off) for off in (off_left, off_right)]
        noise[index] = [_noise(off) for off in (off_left, off_right)]
        doubt[index] = _carried_doubt(rig, view, points, R_left, t_left)
    usual = float(np.median(noise))
    return Misfits(bent, apart, doubt * usual, usual)


def _carried_doubt(
    rig: StereoRig, view: PairSighting, points: np.ndarray, R: np.ndarray, t: np.ndarray
) -> float:
    """How far off the right image's corners are, on the whole, by the doubt of the left image's
    pose R, t [px], for corners of 1 px."""
    lens = lens_of(rig.right)
    turned = points[view.right.ids] @ R.T
    seen = (turned + t) @ rig.R.T + np.ravel(rig.T)
    by_point = lens.project(lens.intrinsics(rig.right), seen)[2] @ rig.R
    J = np.concatenate([-by_point @ skew(turned), by_point], axis=2).mean(axis=0)
    information = pose_information(rig.left, view.left, points, R, t)
    return float(np.sqrt(np.trace(J @ np.linalg.pinv(information) @ J.T)))


def _noise(residuals: np.ndarray) -> float:
    """Standard deviation of a coordinate [px], of which a pose has taken six."""
    return float(np.sqrt(np.sum(residuals**2) / max(residuals.size - 6, 1)))


def _trimmed_rms(residuals: np.ndarray) -> float:
    squares = np.sort(np.sum(residuals**2, axis=1))
    kept = squares[: max(1, round(len(squares) * (1.0 - TRIM)))]
    return float(np.sqrt(kept.mean()))
