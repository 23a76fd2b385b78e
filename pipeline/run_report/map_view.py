"""The map of a report: a picture of its cells, with the path and the marks drawn over it.

Both are placed by shares of the view, so that strokes, numbers and words keep their size while the
map grows and shrinks with the screen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mapping.grid import FREE, OCCUPIED, OccupancyGrid, coarser
from pipeline.pages.render import png_uri
from pipeline.pages.svg import round_steps, way
from pipeline.picture import PAPER, WALL
from pipeline.places import Place

MOST_CELLS = 1500  # along a side of the picture; of larger maps several cells are one
MARGIN = 0.03  # around map and path, as a share of the longer side
SCALE = 0.3  # longest scale bar, as a share of the width
LENGTHS = (200, 100, 50, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1)  # of scale bars [m]
MARKS = 8  # along the path
# Closer together than these shares of the view numbers of metres are left out, pairs are joined.
CROWDED, TOGETHER = 12.0, 5.0  # %


@dataclass(frozen=True)
class Mark:
    """Words on the map; left, top: of their middle, in % of the view."""

    words: tuple[str, ...]
    left: float
    top: float

    def near(self, other: Mark, share: float) -> bool:
        """Whether both are closer than a share of the view [%]."""
        return max(abs(self.left - other.left), abs(self.top - other.top)) < share


@dataclass(frozen=True)
class MapView:
    """width, height: of the view [m]; picture: of the cells, at left, top, wide, high [% of the
    view]; path, particles: SVG path data in metres from the upper left; start, end: of the path;
    metres: driven so far, along it; suspects: numbers of the pairs shown; places: that somebody
    named; scale: length of the bar [m]."""

    width: float
    height: float
    picture: str
    box: tuple[float, float, float, float]
    path: str
    particles: str
    ends: list[Mark]
    metres: list[Mark]
    suspects: list[Mark]
    places: list[Mark]
    scale: float


def map_view(
    grid: OccupancyGrid,
    path: np.ndarray,
    driven: np.ndarray,
    particles: np.ndarray,
    suspects: Sequence[int],
    places: Sequence[Place] = (),
) -> MapView:
    """The map with a path (n, 3), metres driven at each of its poses (n,), the particles' poses at
    the end (k, 3), the numbers of the poses at which suspects were seen (below 0: nowhere), and
    places."""
    height, width = grid.probability.shape
    low = np.array(grid.origin, float)
    high = low + grid.cell * np.array([width, height])
    seen = path[:, :2] if len(path) else np.array([low, high])
    left, bottom = np.minimum(low, seen.min(axis=0))
    right, top = np.maximum(high, seen.max(axis=0))
    margin = MARGIN * max(right - left, top - bottom)
    left, bottom, right, top = left - margin, bottom - margin, right + margin, top + margin
    size = np.array([right - left, top - bottom])

    def placed(points: np.ndarray) -> np.ndarray:
        return np.stack([points[:, 0] - left, top - points[:, 1]], axis=1)

    def mark(text: str, index: int) -> Mark:
        x, y = placed(path[index : index + 1])[0] / size * 100.0
        return Mark((text,), round(float(x), 2), round(float(y), 2))

    box = (low[0] - left, top - high[1], high[0] - low[0], high[1] - low[1])
    share = np.array(box) / np.tile(size, 2) * 100.0
    pairs = _joined(
        [mark(str(n), i) for n, i in enumerate(suspects, start=1) if 0 <= i < len(path)]
    )
    named = [mark(one.name, min(one.index, len(path) - 1)) for one in places if len(path)]
    steps = round_steps(0.0, float(driven[-1]), MARKS)[1:] if len(path) else []
    return MapView(
        width=float(size[0]),
        height=float(size[1]),
        picture=png_uri(_picture(grid)),
        box=(float(share[0]), float(share[1]), float(share[2]), float(share[3])),
        path=way(placed(path)) if len(path) else "",
        particles="".join(f"M{x:.3f} {y:.3f}h0" for x, y in placed(particles)[:500]),
        ends=[mark("start", 0), mark("end", len(path) - 1)] if len(path) else [],
        metres=_apart(
            [mark(f"{m:g}", int(np.searchsorted(driven, m - 1e-9))) for m in steps],
            [*pairs, *named],
        ),
        suspects=pairs,
        places=named,
        scale=next((m for m in LENGTHS if m <= SCALE * size[0]), LENGTHS[-1]),
    )


def _apart(marks: Sequence[Mark], others: Sequence[Mark]) -> list[Mark]:
    """Those that are hidden neither by each other nor by others."""
    kept: list[Mark] = []
    for mark in marks:
        if not any(mark.near(one, CROWDED) for one in kept) and not any(
            mark.near(one, TOGETHER) for one in others
        ):
            kept.append(mark)
    return kept


def _joined(marks: Sequence[Mark]) -> list[Mark]:
    """Those that would hide each other put side by side."""
    kept: list[Mark] = []
    for mark in marks:
        for number, other in enumerate(kept):
            if mark.near(other, TOGETHER):
                kept[number] = replace(other, words=(*other.words, *mark.words))
                break
        else:
            kept.append(mark)
    return kept


def _picture(grid: OccupancyGrid) -> np.ndarray:
    """The cells (H, W, 4) uint8 BGRA, the highest y above; the page shows through the unknown."""
    classes = coarser(grid.classes, -(-max(grid.probability.shape) // MOST_CELLS))
    picture = np.zeros((*classes.shape, 4), np.uint8)
    picture[classes == FREE] = (*PAPER, 255)
    picture[classes == OCCUPIED] = (*WALL, 255)
    return picture[::-1]
