"""Truth maps of a scene: the floor plan, and the part of it that perfect sensors would see.

Both are rasterised directly in the frame of the robot's first pose, which is where a run's map
starts, so that they lie on it cell by cell without resampling.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy import ndimage

from calibration.rig import Mount, StereoRig
from mapping.grid import OccupancyGrid
from odometry.motion import compose, inverse
from simulation.raycaster import RayCaster
from simulation.scene import Scene

CELL = 0.05
Z_MIN, Z_MAX = 0.10, 1.20
MAX_RANGE = 8.0
MARGIN = 0.5  # unknown border around the room [m]
INTO = 1e-3  # a hit is booked this far behind the surface, never on the border of two cells [m]


def floor_plan(scene: Scene, first_pose: np.ndarray) -> OccupancyGrid:
    """Every cell whose column holds geometry between Z_MIN and Z_MAX is occupied, what the robot
    could reach from its first pose is free (probability 0), the rest unknown."""
    grid = _empty(scene, first_pose)
    solid = np.zeros(grid.probability.shape, bool)
    for box in scene.boxes:
        if box.bottom < Z_MAX and box.top > Z_MIN:
            _mark_box(solid, grid, _in_frame(box.corners, first_pose))
    start = np.zeros_like(solid)
    start[cell_index(grid, np.zeros(2))] = True
    reachable = ndimage.binary_propagation(start, mask=~solid)
    return _filled(grid, solid, reachable)


def seen_plan(scene: Scene, rig: StereoRig, poses: np.ndarray) -> OccupancyGrid:
    """What perfect ranging sees along `poses` (n, 3) in the scene's frame.

    A level pinhole camera stands at the left camera's place and casts one ray per pixel. Per image
    column the horizontally nearest hit within the height band and MAX_RANGE is occupied, what lies
    before it free (all of MAX_RANGE when nothing stands in it); occupied beats free, the rest is
    unknown.
    """
    mount = rig.mount or Mount()
    level = Mount(height=mount.height, yaw=mount.yaw, x=mount.x, y=mount.y)
    grid = _empty(scene, poses[0])
    free = np.zeros(grid.probability.shape, bool)
    solid = np.zeros_like(free)
    caster = RayCaster(scene.faces())
    local = _pinhole_rays(rig) @ level.rotation.T  # robot frame, horizontal length 1
    bearing = np.arctan2(local[0, :, 1], local[0, :, 0])
    ahead = np.arange(0.0, MAX_RANGE, CELL / 4.0)
    for pose in poses:
        reach = _column_ranges(caster, local, level, pose)
        eye = compose(compose(inverse(poses[0]), pose), np.array([level.x, level.y, 0.0]))
        angle = eye[2] + bearing
        beam = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        hit = np.isfinite(reach)
        solid[cell_index(grid, eye[:2] + (reach[hit, None] + INTO) * beam[hit])] = True
        before = ahead[None, :] < np.minimum(reach, MAX_RANGE)[:, None]
        points = eye[:2] + ahead[None, :, None] * beam[:, None, :]
        free[cell_index(grid, points[before])] = True
    return _filled(grid, solid, free)


def cell_index(grid: OccupancyGrid, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(row, column) of the cells that hold `points` (..., 2) m."""
    at = np.floor((np.asarray(points) - grid.origin) / grid.cell).astype(np.int64)
    return at[..., 1], at[..., 0]


def _empty(scene: Scene, first_pose: np.ndarray) -> OccupancyGrid:
    length, width, _ = scene.size
    room = np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])
    corners = _in_frame(room, first_pose)
    low = np.floor((corners.min(axis=0) - MARGIN) / CELL) * CELL
    columns, rows = np.ceil((corners.max(axis=0) + MARGIN - low) / CELL).astype(int)
    unknown = np.full((rows, columns), np.nan, np.float32)
    return OccupancyGrid(unknown, (float(low[0]), float(low[1])), CELL)


def _filled(grid: OccupancyGrid, solid: np.ndarray, free: np.ndarray) -> OccupancyGrid:
    probability = grid.probability.copy()
    probability[free] = 0.0
    probability[solid] = 1.0
    return replace(grid, probability=probability)


def _in_frame(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return (points - pose[:2]) @ np.array([[c, -s], [s, c]])


def _mark_box(solid: np.ndarray, grid: OccupancyGrid, corners: np.ndarray) -> None:
    """Set the cells that the rectangle `corners` (4, 2) overlaps (separating axes)."""
    (row0, column0), (row1, column1) = (
        np.ravel(cell_index(grid, v)) for v in (corners.min(axis=0), corners.max(axis=0))
    )
    rows = np.arange(max(row0, 0), min(row1 + 1, solid.shape[0]))
    columns = np.arange(max(column0, 0), min(column1 + 1, solid.shape[1]))
    y, x = np.meshgrid(
        grid.origin[1] + (rows + 0.5) * grid.cell,
        grid.origin[0] + (columns + 0.5) * grid.cell,
        indexing="ij",
    )
    middle = corners.mean(axis=0)
    overlap = np.ones(x.shape, bool)
    sides = (corners[1] - corners[0], corners[2] - corners[1])
    for axis in (np.array([1.0, 0.0]), np.array([0.0, 1.0]), *sides):
        axis = axis / np.linalg.norm(axis)
        half = np.abs((corners - middle) @ axis).max() + 0.5 * grid.cell * np.abs(axis).sum()
        distance = np.abs((x - middle[0]) * axis[0] + (y - middle[1]) * axis[1])
        overlap &= distance < half - 1e-9
    solid[np.ix_(rows, columns)] |= overlap


def _pinhole_rays(rig: StereoRig) -> np.ndarray:
    """(H, W, 3) rays of the left camera without its distortion, horizontal length 1."""
    width, height = rig.image_size
    camera = rig.left
    y, x = np.meshgrid(
        (np.arange(height) - camera.cy) / camera.fy,
        (np.arange(width) - camera.cx) / camera.fx,
        indexing="ij",
    )
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    return rays / np.hypot(x, 1.0)[..., None]


def _column_ranges(
    caster: RayCaster, local: np.ndarray, level: Mount, pose: np.ndarray
) -> np.ndarray:
    """(W,) nearest horizontal range per image column within the height band [m].

    inf: nothing up to MAX_RANGE; NaN: the column does not tell (it looks over or under the band).
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    robot = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rays = np.empty((*local.shape[:2], 6), np.float32)
    rays[..., :3] = robot @ level.position + (pose[0], pose[1], 0.0)
    rays[..., 3:] = local @ robot.T
    reach = caster.cast(rays)[0].astype(float)
    height = level.height + np.minimum(reach, MAX_RANGE) * local[..., 2]
    in_band = (height > Z_MIN) & (height < Z_MAX)
    nearest = np.where(in_band & (reach <= MAX_RANGE), reach, np.inf).min(axis=0)
    passes = (in_band & (reach > MAX_RANGE)).any(axis=0)
    nearest[np.isinf(nearest) & ~passes] = np.nan
    return nearest
