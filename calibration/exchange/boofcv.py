"""BoofCV's stereo.yaml, to read only: `rightToLeft` carries a point from the right frame to the
left; its lengths count the unit of the board's squares. Radial k1 k2 [k3], tangential t1 t2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.exchange.fields import (
    checked,
    field,
    image_size,
    numbers,
    pinhole,
    rotation,
    same_size,
    some_numbers,
)
from calibration.exchange.lenses import from_opencv
from calibration.exchange.opencv_storage import in_metres
from calibration.rig import CameraModel, RigError, StereoRig

MODEL = "stereo_camera"


def read(data: dict[str, Any], source: str, unit: float | None) -> StereoRig:
    """The rig. unit: what the translation counts [m]; None: metres.

    Raises:
        RigError: a field is missing or wrong, or the baseline is none in metres.
    """
    sides = (f"{source}: left", f"{source}: right")
    left, left_size = _camera(_section(data, "left", source), sides[0])
    right, right_size = _camera(_section(data, "right", source), sides[1])
    same_size(left_size, right_size, sides)
    pose = _section(data, "rightToLeft", source)
    where = f"{source}: rightToLeft"
    left_from_right = np.array(numbers(pose.get("rotation"), 9, f"{where}.rotation")).reshape(3, 3)
    R = rotation(left_from_right, f"{where}.rotation").T
    position = numbers([pose.get(axis) for axis in "xyz"], 3, f"{where}: x, y, z")
    T = in_metres(-R @ np.array(position), unit, where)
    return checked(StereoRig(left_size, left, right, R, T), source)


def _camera(data: dict[str, Any], where: str) -> tuple[CameraModel, tuple[int, int]]:
    view = _section(data, "pinhole", where)
    fx, skew, cx, fy, cy = numbers(
        [view.get(k) for k in ("fx", "skew", "cx", "fy", "cy")], 5, f"{where}: fx skew cx fy cy"
    )
    K = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    pinhole(K, where)
    size = image_size([view.get("width"), view.get("height")], f"{where}: width, height")
    lens = _section(data, "radial_tangential", where)
    radial = some_numbers(lens.get("radial"), f"{where}: radial")
    t1, t2 = numbers([lens.get("t1"), lens.get("t2")], 2, f"{where}: t1, t2")
    if len(radial) > 3:
        raise RigError(f"{where}: radial: {len(radial)} numbers; a rig holds three at most")
    k1, k2, k3 = (*radial, 0.0, 0.0, 0.0)[:3]
    return CameraModel(fx, fy, cx, cy, *from_opencv([k1, k2, t1, t2, k3], where)), size


def _section(data: dict[str, Any], name: str, where: str) -> dict[str, Any]:
    value = field(data, name, where)
    if not isinstance(value, dict):
        raise RigError(f"{where}: {name}: expected named values, got {value!r}")
    return value
