"""Photographs of printed boards: the very sheet that is printed, seen through a homography."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.board import Board
from calibration.board_drawing import draw_board

DOTS = 2400  # of the drawing's longer side


def photograph(
    board: Board,
    homography: np.ndarray,
    size: tuple[int, int],
    blur: float = 0.7,
    noise: float = 2.0,
    seed: int = 0,
) -> np.ndarray:
    """The printed board on a grey wall, uint8 (H, W).

    homography: (3, 3) from the board's metres to pixels, whose centres are at integers.
    size: (width, height) px. blur: standard deviation [px]; noise: of grey values.
    """
    sheet, dots_from_board = sheet_of(board)
    width, height = size
    fine = 3
    enlarge = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1.0]])
    H = enlarge @ homography @ np.linalg.inv(dots_from_board)
    large = cv2.warpPerspective(sheet, H, (width * fine, height * fine), borderValue=(110,))
    large = cv2.GaussianBlur(large, (0, 0), blur * fine)
    image = cv2.resize(large, size, interpolation=cv2.INTER_AREA).astype(float)
    image += np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def sheet_of(board: Board, dots: int = DOTS) -> tuple[np.ndarray, np.ndarray]:
    """The board as a fine picture with a white rim, and the map of its metres to the picture."""
    drawing = draw_board(board)
    left, top, right, bottom = drawing.extent
    rim = 0.08 * max(right - left, bottom - top)
    per_metre = dots / (max(right - left, bottom - top) + 2 * rim)
    width, height = (round(per_metre * (side + 2 * rim)) for side in (right - left, bottom - top))
    paper = np.ones((height, width))
    to_dots = np.array(
        [
            [per_metre, 0, per_metre * (rim - left) - 0.5],
            [0, per_metre, per_metre * (rim - top) - 0.5],
            [0, 0, 1.0],
        ]
    )
    for x, y, w, h in drawing.rectangles:
        (u, v), (last_u, last_v) = (
            to_dots[:2, :2] @ corner + to_dots[:2, 2] for corner in ((x, y), (x + w, y + h))
        )
        across, down = _covered(u, last_u, width), _covered(v, last_v, height)
        part = np.ix_(np.flatnonzero(down), np.flatnonzero(across))
        paper[part] -= np.outer(down[down > 0], across[across > 0])
    picture = np.rint(255 * np.clip(paper, 0, 1)).astype(np.uint8)
    shift = 10
    for x, y, radius in drawing.discs:
        centre = np.rint((to_dots[:2, :2] @ (x, y) + to_dots[:2, 2]) * 2**shift).astype(int)
        r = round(radius * per_metre * 2**shift)
        cv2.circle(picture, (int(centre[0]), int(centre[1])), r, (0,), -1, cv2.LINE_AA, shift)
    return picture, to_dots


def _covered(start: float, end: float, count: int) -> np.ndarray:
    """The share (count,) of each dot, from its number - 1/2 to + 1/2, within start and end."""
    dots = np.arange(count)
    return np.clip(np.minimum(dots + 0.5, end) - np.maximum(dots - 0.5, start), 0, 1)


def view(board: Board, seed: int, size: tuple[int, int] = (640, 480), share: float = 0.65):
    """A homography (3, 3) of the board tilted at random, its longer side about `share` of the
    image's width, and where its points are seen (m, 2) px."""
    rng = np.random.default_rng(seed)
    width, height = size
    focal = 0.8 * width
    points = board.points
    R = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3) * (1, 1, 0.5))[0]
    z = focal * 1.35 * np.ptp(points, axis=0).max() / (width * share)
    centre = np.array([rng.uniform(-0.08, 0.08) * z, rng.uniform(-0.05, 0.05) * z, z])
    t = centre - R @ points.mean(axis=0)
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    homography = K @ np.column_stack([R[:, 0], R[:, 1], t])
    seen = cv2.perspectiveTransform(points[:, None, :2].copy(), homography)
    return homography, seen.reshape(-1, 2)
