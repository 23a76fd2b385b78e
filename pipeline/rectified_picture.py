"""A pair as stereo sees it: both rectified images with row lines, and the disparity in colour."""

from __future__ import annotations

import math

import cv2
import numpy as np

from stereo.disparity import SUBPIXEL, DisparityMatcher
from stereo.rectify import Rectifier
from stereo.settings import StereoSettings

LINES = 16  # row lines in a picture
WIDEST = 1920  # px
REACH = 0.4  # disparities searched, as a share of the width: people look at near things too
FOOTER = 30
LINE = (80, 220, 80)  # BGR
UNKNOWN = (64, 64, 64)
INK = (235, 235, 235)
FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_pair(left: np.ndarray, right: np.ndarray, rectify: Rectifier) -> np.ndarray:
    """Left, right and disparity side by side, (H, W, 3) uint8 BGR, from a raw pair.

    Near is red, far blue, grey has no match; the lines lie on the same rows in both images.
    """
    grey = rectify(left, right)
    disparities = 16 * math.ceil(REACH * rectify.camera.width / 16)
    disparity = DisparityMatcher(rectify.camera, StereoSettings(disparities=disparities))(*grey)
    disparity[_beyond(left.shape, rectify)] = -SUBPIXEL
    views = [cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in grey]
    lined = [_with_lines(view) for view in views]
    colours, caption = coloured(disparity, rectify.camera.depth_factor)
    picture = np.hstack([*lined, colours])
    scale = min(1.0, WIDEST / picture.shape[1])
    picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    picture = cv2.copyMakeBorder(picture, 0, FOOTER, 0, 0, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    place = (8, picture.shape[0] - 10)
    return cv2.putText(picture, caption, place, FONT, 0.5, INK, 1, cv2.LINE_AA)


def _beyond(shape: tuple[int, ...], rectify: Rectifier) -> np.ndarray:
    """Mask (H, W) of the pixels of the rectified left image that the camera never saw."""
    white = np.full(shape[:2], 255, np.uint8)
    return rectify(white, white)[0] < 255


def _with_lines(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    for row in np.linspace(0, height, LINES + 2).astype(int)[1:-1].tolist():
        cv2.line(image, (0, row), (width, row), LINE, 1)
    return image


def coloured(disparity: np.ndarray, depth_factor: float) -> tuple[np.ndarray, str]:
    """The disparity as colours (H, W, 3) over the range that it fills, and a caption."""
    known = disparity > 0
    if not known.any():
        return np.full((*disparity.shape, 3), UNKNOWN, np.uint8), "no disparity at all"
    low, high = np.percentile(disparity[known], (2, 98)) / SUBPIXEL
    share = (disparity / SUBPIXEL - low) / max(high - low, 1.0)
    shade = np.rint(np.clip(share, 0.0, 1.0) * 255).astype(np.uint8)
    colours = cv2.applyColorMap(shade, cv2.COLORMAP_TURBO)
    colours[~known] = UNKNOWN
    near, far = depth_factor / high, depth_factor / max(low, 1.0 / SUBPIXEL)
    return colours, (
        f"left | right | disparity: red {high:.0f} px = {near:.2f} m, blue {low:.0f} px = "
        f"{far:.1f} m, grey: no match ({100 * np.mean(known):.0f} % matched)"
    )
