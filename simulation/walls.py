"""What a scene is built of before it is furnished: the room's shell, walls, glazing, as boxes."""

from __future__ import annotations

import math
from typing import Any

from simulation.boxes import Box
from simulation.materials import PANES
from simulation.scene_fields import SceneError, entries, fields, length, listed, material, numbers
from simulation.world_sheet import Wall

WALL_THICKNESS = 0.10
SLAB_THICKNESS = 0.10
DOOR_HEIGHT = 2.06
# Glazing: posts, rails and panes [m].
POST = 0.05
LOW_RAIL, TOP_RAIL = 0.09, 0.07
PANE_THICKNESS = 0.012


def shell(size: tuple[float, ...], materials: dict[str, str]) -> list[Box]:
    """Floor, ceiling and the four walls of a room of `size` (length, width, height) m."""
    length, width, height = size
    t = WALL_THICKNESS
    slab = (length + 2 * t, width + 2 * t, SLAB_THICKNESS)
    middle = (length / 2, width / 2)
    walls = materials["walls"]
    return [
        Box(materials["floor"], middle, -SLAB_THICKNESS, slab),
        Box(materials["ceiling"], middle, height, slab),
        Box(walls, (length / 2, -t / 2), 0.0, (length + 2 * t, t, height)),
        Box(walls, (length / 2, width + t / 2), 0.0, (length + 2 * t, t, height)),
        Box(walls, (-t / 2, width / 2), 0.0, (t, width, height)),
        Box(walls, (length + t / 2, width / 2), 0.0, (t, width, height)),
    ]


def wall(entry: Any, where: str, height: float) -> list[Box]:
    """The boxes of an entry under `walls`; `height`: the room's."""
    given = fields(entry, where, {"from", "to", "material"}, {"thickness", "height", "doors"})
    run = _run(given, where, WALL_THICKNESS)
    high = length(given.get("height", height), f"{where}.height")
    return wall_boxes(run, material(given["material"], f"{where}.material"), high)


def wall_boxes(run: Wall, name: str, height: float) -> list[Box]:
    """The pieces of a wall, and what is above its doors."""
    boxes = [
        _along(run, name, begin, end, 0.0, height, run.thickness) for begin, end in run.pieces()
    ]
    if height > DOOR_HEIGHT:
        for middle, width in run.doors:
            begin, end = middle - 0.5 * width, middle + 0.5 * width
            boxes.append(
                _along(run, name, begin, end, DOOR_HEIGHT, height - DOOR_HEIGHT, run.thickness)
            )
    return [box for box in boxes if box.size[0] > 1e-6]


def glazing(entry: Any, where: str, height: float) -> list[Box]:
    """The boxes of an entry under `glazing`: panes between metal posts and rails."""
    given = fields(entry, where, {"from", "to"}, {"glass", "pane", "height", "doors"})
    run = _run(given, where, POST)
    name = given.get("glass", "glass")
    if name not in PANES:
        raise SceneError(f"{where}.glass: '{name}' is no glass (give {listed(PANES)})")
    high = length(given.get("height", height), f"{where}.height")
    wanted = length(given.get("pane", 1.0), f"{where}.pane")
    metal = "aluminium"
    span = math.dist(run.start, run.end)
    boxes = [_along(run, metal, 0.0, span, high - TOP_RAIL, TOP_RAIL, POST)]
    posts = set()
    for begin, end in run.pieces():
        begin, end = max(begin, 0.0), min(end, span)
        if end - begin < 2.0 * POST:
            continue
        boxes.append(_along(run, metal, begin, end, 0.0, LOW_RAIL, POST))
        panes = max(round((end - begin) / wanted), 1)
        step = (end - begin) / panes
        clear = high - LOW_RAIL - TOP_RAIL
        for i in range(panes):
            low = begin + i * step
            boxes.append(_along(run, name, low, low + step, LOW_RAIL, clear, PANE_THICKNESS))
        posts |= {round(begin + i * step, 6) for i in range(panes + 1)}
    for at in sorted(posts):
        boxes.append(_along(run, metal, at - POST / 2, at + POST / 2, 0.0, high, POST + 0.01))
    return boxes


def _run(given: dict[str, Any], where: str, thickness: float) -> Wall:
    start, end = (numbers(given[key], 2, f"{where}.{key}") for key in ("from", "to"))
    span = math.dist(start, end)
    if span < 0.05:
        raise SceneError(f"{where}.to: {given['to']!r} is where the wall begins: give another end")
    doors = []
    for place, door in entries(given["doors"], f"{where}.doors") if "doors" in given else []:
        middle, width = numbers(door, 2, place)
        if width <= 0 or middle - width / 2 < 0 or middle + width / 2 > span:
            raise SceneError(
                f"{place}: {door!r} is not within the wall: "
                f"[middle from its begin, width] on its {span:.2f} m"
            )
        doors.append((middle, width))
    thick = length(given.get("thickness", thickness), f"{where}.thickness")
    return Wall((start[0], start[1]), (end[0], end[1]), thick, doors)


def _along(
    run: Wall, name: str, begin: float, end: float, low: float, height: float, thickness: float
) -> Box:
    """Box from `begin` to `end` m along the wall."""
    (x, y), span = run.start, math.dist(run.start, run.end)
    c, s = (run.end[0] - x) / span, (run.end[1] - y) / span
    middle = 0.5 * (begin + end)
    centre = (x + middle * c, y + middle * s)
    return Box(name, centre, low, (end - begin, thickness, height), math.atan2(s, c))
