"""EuRoC/ASL sensor.yaml: one file a camera, `T_BS` carries the camera's frame to the body's.

The body is the robot where wheel ticks (`odom0`) are recorded: then T_BS holds the mount.
Elsewhere, as in EuRoC itself, it is an IMU and says nothing about the floor.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.exchange.fields import (
    checked,
    image_size,
    matrix,
    numbers,
    pose,
    same_size,
)
from calibration.exchange.lenses import with_four_coefficients
from calibration.rig import CameraModel, Mount, RigError, StereoRig

# ASL's names of lens models, and ours.
LENSES = {"radial-tangential": "radtan", "equidistant": "fisheye", "none": "none"}
TOLD = {ours: asl for asl, ours in LENSES.items()}


def read(
    sheets: tuple[dict[str, Any], dict[str, Any]],
    sources: tuple[str, str],
    body_is_robot: bool,
) -> StereoRig:
    """The rig in the content of cam0/sensor.yaml (left) and cam1/sensor.yaml.

    Raises:
        RigError: a field is missing or wrong.
    """
    left, right = (_camera(s, source) for s, source in zip(sheets, sources, strict=True))
    (left_turn, left_position), (right_turn, right_position) = (
        pose(matrix(s, "T_BS", (4, 4), source), f"{source}: T_BS.data")
        for s, source in zip(sheets, sources, strict=True)
    )
    sizes = [
        image_size(s.get("resolution"), f"{f}: resolution")
        for s, f in zip(sheets, sources, strict=True)
    ]
    same_size(sizes[0], sizes[1], sources)
    right_from_body = np.linalg.inv(right_turn)
    rig = StereoRig(
        sizes[0],
        left,
        right,
        right_from_body @ left_turn,
        right_from_body @ (left_position - right_position),
        mount=Mount.from_pose(left_turn, left_position) if body_is_robot else None,
    )
    return checked(rig, f"{sources[0]} and {sources[1]}")


def write(rig: StereoRig) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Content of cam0/sensor.yaml and cam1/sensor.yaml; and what does not fit.

    Raises:
        RigError: a lens that the layout has no name for.
    """
    rig, notes = with_four_coefficients(rig, "EuRoC's sensor.yaml")
    sheets = camera_sheets(rig)
    return {f"{name}/sensor.yaml": sheet for name, sheet in sheets.items()}, notes


def camera_sheets(rig: StereoRig, rate: float | None = None) -> dict[str, dict[str, Any]]:
    """What stands in the sensor.yaml of `cam0` and of `cam1`; the body is the robot.

    rate: pairs a second, where it is known.

    Raises:
        RigError: a distortion that the layout has no name for.
    """
    mount = rig.mount or Mount()
    known = "" if rig.mount else " (mount not known: level, 0.3 m up)"
    rotation = mount.rotation @ rig.R.T
    poses = {
        "cam0": (mount.rotation, mount.position),
        "cam1": (rotation, mount.position - rotation @ rig.T),
    }
    cameras = {"cam0": ("left", rig.left), "cam1": ("right", rig.right)}
    return {
        name: {
            "sensor_type": "camera",
            "comment": f"{side} camera; body = robot: x forward, y left, z up{known}",
            "T_BS": {"cols": 4, "rows": 4, "data": _transform(*poses[name])},
            **({} if rate is None else {"rate_hz": float(rate)}),
            "resolution": [int(v) for v in rig.image_size],
            "camera_model": "pinhole",
            "intrinsics": [float(v) for v in (camera.fx, camera.fy, camera.cx, camera.cy)],
            **_distortion(camera),
        }
        for name, (side, camera) in cameras.items()
    }


def _camera(sheet: dict[str, Any], source: str) -> CameraModel:
    fx, fy, cx, cy = numbers(sheet.get("intrinsics"), 4, f"{source}: intrinsics")
    name = sheet.get("distortion_model", "none")
    if not isinstance(name, str) or name not in LENSES:
        raise RigError(
            f"{source}: distortion_model '{name}' is not known ({', '.join(sorted(LENSES))})"
        )
    where = f"{source}: distortion_coefficients"
    D = () if name == "none" else numbers(sheet.get("distortion_coefficients"), 4, where)
    return CameraModel(fx, fy, cx, cy, LENSES[name], tuple(D))


def _transform(rotation: np.ndarray, position: np.ndarray) -> list[float]:
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = position
    return [float(v) for v in transform.ravel()]


def _distortion(camera: CameraModel) -> dict[str, Any]:
    coefficients = [float(v) for v in camera.distortion]
    if camera.distortion_model == "radtan" and coefficients[4:] == [0.0]:
        coefficients = coefficients[:4]
    if camera.distortion_model not in TOLD or len(coefficients) > 4:
        raise RigError(
            f"rig: distortion '{camera.distortion_model}' with {len(coefficients)} coefficients "
            "does not fit the ASL layout: calibrate with radtan (k1 k2 p1 p2) or fisheye"
        )
    return {
        "distortion_model": TOLD[camera.distortion_model],
        "distortion_coefficients": coefficients,
    }
