"""ROS camera_info: one YAML file a camera, as `camera_calibration` writes left.yaml, right.yaml.

There is no pose between the cameras in it. With the rectifying rotations R1, R2 and the right
camera's projection P2 = [K' | (-f B, 0, 0)] it is R = R2^T R1, T = R2^T (P2[0,3] / f, 0, 0).
Source: sensor_msgs/CameraInfo.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.exchange.fields import (
    block,
    checked,
    image_size,
    matrix,
    numbers,
    pinhole,
    rotation,
    same_size,
    some_numbers,
)
from calibration.exchange.lenses import from_opencv
from calibration.exchange.rectification import rectification
from calibration.rig import CameraModel, RigError, StereoRig

# Numbers that plumb_bob and rational_polynomial take.
SIZES = {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14)}
FISHEYE = ("equidistant", "fisheye")


def read(
    sheets: tuple[dict[str, Any], dict[str, Any]], sources: tuple[str, str]
) -> tuple[StereoRig, list[str]]:
    """The rig in the sheets of the left and the right camera; and what had to be assumed.

    Raises:
        RigError: a field is missing or wrong; the sheets are those of single cameras.
    """
    notes: list[str] = []
    left, right = (_camera(s, source, notes) for s, source in zip(sheets, sources, strict=True))
    size = _size(sheets, sources)
    P1, P2, offset = _projections(sheets, sources)
    R1, R2 = (
        rotation(matrix(s, "rectification_matrix", (3, 3), f), f"{f}: rectification_matrix")
        for s, f in zip(sheets, sources, strict=True)
    )
    rig = StereoRig(
        size,
        left,
        right,
        R2.T @ R1,
        R2.T @ offset,
        rectified=_is_rectified((left, right), (R1, R2), (P1, P2)),
    )
    return checked(rig, f"{sources[0]} and {sources[1]}"), notes


def read_rectified(
    sheets: tuple[dict[str, Any], dict[str, Any]], sources: tuple[str, str]
) -> StereoRig:
    """The rig of the rectified images that these sheets make (image_rect): projections only.

    Raises:
        RigError: as `read`.
    """
    P1, P2, offset = _projections(sheets, sources)
    left, right = (
        CameraModel(*pinhole(P[:, :3], f"{source}: projection_matrix"))
        for P, source in zip((P1, P2), sources, strict=True)
    )
    rig = StereoRig(_size(sheets, sources), left, right, np.eye(3), offset, rectified=True)
    return checked(rig, f"{sources[0]} and {sources[1]}")


def write(rig: StereoRig) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Content of left.yaml and right.yaml in full precision; no note: all of it fits."""
    made = rectification(rig)
    cameras = {
        "left": (rig.left, made.R1, made.P1),
        "right": (rig.right, made.R2, made.P2),
    }
    return {f"{name}.yaml": _sheet(name, rig, *c) for name, c in cameras.items()}, []


def _size(
    sheets: tuple[dict[str, Any], dict[str, Any]], sources: tuple[str, str]
) -> tuple[int, int]:
    left, right = (
        image_size([s.get("image_width"), s.get("image_height")], f"{f}: image_width, image_height")
        for s, f in zip(sheets, sources, strict=True)
    )
    same_size(left, right, sources)
    return left


def _projections(
    sheets: tuple[dict[str, Any], dict[str, Any]], sources: tuple[str, str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P1, P2 (3, 4); where the left camera's centre stands for the rectified right one (3,) [m]."""
    for sheet, source in zip(sheets, sources, strict=True):
        if sheet.get("rectification_matrix") is None or sheet.get("projection_matrix") is None:
            raise RigError(
                f"{source}: without rectification_matrix and projection_matrix the pose between "
                "the cameras is not known: calibrate them as a stereo pair"
            )
    P1, P2 = (_projection(s, f) for s, f in zip(sheets, sources, strict=True))
    offset = P2[:2, 3] / P2[[0, 1], [0, 1]] - P1[:2, 3] / P1[[0, 1], [0, 1]]
    if not offset.any():
        raise RigError(
            f"{sources[1]}: projection_matrix[3] is 0 as in {sources[0]}: these are single "
            "cameras: calibrate them as a stereo pair"
        )
    if P1[:2, 3].any() and not P2[:2, 3].any():
        raise RigError(
            f"{sources[0]}: projection_matrix[3] is {P1[0, 3]:g}, in {sources[1]} it is 0: give "
            "the left camera's file first"
        )
    return P1, P2, np.array([*offset, 0.0])


def _camera(sheet: dict[str, Any], source: str, notes: list[str]) -> CameraModel:
    K = matrix(sheet, "camera_matrix", (3, 3), source)
    fx, fy, cx, cy = pinhole(K, f"{source}: camera_matrix")
    model = sheet.get("distortion_model")
    if not model:
        model = "plumb_bob"
        notes.append(f"{source}: no distortion_model: taken as plumb_bob (k1 k2 p1 p2 k3)")
    where = f"{source}: distortion_coefficients.data"
    D = some_numbers(block(sheet, "distortion_coefficients", source), where)
    if model in FISHEYE:
        return CameraModel(fx, fy, cx, cy, "fisheye", tuple(numbers(D, 4, where)))
    if not isinstance(model, str) or model not in SIZES:
        raise RigError(
            f"{source}: distortion_model {model!r} is not known ({', '.join(SIZES)}, equidistant)"
        )
    if any(D) and len(D) not in SIZES[model]:
        raise RigError(f"{where}: {len(D)} numbers given, '{model}' takes {SIZES[model][-1]}")
    return CameraModel(fx, fy, cx, cy, *from_opencv(D if any(D) else [], where))


def _projection(sheet: dict[str, Any], source: str) -> np.ndarray:
    P = matrix(sheet, "projection_matrix", (3, 4), source)
    if not (P[0, 0] > 0.0 and P[1, 1] > 0.0):
        raise RigError(
            f"{source}: projection_matrix: focal lengths {P[0, 0]:g}, {P[1, 1]:g} must be "
            "positive: calibrate the cameras as a stereo pair"
        )
    return P


def _is_rectified(cameras, rotations, projections) -> bool:
    """Whether the images need no rectification: no lens, no turn, nothing re-projected."""
    return all(
        c.distortion_model == "none"
        and np.array_equal(R, np.eye(3))
        and np.array_equal(P[:, :3], c.K)
        for c, R, P in zip(cameras, rotations, projections, strict=True)
    )


def _sheet(
    name: str, rig: StereoRig, camera: CameraModel, R: np.ndarray, P: np.ndarray
) -> dict[str, Any]:
    model, coefficients = _told(camera)
    return {
        "image_width": int(rig.image_size[0]),
        "image_height": int(rig.image_size[1]),
        "camera_name": name,
        "camera_matrix": _block(camera.K),
        "distortion_model": model,
        "distortion_coefficients": _block(np.array([coefficients])),
        "rectification_matrix": _block(R),
        "projection_matrix": _block(P),
    }


def _told(camera: CameraModel) -> tuple[str, list[float]]:
    coefficients = list(camera.distortion)
    if camera.distortion_model == "fisheye":
        return "equidistant", coefficients
    if camera.distortion_model == "rational":
        return "rational_polynomial", coefficients
    return "plumb_bob", (coefficients + [0.0] * 5)[:5]


def _block(M: np.ndarray) -> dict[str, Any]:
    return {"rows": M.shape[0], "cols": M.shape[1], "data": [float(v) for v in M.ravel()]}
