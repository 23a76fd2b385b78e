"""Nearest obstacle per column: disparity -> range in every bearing (paper Sec. II-A).

The nearest pixel of a column is often a false match. An obstacle therefore needs `support`:
that many pixels of the column and its two neighbours, within the height band, that agree to
about a pixel of disparity. Support 1 is the paper's plain nearest depth.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stereo.disparity import SUBPIXEL
from stereo.rectify import RectifiedCamera
from stereo.settings import StereoSettings


def nearest_per_column(
    disparity: np.ndarray,
    camera: RectifiedCamera,
    settings: StereoSettings,
    disparities: int,
    max_range: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Range and sigma (W,) [m] of the nearest obstacle in each image column, left to right.

    disparity: (H, W) int16, sixteenths of a pixel, negative = no match. Ranges are horizontal
    distances from the camera; NaN where too few pixels answer, +inf where those that answer
    all lie beyond `max_range`.
    """
    yaw = camera.yaw
    to_sensor = np.array(
        [[math.cos(yaw), math.sin(yaw), 0.0], [-math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
    count, nearness = _column_histogram(
        disparity,
        to_sensor @ camera.rotation,
        np.array([camera.f, camera.cx, camera.cy, camera.baseline]),
        float(camera.position[2]),
        np.array(
            [
                settings.height_min,
                settings.height_max,
                math.tan(math.radians(settings.tilt_sigma)),
                settings.noise,
            ]
        ),
        disparities,
    )
    return _nearest_supported(
        count,
        nearness,
        np.array([camera.f, camera.cx, camera.baseline]),
        settings.support,
        settings.noise,
        max_range,
    )


@njit(cache=True, nogil=True)
def _column_histogram(disparity, rotation, intrinsics, height, band, disparities):
    """Pixels in the height band: their number and summed 1/range per (column, disparity)."""
    f, cx, cy, baseline = intrinsics
    low, high, tilt, noise = band
    # Floor seen through a tilt or a disparity error must not become an obstacle: both raise it
    # in proportion to the depth.
    doubt = 3.0 * math.hypot(tilt, height * noise / (f * baseline))
    rows, columns = disparity.shape
    count = np.zeros((columns, disparities + 1), np.int32)
    nearness = np.zeros((columns, disparities + 1), np.float64)
    for v in range(rows):
        y = (v - cy) / f
        ahead, left, above = (
            rotation[0, 1] * y + rotation[0, 2],
            rotation[1, 1] * y + rotation[1, 2],
            rotation[2, 1] * y + rotation[2, 2],
        )
        for u in range(columns):
            raw = disparity[v, u]
            if raw <= 0:
                continue
            x = (u - cx) / f
            Z = SUBPIXEL * f * baseline / raw
            up = height + Z * (rotation[2, 0] * x + above)
            if up < low or up > high or up < doubt * Z:
                continue
            X, Y = Z * (rotation[0, 0] * x + ahead), Z * (rotation[1, 0] * x + left)
            if X <= 0.0:
                continue
            column = round(cx - f * Y / X)
            if 0 <= column < columns:
                bin_ = min(round(raw / SUBPIXEL), disparities)
                count[column, bin_] += 1
                nearness[column, bin_] += 1.0 / math.sqrt(X * X + Y * Y)
    return count, nearness


@njit(cache=True, nogil=True)
def _nearest_supported(count, nearness, intrinsics, support, noise, max_range):
    """The nearest disparity with enough support in each column, as range and sigma."""
    f, cx, baseline = intrinsics
    columns, bins = count.shape
    ranges = np.full(columns, np.nan)
    sigmas = np.full(columns, np.nan)
    for u in range(columns):
        first, last = max(u - 1, 0), min(u + 1, columns - 1)
        secant = math.hypot(1.0, (u - cx) / f)
        for d in range(bins - 1, 0, -1):
            if count[u, d] == 0:
                continue
            pixels, total = 0, 0.0
            for i in range(first, last + 1):
                for j in range(max(d - 1, 0), d + 1):
                    pixels += count[i, j]
                    total += nearness[i, j]
            if pixels < support:
                continue
            r = pixels / total
            if r > max_range:
                ranges[u] = np.inf
            else:
                ranges[u] = r
                sigmas[u] = r * r * noise / (f * baseline * secant)
            break
    return ranges, sigmas
