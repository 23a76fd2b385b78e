"""Stage 1: ten observations become one robot-centred local map (paper Sec. II).

    for each observation:  place it by odometry, classify the cells it sees, eqs (1), (2)
    then:                  thin what is blurred along the line of sight by the doubt of stereo

False matches do not repeat from place to place: what one observation calls an obstacle, the
others see through. The map is drawn once, when the window is full, in the latest robot frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mapping.gate import gate_of
from mapping.local_kernels import add_observations, thin
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
    points: (n, 2) hits in that frame that fall on obstacle cells [m]; kappa: the share of an
    independent measurement that each of them is;
    motion: of the robot since the local map before; stamp: of the latest observation;
    observations: how many were fused; answered: mean share of bearings with an answer.
    """

    log_odds: np.ndarray
    possible: np.ndarray
    origin: tuple[float, float]
    cell: float
    points: np.ndarray
    kappa: float
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
        self.gate = gate_of(self.settings)
        self._full = 1 if self.settings.per_scan else self.settings.window
        self._motion: Motion | None = None
        self._window: list[tuple[np.ndarray, RangeScan]] = []

    @property
    def motion(self) -> Motion:
        """Since the last local map closed."""
        return Motion.none(0) if self._motion is None else self._motion

    def move(self, motion: Motion) -> None:
        """Take in the motion up to the next pair."""
        self._motion = motion if self._motion is None else self._motion.then(motion)

    def observe(self, scan: RangeScan) -> LocalMap | None:
        """Take in the scan of an observation; the local map when the window is full."""
        assert self._motion is not None, "move() comes before observe()"
        self._window.append((self._motion.increment, scan))
        return self._close() if len(self._window) >= self._full else None

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
        scans = [scan for _, scan in self._window]
        poses = compose(inverse(motion.increment), np.array([pose for pose, _ in self._window]))
        sensors = compose(poses, np.array([scan.origin for scan in scans]))
        thinned, blurred, origin = draw_thinned(scans, sensors, self.settings, self.model)
        above = self.model.local_occupied_above
        local = LocalMap(
            log_odds=thinned,
            possible=blurred > above,
            origin=origin,
            cell=self.settings.cell,
            points=_points_on(thinned > above, origin, self.settings.cell, scans, sensors),
            kappa=min(1.0, scans[-1].spacing / math.radians(self.settings.correlated)),
            motion=motion,
            stamp=scans[-1].stamp,
            observations=len(scans),
            answered=float(np.mean([scan.answered for scan in scans])),
        )
        self._window = []
        self._motion = Motion.none(motion.last)
        return local


def draw_thinned(
    scans: list[RangeScan], sensors: np.ndarray, settings: MappingSettings, model: SensorModel
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Fuse scans taken from sensor poses (n, 3), and thin what is blurred along the line of sight.

    Returns log-odds (H, W) thinned and as they were, and the origin (x, y) of both.
    """
    if not settings.spread:
        scans = [replace(s, sigma=np.where(np.isfinite(s.range), 0.0, np.nan)) for s in scans]
    blurred, likely, origin = draw(scans, sensors, settings.cell, model)
    # Ranges that claim to be exact have blurred nothing.
    if not any(np.nanmax(scan.sigma, initial=0.0) > 0.0 for scan in scans):
        return blurred, blurred, origin
    eye, above = sensors.mean(axis=0), model.local_occupied_above
    thinned = thin(blurred, likely, *origin, settings.cell, eye[0], eye[1], above)
    return thinned, blurred, origin


def draw(
    scans: list[RangeScan], sensors: np.ndarray, cell: float, model: SensorModel
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Fuse scans taken from sensor poses (n, 3).

    Returns log-odds (H, W), the density (H, W) [1/m] of an obstacle in each cell, and the origin
    (x, y) of both.
    """
    first = np.cumsum([0] + [scan.range.size for scan in scans])
    bearing, ranges, sigma = (
        np.concatenate([getattr(scan, name) for scan in scans])
        for name in ("bearing", "range", "sigma")
    )
    max_range = np.array([scan.max_range for scan in scans])
    heading = np.repeat(sensors, np.diff(first), axis=0)
    reach = np.where(
        np.isfinite(ranges), ranges + 3.0 * sigma, np.repeat(max_range, np.diff(first))
    )
    reach = np.where(np.isnan(ranges), 0.0, reach)
    low, high = _bounds(heading, heading[:, 2] + bearing, reach, cell)
    shape = tuple(int(n) for n in np.round((high - low) / cell)[::-1])
    grid = np.full(shape, np.nan, np.float32)
    likely = np.zeros(shape, np.float32)
    add_observations(
        grid,
        likely,
        low[0],
        low[1],
        cell,
        sensors,
        first,
        bearing,
        ranges,
        sigma,
        max_range,
        model.occupied_step,
        model.free_step,
        CLAMP,
    )
    return grid, likely, (float(low[0]), float(low[1]))


def _points_on(
    obstacles: np.ndarray,
    origin: tuple[float, float],
    cell: float,
    scans: list[RangeScan],
    sensors: np.ndarray,
) -> np.ndarray:
    """Hits (n, 2) of all scans that fall on obstacle cells (H, W): false ones mostly do not."""
    points = []
    for scan, sensor in zip(scans, sensors, strict=True):
        hit = np.isfinite(scan.range)
        angle = sensor[2] + scan.bearing[hit]
        beam = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points.append(sensor[:2] + scan.range[hit, None] * beam)
    points = np.concatenate(points)
    at = np.floor((points - origin) / cell).astype(np.int64)
    return points[obstacles[at[:, 1], at[:, 0]]]


def _bounds(
    sensors: np.ndarray, angle: np.ndarray, reach: np.ndarray, cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the box around all beams, on multiples of the cell."""
    x, y = sensors[:, 0] + reach * np.cos(angle), sensors[:, 1] + reach * np.sin(angle)
    ends = np.concatenate([np.stack([x, y], axis=1), sensors[:, :2]])
    low = (np.floor(ends.min(axis=0) / cell) - 2) * cell
    high = (np.ceil(ends.max(axis=0) / cell) + 2) * cell
    return low, high
