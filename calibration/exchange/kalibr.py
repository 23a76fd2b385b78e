"""Kalibr's camchain.yaml: both cameras and `T_cn_cnm1`, which carries cam0's frame to cam1's.

Source: Kalibr's wiki, "Yaml formats".
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.exchange.fields import (
    checked,
    field,
    image_size,
    numbers,
    pose,
    rows_of,
    same_size,
)
from calibration.exchange.lenses import with_four_coefficients
from calibration.rig import CameraModel, RigError, StereoRig

LENSES = {"radtan": "radtan", "equidistant": "fisheye", "none": "none"}  # Kalibr's names, ours
TOLD = {ours: kalibr for kalibr, ours in LENSES.items()}
REMEDY = "calibrate with --models pinhole-radtan pinhole-radtan, or pinhole-equi for a fisheye"


def read(chain: dict[str, Any], source: str) -> tuple[StereoRig, list[str]]:
    """The rig of cam0 (left) and cam1; and what is passed over.

    Raises:
        RigError: a field is missing or wrong, or a camera model that a rig cannot hold.
    """
    sheets = [field(chain, name, source) for name in ("cam0", "cam1")]
    names = [f"{source}: cam0", f"{source}: cam1"]
    for sheet, name in zip(sheets, names, strict=True):
        if not isinstance(sheet, dict):
            raise RigError(f"{name}: {sheet!r} is not a camera")
    left, right = (_camera(s, name) for s, name in zip(sheets, names, strict=True))
    sizes = [
        image_size(s.get("resolution"), f"{name}.resolution")
        for s, name in zip(sheets, names, strict=True)
    ]
    same_size(sizes[0], sizes[1], (names[0], names[1]))
    where = f"{names[1]}.T_cn_cnm1"
    if sheets[1].get("T_cn_cnm1") is None:
        raise RigError(f"{where}: missing: calibrate both cameras together in Kalibr")
    R, T = pose(rows_of(sheets[1]["T_cn_cnm1"], (4, 4), where), where)
    rig = StereoRig(sizes[0], left, right, R, T)
    notes = [f"{source}: {key} is not read" for key in chain if key not in ("cam0", "cam1")]
    if any("T_cam_imu" in s for s in sheets):
        notes.append(f"{source}: T_cam_imu is not read: a rig holds no IMU")
    return checked(rig, source), notes


def write(rig: StereoRig) -> tuple[dict[str, Any], list[str]]:
    """Content of camchain.yaml; and what does not fit.

    Raises:
        RigError: a lens that Kalibr has no model for.
    """
    rig, notes = with_four_coefficients(rig, "Kalibr's camchain")
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rig.R, rig.T
    cam0, cam1 = (
        _sheet(rig, camera, number) for number, camera in enumerate((rig.left, rig.right))
    )
    return {"cam0": cam0, "cam1": {"T_cn_cnm1": transform.tolist(), **cam1}}, notes


def _camera(sheet: dict[str, Any], where: str) -> CameraModel:
    model = field(sheet, "camera_model", where)
    if model != "pinhole":
        raise RigError(f"{where}.camera_model: {model!r} is not known here (pinhole): {REMEDY}")
    lens = sheet.get("distortion_model", "none")
    if not isinstance(lens, str) or lens not in LENSES:
        raise RigError(
            f"{where}.distortion_model: {lens!r} is not known here ({', '.join(LENSES)}): {REMEDY}"
        )
    fx, fy, cx, cy = numbers(sheet.get("intrinsics"), 4, f"{where}.intrinsics")
    count = 0 if lens == "none" else 4
    D = numbers(sheet.get("distortion_coeffs") or [], count, f"{where}.distortion_coeffs")
    return CameraModel(fx, fy, cx, cy, LENSES[lens], tuple(D))


def _sheet(rig: StereoRig, camera: CameraModel, number: int) -> dict[str, Any]:
    return {
        "cam_overlaps": [1 - number],
        "camera_model": "pinhole",
        "intrinsics": [float(v) for v in (camera.fx, camera.fy, camera.cx, camera.cy)],
        "distortion_model": TOLD[camera.distortion_model],
        "distortion_coeffs": [float(v) for v in camera.distortion],
        "resolution": [int(v) for v in rig.image_size],
        "rostopic": f"/cam{number}/image_raw",
    }
