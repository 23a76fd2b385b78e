"""map.png: the map as a person wants to see it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from mapping.grid import FREE, OCCUPIED, OccupancyGrid

LONG_SIDE = 1400  # of the map in the picture [px]
MARGIN = 24
FOOTER = 84
# BGR
PAPER = (255, 255, 255)
UNKNOWN = (226, 222, 218)
WALL = (48, 36, 28)
INK = (60, 50, 44)
PATH = (200, 120, 30)
START = (70, 150, 40)
END = (50, 50, 210)
PARTICLE = (60, 150, 250)
PLACE = (150, 50, 130)
FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_map(
    grid: OccupancyGrid,
    path: np.ndarray,
    particles: np.ndarray,
    caption: str,
    places: Sequence[Mapping[str, Any]] = (),
) -> np.ndarray:
    """A picture (H, W, 3) uint8 BGR of the three classes of the map's cells with the path (n, 3),
    which lies in it, the particles' last poses, places by `name`, `x`, `y`, and a scale."""
    height, width = grid.probability.shape
    zoom = int(np.clip(LONG_SIDE // max(height, width), 1, 16))
    canvas = np.full((height * zoom + FOOTER + 2 * MARGIN, _width(width * zoom), 3), 255, np.uint8)
    canvas[:] = PAPER
    picture = cv2.resize(
        _colours(grid)[::-1], None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST
    )
    left = (canvas.shape[1] - picture.shape[1]) // 2
    canvas[MARGIN : MARGIN + picture.shape[0], left : left + picture.shape[1]] = picture

    def pixels(xy: np.ndarray) -> np.ndarray:
        cells = (np.asarray(xy, float) - grid.origin) / grid.cell
        u = left + cells[..., 0] * zoom
        v = MARGIN + (height - cells[..., 1]) * zoom
        return np.round(np.stack([u, v], axis=-1)).astype(np.int32)

    if len(path):
        cv2.polylines(canvas, [pixels(path[:, :2])], False, PATH, 2, cv2.LINE_AA)
        for point in pixels(particles[:, :2]):
            cv2.circle(canvas, _xy(point), 2, PARTICLE, -1, cv2.LINE_AA)
        cv2.circle(canvas, _xy(pixels(path[0, :2])), 8, START, -1, cv2.LINE_AA)
        end = pixels(path[-1, :2])
        cv2.rectangle(canvas, _xy(end - 7), _xy(end + 7), END, -1)
    for place in places:
        u, v = _xy(pixels(np.array([place["x"], place["y"]])))
        cv2.drawMarker(canvas, (u, v), PLACE, cv2.MARKER_DIAMOND, 16, 3, cv2.LINE_AA)
        # OpenCV's letters are those of ASCII.
        name = place["name"].encode("ascii", "replace").decode()
        for colour, width in ((PAPER, 4), (PLACE, 1)):
            cv2.putText(canvas, name, (u + 12, v + 5), FONT, 0.6, colour, width, cv2.LINE_AA)
    _footer(canvas, grid.cell / zoom, MARGIN * 2 + picture.shape[0], caption)
    return canvas


def _width(map_width: int) -> int:
    return max(map_width + 2 * MARGIN, 1100)  # the legend takes as much


def _xy(point: np.ndarray) -> tuple[int, int]:
    return int(point[0]), int(point[1])


def _colours(grid: OccupancyGrid) -> np.ndarray:
    classes = grid.classes
    colours = np.full((*classes.shape, 3), UNKNOWN, np.uint8)
    colours[classes == FREE], colours[classes == OCCUPIED] = PAPER, WALL
    return colours


def _footer(canvas: np.ndarray, metres_per_pixel: float, top: int, caption: str) -> None:
    """Scale bar, legend and caption below the map."""
    lengths = (100, 50, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1)
    metres = next((m for m in lengths if m / metres_per_pixel <= 320), lengths[-1])
    length, x, y = round(metres / metres_per_pixel), MARGIN, top + 20
    cv2.rectangle(canvas, (x, y - 4), (x + length, y + 2), INK, -1)
    for end in (x, x + length):
        cv2.line(canvas, (end, y - 9), (end, y + 7), INK, 2)
    cv2.putText(canvas, f"{metres:g} m", (x + length + 12, y + 6), FONT, 0.6, INK, 1, cv2.LINE_AA)
    x = x + length + 100
    for colour, name in (
        (PATH, "path"),
        (START, "start"),
        (END, "end"),
        (PARTICLE, "particles at the end"),
        (WALL, "obstacle"),
        (PAPER, "free"),
        (UNKNOWN, "unknown"),
    ):
        cv2.rectangle(canvas, (x, y - 9), (x + 16, y + 7), colour, -1)
        if colour == PAPER:
            cv2.rectangle(canvas, (x, y - 9), (x + 16, y + 7), INK, 1)
        cv2.putText(canvas, name, (x + 24, y + 5), FONT, 0.5, INK, 1, cv2.LINE_AA)
        x += 40 + cv2.getTextSize(name, FONT, 0.5, 1)[0][0] + 14
    cv2.putText(canvas, caption, (MARGIN, y + 42), FONT, 0.5, INK, 1, cv2.LINE_AA)
