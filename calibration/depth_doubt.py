"""What the calibration means for depth: how far off a point is whose pixels are known.

Two errors meet. Matching misses the disparity by a fraction of a pixel, anew in every frame; the
calibration is wrong once and for all, and its covariance tells by how much: the same pixels are
triangulated with rigs that differ by one sigma in one parameter, J C J^T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.depth_error import DISPARITY_SIGMA, DISTANCES, TOLERANCE, depth_sigma
from calibration.lens import LENSES, lens_of, rays
from calibration.rig import CameraModel, StereoRig
from calibration.rotation import turn_matrix
from calibration.solution import StereoSolution
from calibration.triangulate import triangulate

GRID = (5, 4)  # pixels across and down at which the doubt is averaged
RIM = 0.15  # share of the image at each side that is left out
LEAST_AHEAD = 0.7  # cosine: rays farther from the optical axis tell little of depth
STEP = 0.01  # sigmas: depth far away is no straight line over a whole one
FARTHEST = 20.0  # m: the usable range is looked for up to here


@dataclass(frozen=True, eq=False)
class DepthDoubt:
    """Standard deviations of depth [m] at `distances` (k,) [m].

    from_matching: by a disparity that is off by `disparity_sigma` px; from_calibration: by the
    doubt of the rig, over the middle of the image. usable_range: where the two together reach
    `tolerance` [m].
    """

    distances: np.ndarray
    from_matching: np.ndarray
    from_calibration: np.ndarray
    usable_range: float
    disparity_sigma: float = DISPARITY_SIGMA
    tolerance: float = TOLERANCE

    @property
    def total(self) -> np.ndarray:
        """Both errors together (k,) [m]."""
        return np.hypot(self.from_matching, self.from_calibration)


def depth_doubt(solution: StereoSolution, distances: Sequence[float] = DISTANCES) -> DepthDoubt:
    """The doubt of depth with a solved rig."""
    rig = solution.rig
    focal = (rig.left.fx + rig.left.fy + rig.right.fx + rig.right.fy) / 4.0
    told = np.array(distances, float)
    fine = np.geomspace(0.1, FARTHEST, 60)
    every = np.concatenate([told, fine])
    matching = depth_sigma(focal, rig.baseline, every)
    calibration = calibration_sigma(solution, every)
    total = np.hypot(matching, calibration)[len(told) :]
    # Very near, no point is seen by both. Both errors grow with distance, and in logarithms they
    # are nearly straight lines.
    seen = np.isfinite(total)
    usable = np.exp(np.interp(np.log(TOLERANCE), np.log(total[seen]), np.log(fine[seen])))
    return DepthDoubt(told, matching[: len(told)], calibration[: len(told)], float(usable))


def calibration_sigma(solution: StereoSolution, distances: np.ndarray) -> np.ndarray:
    """Standard deviation of depth from the doubt of the rig alone (k,) [m].

    Its root mean square over pixels of the left image that the right camera sees, too; NaN at a
    distance at which there is none.
    """
    left, right, depth_index = common_pixels(solution.rig, distances)
    sigma = np.sqrt(np.diag(solution.covariance))
    correlation = solution.covariance / np.outer(sigma, sigma)
    change = np.array(
        [
            _depth(solution, name, step, left, right) - _depth(solution, name, -step, left, right)
            for name, step in zip(solution.names, STEP * sigma, strict=True)
        ]
    ) / (2.0 * STEP)
    variance = np.einsum("pn,pq,qn->n", change, correlation, change)
    seen = np.bincount(depth_index, minlength=len(distances))
    sums = np.bincount(depth_index, variance, minlength=len(distances))
    return np.sqrt(np.divide(sums, seen, out=np.full(len(distances), np.nan), where=seen > 0))


def common_pixels(
    rig: StereoRig, distances: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n, 2) of the same points in both images, and the index (n,) of each one's distance:
    a grid over the left image, as far as the right camera sees the points, too."""
    size = np.array(rig.image_size, float)
    across, down = (np.linspace(RIM, 1.0 - RIM, count) for count in GRID)
    left = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2) * size - 0.5
    directions = rays(rig.left, left)
    ahead = directions[:, 2] > LEAST_AHEAD
    left, directions = left[ahead], directions[ahead]
    index = np.repeat(np.arange(len(distances)), len(left))
    left, directions = np.tile(left, (len(distances), 1)), np.tile(directions, (len(distances), 1))
    points = directions / directions[:, 2:] * distances[index, None]
    seen_by_right = points @ rig.R.T + np.ravel(rig.T)
    lens = lens_of(rig.right)
    right = lens.project(lens.intrinsics(rig.right), seen_by_right)[0]
    inside = ((right > -0.5) & (right < size - 0.5)).all(axis=1) & (seen_by_right[:, 2] > 0)
    return left[inside], right[inside], index[inside]


def _depth(solution: StereoSolution, name: str, step: float, left, right) -> np.ndarray:
    return triangulate(moved(solution, name, step), left, right)[:, 2]


def moved(solution: StereoSolution, name: str, step: float) -> StereoRig:
    """The solution's rig with one of its parameters larger by `step`."""
    rig = solution.rig
    part, _, field = name.partition(".")
    if part == "left":
        return replace(rig, left=_moved_camera(rig.left, solution.lens, field, step))
    if part == "right":
        return replace(rig, right=_moved_camera(rig.right, solution.lens, field, step))
    axis = "xyz".index(field)
    if part == "translation":
        return replace(rig, T=np.ravel(rig.T) + step * np.eye(3)[axis])
    # The solve's small turns come after R, in the right camera's axes.
    return replace(rig, R=turn_matrix(step * np.eye(3)[axis]) @ rig.R)


def _moved_camera(camera: CameraModel, lens: str, field: str, step: float) -> CameraModel:
    model = LENSES[lens]
    intrinsics = model.intrinsics(camera)
    intrinsics[model.names.index(field)] += step
    return model.camera(intrinsics)
