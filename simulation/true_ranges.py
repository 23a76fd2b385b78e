"""TrueRanger: the range vector that a perfect sensor at the left camera would measure.

Every bearing is a half plane through the camera's centre. It is swept by rays of all elevations
that lie in the raw left image, so that pitch and roll are exact: no point has to be sorted into a
bearing, and what the image does not show is not known.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from calibration.rig import CameraModel, RigError, StereoRig
from simulation.camera_rays import camera_poses, distort, undistort
from simulation.tracer import Tracer
from stereo.ranger import StereoRanger
from stereo.settings import StereoSettings

DENSE = 400  # images up to this width are swept in steps of one pixel, wider ones of two
SAME_SURFACE = 0.05  # m behind the range
NO_PIXEL = -1


class TrueRanger:
    """True range vectors of one rig in the scene of `tracer`.

    stated: the rig as the recording tells it, whose bearings are wanted; by default the true one.
    bearing: (b,) rad, those of a `RangeScan` of the stated rig. The heights of the band are
    those of `StereoSettings`, the same at every distance.

    Raises:
        RigError: the rig has no mount.
    """

    def __init__(self, tracer: Tracer, rig: StereoRig, stated: StereoRig | None = None) -> None:
        if rig.mount is None:
            raise RigError("rig: field 'mount' is missing: the true ranges depend on it")
        self._tracer, self._rig = tracer, rig
        defaults = StereoSettings()
        self._band = (defaults.height_min, defaults.height_max)
        camera = StereoRanger(stated or rig).camera
        columns = np.arange(camera.width)[::-1]
        self.bearing = np.arctan2(camera.cx - columns, camera.f)
        beams = self._sweep(self.bearing + camera.yaw)
        pixel = _pixels(rig.left, rig.image_size, beams @ rig.mount.rotation)
        inside = pixel != NO_PIXEL
        self._first = np.concatenate([[0], np.cumsum(inside.sum(axis=1))])
        self._beams = beams[inside]
        self._pixel = pixel[inside]

    def __call__(
        self, pose: np.ndarray, grey: np.ndarray, time: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """range and texture (b,) float32 as in `TrueScans`, seen by the robot at `pose` at `time`.

        grey: (H, W) noise-free grey levels of the raw left image.
        """
        c, s = math.cos(pose[2]), math.sin(pose[2])
        turned = self._beams @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        eye = camera_poses(self._rig, pose)[0][1]
        rays = np.empty((len(turned), 6), np.float32)
        rays[:, :3] = eye
        rays[:, 3:] = turned
        reach = self._tracer.depth(rays, time)
        steep = _squared_gradient(grey).ravel()[self._pixel]
        low, high = self._band
        return nearest_in_band(
            self._first, reach, self._beams[:, 2], steep, float(eye[2]), low, high
        )

    def _sweep(self, azimuth: np.ndarray) -> np.ndarray:
        """Beams (b, n, 3) in the robot's frame, of horizontal length 1, one row to an azimuth."""
        rig = self._rig
        assert rig.mount is not None
        border = _border(rig.image_size)
        rays = np.column_stack([undistort(rig.left, border), np.ones(len(border))])
        rays = rays @ rig.mount.rotation.T
        elevation = np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1]))
        pixels = 1 if rig.image_size[0] <= DENSE else 2
        steps = math.ceil(np.ptp(elevation) * rig.left.fy / pixels)
        slope = np.tan(np.linspace(elevation.min(), elevation.max(), steps))
        beams = np.empty((azimuth.size, steps, 3))
        beams[..., 0] = np.cos(azimuth)[:, None]
        beams[..., 1] = np.sin(azimuth)[:, None]
        beams[..., 2] = slope
        return beams


def _pixels(camera: CameraModel, image_size: tuple[int, int], rays: np.ndarray) -> np.ndarray:
    """Flat index (...) of the pixel that shows each ray (..., 3) of the camera's frame, or
    NO_PIXEL."""
    width, height = image_size
    # Far outside the image a lens model folds back into it.
    seen = undistort(camera, _border(image_size))
    ahead = rays[..., 2] > 1e-6
    points = rays[..., :2] / np.where(ahead, rays[..., 2], 1.0)[..., None]
    margin = 0.5 / camera.fx
    ahead &= (points >= seen.min(axis=0) - margin).all(axis=-1)
    ahead &= (points <= seen.max(axis=0) + margin).all(axis=-1)
    pixel = np.full(rays.shape[:-1], NO_PIXEL)
    u, v = np.rint(distort(camera, points[ahead])).astype(np.int64).T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    pixel[ahead] = np.where(inside, v * width + u, NO_PIXEL)
    return pixel


def _border(image_size: tuple[int, int]) -> np.ndarray:
    """Pixels (n, 2) along the image's border."""
    width, height = image_size
    u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    edge = (u == 0) | (u == width - 1) | (v == 0) | (v == height - 1)
    return np.stack([u[edge], v[edge]], axis=1)


def _squared_gradient(grey: np.ndarray) -> np.ndarray:
    """Square of the horizontal central difference of an image (H, W); 0 at its sides."""
    squared = np.zeros(grey.shape, np.float32)
    squared[:, 1:-1] = (0.5 * (grey[:, 2:] - grey[:, :-2])) ** 2
    return squared


@njit(cache=True, nogil=True)
def nearest_in_band(first, reach, slope, steep, height, low, high):
    """range and texture (b,) of the beams first[i] to first[i + 1] of every bearing i.

    reach (n,): horizontal distance to the first surface [m], inf if none; slope (n,): rise per
    metre; steep (n,): squared gradient of the image there; height: of the camera [m].
    """
    bearings = len(first) - 1
    ranges = np.full(bearings, np.nan, np.float32)
    texture = np.full(bearings, np.nan, np.float32)
    for b in range(bearings):
        nearest = np.inf
        enters = False
        for i in range(first[b], first[b + 1]):
            if np.isfinite(reach[i]):
                up = height + reach[i] * slope[i]
                if low <= up <= high:
                    nearest = min(nearest, reach[i])
            # Where the beam enters the band, if it does before it ends.
            if low <= height <= high:
                enters = True
            elif height > high and slope[i] < 0.0:
                enters = enters or reach[i] > (high - height) / slope[i]
            elif height < low and slope[i] > 0.0:
                enters = enters or reach[i] > (low - height) / slope[i]
        if nearest == np.inf:
            if enters:
                ranges[b] = np.inf
            continue
        pixels = 0
        total = 0.0
        for i in range(first[b], first[b + 1]):
            up = height + reach[i] * slope[i]
            if reach[i] <= nearest + SAME_SURFACE and low <= up <= high:
                pixels += 1
                total += steep[i]
        ranges[b] = nearest
        texture[b] = math.sqrt(total / pixels)
    return ranges, texture
