"""Disparity by semi-global block matching (Hirschmueller 2008; OpenCV's SGBM)."""

from __future__ import annotations

import math
import threading

import cv2
import numpy as np

from stereo.rectify import RectifiedCamera
from stereo.settings import StereoSettings

# OpenCV's disparities are sixteenths of a pixel.
SUBPIXEL = 16
# Nearest obstacle that the default number of disparities keeps in reach [m].
NEAREST = 0.5


def choose_disparities(f: float, baseline: float, width: int) -> int:
    """Multiple of 16 that reaches down to 0.5 m, at most a fifth of the image's width."""
    wanted = min(f * baseline / NEAREST, width / 5.0)
    return max(16, 16 * math.ceil(wanted / 16 - 1e-9))


class DisparityMatcher:
    """Rectified pair in, disparity out; may be called from several threads at once."""

    def __init__(self, camera: RectifiedCamera, settings: StereoSettings):
        self.disparities = settings.disparities or choose_disparities(
            camera.f, camera.baseline, camera.width
        )
        self.settings = settings
        self._local = threading.local()  # a StereoSGBM object holds buffers: one a thread

    def __call__(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Disparity (H, W) int16 in sixteenths of a pixel; negative where there is no match.

        The images are padded on the left: SGBM gives no answer in the first `disparities`
        columns, although the far things there lie inside the right image.
        """
        pad = self.disparities
        padded = [
            cv2.copyMakeBorder(image, 0, 0, pad, 0, cv2.BORDER_REPLICATE) for image in (left, right)
        ]
        disparity = self._matcher().compute(*padded)[:, pad:]
        # A match outside the right image is made of padding, not of anything seen.
        reach = np.minimum(SUBPIXEL * np.arange(left.shape[1]), np.iinfo(np.int16).max)
        return np.where(disparity > reach, np.int16(-SUBPIXEL), disparity)

    def _matcher(self) -> cv2.StereoSGBM:
        matcher = getattr(self._local, "matcher", None)
        if matcher is None:
            block = self.settings.block
            matcher = self._local.matcher = cv2.StereoSGBM.create(
                minDisparity=0,
                numDisparities=self.disparities,
                blockSize=block,
                P1=8 * block * block,
                P2=32 * block * block,
                disp12MaxDiff=1,
                uniquenessRatio=self.settings.uniqueness,
                speckleWindowSize=self.settings.speckle,
                speckleRange=1,
                mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
            )
        return matcher
