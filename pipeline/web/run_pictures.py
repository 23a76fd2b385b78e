"""What the page of a run shows, as few bytes, made cheaply.

Distances are codes of one byte in all pictures, so that one scale of colours tells them:
0 = unknown, 1 to FAR = near to `max_range`, FREE = nothing up to there. Cells of maps:
the classes of `mapping.grid`, of which unknown is 255.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from calibration.rig import Mount, StereoRig
from mapping.grid import OccupancyGrid, coarser
from mapping.local_map import draw_thinned
from mapping.sensor_model import SensorModel, probability
from mapping.settings import MappingSettings
from odometry.motion import compose, inverse
from pipeline.recordings.base import DamagedFrameError, Pair, PairFiles, RecordedPair
from pipeline.seeing import LoadedPair
from pipeline.web.encoding import camera_jpeg, jpeg
from simulation.camera_rays import distort
from stereo.camera import CapturedPair
from stereo.disparity import SUBPIXEL
from stereo.errors import StereoError
from stereo.ranger import StereoFrame, StereoRanger
from stereo.rectify import RectifiedCamera
from stereo.scan import RangeScan

UNKNOWN, FAR, FREE = 0, 254, 255
COLUMNS = 160  # of the tint
MOST_CELLS = 1600  # of a map's longer side
PATH_STEP, PATH_POINTS = 0.05, 3000  # m


def left_image(pair: Pair) -> tuple[bytes, bool] | None:
    """The left image as JPEG, and whether the right one stands beside it; None: it is damaged."""
    if isinstance(pair, LoadedPair):
        if not isinstance(pair.source, CapturedPair | PairFiles):
            return None if pair.pair is None else (jpeg(pair.pair.left), False)
        pair = pair.source
    if isinstance(pair, CapturedPair):
        data, both = pair.left.data, pair.right is None
    elif isinstance(pair, PairFiles) and pair.left.suffix.lower() in (".jpg", ".jpeg"):
        data, both = _content(pair), False
    else:
        data, both = _pixels(pair), False
    image = camera_jpeg(data)
    return None if image is None else (image, both)


def _content(pair: PairFiles) -> bytes:
    try:
        return pair.left.read_bytes()
    except OSError:
        return b""


def _pixels(pair: Pair) -> np.ndarray | bytes:
    try:
        return cast(RecordedPair, pair).load_left()
    except (DamagedFrameError, StereoError):
        return b""


def strips(rig: StereoRig, camera: RectifiedCamera) -> np.ndarray:
    """Edges (COLUMNS + 1, 4) of the tinted columns in the raw left image, in shares of its size:
    u, v at the upper end of the rows that are looked at, then at the lower."""
    width, height = rig.image_size
    u = np.linspace(-0.5, camera.width - 0.5, COLUMNS + 1)
    raw_from_rectified = (rig.mount or Mount()).rotation.T @ camera.rotation
    ends = []
    for v in (-0.5, camera.height - 0.5):
        rays = np.stack([(u - camera.cx) / camera.f, np.full(len(u), v), np.ones(len(u))])
        rays[1] = (rays[1] - camera.cy) / camera.f_rows
        X, Y, Z = raw_from_rectified @ rays
        at = distort(rig.left, np.stack([X / Z, Y / Z], axis=1))
        ends.append((at + 0.5) / (width, height))
    return np.concatenate(ends, axis=1)


def tint(
    scan: RangeScan, camera: RectifiedCamera, seen_from: np.ndarray, now: np.ndarray
) -> np.ndarray:
    """Codes (COLUMNS,) of the ranges in the columns of an image.

    seen_from, now: poses (3,) of the robot at the scan and at the image; what stands still is
    carried along.
    """
    answered = ~np.isnan(scan.range)
    sensor = compose(seen_from, np.array(scan.origin))
    angle = sensor[2] + scan.bearing[answered]
    reach = np.minimum(scan.range[answered], scan.max_range)
    points = sensor[:2] + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    eye = compose(now, np.array(scan.origin))
    x, y = (points - eye[:2]).T
    ahead = math.cos(eye[2]) * x + math.sin(eye[2]) * y
    left = math.cos(eye[2]) * y - math.sin(eye[2]) * x
    before = ahead > 0.0
    column = camera.cx - camera.f * left[before] / ahead[before]
    place = np.floor((column + 0.5) * COLUMNS / camera.width).astype(int)
    inside = (place >= 0) & (place < COLUMNS)
    codes = _distance_codes(np.hypot(ahead, left)[before], scan.max_range)
    codes[~np.isfinite(scan.range[answered][before])] = FREE
    nearest = np.full(COLUMNS, FREE + 1)
    np.minimum.at(nearest, place[inside], codes[inside])
    return np.where(nearest > FREE, UNKNOWN, nearest).astype(np.uint8)


def depth(frame: StereoFrame, ranger: StereoRanger) -> np.ndarray:
    """Codes (h, w) of the disparity image, every second column of it."""
    steps = np.arange(1, ranger.match.disparities * SUBPIXEL + 1)
    near = _distance_codes(ranger.camera.depth_factor * SUBPIXEL / steps, ranger.max_range)
    table = np.concatenate([[UNKNOWN], near]).astype(np.uint8)
    return table[np.clip(frame.disparity[:, ::2], 0, len(table) - 1)]


def local_map(
    window: Sequence[tuple[np.ndarray, RangeScan]], settings: MappingSettings
) -> OccupancyGrid:
    """The local map so far, in the frame of the latest of the poses (3,), as stage 1 draws it."""
    last = inverse(window[-1][0])
    scans = [scan for _, scan in window]
    sensors = np.array([compose(compose(last, pose), np.array(s.origin)) for pose, s in window])
    log_odds, _, origin = draw_thinned(scans, sensors, settings, SensorModel.of(settings))
    return OccupancyGrid(probability(log_odds).astype(np.float32), origin, settings.cell)


def cells(grid: OccupancyGrid) -> tuple[np.ndarray, float]:
    """Codes (h, w) of a map, row 0 = lowest y, and the side of a cell [m]; a large map coarser, so
    that no obstacle gets lost."""
    factor = -(-max(grid.probability.shape) // MOST_CELLS)
    return coarser(grid.classes, factor).view(np.uint8), grid.cell * factor


def thinned(path: np.ndarray) -> np.ndarray:
    """Points (n, 2) float32 of a path (m, 3), as many as one can tell apart."""
    if not len(path):
        return np.empty((0, 2), np.float32)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    step = max(PATH_STEP, way[-1] / PATH_POINTS)
    kept = np.flatnonzero(np.diff(np.floor(way / step), prepend=-1.0))
    return path[np.append(kept, len(path) - 1), :2].astype(np.float32)


def _distance_codes(distance: np.ndarray, max_range: float) -> np.ndarray:
    return 1 + np.minimum(np.round(distance / max_range * (FAR - 1)), FAR - 1).astype(int)
