"""CameraInfo messages as the sheets that `calibration.exchange.camera_info` reads and writes."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.exchange import camera_info
from calibration.rig import RigError, StereoRig
from pipeline.errors import InputError


def rig_of(
    messages: tuple[Any, Any], topics: tuple[str, str], rectified: bool
) -> tuple[StereoRig, list[str]]:
    """The rig in the CameraInfo of the left and the right camera; and what had to be assumed.

    rectified: the images are those that these calibrations make, not the raw ones.

    Raises:
        InputError: they are no stereo calibration; it names the topic, the field and the remedy.
    """
    sheets = (_sheet(messages[0]), _sheet(messages[1]))
    try:
        if rectified:
            return camera_info.read_rectified(sheets, topics), []
        return camera_info.read(sheets, topics)
    except RigError as error:
        raise InputError(f"{error}, or give --rig rig.yaml") from None


def _sheet(message: Any) -> dict[str, Any]:
    # ROS 1 writes capital letters.
    K, D, R, P = (
        [float(v) for v in getattr(message, name, getattr(message, name.lower(), []))]
        for name in ("K", "D", "R", "P")
    )
    sheet: dict[str, Any] = {
        "image_width": int(message.width),
        "image_height": int(message.height),
        "camera_matrix": {"data": K},
        "distortion_model": message.distortion_model or None,
        "distortion_coefficients": {"data": D},
    }
    # All zeros: not calibrated.
    if any(R):
        sheet["rectification_matrix"] = {"data": R}
    if any(P):
        sheet["projection_matrix"] = {"data": P}
    return sheet


def info_fields(rig: StereoRig) -> tuple[dict[str, Any], dict[str, Any]]:
    """The fields of both cameras' CameraInfo, without the header, by ROS 2's names."""
    sheets, _ = camera_info.write(rig)
    left, right = (
        {
            "height": sheet["image_height"],
            "width": sheet["image_width"],
            "distortion_model": sheet["distortion_model"],
            "d": np.array(sheet["distortion_coefficients"]["data"]),
            "k": np.array(sheet["camera_matrix"]["data"]),
            "r": np.array(sheet["rectification_matrix"]["data"]),
            "p": np.array(sheet["projection_matrix"]["data"]),
        }
        for sheet in (sheets["left.yaml"], sheets["right.yaml"])
    )
    return left, right
