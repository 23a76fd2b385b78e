"""Views of a board through a known rig: the truth that calibration must find again."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.board import Board
from calibration.rig import CameraModel, StereoRig

BOARD = Board(9, 6, 0.025)
SMALL_RIG = StereoRig(
    (320, 240),
    CameraModel(246.4, 246.4, 159.5, 119.5),
    CameraModel(246.4, 246.4, 159.5, 119.5),
    np.eye(3),
    np.array([-0.12, 0.0, 0.0]),
)


def distorted_rig() -> StereoRig:
    """A pair of unlike lenses, slightly turned against each other."""
    R = cv2.Rodrigues(np.array([0.004, -0.010, 0.006]))[0]
    return StereoRig(
        (640, 480),
        CameraModel(492.8, 494.1, 322.5, 236.0, "radtan", (-0.28, 0.10, 0.001, -0.0005)),
        CameraModel(489.6, 490.4, 317.0, 243.5, "radtan", (-0.26, 0.08, -0.0008, 0.0004)),
        R,
        np.array([-0.12, 0.0012, -0.0007]),
    )


def board_poses(count: int, seed: int, board: Board = BOARD, distance=(0.35, 0.6)) -> list:
    """Poses (R (3, 3), t (3,) m) of the board in the left camera, tilted to all sides."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        tilt = rng.uniform(-0.5, 0.5, 3) * (1.0, 1.0, 0.4)
        R = cv2.Rodrigues(tilt)[0]
        z = rng.uniform(*distance)
        centre = np.array([0.06 + rng.uniform(-0.1, 0.1) * z, rng.uniform(-0.15, 0.15) * z, z])
        poses.append((R, centre - R @ board.points.mean(axis=0)))
    return poses


def project(rig: StereoRig, pose, board: Board = BOARD) -> tuple[np.ndarray, np.ndarray]:
    """The board's corners (n, 2) in the left and in the right image."""
    R, t = pose
    sides = ((rig.left, R, t), (rig.right, rig.R @ R, rig.R @ t + rig.T))
    left, right = (
        cv2.projectPoints(board.points, cv2.Rodrigues(R)[0], t, camera.K, camera.D)[0]
        for camera, R, t in sides
    )
    return left.reshape(-1, 2), right.reshape(-1, 2)


def render(rig: StereoRig, pose, board: Board = BOARD) -> tuple[np.ndarray, np.ndarray]:
    """Both images of the printed board, uint8 (H, W), for lenses without distortion."""
    R, t = pose
    texture, texture_from_board = _printed(board)
    sides = ((rig.left, R, t), (rig.right, rig.R @ R, rig.R @ t + rig.T))
    images = [_photograph(rig, c, R, t, texture, texture_from_board) for c, R, t in sides]
    return images[0], images[1]


def _printed(board: Board) -> tuple[np.ndarray, np.ndarray]:
    """The board with a white rim one square wide, and the map of board metres to its pixels."""
    side = 40
    grid = np.indices((board.rows + 1, board.columns + 1)).sum(axis=0) % 2
    texture = np.pad(np.kron(grid, np.ones((side, side))) * 255, side, constant_values=255)
    per_metre = side / board.square
    # Corner (0, 0) lies two squares in; pixel centres are at integers.
    shift = 2 * side - 0.5
    to_pixels = np.array([[per_metre, 0, shift], [0, per_metre, shift], [0, 0, 1.0]])
    return texture.astype(np.uint8), to_pixels


def _photograph(rig, camera, R, t, texture, texture_from_board) -> np.ndarray:
    width, height = rig.image_size
    fine = 4
    image_from_board = camera.K @ np.column_stack([R[:, 0], R[:, 1], t])
    enlarge = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1.0]])
    H = enlarge @ image_from_board @ np.linalg.inv(texture_from_board)
    large = cv2.warpPerspective(texture, H, (width * fine, height * fine), borderValue=(110,))
    return cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA)
