"""Scene: rooms, what stands in them, who walks there, and the robot's route, read from YAML.

Lengths in metres, angles in degrees counter-clockwise from above, speeds in m/s.

beemap_scene: 1
room: {size: [12, 7.5, 2.5], floor: vinyl, walls: white, ceiling: ceiling}
walls:                              # more walls; doors: [middle from the wall's begin, width]
  - {from: [0, 4], to: [8, 4], material: plaster, thickness: 0.1, doors: [[2.5, 1.0]]}
glazing:                            # posts about every `pane` m, and glass between them
  - {from: [8, 4], to: [12, 4], glass: frosted_glass, pane: 1.0, height: 2.3, doors: [[1, 0.9]]}
models:                             # boxes about an origin of their own; a front faces +x
  table:
    - {material: wood, at: [0, 0, 0.72], size: [0.8, 1.6, 0.03]}      # at: middle, underside
    - {material: metal, at: [0.37, 0.77, 0], size: [0.03, 0.03, 0.72], turn: 10}
objects:                            # single boxes, or models; repeat: [how many, step x, step y]
  - {model: table, at: [3, 2], turn: 90, repeat: [2, 2.5, 0]}
  - {material: lamp, at: [6, 2, 2.4], size: [1.2, 0.6, 0.05]}
movers:                             # models that walk along a path and back; they face +x
  - {model: person, path: [[1, 6], [9, 6]], speed: 0.8}
route: {speed: 0.34, turn_rate: 27, fillet: 0.6, waypoints: [[1, 1], [11, 1], [11, 3]]}

`walls`, `glazing`, `models` and `movers` may be left out; so may `light: coarse`, which bakes light
faster and leaves faint clouds on walls. A room may also be a floor plan of
simulation/worlds, or a world file, stood up: `room: {world: flat, height: 2.5, floor: ...}`; then
`furniture: {desk: {material: wood, height: 0.75}, ...}` says how its furniture looks, and the
route's waypoints and fillet are the world's unless given. Materials: see materials.py.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from calibration.yamlfile import YamlFileError, parse_yaml, read_yaml
from simulation.boxes import Box, Faces, box_faces
from simulation.extrusion import extruded, world_sheet
from simulation.movers import Mover
from simulation.route import Route
from simulation.scene_fields import (
    SceneError,
    entries,
    fields,
    length,
    listed,
    material,
    named,
    number,
    numbers,
    points,
    positive,
)
from simulation.walls import glazing, shell, wall
from simulation.world_sheet import RouteSheet

__all__ = ["Scene", "SceneError", "load_scene", "scene_from_dict", "scene_names"]

MOST_REPEATS = 1000
SURFACES = ("floor", "walls", "ceiling")


@dataclass(frozen=True)
class Scene:
    """A place of `size` (length, width, height) m, its boxes (walls included), the route, the
    movers, which are not among the boxes, and how its light is baked."""

    name: str
    size: tuple[float, float, float]
    boxes: tuple[Box, ...]
    route: Route
    movers: tuple[Mover, ...] = ()
    coarse_light: bool = False

    def faces(self) -> Faces:
        """The faces of every box; a box's seed is its place in the list."""
        return box_faces(self.boxes)

    def mover_faces(self) -> list[Faces]:
        """The faces of every mover about its own origin; seeds go on where the boxes' end."""
        first, result = len(self.boxes), []
        for mover in self.movers:
            result.append(box_faces(mover.boxes, first))
            first += len(mover.boxes)
        return result


def scene_names() -> list[str]:
    """The scenes that ship with the package."""
    names = (entry.name for entry in files("simulation.scenes").iterdir())
    return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))


def load_scene(name_or_path: str | Path) -> Scene:
    """Read a scene that ships with the package (by its name) or a scene file (by its path).

    Raises:
        SceneError: no such scene, or a field that is missing, unknown or out of range.
    """
    packaged = files("simulation.scenes") / f"{name_or_path}.yaml"
    try:
        if isinstance(name_or_path, str) and name_or_path.isidentifier() and packaged.is_file():
            data = parse_yaml(packaged.read_text(encoding="utf-8"), packaged.name)
        else:
            data = read_yaml(Path(name_or_path))
    except YamlFileError as error:
        raise SceneError(str(error)) from None
    return scene_from_dict(data, str(name_or_path))


def scene_from_dict(data: Any, source: str) -> Scene:
    """A `Scene` from the parsed content of a scene file; `source` is named in errors."""
    if not isinstance(data, dict) or data.get("beemap_scene") != 1:
        raise SceneError(f"{source}: not a scene file (no 'beemap_scene: 1' in it)")
    optional = {"walls", "glazing", "models", "movers", "furniture", "light"}
    top = fields(data, source, {"beemap_scene", "room", "objects", "route"}, optional)
    size, boxes, route = _room(top, source)
    for part, build in (("walls", wall), ("glazing", glazing)):
        for place, entry in entries(top[part], f"{source}: {part}") if part in top else []:
            boxes += build(entry, place, size[2])
    models = _models(top.get("models", {}), f"{source}: models")
    for place, entry in entries(top["objects"], f"{source}: objects"):
        boxes += _object(entry, place, models)
    walkers = entries(top["movers"], f"{source}: movers") if "movers" in top else []
    movers = tuple(_mover(entry, place, models) for place, entry in walkers)
    way = _route(top["route"], f"{source}: route", size, route)
    light = top.get("light", "smooth")
    if light not in ("smooth", "coarse"):
        raise SceneError(f"{source}: light: {light!r} unknown: give smooth or coarse")
    return Scene(Path(source).stem, size, tuple(boxes), way, movers, light == "coarse")


def _room(
    top: dict[str, Any], source: str
) -> tuple[tuple[float, float, float], list[Box], RouteSheet | None]:
    """Size and boxes of the room, and the route that its world holds."""
    where = f"{source}: room"
    of_world = isinstance(top["room"], dict) and "world" in top["room"]
    needed = {"world", "height"} if of_world else {"size"}
    room = fields(top["room"], where, needed | set(SURFACES))
    surfaces = {part: material(room[part], f"{where}.{part}") for part in SURFACES}
    if not of_world:
        if "furniture" in top:
            raise SceneError(f"{source}: furniture: belongs to a room of a world: use objects")
        size = positive(room["size"], 3, f"{where}.size")
        return (size[0], size[1], size[2]), shell(size, surfaces), None
    sheet = world_sheet(room["world"], f"{where}.world")
    height = length(room["height"], f"{where}.height")
    boxes = shell((*sheet.size, height), surfaces)
    furniture = top.get("furniture", {})
    boxes += extruded(sheet, surfaces["walls"], height, furniture, f"{source}: furniture")
    return (*sheet.size, height), boxes, sheet.route


def _models(data: Any, where: str) -> dict[str, list[Box]]:
    return {
        name: [_box(part, place) for place, part in entries(parts, f"{where}.{name}")]
        for name, parts in named(data, where).items()
    }


def _object(entry: Any, where: str, models: dict[str, list[Box]]) -> list[Box]:
    if not isinstance(entry, dict) or "model" not in entry:
        given = fields(entry, where, {"material", "at", "size"}, {"turn", "repeat"})
        boxes = [_box({key: given[key] for key in given if key != "repeat"}, where)]
    else:
        given = fields(entry, where, {"model", "at"}, {"turn", "repeat"})
        x, y = numbers(given["at"], 2, f"{where}.at")
        turn = math.radians(number(given.get("turn", 0.0), f"{where}.turn"))
        boxes = [box.placed(x, y, turn) for box in _model(given["model"], where, models)]
    count, dx, dy = numbers(given.get("repeat", [1, 0, 0]), 3, f"{where}.repeat")
    if count not in range(1, MOST_REPEATS + 1):
        raise SceneError(f"{where}.repeat: {count:g} is no count from 1 to {MOST_REPEATS}")
    return [box.placed(i * dx, i * dy, 0.0) for i in range(int(count)) for box in boxes]


def _model(name: Any, where: str, models: dict[str, list[Box]]) -> list[Box]:
    if name not in models:
        raise SceneError(f"{where}.model: '{name}' is not under models (there: {listed(models)})")
    return models[name]


def _box(entry: Any, where: str) -> Box:
    given = fields(entry, where, {"material", "at", "size"}, {"turn"})
    x, y, z = numbers(given["at"], 3, f"{where}.at")
    turn = math.radians(number(given.get("turn", 0.0), f"{where}.turn"))
    name = material(given["material"], f"{where}.material")
    return Box(name, (x, y), z, positive(given["size"], 3, f"{where}.size"), turn)


def _mover(entry: Any, where: str, models: dict[str, list[Box]]) -> Mover:
    given = fields(entry, where, {"model", "path", "speed"})
    boxes = _model(given["model"], where, models)
    path = points(given["path"], f"{where}.path")
    if len(path) < 2 or any(a == b for a, b in itertools.pairwise(path)):
        raise SceneError(f"{where}.path: at least two different points in a row are needed")
    speed = length(given["speed"], f"{where}.speed")
    return Mover(tuple(boxes), tuple((x, y) for x, y in path), speed)


def _route(data: Any, where: str, room: tuple[float, ...], of_world: RouteSheet | None) -> Route:
    free = {"waypoints", "fillet"}
    if isinstance(data, dict) and of_world and not free & set(data):
        data = {
            "waypoints": [list(p) for p in of_world.waypoints],
            "fillet": of_world.fillet,
            **data,
        }
    given = fields(data, where, {"speed", "turn_rate"} | free)
    waypoints = points(given["waypoints"], f"{where}.waypoints")
    for i, (x, y) in enumerate(waypoints):
        if not (0.0 < x < room[0] and 0.0 < y < room[1]):
            raise SceneError(
                f"{where}.waypoints[{i}]: ({x}, {y}) is outside the room ({room[0]} x {room[1]} m)"
            )
    fillet, speed, rate = (
        length(given[key], f"{where}.{key}") for key in ("fillet", "speed", "turn_rate")
    )
    try:
        return Route.through(np.array(waypoints), fillet, speed, math.radians(rate))
    except ValueError as error:
        raise SceneError(f"{where}.waypoints: {error}") from None
