"""A floor plan of simulation/worlds stood up: its walls, doors and furniture as boxes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulation.boxes import Box
from simulation.scene_fields import SceneError, fields, length, material, named
from simulation.walls import wall_boxes
from simulation.world import load_sheet
from simulation.world_sheet import Wall, WorldError, WorldSheet

PICTURE = (0.70, 1.00)  # m, width and height
PICTURE_HANGS = (0.35, 0.75)  # lower edges, by turns [m]
PICTURE_EVERY = 2.4  # m
PICTURE_PROUD = 0.01  # m


def world_sheet(name: Any, where: str) -> WorldSheet:
    """The world that a scene's room names."""
    try:
        return load_sheet(str(name))
    except WorldError as error:
        raise SceneError(f"{where}: {error}") from None


def extruded(sheet: WorldSheet, walls: str, height: float, furniture: Any, where: str) -> list[Box]:
    """Walls of the material `walls`, with pictures on them, and furniture as high and of such
    material as `furniture` says of every kind of the world."""
    boxes = [box for run in sheet.walls for box in wall_boxes(run, walls, height)]
    boxes += [picture for run in sheet.walls for picture in _pictures(run, sheet)]
    looks = named(furniture, where)
    fields(looks, where, set(sheet.furniture))
    for kind, placed in sheet.furniture.items():
        look = fields(looks[kind], f"{where}.{kind}", {"material", "height"})
        name = material(look["material"], f"{where}.{kind}.material")
        high = length(look["height"], f"{where}.{kind}.height")
        for x, y, *yaw in placed.at:
            boxes.append(Box(name, (x, y), 0.0, (*placed.size, high), math.radians(sum(yaw))))
    return boxes


def _pictures(run: Wall, sheet: WorldSheet) -> list[Box]:
    """Pictures on both sides of a wall where it is long enough, inside the world."""
    start, span = np.array(run.start), np.subtract(run.end, run.start)
    along = span / np.hypot(*span)
    across = np.array([-along[1], along[0]])
    boxes = []
    for begin, end in run.pieces():
        count = int((end - begin) / PICTURE_EVERY + 0.5)
        for i in range(count):
            at = begin + (i + 0.5) * (end - begin) / count
            for side in (-1.0, 1.0):
                out = 0.5 * (run.thickness + PICTURE_PROUD) * side
                x, y = start + at * along + out * across
                if not (0.0 < x < sheet.size[0] and 0.0 < y < sheet.size[1]):
                    continue
                turn = math.atan2(*across[::-1] * side)
                size = (PICTURE_PROUD, *PICTURE)
                low = PICTURE_HANGS[(i + (side > 0)) % 2]
                boxes.append(Box("poster", (float(x), float(y)), low, size, turn))
    return boxes
