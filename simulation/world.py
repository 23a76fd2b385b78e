"""World: a floor plan of solid and open cells, and the route through it.

Read from a world file (see world_sheet.py; those in simulation/worlds ship with the package), or
from any floor plan as map_server's image and YAML.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from calibration.yamlfile import YamlFileError, parse_yaml, read_yaml
from simulation.route import Route
from simulation.world_sheet import CellSide, Metres, RouteSheet, WorldError, WorldSheet, checked

# Points of a path in a text file that are closer to the one before are passed over [m].
LEAST_STEP = 0.05


@dataclass(frozen=True)
class World:
    """solid: (H, W) bool, row 0 = lowest y; cell: side of a cell [m]; origin: (x, y) of the
    lower-left corner of cell [0, 0] [m]; route: the one that the file holds."""

    name: str
    solid: np.ndarray
    cell: float
    origin: tuple[float, float]
    route: Route | None = None

    def index(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row, column (...) of the cells that hold `points` (..., 2) m, and whether they lie
        inside the world; row and column are 0 where not."""
        at = np.floor((np.asarray(points) - self.origin) / self.cell).astype(np.int64)
        inside = np.all((at >= 0) & (at < self.solid.shape[::-1]), axis=-1)
        row, column = np.where(inside, at[..., 1], 0), np.where(inside, at[..., 0], 0)
        return row, column, inside


def load_world(name_or_path: str | Path) -> World:
    """A world that ships with the package (by its name), a world file, or a map_server file.

    In a map_server image all cells above `occupied_thresh` are solid, all others are open.

    Raises:
        WorldError: no such world, or a field that is missing, unknown or out of range.
    """
    data, path = _content(name_or_path)
    if isinstance(data, dict) and "image" in data:
        return _world_of_image(checked(data, MapServerSheet, str(path)), path)
    sheet = checked(data, WorldSheet, str(path))
    route = sheet.route.route(f"{path}: route") if sheet.route else None
    return World(path.stem, sheet.solid(), sheet.cell, (0.0, 0.0), route)


def load_sheet(name_or_path: str | Path) -> WorldSheet:
    """What a world file says, that of a world which ships with the package by its name.

    Raises:
        WorldError: as `load_world`; or it is an image.
    """
    data, path = _content(name_or_path)
    return checked(data, WorldSheet, str(path))


def _content(name_or_path: str | Path) -> tuple[Any, Path]:
    """The parsed YAML of a world, and the path or name to call it by."""
    path = Path(name_or_path)
    packaged = files("simulation.worlds") / f"{name_or_path}.yaml"
    is_name = str(name_or_path).isidentifier()
    if is_name and packaged.is_file():
        return parse_yaml(packaged.read_text(encoding="utf-8"), packaged.name), path
    if is_name and not path.exists():
        raise WorldError(
            f"{name_or_path}: no such world: give {', '.join(world_names())}, or a file"
        )
    return _yaml(path), path


def world_names() -> list[str]:
    """The worlds that ship with the package."""
    names = (entry.name for entry in files("simulation.worlds").iterdir())
    return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))


def load_route(path: str | Path) -> Route:
    """The route of a YAML file `waypoints: [[x, y], ...]` with `fillet: m` (optional), or along
    the points of a text file: `x y` or `x, y` a line, or a TUM path.

    A text file may begin with a line of names; # begins a comment. Corners are rounded as
    RouteSheet says.

    Raises:
        WorldError: it cannot be read, or cannot be driven forward.
    """
    path = Path(path)
    if path.suffix in (".yaml", ".yml"):
        return checked(_yaml(path), RouteSheet, str(path)).route(str(path))
    points: list[tuple[float, float]] = []
    for point in _text_points(path):
        if not points or np.hypot(*np.subtract(point, points[-1])) >= LEAST_STEP:
            points.append(point)
    return RouteSheet(points).route(str(path))


class MapServerSheet(msgspec.Struct):
    """What counts here of a map_server file."""

    image: str
    resolution: CellSide
    origin: tuple[Metres, Metres, float]
    occupied_thresh: float
    negate: int = 0
    mode: Literal["trinary", "scale"] = "trinary"


def _world_of_image(sheet: MapServerSheet, path: Path) -> World:
    import cv2

    x, y, yaw = sheet.origin
    if yaw != 0.0:
        raise WorldError(f"{path}: origin: the yaw {yaw} must be 0: turn the image instead")
    image = path.parent / sheet.image
    try:
        content = np.frombuffer(image.read_bytes(), np.uint8)
    except OSError as error:
        raise WorldError(f"{path}: image: {image} cannot be read ({error.strerror})") from None
    grey = cv2.imdecode(content, cv2.IMREAD_GRAYSCALE) if content.size else None
    if grey is None:
        raise WorldError(f"{path}: image: {image} is not a readable image (PGM or PNG)")
    occupancy = (grey if sheet.negate else 255.0 - grey) / 255.0
    # The image's first row is the world's last: images count downwards.
    solid = np.ascontiguousarray(occupancy[::-1] > sheet.occupied_thresh)
    return World(path.stem, solid, sheet.resolution, (x, y))


def _text_points(path: Path) -> list[tuple[float, float]]:
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise WorldError(f"{path}: cannot be read ({error.strerror})") from None
    points = []
    for number, line in enumerate(lines, start=1):
        fields = line.partition("#")[0].replace(",", " ").split()
        if not fields:
            continue
        try:
            values = [float(field) for field in fields]
            if len(values) not in (2, 3, 8) or not np.isfinite(values).all():
                raise ValueError
        except ValueError:
            if not points and number == 1:
                continue  # the names of the columns
            raise WorldError(
                f"{path}, line {number}: expected 'x y', 'x y heading' or the 8 numbers of a TUM "
                f"path, got '{line.strip()[:60]}'"
            ) from None
        points.append((values[1], values[2]) if len(values) == 8 else (values[0], values[1]))
    return points


def _yaml(path: Path) -> Any:
    try:
        return read_yaml(path)
    except YamlFileError as error:
        raise WorldError(str(error)) from None
