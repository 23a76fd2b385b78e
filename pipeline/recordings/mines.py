"""Logs of the Mines ParisTech rover (CoreSLAM, BreezySLAM): raw wheel ticks with laser scans.

    time [us], -, left ticks, right ticks, 20 more, 683 ranges [mm]

one scan a line, 707 numbers, fields parted by blanks. The robot is known, not told by the file:
2000 ticks a turn, wheels of 77 mm radius, a Hokuyo URG-04LX of 240 deg that looks ahead 145 mm
before the axle. Ranges of 0 are none, and those of a few millimetres error codes.

The published track is 330 mm. `beemap odometry calibrate` on exp1.dat finds that the robot turns
as with 307 mm (radii as published), and that each scan is 0.15 s older than the ticks beside it;
with these the walls come out straight.
"""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np

from odometry.encoders import EncoderParameters
from odometry.motion import compose
from odometry.settings import OdometrySettings
from odometry.source import EncoderOdometry
from odometry.tick_log import TickLog
from pipeline.errors import InputError
from pipeline.recordings.laser import Beams
from pipeline.recordings.scan_log import ScanLog

HEAD, BEAMS = 24, 683
FIELDS = HEAD + BEAMS
TIME, LEFT, RIGHT = 0, 2, 3
ROVER = EncoderParameters(2000, 0.077, 0.077, 0.307, 32, time_offset=0.15)
LASER_AHEAD = 0.145  # m
STEP = math.radians(360.0 / 1024.0)
NEAREST = 20  # mm; less is an error code
# What the scanner's maker states: 1 % beyond a metre, less before; nothing beyond 5.6 m. Wheel
# ticks are far better than what scan logs usually call odometry.
SUGGESTED = {
    "laser": {"max_range": 5.6, "noise": 0.01},
    "odometry": {"along": 0.03, "across": 0.02, "heading": 2.0, "turn": 4.0},
    "mapping": {"max_range": 5.6, "spacing": 0.2, "spacing_angle": 10.0, "window": 8},
}


def recognises(path: Path) -> bool:
    """Whether the first line of a file is one of this format."""
    try:
        with path.open("rb") as file:
            return _parse(file.readline(1 << 16)) is not None
    except OSError:
        return False


def read_mines(path: Path) -> ScanLog:
    """Read such a log; damaged lines are counted and named.

    Raises:
        InputError: it cannot be read, or fewer than two lines are whole.
    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    skipped: dict[str, list[str]] = {}
    rows, last = [], -1
    for number, line in enumerate(lines, start=1):
        row = _parse(line)
        reason = "damaged line" if row is None else "time not after the last"
        if row is None or row[TIME] <= last:
            if line.strip():
                skipped.setdefault(reason, []).append(f"line {number}")
            continue
        last = row[TIME]
        rows.append(row)
    if len(rows) < 2:
        raise InputError(f"{path}: {len(rows)} whole lines of {FIELDS} numbers: at least 2 needed")
    return _log(path, np.array(rows, np.int64), skipped)


def _log(path: Path, table: np.ndarray, skipped: dict[str, list[str]]) -> ScanLog:
    stamps = table[:, TIME] * 1000
    ticks = TickLog(stamps, table[:, LEFT], table[:, RIGHT])
    odometry, poses = EncoderOdometry(ticks, ROVER, OdometrySettings()), [np.zeros(3)]
    for stamp in stamps.tolist():
        motion = odometry.until(stamp)
        poses.append(poses[-1] if motion is None else compose(poses[-1], motion.increment))
    ranges = table[:, HEAD:].astype(float)
    ranges[ranges < NEAREST] = 0.0
    beams = Beams((np.arange(BEAMS) - (BEAMS - 1) / 2) * STEP, None, False)
    return ScanLog(
        path,
        "Mines rover log",
        stamps,
        np.array(poses[1:]),
        list(ranges / 1000.0),
        [beams] * len(table),
        np.tile([LASER_AHEAD, 0.0, 0.0], (len(table), 1)),
        Counter(scans=len(table)),
        skipped,
        SUGGESTED,
        ticks,
        ROVER,
    )


def _parse(line: bytes) -> list[int] | None:
    """The whole numbers of a line, those that are not whole as 0; None: it is no such line."""
    fields = line.split()
    if len(fields) != FIELDS:
        return None
    numbers = [int(f) if f.isdigit() and len(f) < 16 else None for f in fields]
    needed = (numbers[TIME], numbers[LEFT], numbers[RIGHT], *numbers[HEAD:])
    if any(number is None for number in needed):
        return None
    return [number or 0 for number in numbers]
