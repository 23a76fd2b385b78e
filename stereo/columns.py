"""Nearest obstacle per column: disparity -> range in every bearing, with its doubt (Sec. II-A).

    gather the pixels of the height band by bearing and disparity
    nearest disparity that enough pixels with a gradient of their own agree upon
    trim what block matching fattens; drop what no neighbour confirms
    sigma: noise of matching and disagreement of neighbouring columns, through the geometry

The nearest pixel of a column is often a false match. Support 1 is the paper's plain nearest depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from stereo.column_kernels import confirm, gather, nearest_standing, trim_outlines
from stereo.rectify import RectifiedCamera
from stereo.settings import StereoSettings

# Sobel's operator sums so many differences over two pixels.
SOBEL = 4.0
# An obstacle so high [m] must be seen; of its pixels in three columns, this share be firm.
LEAST_HEIGHT = 0.03
LEAST_SHARE = 0.6
# So many times that, filled in across a blank surface before a firm one: something may stand there.
VETO = 2.0
# Filled and firm pixels are of one surface within this share of the disparity (at least 1 px).
ONE_SURFACE = 0.1
# The outline of a surface is sought in its last so many columns: block and support fatten by 3.
OUTLINE = 4
# Ranges differing by more than this factor belong to different surfaces.
STEP = 1.1
# Disagreement with the neighbouring columns counts so many times: it is seen less than it is.
ROUGHNESS = 1.5


@dataclass(frozen=True)
class Columns:
    """Of each image column, left to right, (W,) each: range and sigma [m] as in a `RangeScan`,
    support: the firm pixels in three columns that agree on it."""

    range: np.ndarray
    sigma: np.ndarray
    support: np.ndarray


def nearest_per_column(
    disparity: np.ndarray,
    image: np.ndarray,
    seen: np.ndarray,
    camera: RectifiedCamera,
    settings: StereoSettings,
    disparities: int,
    max_range: float,
) -> Columns:
    """The nearest obstacle in each image column.

    disparity: (H, W) int16, sixteenths of a pixel, negative = no match; image: (H, W) uint8, the
    rectified left one; seen: see `Rectifier.seen`. Ranges are horizontal distances from the
    camera; NaN where too few pixels answer or a blank surface may stand before them, +inf where
    those that answer all lie beyond `max_range`.
    """
    plain = settings.support == 1
    yaw = camera.yaw
    to_sensor = np.array(
        [[math.cos(yaw), math.sin(yaw), 0.0], [-math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
    tilt = math.tan(math.radians(settings.tilt_sigma))
    gradients = cv2.Sobel(image, cv2.CV_16S, 1, 0, ksize=3)
    noise2 = 1e-6 if plain else gradient_noise(gradients) ** 2 * settings.texture**2
    filled, evidence, weights, nearness, energy = gather(
        disparity,
        gradients,
        seen,
        to_sensor @ camera.rotation,
        np.array([camera.f, camera.f_rows, camera.cx, camera.cy, camera.baseline]),
        float(camera.position[2]),
        np.array([settings.height_min, settings.height_max, tilt, settings.noise]),
        noise2,
        disparities + 1,
    )
    needed = _needed(camera, settings, disparities)
    ranges, support, outline = nearest_standing(
        filled,
        evidence,
        weights,
        nearness,
        energy,
        needed,
        np.inf if plain else VETO,
        ONE_SURFACE,
        max_range,
    )
    secant = np.hypot(1.0, (np.arange(camera.width) - camera.cx) / camera.f)
    factor = camera.depth_factor * secant  # disparity = factor / range
    roughness = np.zeros(camera.width)
    if not plain:
        ranges = trim_outlines(ranges, outline, OUTLINE, STEP)
        ranges, roughness = confirm(ranges, factor, ONE_SURFACE)
    noise = np.hypot(settings.noise, ROUGHNESS * roughness)
    sigma = np.where(np.isfinite(ranges), ranges**2 * noise / factor, np.nan)
    return Columns(ranges, sigma, np.where(np.isnan(ranges), 0, support))


def gradient_noise(g):
    h, w = g.shape
    g = g[: h // 8 * 8, : w // 8 * 8].astype(np.float32)
    b = (g**2).reshape(h // 8, 8, -1, 8).mean((1, 3)).ravel()
    return max(2.0, float(np.sqrt(np.quantile(b, 0.03))))


def _needed(camera: RectifiedCamera, settings: StereoSettings, disparities: int) -> np.ndarray:
    """(disparities + 1,) pixels that an obstacle must show in three columns, by disparity."""
    if settings.support == 1:
        return np.ones(disparities + 1)
    rows = LEAST_HEIGHT * camera.f_rows * np.arange(disparities + 1) / camera.depth_factor
    return np.maximum(3 * LEAST_SHARE * rows, settings.support)
