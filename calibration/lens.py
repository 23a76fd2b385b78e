"""How a lens maps a point before the camera to a pixel, its derivatives, and the way back.

Pinhole lenses (OpenCV's "radtan" and "rational"), with x = X/Z, y = Y/Z, r2 = x^2 + y^2:

    q  = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
    x' = q x + 2 p1 x y + p2 (r2 + 2 x^2)
    y' = q y + p1 (r2 + 2 y^2) + 2 p2 x y

Fisheye lenses (Kannala and Brandt 2006, OpenCV's `fisheye`), with R2 = X^2 + Y^2 and
theta = atan2(R, Z), which may exceed 90 degrees:

    t  = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
    x' = t X / R,   y' = t Y / R

The pixel is (fx x' + cx, fy y' + cy). A camera's intrinsics are the vector fx, fy, cx, cy followed
by the lens's coefficients in OpenCV's order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.rig import CameraModel

PINHOLE = ("fx", "fy", "cx", "cy")
RATIONAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
INVERSION_STEPS = 30
# Newton's step on the way back from a pixel, in units of the image plane at depth 1.
LONGEST_STEP = 0.5
LEAST_DEPTH = 1e-9


@dataclass(frozen=True)
class Lens:
    """A lens model.

    coefficients: names of its numbers in OpenCV's order; distortion_model: as in `rig.yaml`.
    distort: (coefficients (k,), X, Y, Z (...)) -> x', y' and their derivatives, as `_pinhole`.
    wide: the lens sees points beside and behind the camera.
    """

    name: str
    distortion_model: str
    coefficients: tuple[str, ...]
    distort: Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]
    wide: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a camera's intrinsics."""
        return PINHOLE + self.coefficients

    def extends(self, other: Lens) -> bool:
        """Whether the other lens is this one with some coefficients zero."""
        given = len(other.coefficients)
        return self.wide == other.wide and self.coefficients[:given] == other.coefficients

    def project(
        self, intrinsics: np.ndarray, points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pixels of points in the camera's frame, and the derivatives.

        Args:
            intrinsics: (c,) in the order of `names`; points: (..., 3) of any unit.

        Returns:
            pixels (..., 2), d pixels / d intrinsics (..., 2, c), d pixels / d points (..., 2, 3).
        """
        focal, centre = intrinsics[:2], intrinsics[2:4]
        flat, d_coefficients, d_points = self.distort(intrinsics[4:], points)
        d_intrinsics = np.zeros((*flat.shape, len(self.names)))
        d_intrinsics[..., 0, 0] = flat[..., 0]
        d_intrinsics[..., 1, 1] = flat[..., 1]
        d_intrinsics[..., 0, 2] = d_intrinsics[..., 1, 3] = 1.0
        d_intrinsics[..., 4:] = d_coefficients * focal[:, None]
        return flat * focal + centre, d_intrinsics, d_points * focal[:, None]

    def camera(self, intrinsics: np.ndarray) -> CameraModel:
        """The camera with these intrinsics (c,)."""
        fx, fy, cx, cy, *coefficients = (float(v) for v in intrinsics)
        return CameraModel(fx, fy, cx, cy, self.distortion_model, tuple(coefficients))

    def intrinsics(self, camera: CameraModel) -> np.ndarray:
        """(c,) of a camera that has this lens or a simpler one of the same kind."""
        values = np.zeros(len(self.names))
        values[:4] = camera.fx, camera.fy, camera.cx, camera.cy
        values[4 : 4 + len(camera.distortion)] = camera.distortion
        return values


def _pinhole(coefficients: np.ndarray, points: np.ndarray):
    """x', y' as (..., 2), their derivatives by the coefficients and by the points."""
    given = len(coefficients)
    k1, k2, p1, p2, k3, k4, k5, k6 = np.concatenate([coefficients, np.zeros(8 - given)])
    depth = points[..., 2]
    depth = np.where(np.abs(depth) < LEAST_DEPTH, LEAST_DEPTH, depth)
    x, y = points[..., 0] / depth, points[..., 1] / depth
    xx, xy, yy = x * x, x * y, y * y
    r2 = xx + yy
    below = 1.0 / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    q = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) * below
    # d q / d r2, twice.
    slope = (k1 + r2 * (2 * k2 + r2 * 3 * k3)) - q * (k4 + r2 * (2 * k5 + r2 * 3 * k6))
    slope *= 2.0 * below

    flat = np.empty((*x.shape, 2))
    flat[..., 0] = q * x + 2 * p1 * xy + p2 * (r2 + 2 * xx)
    flat[..., 1] = q * y + p1 * (r2 + 2 * yy) + 2 * p2 * xy

    d_coefficients = np.empty((*x.shape, 2, given))
    # Of x' and y' by k1, k2, k3: q x and q y grow with powers of r2.
    power = r2 * below
    for column in (0, 1, 4)[: 3 if given > 4 else 2]:
        d_coefficients[..., 0, column] = power * x
        d_coefficients[..., 1, column] = power * y
        power = power * r2
    d_coefficients[..., 0, 2] = d_coefficients[..., 1, 3] = 2 * xy
    d_coefficients[..., 1, 2] = r2 + 2 * yy
    d_coefficients[..., 0, 3] = r2 + 2 * xx
    if given > 5:
        d_coefficients[..., 5:8] = -q[..., None, None] * d_coefficients[..., [0, 1, 4]]

    d_xx = q + slope * xx + 2 * p1 * y + 6 * p2 * x
    d_xy = slope * xy + 2 * p1 * x + 2 * p2 * y
    d_yy = q + slope * yy + 6 * p1 * y + 2 * p2 * x
    d_points = np.empty((*x.shape, 2, 3))
    d_points[..., 0, 0] = d_xx / depth
    d_points[..., 0, 1] = d_points[..., 1, 0] = d_xy / depth
    d_points[..., 1, 1] = d_yy / depth
    d_points[..., 0, 2] = -(d_xx * x + d_xy * y) / depth
    d_points[..., 1, 2] = -(d_xy * x + d_yy * y) / depth
    return flat, d_coefficients, d_points


def _fisheye(coefficients: np.ndarray, points: np.ndarray):
    """As `_pinhole`, for a lens by its angle."""
    X, Y, Z = points[..., 0], points[..., 1], points[..., 2]
    distance2 = np.maximum(X * X + Y * Y + Z * Z, LEAST_DEPTH**2)
    beside = np.maximum(np.sqrt(X * X + Y * Y), 1e-9 * np.sqrt(distance2))
    theta = np.arctan2(beside, Z)
    powers = np.cumprod(np.broadcast_to((theta * theta)[..., None], (*theta.shape, 4)), axis=-1)
    t = theta * (1.0 + powers @ coefficients)
    slope = 1.0 + powers @ (coefficients * (3, 5, 7, 9))
    out = np.stack([X, Y], axis=-1) / beside[..., None]

    d_coefficients = out[..., None] * (theta[..., None] * powers)[..., None, :]
    # Outwards t changes by `slope` d theta; sideways the direction `out` turns.
    outward = slope * Z / distance2
    sideways = t / beside
    d_points = np.empty((*theta.shape, 2, 3))
    d_points[..., :2] = (
        (outward - sideways)[..., None, None] * out[..., :, None] * out[..., None, :]
    )
    d_points[..., 0, 0] += sideways
    d_points[..., 1, 1] += sideways
    d_points[..., 2] = -(slope * beside / distance2)[..., None] * out
    return t[..., None] * out, d_coefficients, d_points


LENSES = {
    lens.name: lens
    for lens in (
        Lens("radtan4", "radtan", RATIONAL[:4], _pinhole),
        Lens("radtan5", "radtan", RATIONAL[:5], _pinhole),
        Lens("rational", "rational", RATIONAL, _pinhole),
        Lens("fisheye", "fisheye", ("k1", "k2", "k3", "k4"), _fisheye, wide=True),
    )
}


def lens_of(camera: CameraModel) -> Lens:
    """The lens model of a camera; one without distortion has `radtan4` with zeros."""
    if camera.distortion_model == "radtan":
        return LENSES["radtan5" if len(camera.distortion) == 5 else "radtan4"]
    return LENSES.get(camera.distortion_model, LENSES["radtan4"])


def rays(camera: CameraModel, pixels: np.ndarray) -> np.ndarray:
    """Directions (n, 3) in the camera's frame, of length 1, that it sees at the pixels (n, 2).

    Newton's method on the lens's own derivatives: exact also where OpenCV's five rounds of
    substitution are not. A pixel beyond the lens's reach gets the ray at its limit.
    """
    lens = lens_of(camera)
    intrinsics = lens.intrinsics(camera)
    wanted = (np.asarray(pixels, float).reshape(-1, 2) - intrinsics[2:4]) / intrinsics[:2]
    if lens.wide:
        return _fisheye_rays(intrinsics[4:], wanted)
    flat = wanted.copy()
    points = np.ones((len(flat), 3))
    for _ in range(INVERSION_STEPS):
        points[:, :2] = flat
        found, _, d_points = lens.distort(intrinsics[4:], points)
        miss = wanted - found
        a, b, c, d = (d_points[:, i, j] for i in (0, 1) for j in (0, 1))
        det = a * d - b * c
        det = np.where(np.abs(det) < 1e-6, 1e-6, det)
        step = np.stack([d * miss[:, 0] - b * miss[:, 1], a * miss[:, 1] - c * miss[:, 0]], 1)
        step = np.clip(step / det[:, None], -LONGEST_STEP, LONGEST_STEP)
        flat += step
        if not flat.size or np.abs(step).max() < 1e-13:
            break
    points[:, :2] = flat
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def _fisheye_rays(coefficients: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    t = np.linalg.norm(wanted, axis=1)
    theta = np.minimum(t, np.pi)
    for _ in range(INVERSION_STEPS):
        powers = (theta * theta)[:, None] ** np.arange(1, 5)
        miss = t - theta * (1.0 + powers @ coefficients)
        slope = np.maximum(1.0 + powers @ (coefficients * (3, 5, 7, 9)), 1e-3)
        step = np.clip(miss / slope, -LONGEST_STEP, LONGEST_STEP)
        theta = np.clip(theta + step, 0.0, np.pi)
        if not step.size or np.abs(step).max() < 1e-13:
            break
    out = wanted / np.maximum(t, 1e-300)[:, None]
    return np.column_stack([np.sin(theta)[:, None] * out, np.cos(theta)])
