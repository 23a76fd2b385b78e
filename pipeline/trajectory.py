"""Paths as TUM files: `timestamp tx ty tz qx qy qz qw`, seconds and metres, one pose a line."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.textfiles import read_lines

DECIMAL = re.compile(r"([+-]?)([0-9]{1,18})\.([0-9]+)")


@dataclass(frozen=True)
class Trajectory:
    """stamps: (n,) int64 ns; poses: (n, 3) x m, y m, theta rad."""

    stamps: np.ndarray
    poses: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps)


def distance_travelled(poses: np.ndarray) -> np.ndarray:
    """Distance (n,) travelled up to each of the poses (n, 3) [m]."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write the planar path with z = 0; stamps keep their nanoseconds."""
    lines = []
    for stamp, (x, y, theta) in zip(trajectory.stamps.tolist(), trajectory.poses, strict=True):
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        qz, qw = np.sin(theta / 2.0), np.cos(theta / 2.0)
        lines.append(f"{seconds}.{nanoseconds:09d} {x:.6f} {y:.6f} 0 0 0 {qz:.9f} {qw:.9f}\n")
    Path(path).write_text("".join(lines), encoding="ascii")


def read_tum(path: Path) -> Trajectory:
    """Read a TUM file; comments (#) and blank lines are passed over.

    The heading is the yaw of the quaternion. Raises InputError naming file and line.
    """
    stamps, poses = [], []
    for number, line in enumerate(read_lines(Path(path)), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        fields = line.replace(",", " ").split()
        try:
            if len(fields) != 8:
                raise ValueError
            _, x, y, _, qx, qy, qz, qw = (float(v) for v in fields)
            stamp = seconds_to_ns(fields[0])
        except ValueError:
            raise InputError(
                f"{path}, line {number}: expected 8 numbers 'time tx ty tz qx qy qz qw', "
                f"got '{line.strip()[:60]}'"
            ) from None
        stamps.append(stamp)
        yaw = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        poses.append((x, y, yaw))
    if not stamps:
        raise InputError(f"{path}: holds no pose")
    return Trajectory(np.array(stamps, np.int64), np.array(poses, float))


def seconds_to_ns(text: str) -> int:
    """Decimal seconds to integer nanoseconds without the rounding of a float.

    Raises ValueError when the text is no number, or no time that int64 nanoseconds can hold.
    """
    decimal = DECIMAL.fullmatch(text.strip())
    if decimal:
        sign, whole, fraction = decimal.groups()
        nanoseconds = int(whole) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))
        nanoseconds = -nanoseconds if sign == "-" else nanoseconds
    else:
        value = float(text) * 1e9
        if not np.isfinite(value):
            raise ValueError(text)
        nanoseconds = round(value)
    if abs(nanoseconds) >= 2**63:
        raise ValueError(text)
    return nanoseconds
