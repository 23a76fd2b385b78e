"""Scenes of a few textured rectangles, seen by any rig: pairs whose ranges can be told by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from calibration.rig import CameraModel, StereoRig
from stereo.pair import StereoPair
from stereo.scan import RangeScan
from tests.stereo_rigs import BASELINE, F, texture

TEXEL = 0.005  # m
BACKGROUND = 100.0
WINDOW = 10  # px
UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Sheet:
    """A rectangle on the robot's frame [m]: a corner, the directions (3,) of its sides, their
    lengths; grey (h, w) uint8, repeated over it in squares of TEXEL."""

    corner: tuple[float, float, float]
    along: tuple[float, float, float]
    up: tuple[float, float, float]
    size: tuple[float, float]
    grey: np.ndarray


@lru_cache(maxsize=64)
def grain(seed: int) -> np.ndarray:
    """Texture of 2 x 4 m."""
    return texture((400, 800), seed)


def facing(
    x: float,
    y: tuple[float, float] = (-8.0, 8.0),
    z: tuple[float, float] = (-4.0, 4.0),
    grey: np.ndarray | None = None,
    seed: int = 0,
) -> Sheet:
    """A rectangle that faces the robot `x` ahead of it, textured unless told otherwise."""
    grey = grain(seed) if grey is None else grey
    return Sheet((x, y[0], z[0]), (0.0, 1.0, 0.0), UP, (y[1] - y[0], z[1] - z[0]), grey)


def see(
    rig: StereoRig,
    sheets: Sequence[Sheet],
    noise: float = 0.0,
    seed: int = 0,
    finer: int = 1,
) -> StereoPair:
    """The raw pair, with normal noise of so many grey levels, other in every pixel; each the mean
    of `finer` squared rays, for what is seen at a flat angle."""
    rng = np.random.default_rng(seed)
    fine = rig.scaled(finer)
    images = []
    for camera, R, T in ((fine.left, np.eye(3), np.zeros(3)), (fine.right, rig.R, rig.T)):
        exact = cv2.resize(
            _image(fine, camera, R, T, sheets), rig.image_size, interpolation=cv2.INTER_AREA
        )
        noisy = exact + noise * rng.normal(size=exact.shape)
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return StereoPair(0, *images)


def well_inside(scan: RangeScan, truth: np.ndarray) -> np.ndarray:
    """Columns (n,) that lie some way inside both images of `straight_rig`, where a windowful of
    what is at these ranges can be compared."""
    u = 159.5 - F * np.tan(scan.bearing)
    return (u - F * BASELINE / (truth * np.cos(scan.bearing)) > WINDOW) & (u < 319 - WINDOW)


def _image(
    rig: StereoRig, camera: CameraModel, R: np.ndarray, T: np.ndarray, sheets: Sequence[Sheet]
) -> np.ndarray:
    assert rig.mount is not None
    shape = rig.image_size[::-1]
    rays = _rays(camera, shape) @ R @ rig.mount.rotation.T
    centre = rig.mount.position - rig.mount.rotation @ R.T @ T
    image = np.full(len(rays), BACKGROUND)
    nearest = np.full(len(rays), np.inf)
    for sheet in sheets:
        along, up = np.array(sheet.along), np.array(sheet.up)
        normal = np.cross(along, up)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (np.array(sheet.corner) - centre) @ normal / (rays @ normal)
            hit = centre + rays * t[:, None] - sheet.corner
            a, b = hit @ along, hit @ up
            width, height = sheet.size
            here = (t > 0) & (t < nearest) & (a >= 0) & (a < width) & (b >= 0) & (b < height)
        at = np.stack([a[here], b[here]], axis=1) / TEXEL % sheet.grey.shape[::-1]
        image[here] = _sampled(sheet.grey, at)
        nearest[here] = t[here]
    return image.reshape(shape)


@lru_cache(maxsize=8)
def _rays(camera: CameraModel, shape: tuple[int, ...]) -> np.ndarray:
    """(H W, 3) directions of unit depth in the camera's frame."""
    v, u = np.indices(shape).astype(np.float64)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[:, None]
    undistort = (
        cv2.fisheye.undistortPoints if camera.distortion_model == "fisheye" else cv2.undistortPoints
    )
    flat = np.asarray(undistort(pixels, camera.K, camera.D)).reshape(-1, 2)
    return np.column_stack([flat, np.ones(len(flat))])


def _sampled(grey: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Grey levels (n,) between the texels at columns and rows (n, 2), which wrap around."""
    h, w = grey.shape
    u, v = np.floor(at).astype(np.int32).T
    s, t = at.T - (u, v)
    u, v, right, below = u % w, v % h, (u + 1) % w, (v + 1) % h
    upper = (1 - s) * grey[v, u] + s * grey[v, right]
    return (1 - t) * upper + t * ((1 - s) * grey[below, u] + s * grey[below, right])
