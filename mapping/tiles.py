"""The particles' maps: one pool of square tiles, shared by copy on write.

Each particle holds a table of tile numbers. Resampling copies tables and counts references;
a tile is copied only when a particle that shares it writes to it. Memory grows with what was
seen, not with the map's bounding box times the particles; the table grows as the robot goes.

Values are int8: log-odds in steps of CLAMP / 127 (0.04), half the memory and traffic of int16
at an error of 1 % of one observation. UNKNOWN marks a cell that nobody has observed.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mapping.sensor_model import CLAMP

TILE = 32
STEPS_PER_LOG_ODDS = 127.0 / CLAMP
UNKNOWN = np.int8(-128)
NO_TILE = -1


class TileMaps:
    """Maps of N particles on one global grid whose cell (0, 0) has its corner at (0, 0) m.

    tiles: (capacity, TILE, TILE) int8; table: (N, rows, columns) int32 of tile numbers;
    corner: (row, column) of the table's first tile, counted in tiles from the grid's origin.
    """

    def __init__(self, particles: int):
        self.tiles = np.empty((64, TILE, TILE), np.int8)
        self.references = np.zeros(64, np.int32)
        self.table = np.full((particles, 0, 0), NO_TILE, np.int32)
        self.corner = np.zeros(2, np.int64)

    @property
    def tiles_in_use(self) -> int:
        """Tiles that some particle refers to."""
        return int(np.count_nonzero(self.references))

    @property
    def _extent(self) -> tuple[int, int]:
        """Rows and columns of the table."""
        return len(self.table[0]), len(self.table[0].T)

    def cover(self, low: np.ndarray, high: np.ndarray) -> None:
        """Grow the table so that it covers global cells (row, column) from `low` to `high`."""
        first = np.floor_divide(low, TILE)
        last = np.floor_divide(high, TILE) + 1
        rows, columns = self._extent
        if self.table.size:
            shape = np.array([rows, columns])
            first = np.minimum(first, self.corner)
            last = np.maximum(last, self.corner + shape)
            if (first == self.corner).all() and (last == self.corner + shape).all():
                return
        table = np.full((len(self.table), *(last - first)), NO_TILE, np.int32)
        row, column = self.corner - first if self.table.size else (0, 0)
        table[:, row : row + rows, column : column + columns] = self.table
        self.table, self.corner = table, first

    def make_writable(self, needed: np.ndarray) -> None:
        """Give every particle a tile of its own wherever `needed` (N, rows, columns) is set."""
        wanted = int(np.count_nonzero(needed))
        free = np.flatnonzero(self.references == 0)
        if free.size < wanted:
            self._enlarge(wanted - free.size)
            free = np.flatnonzero(self.references == 0)
        _make_writable(self.table, needed, self.tiles, self.references, free)

    def resample(self, ancestors: np.ndarray) -> None:
        """Particle k goes on with the map of `ancestors[k]`; no tile is copied."""
        self.table = self.table[ancestors]
        used = self.table[self.table != NO_TILE]
        self.references[:] = np.bincount(used, minlength=len(self.references))

    def log_odds(self, particle: int) -> tuple[np.ndarray, tuple[float, float]]:
        """One particle's map (H, W) float32, NaN unknown, and its corner in cells (x, y)."""
        rows, columns = self._extent
        values = np.full((rows, TILE, columns, TILE), UNKNOWN, np.int8)
        for row, column in zip(*np.nonzero(self.table[particle] != NO_TILE), strict=True):
            values[row, :, column, :] = self.tiles[self.table[particle, row, column]]
        values = values.reshape(rows * TILE, columns * TILE)
        grid = np.where(values == UNKNOWN, np.float32(np.nan), values / STEPS_PER_LOG_ODDS)
        return grid.astype(np.float32), (self.corner[1] * TILE, self.corner[0] * TILE)

    def _enlarge(self, missing: int) -> None:
        capacity = max(len(self.tiles) + missing, len(self.tiles) * 3 // 2)
        tiles = np.empty((capacity, TILE, TILE), np.int8)
        tiles[: len(self.tiles)] = self.tiles
        references = np.zeros(capacity, np.int32)
        references[: len(self.references)] = self.references
        self.tiles, self.references = tiles, references


@njit(cache=True, nogil=True)
def _make_writable(table, needed, tiles, references, free):
    particles, rows, columns = table.shape
    taken = 0
    for k in range(particles):
        for row in range(rows):
            for column in range(columns):
                if not needed[k, row, column]:
                    continue
                old = table[k, row, column]
                if old != NO_TILE and references[old] == 1:
                    continue
                new = free[taken]
                taken += 1
                if old == NO_TILE:
                    tiles[new] = UNKNOWN
                else:
                    tiles[new] = tiles[old]
                    references[old] -= 1
                references[new] = 1
                table[k, row, column] = new
