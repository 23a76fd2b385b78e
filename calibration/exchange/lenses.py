"""Lens models by their number of coefficients, and a lens told with fewer of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from calibration.field_of_view import angle_of
from calibration.rig import CameraModel, RigError, StereoRig


def from_opencv(coefficients: list[float], where: str) -> tuple[str, tuple[float, ...]]:
    """Our name and coefficients of an OpenCV lens: k1 k2 p1 p2 [k3 [k4 k5 k6 [...]]].

    Trailing zeros that change nothing are left out: a lens of zeros is `none`.

    Raises:
        RigError: a number of coefficients that OpenCV does not know; thin prism or tilt.
    """
    count = len(coefficients)
    if count not in (0, 4, 5, 8, 12, 14):
        raise RigError(f"{where}: {count} coefficients; expected 4, 5 or 8 (k1 k2 p1 p2 k3 ...)")
    if any(coefficients[8:]):
        raise RigError(
            f"{where}: a thin prism or tilted sensor (coefficients 9 to {count}) has no place in "
            "a rig: calibrate with at most 8"
        )
    if any(coefficients[5:]):
        return "rational", tuple(coefficients[:8])
    if any(coefficients[4:]):
        return "radtan", tuple(coefficients[:5])
    if any(coefficients):
        return "radtan", tuple(coefficients[:4])
    return "none", ()


def with_four_coefficients(rig: StereoRig, target: str) -> tuple[StereoRig, list[str]]:
    """The rig as a format tells it whose lenses have four coefficients at most; and a line for
    each camera that this changes. `target` names the format.

    Raises:
        RigError: a rational lens.
    """
    notes, cameras = [], {}
    for name, camera in (("left", rig.left), ("right", rig.right)):
        if camera.distortion_model == "rational":
            raise RigError(
                f"{target} has no rational lens ({name} camera): convert to ros or opencv, or "
                "calibrate with --lens radtan4"
            )
        if camera.distortion[4:] == (0.0,):
            camera = replace(camera, distortion=camera.distortion[:4])
        elif len(camera.distortion) == 5:
            camera, worst = without_k3(camera, rig.image_size)
            notes.append(
                f"{target} has no k3: k1 and k2 of the {name} camera are fitted anew, and points "
                f"move by up to {worst:.2g} px"
            )
        cameras[name] = camera
    return replace(rig, **cameras), notes


def without_k3(camera: CameraModel, size: tuple[int, int]) -> tuple[CameraModel, float]:
    """A radtan lens told as k1 k2 p1 p2, and how far its pixels then move at most [px].

    k1 and k2 are fitted anew to k1 r^2 + k2 r^4 + k3 r^6 out to the image's farthest corner, by
    linear least squares in which every pixel weighs alike.
    """
    k1, k2, p1, p2, k3 = camera.distortion
    r = np.linspace(0.0, _farthest(camera, size), 200)
    design = np.stack([r**3, r**5], axis=1)
    shift = k1 * r**3 + k2 * r**5 + k3 * r**7
    by_area = np.sqrt(r)
    fitted, *_ = np.linalg.lstsq(design * by_area[:, None], shift * by_area, rcond=None)
    worst = float(np.abs(design @ fitted - shift).max()) * max(camera.fx, camera.fy)
    return replace(camera, distortion=(float(fitted[0]), float(fitted[1]), p1, p2)), worst


def _farthest(camera: CameraModel, size: tuple[int, int]) -> float:
    """Undistorted distance of the image's farthest corner from the axis, in focal lengths."""
    u = 0.0 if 2 * camera.cx > size[0] - 1 else size[0] - 1.0
    v = 0.0 if 2 * camera.cy > size[1] - 1 else size[1] - 1.0
    angle = angle_of(camera, (u, v))
    if angle is None:  # the lens folds back before the corner: as far as without a lens
        return math.hypot((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    return math.tan(angle)
