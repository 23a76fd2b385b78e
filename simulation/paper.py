"""The paper's simulated experiment (Sec. IV): scans, odometry and truth along a route.

    for every 200 mm of the route:
        range = exact ray casting through the world's cells
        scan  = range with depth noise and false blocks          (stereo_errors.py, eqs (11), (12))
        odometry += true increment + Gaussian error (20 mm, 20 mm, 0.7 deg)

and the maps to hold a result against. Frames: the world's; the robot's first pose for everything
that a mapper is compared with. The camera stands at the robot's origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from mapping.grid import OccupancyGrid
from odometry.motion import Motion, compose, inverse
from simulation.grid_caster import cast
from simulation.route import Route
from simulation.stereo_errors import StereoErrors
from simulation.world import World
from simulation.world_sheet import WorldError
from stereo.scan import RangeScan

ODOMETRY_PURPOSE = 10  # keys of the random generator: (seed, purpose)

FIRST_STAMP = 1_000_000_000_000  # ns
PERIOD = 500_000_000  # ns: 2 observations a second

# Depth noise may bring walls into the depth range that stand this many sd beyond it.
BEYOND = 5.0


@dataclass(frozen=True)
class PaperSettings(StereoErrors):
    """The paper's figures; beside the stereo errors:

    odometry_noise: sd of each step in x m, y m, theta rad; spacing of the positions [m];
    fov rad and beams: the bearings, evenly spaced over the field of view, its ends included.
    """

    odometry_noise: tuple[float, float, float] = (0.02, 0.02, math.radians(0.7))
    spacing: float = 0.2
    positions: int = 785
    fov: float = math.radians(66.0)
    beams: int = 265

    @property
    def bearing(self) -> np.ndarray:
        """(beams,) rad, left positive."""
        return np.linspace(-0.5 * self.fov, 0.5 * self.fov, self.beams)


@dataclass(frozen=True)
class PaperRun:
    """One run of n positions.

    scans: n; sigma is `depth_noise` times the measured range; +inf: nothing within max_range.
    odometry: (n, 3) dead reckoning from (0, 0, 0); truth: (n, 3) in the frame of the first true
    pose; motions: n, the first one none, with the noise's covariance; poses: (n, 3) true poses in
    the world's frame.
    """

    scans: list[RangeScan]
    odometry: np.ndarray
    truth: np.ndarray
    motions: list[Motion]
    poses: np.ndarray


def simulate(
    world: World, route: Route, settings: PaperSettings, seed: int, perfect: bool = False
) -> PaperRun:
    """Drive `route` through `world`; `perfect` leaves out all errors.

    Odometry, depth noise and false blocks have random numbers of their own: to change one of
    them does not change the others.

    Raises:
        WorldError: as `route_poses`.
    """
    poses = route_poses(world, route, settings)
    stamps = [FIRST_STAMP + PERIOD * i for i in range(len(poses))]
    bearing = settings.bearing
    noise = 0.0 if perfect else settings.depth_noise
    reach = settings.max_range * (1.0 + BEYOND * noise)
    ranges, _ = cast(world.solid, *world.origin, world.cell, poses, bearing, reach)
    if not perfect:
        frames = enumerate(ranges)
        ranges = np.array([settings.measure(r, bearing, seed, frame) for frame, r in frames])
    sigma = noise * np.where(np.isfinite(ranges), ranges, np.nan)
    scans = [
        RangeScan(stamp, (0.0, 0.0, 0.0), bearing, r, s, settings.max_range)
        for stamp, r, s in zip(stamps, ranges, sigma, strict=True)
    ]
    motions = _odometry(poses, stamps, np.array(settings.odometry_noise) * (not perfect), seed)
    odometry = np.zeros_like(poses)
    for i, motion in enumerate(motions[1:], start=1):
        odometry[i] = compose(odometry[i - 1], motion.increment)
    return PaperRun(scans, odometry, compose(inverse(poses[0]), poses), motions, poses)


def route_poses(world: World, route: Route, settings: PaperSettings) -> np.ndarray:
    """True poses (n, 3) in the world's frame, every `spacing` along the route's tangent.

    Raises:
        WorldError: the route is too short for so many positions, or leads through a wall.
    """
    enough = positions_on(route, settings.spacing)
    if settings.positions > enough:
        raise WorldError(
            f"{world.name}: the route of {route.distance:.1f} m has room for {enough} positions "
            f"every {settings.spacing:g} m, not for {settings.positions}: ask for fewer, or give "
            "a longer route"
        )
    driven = np.concatenate([[0.0], np.cumsum(route.length)])
    times = np.concatenate([[0.0], np.cumsum(route.length / route.speed)])
    poses = route.poses(np.interp(settings.spacing * np.arange(settings.positions), driven, times))
    row, column, inside = world.index(poses[:, :2])
    blocked = ~inside | world.solid[row, column]
    if blocked.any():
        x, y = poses[np.argmax(blocked), :2]
        raise WorldError(
            f"{world.name}: the route leads through a wall or out of the world at "
            f"({x:.2f}, {y:.2f}): give another route"
        )
    return poses


def positions_on(route: Route, spacing: float) -> int:
    """How many positions every `spacing` m the route has room for."""
    return math.floor(route.distance / spacing + 1e-9) + 1


def floor_plan(world: World, first_pose: np.ndarray) -> OccupancyGrid:
    """The world in the frame of `first_pose` (3,): 1 solid, 0 what the robot could reach from
    there, NaN else."""
    start = np.zeros_like(world.solid)
    row, column, _ = world.index(first_pose[:2])
    start[row, column] = True
    reachable = np.asarray(ndimage.binary_propagation(start, mask=~world.solid))
    plan = np.where(world.solid | reachable, world.solid, np.nan).astype(np.float32)
    return _in_frame(world, plan, first_pose)


def seen_plan(world: World, poses: np.ndarray, settings: PaperSettings) -> OccupancyGrid:
    """The common ideal: the floor plan where perfect sensors see it from `poses` (n, 3) in the
    world's frame, NaN else; in the frame of the first of them."""
    _, crossed = cast(
        world.solid, *world.origin, world.cell, poses, settings.bearing, settings.max_range
    )
    plan = np.where(crossed, world.solid, np.nan).astype(np.float32)
    return _in_frame(world, plan, poses[0])


def _odometry(poses: np.ndarray, stamps: list[int], noise: np.ndarray, seed: int) -> list[Motion]:
    """The true increments (n,) with a Gaussian error of sd `noise` (3,) in each."""
    increments = compose(inverse(poses[:-1]), poses[1:])
    chance = np.random.default_rng((seed, ODOMETRY_PURPOSE)).standard_normal(increments.shape)
    return [
        Motion.none(stamps[0]),
        *(
            Motion(increment, np.diag(noise**2), first, last)
            for increment, first, last in zip(
                increments + noise * chance, stamps[:-1], stamps[1:], strict=True
            )
        ),
    ]


def _in_frame(world: World, values: np.ndarray, pose: np.ndarray) -> OccupancyGrid:
    """Cell values (H, W) of the world as a grid in the frame of `pose`.

    Every cell takes the value of the world's cell that holds its middle; where `pose` stands on
    a corner of the world's cells and along its axes the cells of both are the same.
    """
    rows, columns = values.shape
    width, height = columns * world.cell, rows * world.cell
    corners = np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0, height, 0]])
    corners[:, :2] += world.origin
    around = compose(inverse(pose), corners)[:, :2]
    low = np.floor(around.min(axis=0) / world.cell + 1e-6)
    columns, rows = np.ceil(around.max(axis=0) / world.cell - 1e-6).astype(int) - low.astype(int)
    x, y = np.meshgrid(low[0] + np.arange(columns) + 0.5, low[1] + np.arange(rows) + 0.5)
    middles = world.cell * np.stack([x, y, np.zeros_like(x)], axis=-1)
    row, column, inside = world.index(compose(pose, middles)[..., :2])
    probability = np.where(inside, values[row, column], np.nan).astype(np.float32)
    x, y = np.round(low * world.cell, 9).tolist()
    return OccupancyGrid(probability, (x, y), world.cell)
