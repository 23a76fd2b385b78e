"""Fields of other programs' files: numbers, matrices, sizes; a wrong one is named in one line."""

from __future__ import annotations

import reprlib
from typing import Any

import numpy as np

from calibration.rig import RigError, StereoRig, rig_from_dict, rig_to_dict

# Text files round: camera_info has eight decimals at best, often five.
ROTATION_TOLERANCE = 1e-3


def field(data: dict[str, Any], name: str, source: str) -> Any:
    """The value of a field that must be there."""
    if data.get(name) is None:
        raise RigError(f"{source}: field '{name}' is missing")
    return data[name]


def numbers(value: Any, count: int, where: str) -> list[float]:
    """`count` finite numbers from a list; `where` names file and field in the error."""
    if not isinstance(value, list) or len(value) != count or not all(map(_is_number, value)):
        raise RigError(f"{where}: expected {count} numbers, got {reprlib.repr(value)}")
    return [float(v) for v in value]


def some_numbers(value: Any, where: str) -> list[float]:
    """A list of finite numbers, of any length."""
    if not isinstance(value, list):
        raise RigError(f"{where}: expected a list of numbers, got {reprlib.repr(value)}")
    return numbers(value, len(value), where)


def matrix(data: dict[str, Any], name: str, shape: tuple[int, int], source: str) -> np.ndarray:
    """A matrix written as `{rows: 3, cols: 3, data: [9 numbers, row by row]}`.

    A vector may stand or lie: of `rows` and `cols` only the product counts.
    """
    content = block(data, name, source)
    return np.array(numbers(content, shape[0] * shape[1], f"{source}: {name}.data")).reshape(shape)


def block(data: dict[str, Any], name: str, source: str) -> Any:
    """The `data` of `{rows: , cols: , data: }`."""
    value = field(data, name, source)
    if not isinstance(value, dict) or "data" not in value:
        raise RigError(
            f"{source}: {name}: expected rows, cols and data of a matrix, got {reprlib.repr(value)}"
        )
    return value["data"]


def rows_of(value: Any, shape: tuple[int, int], where: str) -> np.ndarray:
    """A matrix written as a list of its rows."""
    if not isinstance(value, list) or len(value) != shape[0]:
        raise RigError(
            f"{where}: expected {shape[0]} rows of {shape[1]}, got {reprlib.repr(value)}"
        )
    return np.array([numbers(row, shape[1], f"{where}[{i}]") for i, row in enumerate(value)])


def image_size(value: Any, where: str) -> tuple[int, int]:
    """(width, height) in whole pixels from a list of both."""
    width, height = numbers(value, 2, where)
    if min(width, height) < 1 or width != int(width) or height != int(height):
        raise RigError(f"{where}: {value!r} must be whole pixels, as in [640, 480]")
    return int(width), int(height)


def same_size(left: tuple[int, int], right: tuple[int, int], sources: tuple[str, str]) -> None:
    """Refuse two cameras with images of different sizes: a rig has one size."""
    if left != right:
        raise RigError(
            f"{sources[1]}: images of {right[0]}x{right[1]}, those of {sources[0]} are "
            f"{left[0]}x{left[1]}: calibrate both cameras at one size"
        )


def pinhole(K: np.ndarray, where: str) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of a camera matrix (3, 3)."""
    if abs(K[0, 1]) > 1e-9 * abs(K[0, 0]):
        raise RigError(f"{where}: skew {K[0, 1]:g}: calibrate without skew, which is 0 in a rig")
    if not np.array_equal(K[[1, 2, 2, 2], [0, 0, 1, 2]], [0.0, 0.0, 0.0, 1.0]):
        raise RigError(f"{where}: is no camera matrix [fx 0 cx; 0 fy cy; 0 0 1]")
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def rotation(R: np.ndarray, where: str) -> np.ndarray:
    """R (3, 3), which must be a rotation."""
    if not np.allclose(R @ R.T, np.eye(3), atol=ROTATION_TOLERANCE) or np.linalg.det(R) < 0.0:
        raise RigError(f"{where}: is no rotation matrix")
    return R


def pose(M: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) of a homogeneous matrix (4, 4)."""
    if not np.array_equal(M[3], [0.0, 0.0, 0.0, 1.0]):
        raise RigError(f"{where}: its last row is {M[3].tolist()}; a pose has [0, 0, 0, 1]")
    return rotation(M[:3, :3], f"{where}: its upper left 3x3 block"), M[:3, 3]


def checked(rig: StereoRig, source: str) -> StereoRig:
    """The rig, after the checks that a rig file of ours goes through.

    Raises:
        RigError: a focal length, the baseline or the height of the mount cannot be.
    """
    return rig_from_dict(rig_to_dict(rig), f"{source} as a rig")


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and -1e300 < value < 1e300
    )
