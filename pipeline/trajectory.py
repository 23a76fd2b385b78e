"""Paths as TUM files: `timestamp tx ty tz qx qy qz qw`, seconds and metres, one pose a line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import InputError


@dataclass(frozen=True)
class Trajectory:
    """stamps: (n,) int64 ns; poses: (n, 3) x m, y m, theta rad."""

    stamps: np.ndarray
    poses: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps)


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
    for number, line in enumerate(_lines(Path(path)), start=1):
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

    Raises ValueError when the text is not a finite number.
    """
    whole, point, fraction = text.partition(".")
    if point and whole.lstrip("+-").isdigit() and fraction.isdigit():
        nanoseconds = int(fraction[:9].ljust(9, "0"))
        sign = -1 if whole.startswith("-") else 1
        return int(whole) * 1_000_000_000 + sign * nanoseconds
    value = float(text)
    if not np.isfinite(value):
        raise ValueError(text)
    return round(value * 1e9)


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a TUM path ({error})") from None
