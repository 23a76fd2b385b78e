"""How much a camera sees, the distortion of its lens counted."""

from __future__ import annotations

import math

import numpy as np

from calibration.lens import lens_of
from calibration.rig import CameraModel

STEP = 1e-3  # of the angles that are tried [rad]
# A pinhole sees less than 180 degrees.
PINHOLE_LIMIT = math.radians(89.5)


def angle_of(camera: CameraModel, pixel: tuple[float, float]) -> float | None:
    """Angle [rad] from the optical axis to the ray that is seen at a pixel (u, v).

    None where the lens model folds back before it gets there.
    """
    lens = lens_of(camera)
    x, y = (pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy
    radius = math.hypot(x, y)
    towards = np.array([x, y]) / radius if radius > 0.0 else np.array([1.0, 0.0])
    angles = np.arange(0.0, math.pi if lens.wide else PINHOLE_LIMIT, STEP)
    fan = np.column_stack([np.sin(angles)[:, None] * towards, np.cos(angles)])
    pixels, _, _ = lens.project(lens.intrinsics(camera), fan)
    radii = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy] @ towards
    falling = np.flatnonzero(np.diff(radii) <= 0.0)
    until = int(falling[0]) + 1 if falling.size else len(radii)
    if radius > radii[until - 1]:
        return None
    return float(np.interp(radius, radii[:until], angles[:until]))


def field_of_view(camera: CameraModel, size: tuple[int, int]) -> tuple[float | None, float | None]:
    """Angles [rad] that an image of `size` (width, height) sees across and down, along the row
    and the column of its principal point; None where the lens model folds back before an edge."""
    width, height = size
    return (
        _between(camera, (-0.5, camera.cy), (width - 0.5, camera.cy)),
        _between(camera, (camera.cx, -0.5), (camera.cx, height - 0.5)),
    )


def _between(
    camera: CameraModel, first: tuple[float, float], last: tuple[float, float]
) -> float | None:
    """The angle from one edge to the other; the principal point need not lie between them."""
    angles = [angle_of(camera, pixel) for pixel in (first, last)]
    signs = [1.0 if p[0] + p[1] > camera.cx + camera.cy else -1.0 for p in (first, last)]
    if angles[0] is None or angles[1] is None:
        return None
    return signs[1] * angles[1] - signs[0] * angles[0]
