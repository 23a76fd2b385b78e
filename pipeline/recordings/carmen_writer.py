"""CARMEN logs written: one ROBOTLASER1 line a scan, and what the log says of itself as PARAM.

`carmen.py` is the reader and tells the fields; a maximum reading says that nothing was within
`max_range`, zero that the beam does not know.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from odometry.motion import compose
from stereo.scan import RangeScan

HOST = "nohost"
LASER_TYPE = 99  # of a sensor that CARMEN does not know
SMALLEST = 1e-4  # one unit of the last decimal of a reading [m]


def write_carmen(
    path: str | Path,
    scans: Iterable[RangeScan],
    odometry: np.ndarray,
    about: Iterable[str] = (),
    suggested: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Write scans with evenly spaced bearings, and the odometry (n, 3) they were taken at.

    about: lines of comment at the top; suggested: stage -> key -> value of the settings that
    fit this log, as `ScanLog.suggested` has them. Poses and times are written exactly, readings
    to a tenth of a millimetre.
    """
    with Path(path).open("w", encoding="utf-8") as file:
        file.writelines(f"# {line}\n" for line in about)
        for stage, values in (suggested or {}).items():
            for key, value in values.items():
                file.write(f"PARAM beemap_{stage}_{key} {_token(value)} {HOST} 0\n")
        for scan, pose in zip(scans, odometry, strict=True):
            file.write(_robotlaser(scan, pose))


def _robotlaser(scan: RangeScan, robot: np.ndarray) -> str:
    n = scan.bearing.size
    span = float(scan.bearing[-1] - scan.bearing[0])
    # A lone beam has no neighbour to be a step away from; readers want one all the same.
    step = span / (n - 1) if n > 1 else math.radians(1.0)
    laser = compose(robot, np.array(scan.origin))
    time = seconds(scan.stamp)
    return " ".join(
        [
            f"ROBOTLASER1 {LASER_TYPE} {float(scan.bearing[0])!r} {span!r} {step!r}",
            f"{float(scan.max_range)!r} 0 0 {n}",
            *_readings(scan),
            "0",  # remissions
            *(repr(v) for v in (*laser.tolist(), *robot.tolist())),
            f"0 0 0 0 0 {time} {HOST} {time}\n",
        ]
    )


def _readings(scan: RangeScan) -> list[str]:
    # Rounding must not turn an obstacle into "nothing" or "unknown".
    ranges = np.clip(scan.range, SMALLEST, scan.max_range - SMALLEST)
    ranges[scan.range == np.inf] = scan.max_range
    return [f"{r:.4f}" for r in np.nan_to_num(ranges, nan=0.0).tolist()]


def seconds(stamp: int) -> str:
    """Integer nanoseconds as decimal seconds, exactly; microseconds where they suffice."""
    whole, nanoseconds = divmod(abs(stamp), 1_000_000_000)
    fraction = f"{nanoseconds:09d}"
    return f"{'-' if stamp < 0 else ''}{whole}.{fraction.removesuffix('000')}"


def _token(value: Any) -> str:
    """A setting as one word of YAML."""
    if value is None:
        return "null"
    if isinstance(value, (list, tuple)):
        return f"[{','.join(map(_token, value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)
