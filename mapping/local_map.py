"""Stage 1: ten observations become one robot-centred local map (paper Sec. II).

    for each observation:  place it by odometry, classify the cells it sees, eqs (1), (2)
    then:                  thin what is blurred along the line of sight by the doubt of stereo

False matches do not repeat from place to place: what one observation calls an obstacle, the
others see through. The map is drawn once, when the window is full, in the latest robot frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mapping.gate import ObservationGate
from mapping.local_kernels import add_observation, thin
from mapping.sensor_model import CLAMP, SensorModel
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from stereo.scan import RangeScan


@dataclass(frozen=True)
class LocalMap:
    """Occupancy around the robot.

    log_odds: (H, W) float32, row 0 = lowest y, NaN where nothing was observed;
    possible: (H, W) bool, where an obstacle may stand by the doubt of its range, thinned or not;
    origin: (x, y) of the lower-left corner of cell [0, 0] in the robot's latest frame [m];
    motion: of the robot since the local map before; stamp: of the latest observation;
    observations: how many were fused; answered: mean share of bearings with an answer.
    """

    log_odds: np.ndarray
    possible: np.ndarray
    origin: tuple[float, float]
    cell: float
    motion: Motion
    stamp: int
    observations: int
    answered: float


class LocalMapper:
    """Collects observations until a window is full.

    The pose of every observation is kept relative to the window's start, by odometry alone:
    over 1.7 m it is accurate enough (Sec. II-E).
    """

    def __init__(self, settings: MappingSettings | None = None):
        self.settings = settings or MappingSettings()
        self.model = SensorModel.of(self.settings)
        self.gate = ObservationGate(
            self.settings.spacing, math.radians(self.settings.spacing_angle)
        )
        self._motion: Motion | None = None
        self._window: list[tuple[np.ndarray, RangeScan]] = []

    def move(self, motion: Motion) -> None:
        """Take in the motion up to the next pair."""
        self._motion = motion if self._motion is None else self._motion.then(motion)

    def observe(self, scan: RangeScan) -> LocalMap | None:
        """Take in the scan of an observation; the local map when the window is full."""
        assert self._motion is not None, "move() comes before observe()"
        self._window.append((self._motion.increment, scan))
        return self._close() if len(self._window) >= self.settings.window else None

    def add(self, scan: RangeScan, motion: Motion) -> LocalMap | None:
        """The whole stage in one call: move, and observe when the gate says so."""
        due = self.gate.step(motion.increment)
        self.move(motion)
        return self.observe(scan) if due else None

    def flush(self) -> LocalMap | None:
        """The last, shorter local map of a run; None when nothing was observed since."""
        return self._close() if self._window else None

    def _close(self) -> LocalMap:
        motion = self._motion
        assert motion is not None
        latest = inverse(motion.increment)
        scans = [scan for _, scan in self._window]
        poses = [compose(latest, pose) for pose, _ in self._window]
        blurred, likely, origin = draw(scans, poses, self.settings.cell, self.model)
        eye = np.mean(
            [compose(p, np.array(s.origin)) for p, s in zip(poses, scans, strict=True)], 0
        )
        above = self.model.occupied_above
        local = LocalMap(
            log_odds=thin(blurred, likely, *origin, self.settings.cell, eye[0], eye[1], above),
            possible=blurred > above,
            origin=origin,
            cell=self.settings.cell,
            motion=motion,
            stamp=scans[-1].stamp,
            observations=len(scans),
            answered=float(np.mean([scan.answered for scan in scans])),
        )
        self._window = []
        self._motion = Motion.none(motion.last)
        return local


def draw(
    scans: list[RangeScan], poses: list[np.ndarray], cell: float, model: SensorModel
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Fuse scans taken at robot poses (3,).

    Returns log-odds (H, W), the density (H, W) [1/m] of an obstacle in each cell, and the origin
    (x, y) of both.
    """
    sensors = [compose(pose, np.array(s.origin)) for pose, s in zip(poses, scans, strict=True)]
    low, high = _bounds(scans, sensors, cell)
    shape = tuple(int(n) for n in np.round((high - low) / cell)[::-1])
    grid = np.full(shape, np.nan, np.float32)
    likely = np.zeros(shape, np.float32)
    for scan, sensor in zip(scans, sensors, strict=True):
        add_observation(
            grid,
            likely,
            low[0],
            low[1],
            cell,
            sensor,
            scan.bearing,
            scan.range,
            scan.sigma,
            scan.max_range,
            model.occupied_step,
            model.free_step,
            CLAMP,
        )
    return grid, likely, (float(low[0]), float(low[1]))


def _bounds(scans: list[RangeScan], sensors: list[np.ndarray], cell: float):
    """Corners of the box around all that the scans can touch, on multiples of the cell."""
    corners = []
    for scan, (x, y, theta) in zip(scans, sensors, strict=True):
        reach = np.where(np.isfinite(scan.range), scan.range + 3.0 * scan.sigma, scan.max_range)
        reach = np.where(np.isnan(scan.range), 0.0, reach)
        angle = theta + scan.bearing
        corners.append(np.stack([x + reach * np.cos(angle), y + reach * np.sin(angle)]))
        corners.append(np.array([[x], [y]]))
    points = np.concatenate(corners, axis=1)
    low = (np.floor(points.min(axis=1) / cell) - 2) * cell
    high = (np.ceil(points.max(axis=1) / cell) + 2) * cell
    return low, high
