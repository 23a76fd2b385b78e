"""What the tests of the mapper share: scans, local maps, drives and their mirror image."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from mapping.local_map import LocalMap
from mapping.mapper import HierarchicalMapper
from mapping.sensor_model import SensorModel
from mapping.settings import MappingSettings
from mapping.tiles import TILE, TileMaps
from odometry.motion import Motion, compose, inverse
from stereo.scan import RangeScan

CELL = 0.05
BEAMS = 265
FOV = 66.0  # deg

Pair = tuple[RangeScan, Motion]


def scan(
    ranges: ArrayLike,
    sigma: float = 0.01,
    fov: float = FOV,
    max_range: float = 8.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> RangeScan:
    """Ranges (n,) m evenly over the field of view [deg]."""
    ranges = np.asarray(ranges, float)
    half = math.radians(fov) / 2
    return RangeScan(
        stamp=0,
        origin=origin,
        bearing=np.linspace(-half, half, ranges.size),
        range=ranges,
        sigma=np.where(np.isfinite(ranges), sigma, np.nan),
        max_range=max_range,
    )


def wall(distance: float, n: int = BEAMS, fov: float = FOV) -> np.ndarray:
    """Ranges (n,) to a flat wall across the robot's way."""
    return distance / np.cos(np.linspace(-math.radians(fov) / 2, math.radians(fov) / 2, n))


def room_ranges(pose: np.ndarray, n: int = BEAMS, fov: float = FOV) -> np.ndarray:
    """Exact ranges (n,) in a 6 x 4 m room with a pillar in it, from a pose in the room's frame."""
    angles = pose[2] + np.linspace(-math.radians(fov) / 2, math.radians(fov) / 2, n)
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = [(3.0 - pose[0]) / c, (-3.0 - pose[0]) / c, (2.0 - pose[1]) / s, (-2.0 - pose[1]) / s]
        t = np.where(np.array(t) > 1e-9, t, np.inf).min(axis=0)
        b = (pose[0] - 0.5) * c + (pose[1] - 0.4) * s
        gap = b * b - ((pose[0] - 0.5) ** 2 + (pose[1] - 0.4) ** 2 - 0.25**2)
        hit = np.where((gap > 0) & (b < 0), -b - np.sqrt(np.maximum(gap, 0)), np.inf)
    return np.minimum(t, hit)


def round_the_room(n: int, step: float = 0.17) -> np.ndarray:
    """Poses (n, 3) in the frame of that room, on an ellipse, about `step` m apart."""
    angle = np.arange(n) * step / 1.5
    heading = np.arctan2(1.2 * np.cos(angle), -1.9 * np.sin(angle))
    return np.stack([1.9 * np.cos(angle), 1.2 * np.sin(angle), heading], axis=1)


def drive(
    poses: np.ndarray,
    noise: tuple[float, float],
    seed: int = 0,
    beams: int = BEAMS,
    fov: float = FOV,
) -> list[Pair]:
    """Exact scans of the room from poses (n, 3), and odometry of which every step errs by `noise`
    (m along both axes, rad) and says so."""
    rng = np.random.default_rng((seed, 7))
    sd = np.array([noise[0], noise[0], noise[1]])
    scans = [scan(room_ranges(pose, beams, fov), fov=fov) for pose in poses]
    pairs = [(scans[0], Motion.none(0))]
    for i, (a, b) in enumerate(pairwise(poses), start=1):
        increment = compose(inverse(a), b) + sd * rng.standard_normal(3)
        pairs.append((scans[i], Motion(increment, np.diag(sd**2), i - 1, i)))
    return pairs


def fed(mapper: HierarchicalMapper, pairs: Iterable[Pair]) -> HierarchicalMapper:
    """The mapper after all pairs and their last local map."""
    for seen, motion in pairs:
        mapper.add(seen, motion)
    mapper.finish()
    return mapper


def local_map(
    log_odds: ArrayLike, origin: tuple[float, float] = (0.0, 0.0), motion: Motion | None = None
) -> LocalMap:
    """A local map of log-odds (H, W) whose obstacles are possible where they are likely."""
    L = np.asarray(log_odds, np.float32)
    with np.errstate(invalid="ignore"):
        possible = SensorModel.of(MappingSettings()).local_occupied_above < L
    motion = motion or Motion.none(0)
    return LocalMap(L, possible, origin, CELL, np.zeros((0, 2)), 0.1, motion, 0, 10, 1.0)


def filled_maps(rng: np.random.Generator, particles: int) -> TileMaps:
    """Maps of 3 x 3 random tiles around the origin, some of them missing; no obstacles marked."""
    maps = TileMaps(particles)
    maps.cover(np.array([-TILE, -TILE]), np.array([2 * TILE - 1, 2 * TILE - 1]))
    maps.make_writable(rng.random(maps.table.shape) < 0.8)
    maps.tiles[:] = rng.integers(-128, 128, maps.tiles.shape)
    return maps


MIRROR = np.array([1.0, -1.0, -1.0])  # of a pose: left and right change places


def mirrored_scan(seen: RangeScan) -> RangeScan:
    """The scan as in a mirror that stands along the robot's x axis."""
    x, y, yaw = seen.origin
    return RangeScan(
        seen.stamp,
        (x, -y, -yaw),
        -seen.bearing[::-1],
        seen.range[::-1],
        seen.sigma[::-1],
        seen.max_range,
    )


def mirrored_motion(motion: Motion) -> Motion:
    """The motion as in that mirror."""
    covariance = motion.covariance * np.outer(MIRROR, MIRROR)
    return Motion(motion.increment * MIRROR, covariance, motion.first, motion.last)


def mirrored(pairs: Sequence[Pair]) -> list[Pair]:
    """The drive as in that mirror."""
    return [(mirrored_scan(seen), mirrored_motion(motion)) for seen, motion in pairs]
