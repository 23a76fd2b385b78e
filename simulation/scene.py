"""Scene: a furnished room and the robot's route through it, read from YAML."""

from __future__ import annotations

import math
from collections.abc import Set
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from calibration.yamlfile import YamlFileError, parse_yaml, read_yaml
from simulation.boxes import Box, Faces, box_faces
from simulation.materials import MATERIALS
from simulation.route import Route

WALL_THICKNESS = 0.10
SLAB_THICKNESS = 0.10


class SceneError(ValueError):
    """A scene file that cannot be used; the message names the file, the field and the remedy."""


@dataclass(frozen=True)
class Scene:
    """A room of `size` (length, width, height) m, its boxes (walls included) and the route."""

    name: str
    size: tuple[float, float, float]
    boxes: tuple[Box, ...]
    route: Route

    def faces(self) -> Faces:
        """The six faces of every box; a box's seed is its place in the list."""
        return box_faces(self.boxes)


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
    top = _fields(data, source, {"beemap_scene", "room", "objects", "route"}, {"models"})
    where = f"{source}: room"
    room = _fields(top["room"], where, {"size", "floor", "walls", "ceiling"})
    size = _positive(room["size"], 3, f"{where}.size")
    shell = {
        part: _material(room[part], f"{where}.{part}") for part in ("floor", "walls", "ceiling")
    }
    models = _models(top.get("models", {}), f"{source}: models")
    boxes = _shell(size, shell)
    for i, entry in enumerate(_list(top["objects"], f"{source}: objects")):
        boxes += _object(entry, f"{source}: objects[{i}]", models)
    return Scene(
        Path(source).stem, size, tuple(boxes), _route(top["route"], f"{source}: route", size)
    )


def _shell(size: tuple, material: dict[str, str]) -> list[Box]:
    length, width, height = size
    t = WALL_THICKNESS
    slab = (length + 2 * t, width + 2 * t, SLAB_THICKNESS)
    middle = (length / 2, width / 2)
    return [
        Box(material["floor"], middle, -SLAB_THICKNESS, slab),
        Box(material["ceiling"], middle, height, slab),
        Box(material["walls"], (length / 2, -t / 2), 0.0, (length + 2 * t, t, height)),
        Box(material["walls"], (length / 2, width + t / 2), 0.0, (length + 2 * t, t, height)),
        Box(material["walls"], (-t / 2, width / 2), 0.0, (t, width, height)),
        Box(material["walls"], (length + t / 2, width / 2), 0.0, (t, width, height)),
    ]


def _models(data: Any, where: str) -> dict[str, list[Box]]:
    if not isinstance(data, dict):
        raise SceneError(f"{where}: expected names with lists of boxes, got {data!r}")
    return {
        name: [
            _box(part, f"{where}.{name}[{i}]")
            for i, part in enumerate(_list(parts, f"{where}.{name}"))
        ]
        for name, parts in data.items()
    }


def _object(entry: Any, where: str, models: dict[str, list[Box]]) -> list[Box]:
    if not isinstance(entry, dict) or "model" not in entry:
        return [_box(entry, where)]
    placed = _fields(entry, where, {"model", "at"}, {"turn"})
    if placed["model"] not in models:
        raise SceneError(
            f"{where}.model: '{placed['model']}' is not under models (there: {_listed(models)})"
        )
    x, y = _numbers(placed["at"], 2, f"{where}.at")
    turn = math.radians(_numbers([placed.get("turn", 0.0)], 1, f"{where}.turn")[0])
    return [box.placed(x, y, turn) for box in models[placed["model"]]]


def _box(entry: Any, where: str) -> Box:
    fields = _fields(entry, where, {"material", "at", "size"}, {"turn"})
    x, y, z = _numbers(fields["at"], 3, f"{where}.at")
    turn = math.radians(_numbers([fields.get("turn", 0.0)], 1, f"{where}.turn")[0])
    material = _material(fields["material"], f"{where}.material")
    return Box(material, (x, y), z, _positive(fields["size"], 3, f"{where}.size"), turn)


def _route(data: Any, where: str, room: tuple[float, ...]) -> Route:
    fields = _fields(data, where, {"waypoints", "fillet", "speed", "turn_rate"})
    points = [
        _numbers(p, 2, f"{where}.waypoints[{i}]")
        for i, p in enumerate(_list(fields["waypoints"], f"{where}.waypoints"))
    ]
    for i, (x, y) in enumerate(points):
        if not (0.0 < x < room[0] and 0.0 < y < room[1]):
            raise SceneError(
                f"{where}.waypoints[{i}]: ({x}, {y}) is outside the room ({room[0]} x {room[1]} m)"
            )
    fillet, speed, rate = (
        _positive([fields[key]], 1, f"{where}.{key}")[0] for key in ("fillet", "speed", "turn_rate")
    )
    try:
        return Route.through(np.array(points), fillet, speed, math.radians(rate))
    except ValueError as error:
        raise SceneError(f"{where}.waypoints: {error}") from None


def _fields(
    data: Any, where: str, required: Set[str], optional: Set[str] = frozenset()
) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise SceneError(f"{where}: expected the fields {_listed(required)}")
    for key in data:
        if key not in required | optional:
            known = _listed(required | optional)
            raise SceneError(f"{where}: unknown field '{key}' (known: {known})")
    for key in required:
        if key not in data:
            raise SceneError(f"{where}: field '{key}' is missing")
    return data


def _list(value: Any, where: str) -> list:
    if not isinstance(value, list) or not value:
        raise SceneError(f"{where}: expected a list, got {value!r}")
    return value


def _material(value: Any, where: str) -> str:
    if value not in MATERIALS:
        raise SceneError(f"{where}: '{value}' unknown (known: {_listed(MATERIALS)})")
    return value


def _numbers(value: Any, count: int, where: str) -> tuple[float, ...]:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(_is_number(v) for v in value):
        raise SceneError(f"{where}: expected {count} finite number(s), got {value!r}")
    return tuple(float(v) for v in value)


def _positive(value: Any, count: int, where: str) -> tuple[Any, ...]:
    numbers = _numbers(value, count, where)
    if min(numbers) <= 0:
        raise SceneError(f"{where}: {value!r} must be positive")
    return numbers


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _listed(names: Any) -> str:
    return ", ".join(sorted(names))
