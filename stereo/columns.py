"""Nearest obstacle per column: disparity -> range in every bearing, with its doubt (Sec. II-A).

    gather the pixels of the height band by bearing and disparity
    nearest disparity for which the image itself shows evidence
    drop what repeats or is blank: another disparity would match as well
    trim what block matching fattens; drop what no neighbour confirms
    sigma: from how much agrees, how distinctly, how roughly; through the geometry

The nearest pixel of a column is often a false match. Support 1 is the paper's plain nearest depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from stereo.column_kernels import confirm, gather, nearest_standing, trim_outlines
from stereo.distinctness import margins
from stereo.image_noise import gradient_noise
from stereo.rectify import RectifiedCamera
from stereo.settings import StereoSettings

# An obstacle so high [m] must be seen; of its pixels in three columns, this share.
LEAST_HEIGHT = 0.03
LEAST_SHARE = 0.6
# So many times that, filled in across a blank surface before a sure one: something may stand there.
VETO = 1.0
# Disparities within this share of each other (at least 1 px) may be of one surface.
ONE_SURFACE = 0.1
# The best rival must cost so many times as much as the match.
DISTINCT = 1.07
# What stands no higher may be floor [m].
LOW = 0.3
# The outline of a surface is sought in its last so many columns: block and support fatten by 3.
OUTLINE = 4
# Ranges differing by more than this factor belong to different surfaces.
STEP = 1.1
TINY = 1e-9
# Variance of a disparity in units of noise^2: what is always there, what a match by AT_MARGIN
# over its rival adds, and what AT_SUPPORT pixels do. Fitted to the rendered recordings.
ALWAYS, AT_MARGIN, AT_SUPPORT = 0.04, 0.17, 140.0
# Disagreement with the neighbouring columns counts so many times: it is seen less than it is.
ROUGHNESS = 2.6


@dataclass(frozen=True)
class Columns:
    """Of each image column, left to right, (W,) each: range and sigma [m] as in a `RangeScan`,
    support: the pixels in three columns that agree on it."""

    range: np.ndarray
    sigma: np.ndarray
    support: np.ndarray


def nearest_per_column(
    disparity: np.ndarray,
    images: tuple[np.ndarray, np.ndarray],
    seen: np.ndarray,
    camera: RectifiedCamera,
    settings: StereoSettings,
    disparities: int,
    max_range: float,
) -> Columns:
    """The nearest obstacle in each image column.

    disparity: (H, W) int16, sixteenths of a pixel, negative = no match; images: (H, W) uint8, the
    rectified pair; seen: see `Rectifier.seen`. Ranges are horizontal distances from the camera;
    NaN where too little answers, a blank surface may stand before what does, or another range
    would match as well; +inf where what answers lies beyond `max_range`.
    """
    left, right = (cv2.Sobel(image, cv2.CV_16S, 1, 0, ksize=3) for image in images)
    gathered, closest = gather(
        disparity,
        left,
        seen,
        _to_sensor(camera) @ camera.rotation,
        np.array([camera.f, camera.f_rows, camera.cx, camera.cy, camera.baseline]),
        float(camera.position[2]),
        _band(settings),
        settings.texture * gradient_noise(left, seen[0], seen[1]),
        disparities + 1,
    )
    secant = np.hypot(1.0, (np.arange(camera.width) - camera.cx) / camera.f)
    factor = camera.depth_factor * secant  # disparity = factor / range
    if settings.support == 1:
        ranges = np.where(closest > 0.0, 1.0 / np.maximum(closest, TINY), np.nan)
        return _columns(ranges, settings.noise, np.ones(camera.width, int), factor, max_range)

    needed = _needed(camera, settings, disparities)
    ranges, support, outline = nearest_standing(*gathered, needed, VETO, ONE_SURFACE)
    # At height z, the floor behind has 1 - z / height of the disparity of what stands before it.
    shares = 1.0 - np.array([settings.height_min, LOW]) / camera.position[2]
    margin, offset = margins(
        disparity, left, right, factor / ranges, _floor(camera), shares, disparities
    )
    ranges[~(margin >= DISTINCT)] = np.nan
    ranges = factor / (factor / ranges + offset)
    ranges[ranges > max_range] = np.inf
    ranges = trim_outlines(ranges, outline, OUTLINE, STEP)
    ranges, roughness = confirm(ranges, factor, ONE_SURFACE)
    noise = np.hypot(settings.noise * _inflation(margin, support), ROUGHNESS * roughness)
    return _columns(ranges, noise, support, factor, max_range)


def _columns(
    ranges: np.ndarray,
    noise: np.ndarray | float,
    support: np.ndarray,
    factor: np.ndarray,
    max_range: float,
) -> Columns:
    """Free beyond `max_range`; sigma of the ranges from the noise of their disparities [px]."""
    ranges = np.where(ranges > max_range, np.inf, ranges)
    sigma = np.where(np.isfinite(ranges), ranges**2 * noise / factor, np.nan)
    return Columns(ranges, sigma, np.where(np.isnan(ranges), 0, support))


def _to_sensor(camera: RectifiedCamera) -> np.ndarray:
    """Rotation (3, 3) from the robot's frame to the level one that looks along the camera."""
    c, s = math.cos(camera.yaw), math.sin(camera.yaw)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _floor(camera: RectifiedCamera) -> np.ndarray:
    """Disparity [px] of the floor: its growth per column and per row, and in the image's corner."""
    across, down, ahead = camera.rotation[2]  # of the optical axes, upward
    nearness = -camera.depth_factor / camera.position[2]
    per_column, per_row = nearness * across / camera.f, nearness * down / camera.f_rows
    corner = nearness * ahead - per_column * camera.cx - per_row * camera.cy
    return np.array([per_column, per_row, corner])


def _band(settings: StereoSettings) -> np.ndarray:
    """Lowest and highest height [m], tangent of the tilt's doubt, noise [px]."""
    tilt = math.tan(math.radians(settings.tilt_sigma))
    return np.array([settings.height_min, settings.height_max, tilt, settings.noise])


def _needed(camera: RectifiedCamera, settings: StereoSettings, disparities: int) -> np.ndarray:
    """(disparities + 1,) pixels that an obstacle must show in three columns, by disparity."""
    rows = LEAST_HEIGHT * camera.f_rows * np.arange(disparities + 1) / camera.depth_factor
    return np.maximum(3 * LEAST_SHARE * rows, settings.support)


def _inflation(margin: np.ndarray, support: np.ndarray) -> np.ndarray:
    """(W,) standard deviation of the disparities in units of `noise`."""
    distinct = AT_MARGIN / np.maximum(margin - 1.0, DISTINCT - 1.0)
    return np.sqrt(ALWAYS + distinct**2 + (AT_SUPPORT / np.maximum(support, 1)) ** 2)
