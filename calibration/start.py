"""Where the bundle adjustment starts: each camera by itself, from homographies of rays.

For a guess of the focal length the pixels of a view become rays, and the board's pose follows from
the homography that carries its points to those rays (Zhang 2000, with rays for pixels so that it
holds for fisheye lenses too). Of a ladder of guesses the best few are refined, the best is kept.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.bundle import Geometry, Observations
from calibration.errors import CalibrationError
from calibration.lens import Lens, rays
from calibration.outliers import noise_scale, robust_adjust

# Focal length over the image's longer side: 130 deg to a 17 deg lens by its pinhole.
FOCAL_LADDER = 0.25 * 1.25 ** np.arange(12)
REFINED = 3


def start_camera(
    lens: Lens, seen: Observations, camera: int, image_size: tuple[int, int]
) -> Geometry:
    """One camera's intrinsics and the board's pose in each of its views.

    Raises:
        CalibrationError: no guess explains the corners.
    """
    alone = replace(seen, corners=seen.corners[[camera]], seen=seen.seen[[camera]])
    guesses = [_guess(lens, alone, image_size, share) for share in FOCAL_LADDER]
    guesses = [(fit, geometry) for fit, geometry in guesses if np.isfinite(fit)]
    guesses.sort(key=lambda guess: guess[0])
    refined = []
    for _, geometry in guesses[:REFINED]:
        geometry, residuals = robust_adjust(lens, alone, geometry)
        refined.append((noise_scale(residuals, alone.seen), geometry))
    if not refined:
        raise CalibrationError(
            "the corners fit no camera: check the counts in --board, and that the images are the "
            "camera's own, neither cropped nor resized"
        )
    return min(refined, key=lambda result: result[0])[1]


def start_pair(lens: Lens, seen: Observations, image_size: tuple[int, int]) -> Geometry:
    """Both cameras, and between them the pose on which their views agree best."""
    left, right = (start_camera(lens, seen, camera, image_size) for camera in (0, 1))
    R = right.board_rotation @ np.swapaxes(left.board_rotation, 1, 2)
    t = right.board_position - np.einsum("vij,vj->vi", R, left.board_position)
    middle = _medoid(R)
    identity = np.eye(3)
    return Geometry(
        np.concatenate([left.intrinsics, right.intrinsics]),
        np.stack([identity, R[middle]]),
        np.stack([np.zeros(3), np.median(t, axis=0)]),
        left.board_rotation,
        left.board_position,
    )


def start_poses(
    lens: Lens, intrinsics: np.ndarray, seen: Observations
) -> tuple[np.ndarray, np.ndarray]:
    """The board's pose (v, 3, 3), (v, 3) m in each view of the first camera of `seen`."""
    camera = lens.camera(intrinsics)
    directions = rays(camera, seen.corners[0].reshape(-1, 2)).reshape(*seen.seen[0].shape, 3)
    # M = sum over corners of (p p^T) x (I - r r^T): the homography h minimises h^T M h, the
    # squared distance of the points from the rays.
    centre, size = seen.points.mean(axis=0), np.abs(seen.points).max()
    flat = np.concatenate(
        [(seen.points - centre)[:, :2] / size, np.ones((len(seen.points), 1))], axis=1
    )
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    across *= seen.seen[0][..., None, None]
    count = len(flat)
    products = (flat[:, :, None] * flat[:, None, :]).reshape(count, 9)
    M = (products.T @ across.reshape(-1, count, 9)).reshape(-1, 3, 3, 3, 3)
    M = M.transpose(0, 1, 3, 2, 4).reshape(-1, 9, 9)
    columns = np.linalg.eigh(M)[1][:, :, 0].reshape(-1, 3, 3)
    H = np.swapaxes(columns, 1, 2)
    # Of h and -h, that which puts the points before the camera.
    along = np.sum((flat @ columns) * directions, axis=2)
    behind = np.sum(along * seen.seen[0], axis=1) < 0
    H = H * np.where(behind, -1.0, 1.0)[:, None, None]
    scale = np.linalg.norm(H[:, :, :2], axis=1).mean(axis=1)
    H /= np.maximum(scale, 1e-300)[:, None, None]
    third = np.cross(H[:, :, 0], H[:, :, 1])
    U, _, Vt = np.linalg.svd(np.stack([H[:, :, 0], H[:, :, 1], third], axis=-1))
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    R = U @ Vt
    return R, H[:, :, 2] * size - R @ centre


def _guess(
    lens: Lens, alone: Observations, image_size: tuple[int, int], share: float
) -> tuple[float, Geometry]:
    """How badly a focal length explains the views [px], and the geometry that follows from it."""
    width, height = image_size
    f = share * max(image_size)
    intrinsics = np.zeros(len(lens.names))
    intrinsics[:4] = f, f, (width - 1) / 2, (height - 1) / 2
    R, t = start_poses(lens, intrinsics, alone)
    geometry = Geometry(intrinsics[None], np.eye(3)[None], np.zeros((1, 3)), R, t)
    points = alone.points @ np.swapaxes(R, 1, 2) + t[:, None]
    if not lens.wide and (points[..., 2][alone.seen[0]] <= 0).any():
        return np.inf, geometry
    pixels = lens.project(intrinsics, points)[0]
    return noise_scale(alone.corners - pixels, alone.seen), geometry


def _medoid(R: np.ndarray) -> int:
    """Index of the rotation (v, 3, 3) with the least sum of angles to the others."""
    traces = np.einsum("vij,wij->vw", R, R)
    return int(np.argmin(np.arccos(np.clip((traces - 1) / 2, -1, 1)).sum(axis=1)))
