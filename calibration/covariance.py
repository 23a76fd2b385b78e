"""How far the corners' noise leaves every parameter of the cameras open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.bundle import POSE, Geometry, Observations, linearise, normal_equations, reduced
from calibration.lens import Lens

BETWEEN = (
    *(f"rotation.{axis}" for axis in "xyz"),
    *(f"translation.{axis}" for axis in "xyz"),
)
# The least eigenvalue, of equations scaled to a unit diagonal, that is more than rounding.
LEAST_EIGENVALUE = 1e-14
# Corners are never better than this: what a view cannot tell at this noise it cannot tell.
PLAUSIBLE_NOISE = 0.1  # px


@dataclass(frozen=True, eq=False)
class CameraCovariance:
    """names (p,): "left.fx", ..., "right.k1", ..., "rotation.x" [rad], "translation.x" [m];
    matrix (p, p): in these units; information: (p, p) its inverse at a noise of 1 px."""

    names: tuple[str, ...]
    matrix: np.ndarray
    information: np.ndarray


def camera_covariance(
    lens: Lens, seen: Observations, geometry: Geometry, kept: np.ndarray
) -> CameraCovariance:
    """Covariance of both cameras' parameters, whatever the boards' poses (marginal).

    The turn between the cameras is a small one about the right camera's own axes. The noise is
    that of the kept residuals: their sum of squares over the degrees of freedom.

    Args:
        kept: (2, v, m) the corners that the geometry was solved from.

    Raises:
        numpy.linalg.LinAlgError: the corners do not determine the cameras.
    """
    used = np.flatnonzero(kept.any(axis=(0, 2)))
    counted = replace(seen, seen=kept).views(used)
    residuals, derivatives = linearise(lens, counted, geometry.views(used))
    equations = normal_equations(derivatives, residuals, counted.seen.astype(float))
    information, _ = reduced(equations)
    freedom = 2 * np.count_nonzero(kept) - len(information) - POSE * len(used)
    if freedom < 1:
        raise np.linalg.LinAlgError("more parameters than corners")
    variance = float(np.sum(residuals**2)) / freedom
    names = tuple(f"{side}.{name}" for side in ("left", "right") for name in lens.names) + BETWEEN
    return CameraCovariance(names, variance * _inverse(information), information)


def focal_doubt(geometry: Geometry, information: np.ndarray) -> float:
    """The largest relative standard deviation of a focal length at a plausible noise."""
    cameras, count = geometry.intrinsics.shape
    sigma = PLAUSIBLE_NOISE * np.sqrt(np.diag(_inverse(information)))
    focal = np.array([i * count + axis for i in range(cameras) for axis in (0, 1)])
    return float(np.max(sigma[focal] / np.abs(geometry.intrinsics[:, :2].ravel())))


def _inverse(information: np.ndarray) -> np.ndarray:
    """Of a symmetric matrix with entries of very different size."""
    diagonal = np.diag(information)
    if not np.isfinite(information).all() or (diagonal <= 0).any():
        raise np.linalg.LinAlgError("a parameter without any corner")
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    if values[0] < LEAST_EIGENVALUE:
        raise np.linalg.LinAlgError("singular")
    return scale[:, None] * ((vectors / values) @ vectors.T) * scale
