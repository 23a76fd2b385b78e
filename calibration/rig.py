"""StereoRig: two camera models, the pose between them, and how the pair sits on the robot.

Frames. Camera: x right, y down, z forward (OpenCV). Robot: x forward, y left, z up, origin
midway between the wheels on the floor (REP 103). R, T carry a point from the left camera's
frame to the right's, as `cv2.stereoCalibrate` gives them: X_right = R X_left + T.
Angles are radians here and degrees in `rig.yaml`.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.yamlfile import YamlFileError, dump_yaml, read_yaml

FIELDS = ("beemap_rig", "image_size", "left", "right", "R", "T", "rectified", "mount")
# What makes a rig a calibrated one.
CALIBRATED = ("image_size", "left", "right", "R", "T")
# Sections of rig.yaml that other stages read, in the order in which they are written.
SECTIONS = ("encoders", "devices", "calibration")
CAMERA_FIELDS = ("fx", "fy", "cx", "cy", "distortion_model", "distortion")
MOUNT_FIELDS = ("height", "pitch", "roll", "yaw", "x", "y")
DISTORTION_SIZES = {"none": (0,), "radtan": (4, 5), "rational": (8,), "fisheye": (4,)}

# Columns: where the optical x, y, z axes of a level, forward-looking camera point on the robot.
LEVEL_ROBOT_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class RigError(ValueError):
    """A rig that cannot be used; the message names the file, the field and the remedy."""


@dataclass(frozen=True)
class CameraModel:
    """Pinhole camera with lens distortion; lengths in pixels."""

    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: str = "none"
    distortion: tuple[float, ...] = ()

    @property
    def K(self) -> np.ndarray:  # noqa: N802
        """Camera matrix (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def D(self) -> np.ndarray:  # noqa: N802
        """Distortion coefficients in OpenCV's order (n,); four zeros for a lens without any."""
        return np.array(self.distortion if self.distortion else (0.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Mount:
    """Pose of the raw left camera on the robot: metres and radians.

    yaw, pitch, roll turn about z, y, x in that order; pitch positive = nose down.
    """

    height: float = 0.30
    pitch: float = 0.0
    roll: float = 0.0
    yaw: float = 0.0
    x: float = 0.0
    y: float = 0.0

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) matrix that carries a direction in the camera's frame to the robot's."""
        cy, sy = math.cos(self.yaw), math.sin(self.yaw)
        cp, sp = math.cos(self.pitch), math.sin(self.pitch)
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        Rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        Rx = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        return Rz @ Ry @ Rx @ LEVEL_ROBOT_FROM_CAMERA

    @property
    def position(self) -> np.ndarray:
        """(3,) optical centre of the raw left camera in the robot's frame [m]."""
        return np.array([self.x, self.y, self.height])

    @staticmethod
    def from_pose(rotation: np.ndarray, position: np.ndarray) -> Mount:
        """Inverse of `rotation` and `position`: the mount with that camera pose on the robot."""
        M = np.asarray(rotation) @ LEVEL_ROBOT_FROM_CAMERA.T
        pitch = math.asin(float(np.clip(-M[2, 0], -1.0, 1.0)))
        return Mount(
            height=float(position[2]),
            pitch=pitch,
            roll=math.atan2(M[2, 1], M[2, 2]),
            yaw=math.atan2(M[1, 0], M[0, 0]),
            x=float(position[0]),
            y=float(position[1]),
        )


@dataclass(frozen=True, eq=False)
class StereoRig:
    """A calibrated camera pair. `image_size` is (width, height) in pixels, T in metres."""

    image_size: tuple[int, int]
    left: CameraModel
    right: CameraModel
    R: np.ndarray
    T: np.ndarray
    rectified: bool = False
    mount: Mount | None = None
    # What rig.yaml holds under the names in SECTIONS.
    sections: dict[str, Any] = field(default_factory=dict)

    @property
    def baseline(self) -> float:
        """Distance between the optical centres [m]."""
        return float(np.linalg.norm(self.T))

    def with_mount(self, mount: Mount) -> StereoRig:
        """The same cameras mounted otherwise."""
        return replace(self, mount=mount)

    def scaled(self, factor: float) -> StereoRig:
        """The same lenses behind images `factor` times as large (0.5 halves 640x480)."""
        width, height = (round(v * factor) for v in self.image_size)

        def scale(camera: CameraModel) -> CameraModel:
            # Pixel centres are at integers, so the image's edge lies at -0.5.
            return replace(
                camera,
                fx=camera.fx * factor,
                fy=camera.fy * factor,
                cx=(camera.cx + 0.5) * factor - 0.5,
                cy=(camera.cy + 0.5) * factor - 0.5,
            )

        return replace(
            self, image_size=(width, height), left=scale(self.left), right=scale(self.right)
        )


def minibee() -> StereoRig:
    """The stand-in for the paper's camera (design: 640x480, 66 deg, baseline 120 mm, 0.3 m up)."""
    left = CameraModel(492.8, 492.8, 319.5, 239.5, "none")
    mount = Mount(height=0.30, x=0.10, y=0.06)
    return StereoRig((640, 480), left, left, np.eye(3), np.array([-0.12, 0.0, 0.0]), False, mount)


def load_rig(path: str | Path) -> StereoRig:
    """Read `rig.yaml`, as `save_rig` writes it or as a person edits it.

    Raises:
        RigError: missing file, unknown, missing or ill-typed field; the message names it.
    """
    try:
        data = read_yaml(Path(path))
    except YamlFileError as error:
        raise RigError(str(error)) from None
    return rig_from_dict(data, str(path))


def rig_from_dict(data: Any, source: str) -> StereoRig:
    """A `StereoRig` from the parsed content of a rig file; `source` is named in errors.

    Raises:
        RigError: unknown, missing or ill-typed field.
    """
    check_version(data, source)
    check_keys(data, FIELDS + SECTIONS, source)
    if "devices" in data and not any(key in data for key in CALIBRATED):
        raise RigError(
            f"{source}: names devices and no calibration yet: run 'beemap calibrate capture'"
        )
    for key in CALIBRATED:
        if key not in data:
            raise RigError(f"{source}: field '{key}' is missing: run 'beemap calibrate cameras'")
    rectified = data.get("rectified", False)
    if not isinstance(rectified, bool):
        raise RigError(f"{source}: rectified: {rectified!r} is neither true nor false")
    R, T = _pose(data, source)
    return StereoRig(
        image_size=_image_size(data["image_size"], f"{source}: image_size"),
        left=_camera(data["left"], f"{source}: left"),
        right=_camera(data["right"], f"{source}: right"),
        R=R,
        T=T,
        rectified=rectified,
        mount=_mount(data.get("mount"), f"{source}: mount"),
        sections={key: data[key] for key in SECTIONS if data.get(key) is not None},
    )


def check_version(data: Any, source: str) -> None:
    """Raise RigError unless it is the content of a rig file of this version."""
    if not isinstance(data, dict) or "beemap_rig" not in data:
        raise RigError(f"{source}: not a rig file (no 'beemap_rig: 1' in it)")
    if data["beemap_rig"] != 1:
        raise RigError(f"{source}: beemap_rig is {data['beemap_rig']!r}; this version reads 1")


def check_keys(data: dict, known: tuple[str, ...], where: str) -> None:
    """Raise RigError where `data` has a field that is not known."""
    for key in data:
        if key not in known:
            raise RigError(f"{where}: unknown field '{key}' (known: {', '.join(known)})")


def save_rig(rig: StereoRig, path: str | Path) -> None:
    """Write `rig.yaml` with full precision; the file appears whole or not at all.

    Raises:
        RigError: it cannot be written.
    """
    path = Path(path)
    partial = path.with_name(path.name + ".part")
    try:
        partial.write_text(dump_yaml(rig_to_dict(rig)), encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise RigError(f"{path}: cannot be written ({error.strerror})") from None


def rig_to_dict(rig: StereoRig) -> dict[str, Any]:
    """The content of `rig.yaml`: plain numbers, angles in degrees."""

    def camera(c: CameraModel) -> dict[str, Any]:
        return {
            **{k: float(getattr(c, k)) for k in ("fx", "fy", "cx", "cy")},
            "distortion_model": c.distortion_model,
            "distortion": [float(v) for v in c.distortion],
        }

    data: dict[str, Any] = {
        "beemap_rig": 1,
        "image_size": [int(v) for v in rig.image_size],
        "left": camera(rig.left),
        "right": camera(rig.right),
        "R": np.asarray(rig.R, float).tolist(),
        "T": np.asarray(rig.T, float).tolist(),
        "rectified": bool(rig.rectified),
    }
    if rig.mount is not None:
        m = rig.mount
        angles = {k: math.degrees(getattr(m, k)) for k in ("pitch", "roll", "yaw")}
        data["mount"] = {"height": float(m.height), **angles, "x": float(m.x), "y": float(m.y)}
    return {**data, **{key: rig.sections[key] for key in SECTIONS if key in rig.sections}}


def _image_size(value: Any, where: str) -> tuple[int, int]:
    width, height = _numbers(value, (2,), where)
    if width != int(width) or height != int(height) or min(width, height) < 1:
        raise RigError(f"{where}: {value!r} must be whole pixels, as in [640, 480]")
    return int(width), int(height)


def _pose(data: dict, source: str) -> tuple[np.ndarray, np.ndarray]:
    R = _numbers(data["R"], (3, 3), f"{source}: R")
    T = _numbers(data["T"], (3,), f"{source}: T")
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-4) or np.linalg.det(R) < 0:
        raise RigError(f"{source}: R is not a rotation matrix: run 'beemap calibrate cameras'")
    baseline = math.hypot(*T)
    if not 1e-3 <= baseline <= 10.0:
        raise RigError(
            f"{source}: T has length {baseline:.4g} m; expected 0.001 to 10 m (is it in metres?)"
        )
    return R, T


def _camera(data: Any, where: str) -> CameraModel:
    if not isinstance(data, dict):
        raise RigError(f"{where}: {data!r} is not a camera (fields: {', '.join(CAMERA_FIELDS)})")
    check_keys(data, CAMERA_FIELDS, where)
    values = {}
    for key in ("fx", "fy", "cx", "cy"):
        if key not in data:
            raise RigError(f"{where}.{key}: missing (pixels)")
        values[key] = _number(data[key], f"{where}.{key}")
    for key in ("fx", "fy"):
        if values[key] <= 0:
            raise RigError(f"{where}.{key}: {values[key]} must be positive (pixels)")
    model = data.get("distortion_model", "none")
    if not isinstance(model, str) or model not in DISTORTION_SIZES:
        raise RigError(
            f"{where}.distortion_model: {model!r} unknown (known: {', '.join(DISTORTION_SIZES)})"
        )
    return CameraModel(
        **values,
        distortion_model=model,
        distortion=_distortion(data.get("distortion"), model, f"{where}.distortion"),
    )


def _distortion(value: Any, model: str, where: str) -> tuple[float, ...]:
    value = [] if value is None else value
    if not isinstance(value, list):
        raise RigError(f"{where}: {value!r} is not a list of numbers, as in [0.1, 0, 0, 0]")
    if len(value) not in DISTORTION_SIZES[model]:
        wanted = " or ".join(map(str, DISTORTION_SIZES[model]))
        raise RigError(f"{where}: {len(value)} numbers given, '{model}' takes {wanted}")
    return tuple(_number(v, f"{where}[{i}]") for i, v in enumerate(value))


def _mount(data: Any, where: str) -> Mount | None:
    if data is None:
        return None
    if not isinstance(data, dict):
        raise RigError(f"{where}: {data!r} is not a mount (fields: {', '.join(MOUNT_FIELDS)})")
    check_keys(data, MOUNT_FIELDS, where)
    if "height" not in data:
        raise RigError(f"{where}.height: missing (metres of the left camera above the floor)")
    values = {key: _number(value, f"{where}.{key}") for key, value in data.items()}
    if not 0 < values["height"] <= 10.0:
        raise RigError(
            f"{where}.height: {values['height']:g} m; expected 0 to 10 m (is it in metres?)"
        )
    if not -90 < values.get("pitch", 0.0) < 90:
        raise RigError(f"{where}.pitch: {values['pitch']:g} must lie between -90 and 90 degrees")
    for key in ("pitch", "roll", "yaw"):
        values[key] = math.radians(values.get(key, 0.0))
    return Mount(**values)


def _number(value: Any, where: str) -> float:
    # A whole number too long for a float is no measure of anything either.
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not -1e300 < value < 1e300:
        raise RigError(f"{where}: {value!r} is not a number")
    return float(value)


def _numbers(value: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    """An array of `shape` from nested lists of numbers."""
    length, *rest = shape
    if not isinstance(value, list) or len(value) != length:
        raise RigError(
            f"{where}: {value!r} is not a list of {length} {'lists' if rest else 'numbers'}"
        )
    if rest:
        return np.array([_numbers(v, tuple(rest), f"{where}[{i}]") for i, v in enumerate(value)])
    return np.array([_number(v, f"{where}[{i}]") for i, v in enumerate(value)])
