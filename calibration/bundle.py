"""Bundle adjustment: cameras and board poses that bring the projected corners onto the seen ones.

Least squares over the lenses of all cameras, their poses and the pose of the board in every view,
by Levenberg and Marquardt with exact derivatives. A view's pose meets only that view's corners,
so it is eliminated from the normal equations first (the Schur complement: Triggs et al. 2000,
"Bundle Adjustment - A Modern Synthesis", Sec. 6): what remains has the size of the cameras.

Sizes: s cameras (1, or left and right), v views, m points on the board, c intrinsics a camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.lens import Lens
from calibration.rotation import turn_matrix
from calibration.sighting import Sighting

ROUNDS = 30
FIRST_DAMPING = 1e-4
MOST_DAMPING = 1e8
# A round that gains less than this share of the error is the last.
LEAST_GAIN = 1e-7
POSE = 6  # a small turn (left-multiplied) and a shift


@dataclass(frozen=True, eq=False)
class Observations:
    """Corners by camera, view and number.

    points: (m, 3) of the board [m]; corners: (s, v, m, 2) px, 0 where not seen;
    seen: (s, v, m) bool.
    """

    points: np.ndarray
    corners: np.ndarray
    seen: np.ndarray

    @classmethod
    def of(cls, cameras: Sequence[Sequence[Sighting]], points: np.ndarray) -> Observations:
        """From each camera's sightings, one a view."""
        shape = (len(cameras), len(cameras[0]), len(points))
        corners, seen = np.zeros((*shape, 2)), np.zeros(shape, bool)
        for s, sightings in enumerate(cameras):
            for v, sighting in enumerate(sightings):
                corners[s, v, sighting.ids] = sighting.corners
                seen[s, v, sighting.ids] = True
        return cls(np.asarray(points, float), corners, seen)

    def views(self, chosen: np.ndarray) -> Observations:
        """Only these views."""
        return replace(self, corners=self.corners[:, chosen], seen=self.seen[:, chosen])


@dataclass(frozen=True, eq=False)
class Geometry:
    """What is sought.

    intrinsics: (s, c); R (s, 3, 3), t (s, 3) m carry the first camera's frame to each camera's
    (the first: nothing); board_rotation (v, 3, 3) and board_position (v, 3) m the board to the
    first camera's.
    """

    intrinsics: np.ndarray
    R: np.ndarray
    t: np.ndarray
    board_rotation: np.ndarray
    board_position: np.ndarray

    def moved(self, cameras: np.ndarray, boards: np.ndarray) -> Geometry:
        """After a step: cameras (p,) as `camera_columns` orders them, boards (v, 6)."""
        s, c = self.intrinsics.shape
        between = cameras[s * c :].reshape(s - 1, POSE)
        R, t = self.R.copy(), self.t.copy()
        R[1:] = turn_matrix(between[:, :3]) @ R[1:]
        t[1:] += between[:, 3:]
        return Geometry(
            self.intrinsics + cameras[: s * c].reshape(s, c),
            R,
            t,
            turn_matrix(boards[:, :3]) @ self.board_rotation,
            self.board_position + boards[:, 3:],
        )

    def views(self, chosen: np.ndarray) -> Geometry:
        """Only these views."""
        return replace(
            self,
            board_rotation=self.board_rotation[chosen],
            board_position=self.board_position[chosen],
        )


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations of a step: cameras (p, p), cross (v, p, 6), boards (v, 6, 6), and the
    right-hand sides of cameras (p,) and boards (v, 6)."""

    cameras: np.ndarray
    cross: np.ndarray
    boards: np.ndarray
    cameras_rhs: np.ndarray
    boards_rhs: np.ndarray


def adjust(
    lens: Lens,
    seen: Observations,
    start: Geometry,
    weights: np.ndarray,
    rounds: int = ROUNDS,
) -> tuple[Geometry, np.ndarray]:
    """Minimise the weighted sum of squared reprojection errors.

    Args:
        weights: (s, v, m) >= 0, 0 for corners that do not count.

    Returns:
        the geometry, and its residuals (s, v, m, 2) px, seen less predicted.

    Raises:
        numpy.linalg.LinAlgError: a board of the start stands behind a camera.
    """
    geometry, damping = start, FIRST_DAMPING
    residuals, derivatives = linearise(lens, seen, geometry)
    cost = _cost(residuals, weights)
    if not np.isfinite(cost):
        raise np.linalg.LinAlgError("a board stands behind a camera")
    for _ in range(rounds):
        equations = normal_equations(derivatives, residuals, weights)
        gain = 0.0
        while damping < MOST_DAMPING:
            trial = geometry.moved(*_step(equations, damping))
            trial_residuals, trial_derivatives = linearise(lens, seen, trial)
            trial_cost = _cost(trial_residuals, weights)
            if trial_cost <= cost:
                gain = cost - trial_cost
                geometry, cost = trial, trial_cost
                residuals, derivatives = trial_residuals, trial_derivatives
                damping = max(damping / 10, 1e-12)
                break
            damping *= 10
        if gain <= LEAST_GAIN * cost:
            break
    return geometry, residuals


def linearise(
    lens: Lens, seen: Observations, geometry: Geometry
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Residuals (s, v, m, 2), and per camera the derivatives (v, m, 2, columns) of the predicted
    pixels: by its intrinsics, then its pose (but for the first camera), then the board's pose.

    Residuals are infinite where a lens would have to see behind itself and cannot.
    """
    turned = seen.points @ np.swapaxes(geometry.board_rotation, 1, 2)
    placed = turned + geometry.board_position[:, None]
    residuals, derivatives = np.empty(seen.corners.shape), []
    for s, (R, t) in enumerate(zip(geometry.R, geometry.t, strict=True)):
        rotated = placed @ R.T if s else placed
        points = rotated + t
        pixels, d_intrinsics, d_points = lens.project(geometry.intrinsics[s], points)
        residuals[s] = np.where(seen.seen[s][..., None], seen.corners[s] - pixels, 0.0)
        if not lens.wide:
            residuals[s, seen.seen[s] & (points[..., 2] <= 0)] = np.inf
        columns = [d_intrinsics]
        if s:
            columns += [_cross(rotated, d_points), d_points]
        by_board = d_points @ R if s else d_points
        columns += [_cross(turned, by_board), by_board]
        derivatives.append(np.concatenate(columns, axis=-1))
    return residuals, derivatives


def _cross(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """points x rows: derivative by a small turn of the points (v, m, 3) of what has the
    derivatives `rows` (v, m, 2, 3) by the points."""
    x, y, z = (points[..., None, i] for i in range(3))
    a, b, c = (rows[..., i] for i in range(3))
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=-1)


def camera_columns(cameras: int, intrinsics: int) -> list[np.ndarray]:
    """Per camera: which of all cameras' parameters its own columns are.

    The order of the parameters: every camera's intrinsics, then the poses of all but the first.
    """
    every = np.arange(cameras * intrinsics).reshape(cameras, intrinsics)
    poses = cameras * intrinsics + np.arange((cameras - 1) * POSE).reshape(-1, POSE)
    return [every[0], *(np.concatenate([e, p]) for e, p in zip(every[1:], poses, strict=True))]


def normal_equations(
    derivatives: list[np.ndarray], residuals: np.ndarray, weights: np.ndarray
) -> Equations:
    """The normal equations of the linearised problem."""
    cameras, views = weights.shape[:2]
    own = camera_columns(cameras, derivatives[0].shape[-1] - POSE)
    size = own[-1][-1] + 1
    H, rhs = np.zeros((size, size)), np.zeros(size)
    cross = np.zeros((views, size, POSE))
    boards, boards_rhs = np.zeros((views, POSE, POSE)), np.zeros((views, POSE))
    for s, columns in enumerate(own):
        J = derivatives[s].reshape(views, -1, derivatives[s].shape[-1])
        # A copy with its weights: NumPy takes another, threaded routine for J^T J itself.
        weighted = np.swapaxes(J * np.repeat(weights[s], 2, axis=1)[..., None], 1, 2)
        square = weighted @ J
        right = (weighted @ residuals[s].reshape(views, -1, 1))[..., 0]
        n = len(columns)
        H[np.ix_(columns, columns)] += square[:, :n, :n].sum(axis=0)
        rhs[columns] += right[:, :n].sum(axis=0)
        cross[:, columns] += square[:, :n, n:]
        boards += square[:, n:, n:]
        boards_rhs += right[:, n:]
    return Equations(H, cross, boards, rhs, boards_rhs)


def reduced(equations: Equations, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The cameras' equations after the boards' poses are eliminated: (p, p) and (p,)."""
    H, eliminated, by_boards = _eliminate(equations, damping)
    return H - eliminated, equations.cameras_rhs - by_boards


def _eliminate(equations: Equations, damping: float):
    boards = _damped(equations.boards, damping)
    # One solve for the cross blocks and the right-hand sides together.
    columns = np.concatenate(
        [np.swapaxes(equations.cross, 1, 2), equations.boards_rhs[..., None]], axis=2
    )
    solved = equations.cross @ np.linalg.solve(boards, columns)
    total = solved.sum(axis=0)
    return _damped(equations.cameras, damping), total[:, :-1], total[:, -1]


def _step(equations: Equations, damping: float) -> tuple[np.ndarray, np.ndarray]:
    H, rhs = reduced(equations, damping)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(equations.cameras), 1e-300))
    cameras = scale * np.linalg.lstsq(scale[:, None] * H * scale, scale * rhs, rcond=1e-14)[0]
    rest = equations.boards_rhs - np.swapaxes(equations.cross, 1, 2) @ cameras
    boards = np.linalg.solve(_damped(equations.boards, damping), rest[..., None])[..., 0]
    return cameras, boards


def _damped(H: np.ndarray, damping: float) -> np.ndarray:
    """With the diagonal enlarged, and never singular for want of corners."""
    diagonal = np.einsum("...ii->...i", H)
    result = H.copy()
    np.einsum("...ii->...i", result)[...] += damping * diagonal + 1e-300
    return result


def _cost(residuals: np.ndarray, weights: np.ndarray) -> float:
    squares = np.einsum("svmi,svmi->svm", residuals, residuals)
    return float(np.sum(squares * weights)) if np.isfinite(squares).all() else np.inf
