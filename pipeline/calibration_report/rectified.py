"""Rectified pairs with lines across: on a good rig every line cuts the same things in both."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.calibrate import CalibrationResult, View
from calibration.corners import BoardImage
from calibration.imagesource import ImageSource
from calibration.lens import lens_of, rays
from calibration.rig import CameraModel, StereoRig

PANEL = 480  # width of one image in the picture [px]
GAP = 6
LINES = 12
LINE_COLOURS = ((0, 158, 230), (178, 114, 0))  # BGR, by turns
OUTSIDE = -1000.0  # px: a place that no image has
ZOOM_OUT = 0.85  # focal length over the raw one: the rims of the images stay in view


def pairs_to_show(result: CalibrationResult) -> list[View]:
    """The pairs with the least, the median and the greatest held-out row error."""
    rows = result.heldout.view_rms
    order = [n for n in np.argsort(rows, kind="stable").tolist() if np.isfinite(rows[n])]
    chosen = dict.fromkeys((order[0], order[len(order) // 2], order[-1]))
    by_number = {view.number: view for view in result.views if view.number is not None}
    return [by_number[number] for number in chosen]


def rectified_picture(result: CalibrationResult) -> np.ndarray:
    """The pairs of `pairs_to_show`, one below the other, uint8 (H, W, 3) BGR."""
    maps = _rectifying_maps(result.rig)
    rows = []
    for view in pairs_to_show(result):
        panels = [
            cv2.remap(_grey(image, result.rig.image_size), *side, cv2.INTER_LINEAR)
            for image, side in zip((view.left, view.right), maps, strict=True)
        ]
        gap = np.full((panels[0].shape[0], GAP), 255, np.uint8)
        rows.append(_with_lines(np.hstack([panels[0], gap, panels[1]])))
        rows.append(np.full((GAP, rows[0].shape[1], 3), 255, np.uint8))
    return np.vstack(rows[:-1])


def _grey(image: BoardImage, size: tuple[int, int]) -> np.ndarray:
    grey = ImageSource(image.path, image.half).read()
    # A file that has gone since the corners were found leaves a blank panel.
    return np.full(size[::-1], 200, np.uint8) if grey is None else grey


def _rectifying_maps(rig: StereoRig) -> list[tuple[np.ndarray, np.ndarray]]:
    """For both cameras the raw pixel that each pixel of a rectified panel shows."""
    width, height = rig.image_size
    scale = PANEL / width
    K = np.array([[rig.left.fx, 0, width / 2], [0, rig.left.fx, height / 2], [0, 0, 1]])
    none = np.zeros(4)
    T = np.reshape(rig.T, (3, 1))  # OpenCV 5 takes (3,) for a row
    R_left, R_right, *_ = cv2.stereoRectify(K, none, K, none, rig.image_size, rig.R, T)
    focal = ZOOM_OUT * scale * min(rig.left.fx, rig.right.fx)
    u, v = np.meshgrid(np.arange(PANEL), np.arange(round(height * scale)))
    centre = (np.array(u.shape)[::-1] - 1) / 2
    level = np.stack([(u - centre[0]) / focal, (v - centre[1]) / focal, np.ones(u.shape)], axis=-1)
    # The distance of the boards is seen in the middle: the right panel is not shifted.
    sides = ((rig.left, R_left), (rig.right, R_right))
    return [_map(camera, rig.image_size, level @ R) for camera, R in sides]


def _map(
    camera: CameraModel, size: tuple[int, int], directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    lens = lens_of(camera)
    pixels = lens.project(lens.intrinsics(camera), directions)[0]
    # Far outside the image a lens polynomial folds back and would show the image once more.
    ahead = directions[..., 2] / np.linalg.norm(directions, axis=-1)
    pixels[ahead < _least_ahead(camera, size)] = OUTSIDE
    u, v = np.moveaxis(pixels.astype(np.float32), -1, 0)
    return np.ascontiguousarray(u), np.ascontiguousarray(v)


def _least_ahead(camera: CameraModel, size: tuple[int, int]) -> float:
    """Cosine of the widest angle from the optical axis that an image of `size` sees."""
    corners = np.array([(u, v) for u in (0, size[0] - 1) for v in (0, size[1] - 1)], float)
    return float(rays(camera, corners)[:, 2].min())


def _with_lines(grey: np.ndarray) -> np.ndarray:
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for index, row in enumerate(np.linspace(0, grey.shape[0], LINES + 2)[1:-1]):
        at = round(float(row))
        cv2.line(picture, (0, at), (grey.shape[1], at), LINE_COLOURS[index % 2], 1)
    return picture
