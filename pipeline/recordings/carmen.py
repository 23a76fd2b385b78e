"""CARMEN logs: laser scans with the odometry they were taken at, one message a line.

    FLASER n [n ranges] x y theta odom_x odom_y odom_theta ipc_time host log_time
    ROBOTLASER1 type start fov step maximum accuracy mode n [n ranges] m [m remissions]
                laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv 3 more
                ipc_time host log_time
    PARAM name value ...

Scans are taken in file order: the times of real logs step backwards where messages overtook
each other, and each scan carries its own odometry. x y theta of FLASER are not used: programs
write corrected poses there.
"""

from __future__ import annotations

import bz2
import gzip
import lzma
import math
import zlib
from collections import Counter
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from calibration.yamlfile import YamlFileError, parse_yaml
from odometry.motion import compose, inverse, wrap_angle
from pipeline.errors import InputError
from pipeline.recordings.laser import FARTHEST, Beams
from pipeline.recordings.scan_log import BACKWARDS, CHANGES, NO_NUMBER, REPEATED, ScanLog
from pipeline.trajectory import seconds_to_ns

# What a packed file starts with, whatever it is called.
PACKED = ((b"\x1f\x8b", gzip.open), (b"BZh", bz2.open), (b"\xfd7zXZ", lzma.open))
BLOCK = 1 << 20

PASSED_OVER = {
    "SYNC", "TRUEPOS", "RLASER", "SONAR", "BUMPER", "IMU", "GYRO", "ARM", "MARKER", "CAMERA",
    "NMEAGGA", "NMEARMC", "NMEA-GGA", "NMEA-RMC", "SCANMARK", "POSITIONLASER", "VELOCITY",
    "ROBOTVELOCITY", "BASEVELOCITY", "VECTORMOVE", "FOLLOWTRAJECTORY",
    *(f"{kind}{i}" for kind in ("LASER", "RAWLASER", "ROBOTLASER") for i in range(1, 6)),
}  # fmt: skip

TIME_FIELDS = 3  # ipc_time host log_time, the end of every message
FLASER_FIELDS = 2 + 6 + TIME_FIELDS
ROBOTLASER_HEAD = 8
ROBOTLASER_FIELDS = ROBOTLASER_HEAD + 2 + 11 + TIME_FIELDS
ODOM_FIELDS = 1 + 6 + TIME_FIELDS

# PARAM beemap_<stage>_<key>: what a log says of itself, in the stages of the settings.
SUGGESTION = "beemap_"
STAGES = ("odometry", "laser", "mapping")
# The scanner's place by the two poses of ROBOTLASER1 counts when it stays the same [m, m, rad].
SAME_PLACE = np.array([0.005, 0.005, math.radians(0.5)])
# Longer coordinates are no poses [m]; those of a national grid are shorter.
FARTHEST_POSE = 1e8
FULL_TURN = 2.0 * math.pi + 0.01  # rad, as rounded in a log


def read_carmen(path: str | Path) -> ScanLog:
    """Read a CARMEN log, plain or packed (.gz, .bz2, .xz).

    Lines that are damaged or unknown are counted and named in `skipped`.

    Raises:
        InputError: it cannot be read, or holds no scan.
    """
    path = Path(path)
    reading = _Reading()
    lines = _unpacked(path, reading).removeprefix(b"\xef\xbb\xbf").splitlines()
    for number, line in enumerate(lines, start=1):
        reading.take(number, line.split())
    if not reading.stamps:
        damaged = sum(len(names) for names in reading.skipped.values())
        raise InputError(
            f"{path}: holds no laser scan (no whole FLASER or ROBOTLASER1 line in {len(lines)} "
            f"lines, {damaged} of them damaged or unknown): give a CARMEN log"
        )
    return reading.log(path)


def _unpacked(path: Path, reading: _Reading) -> bytes:
    """All that can be had of the file; a packed one that is cut short is read as far as it goes."""
    blocks: list[bytes] = []
    try:
        with path.open("rb") as file:
            head = file.read(8)
        opener = next((opener for magic, opener in PACKED if head.startswith(magic)), open)
        with opener(path, "rb") as file:
            # read1 hands out what stands before the damage, read loses it.
            while block := file.read1(BLOCK):
                blocks.append(block)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (EOFError, zlib.error, lzma.LZMAError, gzip.BadGzipFile):
        reading.skip("packed file damaged", "the rest of it")
    except OSError as error:
        if error.errno is not None:
            raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
        reading.skip("packed file damaged", "the rest of it")  # bz2 says so by a bare OSError
    return b"".join(blocks)


class _Reading:
    """Collects a log line by line."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self.odometry: list[list[float]] = []
        self.places: list[list[float] | None] = []  # of the scanner by odometry; None: not told
        self.readings: list[np.ndarray] = []
        self.beams: list[Beams] = []
        self.counts: Counter[str] = Counter()
        self.skipped: dict[str, list[str]] = {}
        self.suggested: dict[str, dict[str, Any]] = {}
        self.offset = 0.0

    def take(self, number: int, fields: list[bytes]) -> None:
        """One line, split at blanks."""
        if not fields or fields[0].startswith(b"#"):
            return
        kind = fields[0]
        try:
            if kind == b"FLASER":
                self._flaser(fields)
            elif kind == b"ROBOTLASER1":
                self._robotlaser(fields)
            elif kind == b"PARAM":
                self._param(fields)
            elif kind == b"ODOM":
                _expect(len(fields) == ODOM_FIELDS)
            elif kind.decode("ascii", "replace") not in PASSED_OVER:
                name = kind.decode("ascii", "backslashreplace")[:20]
                self.skip("unknown message type", f"{name}, line {number}")
                return
        except InputError as error:
            self.skip("parameter not understood", f"line {number}: {error}")
        except (ValueError, IndexError, OverflowError):
            self.skip("damaged line", f"line {number}")
        else:
            self.counts[kind.decode("ascii")] += 1

    def skip(self, reason: str, name: str) -> None:
        """Count and name what was passed over."""
        self.skipped.setdefault(reason, []).append(name)

    def _flaser(self, fields: list[bytes]) -> None:
        n = int(fields[1])
        _expect(n > 0 and len(fields) == n + FLASER_FIELDS)
        self._scan(fields[2 : 2 + n], fields[n + 5 : n + 8], None, _flaser_beams(n), fields)

    def _robotlaser(self, fields: list[bytes]) -> None:
        n = int(fields[ROBOTLASER_HEAD])
        _expect(n > 0 and len(fields) > ROBOTLASER_HEAD + 1 + n)
        after = ROBOTLASER_HEAD + 1 + n
        m = int(fields[after])
        _expect(m >= 0 and len(fields) == n + m + ROBOTLASER_FIELDS)
        poses = after + 1 + m
        beams = _stated_beams(n, *fields[2:6])
        place = _numbers(fields[poses : poses + 3])
        self._scan(fields[9:after], fields[poses + 3 : poses + 6], place, beams, fields)

    def _scan(
        self,
        ranges: list[bytes],
        pose: list[bytes],
        place: list[float] | None,
        beams: Beams,
        fields: list[bytes],
    ) -> None:
        """All or nothing: what raises leaves no trace."""
        readings = np.array(list(map(float, ranges)))
        odometry = _numbers(pose)
        _expect(max(map(abs, odometry)) < FARTHEST_POSE)
        stamp = seconds_to_ns(fields[-TIME_FIELDS].decode("ascii"))
        self.stamps.append(stamp)
        self.odometry.append(odometry)
        self.places.append(place)
        self.readings.append(readings)
        self.beams.append(beams)

    def _param(self, fields: list[bytes]) -> None:
        name, value = (field.decode("utf-8", "replace") for field in fields[1:3])
        if name == "robot_frontlaser_offset":
            offset = float(value)
            _expect(math.isfinite(offset))
            self.offset = offset
        elif name.startswith(SUGGESTION):
            stage, _, key = name.removeprefix(SUGGESTION).partition("_")
            self.suggested.setdefault(stage, {})[key] = _suggestion(name, stage, key, value)

    def log(self, path: Path) -> ScanLog:
        """All lines so far as a log; there must be a scan."""
        stamps, odometry = np.array(self.stamps, np.int64), np.array(self.odometry)
        sizes = np.array([r.size for r in self.readings])
        self.counts["scans"] = len(stamps)
        self.counts[BACKWARDS] = int((np.diff(stamps) < 0).sum())
        self.counts[REPEATED] = len(stamps) - len(np.unique(stamps))
        self.counts[CHANGES] = int((np.diff(sizes) != 0).sum())
        self.counts[NO_NUMBER] = sum(int(np.isnan(r).sum()) for r in self.readings)
        return ScanLog(
            path,
            "CARMEN log",
            stamps,
            odometry,
            self.readings,
            self.beams,
            self._origins(odometry),
            +self.counts,
            self.skipped,
            self.suggested,
        )

    def _origins(self, odometry: np.ndarray) -> np.ndarray:
        """The scanner on the robot (n, 3): by PARAM, or as the poses of ROBOTLASER1 tell.

        Those tell it where they differ, and always by the same: some programs write the robot's
        pose twice, others a corrected pose in one of the two places.
        """
        origins = np.tile([self.offset, 0.0, 0.0], (len(odometry), 1))
        told = [i for i, place in enumerate(self.places) if place is not None]
        if told:
            places = np.array([self.places[i] for i in told])
            relation = compose(inverse(odometry[told]), places)
            # Angles about the first one: a scanner that looks back has them at +180 and -180 deg.
            relation[:, 2] = relation[0, 2] + wrap_angle(relation[:, 2] - relation[0, 2])
            typical = np.median(relation, axis=0)
            if (np.abs(relation - typical) <= SAME_PLACE).all() and (
                np.abs(typical) > SAME_PLACE
            ).any():
                origins[told] = typical
        return origins


def _expect(true: bool) -> None:
    if not true:
        raise ValueError


def _numbers(fields: list[bytes]) -> list[float]:
    numbers = list(map(float, fields))
    _expect(all(map(math.isfinite, numbers)))
    return numbers


_flaser_beams = lru_cache(256)(Beams.flaser)


@lru_cache(256)
def _stated_beams(n: int, start: bytes, fov: bytes, step: bytes, maximum: bytes) -> Beams:
    first, angle, increment = _numbers([start, fov, step])
    if increment <= 0.0:
        increment = angle / max(n - 1, 1)
    _expect(abs(first) <= FULL_TURN and increment > 0.0 and (n - 1) * increment <= FULL_TURN)
    limit = float(maximum)
    return Beams(
        first + np.arange(n) * increment, min(limit, FARTHEST) if limit > 0.0 else None, False
    )


def _suggestion(name: str, stage: str, key: str, text: str) -> Any:
    """The checked value of `PARAM beemap_<stage>_<key>`; InputError when it is no such setting."""
    from pipeline.settings import check

    if stage not in STAGES:
        raise InputError(f"{name}: no such stage (known: {', '.join(STAGES)})")
    try:
        value = parse_yaml(text, name)
    except YamlFileError as error:
        raise InputError(str(error)) from None
    check({stage: {key: value}}, "PARAM")
    return value
