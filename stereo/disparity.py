"""Disparity by semi-global block matching (Hirschmueller 2008; OpenCV's SGBM), or plain blocks."""

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

MODES = {
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "hh": cv2.STEREO_SGBM_MODE_HH,
    "hh4": cv2.STEREO_SGBM_MODE_HH4,
}
# Plain block matching has no neighbours to ask and needs a block so many times as wide.
BM_BLOCK = 3


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
        self._rows = camera.height
        self._local = threading.local()  # a matcher holds buffers: one a thread

    def __call__(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Disparity (H, W) int16 in sixteenths of a pixel; negative where there is no match.

        The images are padded on the left: OpenCV gives no answer in the first `disparities`
        columns, although the far things there lie inside the right image.
        """
        pad = self.disparities
        padded = [
            cv2.copyMakeBorder(image, 0, 0, pad, 0, cv2.BORDER_REPLICATE) for image in (left, right)
        ]
        disparity = np.ascontiguousarray(self._matcher().compute(*padded)[:, pad:])
        # A match outside the right image is made of padding, not of anything seen.
        near = disparity[:, :pad]
        near[near > SUBPIXEL * np.arange(near.shape[1])] = -SUBPIXEL
        return disparity

    def _matcher(self) -> cv2.StereoMatcher:
        matcher = getattr(self._local, "matcher", None)
        if matcher is None:
            matcher = self._local.matcher = self._new()
        return matcher

    def _new(self) -> cv2.StereoMatcher:
        settings, block = self.settings, self.settings.block
        if settings.matcher == "bm":
            most = (self._rows - 1) // 2 * 2 + 1  # odd; a block must fit into the image
            plain = cv2.StereoBM.create(self.disparities, min(max(5, BM_BLOCK * block), most))
            plain.setUniquenessRatio(settings.uniqueness)
            plain.setSpeckleWindowSize(settings.speckle)
            plain.setSpeckleRange(1)
            plain.setDisp12MaxDiff(1)
            return plain
        return cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=self.disparities,
            blockSize=block,
            P1=8 * block * block,
            P2=32 * block * block,
            disp12MaxDiff=1,
            uniquenessRatio=settings.uniqueness,
            speckleWindowSize=settings.speckle,
            speckleRange=1,
            mode=MODES[settings.matcher],
        )
