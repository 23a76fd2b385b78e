"""What a run consists of, as rerun shows it: frames in metres and radians, z up."""

from __future__ import annotations

import math

import cv2
import numpy as np
import rerun as rr

from mapping.grid import OCCUPIED, UNKNOWN, OccupancyGrid, coarser
from mapping.local_map import LocalMap
from mapping.sensor_model import probability
from odometry.motion import placed
from pipeline.rectified_picture import coloured
from stereo.ranger import StereoFrame
from stereo.scan import RangeScan

WIDEST = 320  # px of an image
QUALITY = 80
# Side of the longest map shown on the way; the last one is shown as it is [cells].
LONGEST = 400
PATH, TRUTH, ODOMETRY = (30, 120, 200), (70, 150, 40), (150, 150, 150)  # RGB
PARTICLE, HIT, ROBOT = (250, 150, 60), (210, 50, 50), (60, 60, 60)
WALL, FREE = (150, 40, 120), (200, 225, 245)  # of a local map, which lies over the map
FREE_GREY, OCCUPIED_GREY = 250, 20  # of the map
THICK = 0.02  # m


def grid_map(grid: OccupancyGrid, whole: bool = True) -> rr.GridMap:
    """A map in grey; whole: every cell of it, however many."""
    step = 1 if whole else math.ceil(max(grid.probability.shape) / LONGEST)
    classes = coarser(grid.classes, step)
    grey = np.where(classes == OCCUPIED, OCCUPIED_GREY, FREE_GREY)
    pixels = np.repeat(grey[..., None], 3, axis=2)
    return _grid(classes != UNKNOWN, pixels, (*grid.origin, 0.0), step * grid.cell, order=0)


def local_map(local: LocalMap, pose: np.ndarray) -> rr.GridMap:
    """A local map where the robot stood when it was closed, at `pose` (3,)."""
    corner = placed(pose, np.array([local.origin]))[0]
    p = probability(local.log_odds)
    pixels = np.where((p > 0.5)[..., None], WALL, FREE)
    return _grid(~np.isnan(p), pixels, (*corner, float(pose[2])), local.cell, order=1)


def robot(pose: np.ndarray) -> rr.Transform3D:
    """Its frame in that of the map."""
    x, y, theta = (float(v) for v in pose)
    return rr.Transform3D(
        translation=[x, y, 0.0],
        rotation_axis_angle=rr.RotationAxisAngle([0, 0, 1], rr.Angle(rad=theta)),
    )


def heading() -> rr.Arrows3D:
    """What stands for the robot in its own frame."""
    return rr.Arrows3D(origins=[[0, 0, 0.05]], vectors=[[0.4, 0, 0]], colors=[ROBOT], radii=0.04)


def scan_points(scan: RangeScan) -> rr.Points3D:
    """The hits in the robot's frame."""
    hit = np.isfinite(scan.range)
    bearing, ranges = scan.bearing[hit], scan.range[hit]
    points = np.stack([ranges * np.cos(bearing), ranges * np.sin(bearing)], axis=1)
    return _points(placed(np.array(scan.origin), points), HIT, 0.025)


def particles(poses: np.ndarray) -> rr.Points3D:
    """Where each of them (n, 3) is."""
    return _points(poses[:, :2], PARTICLE, 0.03)


def path(poses: np.ndarray, colour: tuple[int, int, int]) -> rr.LineStrips3D:
    """The way through poses (n, 3)."""
    strip = np.column_stack([poses[:, :2], np.full(len(poses), THICK)])
    return rr.LineStrips3D([strip], colors=[colour], radii=THICK)


def picture(image: np.ndarray) -> rr.EncodedImage:
    """An image (H, W) or (H, W, 3) BGR, made smaller, as a JPEG."""
    scale = WIDEST / image.shape[1]
    if scale < 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg")


def disparity(frame: StereoFrame, depth_factor: float) -> rr.EncodedImage:
    """Near is red, far blue, grey has no match."""
    return picture(coloured(frame.disparity, depth_factor)[0])


def _points(xy: np.ndarray, colour: tuple[int, int, int], radius: float) -> rr.Points3D:
    positions = np.column_stack([xy, np.full(len(xy), 2.0 * THICK)])
    return rr.Points3D(positions, colors=[colour], radii=radius)


def _grid(
    known: np.ndarray, pixels: np.ndarray, pose: tuple[float, float, float], cell: float, order: int
) -> rr.GridMap:
    """pixels: (H, W, 3) RGB of the cells; what is not known (H, W) is left clear. pose: of the
    lower left corner. order: higher ones lie over the others."""
    # The first row of an image is its upper one.
    image = np.dstack([pixels * known[..., None], 255 * known])[::-1].astype(np.uint8)
    return rr.GridMap(
        data=image.tobytes(),
        format=rr.components.ImageFormat(
            width=known.shape[1], height=known.shape[0], color_model="RGBA", channel_datatype="U8"
        ),
        cell_size=cell,
        translation=[*pose[:2], order * THICK],
        rotation_axis_angle=rr.RotationAxisAngle([0, 0, 1], rr.Angle(rad=pose[2])),
        opacity=0.99,  # at 1 the viewer looks at no pixel's own
        draw_order=order,
    )
