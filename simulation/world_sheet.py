"""The content of a world file: walls with doors, furniture, a route; and the cells they fill.

beemap_world: 1
size: [18, 18]                  # m; the origin is the lower-left corner, cells of 0.05 m
walls:
  - {from: [0, 4], to: [18, 4], thickness: 0.15, doors: [[2.5, 1.0]]}
furniture:
  desk: {size: [1.6, 0.8], at: [[3.2, 1.0], [6.1, 1.0, 90]]}
route: {waypoints: [[1, 5], [17, 5], [17, 13]], fillet: 0.6}
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from simulation.route import Route

Metres = Annotated[float, Meta(ge=-500.0, le=500.0)]
Length = Annotated[float, Meta(gt=0.0, le=500.0)]
CellSide = Annotated[float, Meta(ge=0.005, le=1.0)]
Point = tuple[Metres, Metres]
T = TypeVar("T")

MOST_CELLS = 25_000_000
LARGEST_FILLET = 0.5  # of routes that do not say theirs [m]


class WorldError(ValueError):
    """A world or route that cannot be used; names the file, the field and the remedy."""


class Wall(msgspec.Struct, forbid_unknown_fields=True, rename={"start": "from", "end": "to"}):
    """A straight wall; `doors`: [distance of the gap's middle from `from`, its width] each."""

    start: Point
    end: Point
    thickness: Length = 0.15
    doors: list[tuple[Length, Length]] = []

    def pieces(self) -> Iterator[tuple[float, float]]:
        """(begin, end) of what the doors leave, as distances from `from`.

        The wall's ends reach half its thickness further: corners close.
        """
        begin, end = -0.5 * self.thickness, math.dist(self.start, self.end) + 0.5 * self.thickness
        for middle, width in sorted(self.doors):
            yield begin, middle - 0.5 * width
            begin = middle + 0.5 * width
        yield begin, end


class Furniture(msgspec.Struct, forbid_unknown_fields=True):
    """Boxes of one size; `at`: [x, y] or [x, y, yaw in degrees] of the middle of each."""

    size: tuple[Length, Length]
    at: list[Annotated[list[Metres], Meta(min_length=2, max_length=3)]]


class RouteSheet(msgspec.Struct, forbid_unknown_fields=True):
    """Corners of the route and the radius by which they are rounded; none: as large as fits,
    up to LARGEST_FILLET."""

    waypoints: list[Point]
    fillet: Length | None = None

    def route(self, where: str) -> Route:
        """Driven at 1 m/s, so that times are distances. Raises WorldError."""
        points = np.array(self.waypoints).reshape(-1, 2)
        fillet = _largest_fillet(points) if self.fillet is None else self.fillet
        try:
            return Route.through(points, fillet, speed=1.0, turn_rate=math.inf)
        except ValueError as error:
            raise WorldError(f"{where}: waypoints: {error}") from None


class WorldSheet(msgspec.Struct, forbid_unknown_fields=True):
    """A world file as it stands."""

    beemap_world: Literal[1]
    size: tuple[Length, Length]
    walls: list[Wall]
    cell: CellSide = 0.05
    furniture: dict[str, Furniture] = {}
    route: RouteSheet | None = None

    def __post_init__(self) -> None:
        if self.size[0] * self.size[1] > MOST_CELLS * self.cell**2:
            raise ValueError(f"size {self.size} m has too many cells of {self.cell} m")

    def solid(self) -> np.ndarray:
        """(H, W) bool, row 0 = lowest y: the cells that walls and furniture fill."""
        columns, rows = (max(round(side / self.cell), 1) for side in self.size)
        solid = np.zeros((rows, columns), bool)
        for wall in self.walls:
            start, span = np.array(wall.start), np.subtract(wall.end, wall.start)
            direction = span / max(float(np.hypot(*span)), 1e-9)
            yaw = math.atan2(span[1], span[0])
            for begin, end in wall.pieces():
                middle = start + 0.5 * (begin + end) * direction
                _fill(solid, self.cell, middle, (end - begin, wall.thickness), yaw)
        for kind in self.furniture.values():
            for x, y, *yaw in kind.at:
                _fill(solid, self.cell, np.array([x, y]), kind.size, math.radians(sum(yaw)))
        return solid


def checked(data: Any, kind: type[T], source: str) -> T:
    """`data` as the fields of `kind`; a WorldError names the field and what is allowed."""
    if _holds_nan(data):
        raise WorldError(f"{source}: holds .nan where a number is needed")
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at ")
        field = place.strip("`").removeprefix("$").removeprefix(".")
        raise WorldError(": ".join(filter(None, (source, field, message)))) from None


def _holds_nan(data: Any) -> bool:
    """Whether nan stands somewhere in it: limits let it pass."""
    if isinstance(data, dict):
        return any(map(_holds_nan, data.values()))
    if isinstance(data, list):
        return any(map(_holds_nan, data))
    return data != data


def _fill(
    solid: np.ndarray, cell: float, middle: np.ndarray, size: tuple[float, float], yaw: float
) -> None:
    """Fill the cells whose centre lies in the box of `size` (length, width) m.

    A side shorter than a cell's diagonal is taken as that long: nothing thin has gaps.
    """
    if min(size) <= 0.0:
        return
    half = np.maximum(size, math.sqrt(2.0) * cell) / 2.0
    radius = float(np.hypot(*half))
    rows, columns = (
        np.arange(max(math.floor((at - radius) / cell), 0), min(math.ceil((at + radius) / cell), n))
        for at, n in zip(middle[::-1], solid.shape, strict=True)
    )
    x, y = np.meshgrid((columns + 0.5) * cell - middle[0], (rows + 0.5) * cell - middle[1])
    along = x * math.cos(yaw) + y * math.sin(yaw)
    across = y * math.cos(yaw) - x * math.sin(yaw)
    inside = (np.abs(along) < half[0] + 1e-9) & (np.abs(across) < half[1] + 1e-9)
    solid[np.ix_(rows, columns)] |= inside


def _largest_fillet(points: np.ndarray) -> float:
    """Radius [m] that every leg between two corners has room for, at most LARGEST_FILLET."""
    legs = np.diff(points, axis=0)
    turns = np.diff(np.arctan2(legs[:, 1], legs[:, 0]))
    # Of each unit of radius a corner takes tan(turn / 2) from both its legs.
    taken = np.abs(np.tan(np.concatenate([[0.0], turns, [0.0]]) / 2.0))
    room = np.hypot(legs[:, 0], legs[:, 1]) / np.maximum(taken[:-1] + taken[1:], 1e-9)
    return min(LARGEST_FILLET, 0.999 * float(room.min(initial=math.inf)))
