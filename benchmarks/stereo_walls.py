"""A flat wall through stereo and stage 1: does it stand, or dissolve with distance?"""

from __future__ import annotations

import math

import cv2
import numpy as np

from benchmarks.walls import WALL_X, Place, wall_hall, wall_pairs
from mapping.local_map import LocalMap, LocalMapper
from mapping.sensor_model import log_odds
from odometry.motion import Motion, compose, inverse
from pipeline.experiments.report import markdown_table
from pipeline.run import USABLE_CELLS
from pipeline.settings import Settings
from simulation.rigs import bent_minibee, with_baseline
from simulation.tracer import Tracer
from stereo.ranger import StereoRanger

DISTANCES = (2.0, 4.0, 6.0)  # m, along the view, at the middle of the way
ANGLES = (0, 15, 30, 45)  # deg between the view and the wall's normal
BASELINES = (0.060, 0.120)  # m
HEADER = (
    "baseline",
    "farthest range",
    "distance",
    *(f"{angle} deg: occupied" for angle in ANGLES),
    *(f"{angle} deg: free" for angle in ANGLES),
)


def main() -> str:
    """Measure; the section as Markdown."""
    cv2.setNumThreads(1)
    tracer = Tracer(wall_hall())
    rows = [_row(tracer, baseline, distance) for baseline in BASELINES for distance in DISTANCES]
    return "\n\n".join(
        [
            "## A flat wall, ten observations: `python -m benchmarks.stereo_walls`",
            markdown_table(HEADER, rows),
            "640x480, the robot drives straight on, 0.17 m between observations, exact poses, so "
            "that its middle place is at the distance. Cells of the wall that at least half of the "
            "observations look at within the farthest range used: occupied = a cell within one "
            "cell is above 0.7, free = the cell itself is below 0.2. (n): fewer than ten such "
            "cells; -: none. Asked for: at least 90 % occupied, at most 3 % free.",
        ]
    )


def _row(tracer: Tracer, baseline: float, distance: float) -> list[str]:
    rig = with_baseline(bent_minibee(), baseline)
    settings = Settings()
    ranger = StereoRanger(rig, usable_sigma=USABLE_CELLS * settings.mapping.cell)
    occupied, free = [], []
    for angle in ANGLES:
        mapper = LocalMapper(settings.mapping)
        places = wall_pairs(tracer, rig, distance, math.radians(angle), settings.mapping.spacing)
        local, before = None, places[0].pose
        for place in places:
            scan = ranger(place.pair)
            step = compose(inverse(before), place.pose)
            mapper.move(Motion(step, np.zeros((3, 3)), 0, place.pair.stamp))
            local, before = mapper.observe(scan), place.pose
        assert local is not None
        cells = _wall_cells(places, ranger, local)
        stands, gone = _state(local, cells, settings)
        occupied.append(_told(stands))
        free.append(_told(gone))
    reach = f"{ranger.max_range:.1f} m"
    return [f"{1e3 * baseline:.0f} mm", reach, f"{distance:g} m", *occupied, *free]


def _wall_cells(places: list[Place], ranger: StereoRanger, local: LocalMap) -> np.ndarray:
    """(k, 2) row and column in the local map of the wall's cells that half of the scans see."""
    camera = ranger.camera
    half_view = math.atan((camera.width - 1) / 2.0 / camera.f)
    last = places[-1].pose
    along = np.arange(0.0, 40.0, local.cell / 4.0) - 20.0
    points = np.column_stack([np.full(along.size, WALL_X), along, np.zeros(along.size)])
    seen = np.zeros(along.size, int)
    for place in places:
        eye = compose(place.pose, np.array([*camera.position[:2], camera.yaw]))
        x, y, _ = compose(inverse(eye), points).T
        seen += (np.abs(np.arctan2(y, x)) < half_view) & (np.hypot(x, y) < ranger.max_range)
    inside = points[seen >= len(places) / 2]
    at = compose(inverse(last), inside)[:, :2]
    cells = np.floor((at - local.origin) / local.cell).astype(int)
    cells = np.unique(cells[:, ::-1], axis=0) if len(cells) else np.empty((0, 2), int)
    rows, columns = local.log_odds.shape
    inside_map = (cells >= 1).all(axis=1) & (cells < (rows - 1, columns - 1)).all(axis=1)
    return cells[inside_map]


def _state(local: LocalMap, cells: np.ndarray, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """Whether each wall cell (k,) stands within one cell, and whether it is free."""
    solid = np.nan_to_num(local.log_odds, nan=0.0) > log_odds(settings.mapping.occupied)
    stands = np.zeros(len(cells), bool)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            stands |= solid[cells[:, 0] + i, cells[:, 1] + j]
    gone = local.log_odds[cells[:, 0], cells[:, 1]] < log_odds(settings.mapping.free)
    return stands, gone


def _told(mask: np.ndarray) -> str:
    if not mask.size:
        return "-"
    few = "" if mask.size >= 10 else f" ({mask.size})"
    return f"{100 * mask.mean():.0f} %{few}"


if __name__ == "__main__":
    print(main())
