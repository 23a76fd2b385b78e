"""The particles' maps: one pool of square tiles, shared by copy on write.

Each particle holds a table of tile numbers. Resampling copies tables and counts references;
a tile is copied only when a particle that shares it writes to it. Memory grows with what was
seen, not with the map's bounding box times the particles; the table grows as the robot goes.

Values are int8: log-odds in steps of CLAMP / 127 (0.04), half the memory and traffic of int16
at an error of 1 % of one observation. UNKNOWN marks a cell that nobody has observed.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from mapping.sensor_model import CLAMP

TILE_BITS = 5
TILE = 1 << TILE_BITS
STEPS_PER_LOG_ODDS = 127.0 / CLAMP
UNKNOWN = np.int8(-128)
NO_TILE = -1


class TileMaps:
    """Maps of N particles on one global grid whose cell (0, 0) has its corner at (0, 0) m.

    tiles: (capacity, TILE, TILE) int8; obstacles: (capacity, TILE) uint32, a bit for every cell
    of a tile's row that is an obstacle (few are: matching visits only these);
    table: (N, rows, columns) int32 of tile numbers;
    corner: (row, column) of the table's first tile, counted in tiles from the grid's origin.
    """

    def __init__(self, particles: int):
        self.tiles = np.empty((64, TILE, TILE), np.int8)
        self.obstacles = np.zeros((64, TILE), np.uint32)
        self.references = np.zeros(64, np.int32)
        self.table = np.full((particles, 0, 0), NO_TILE, np.int32)
        self.corner = np.zeros(2, np.int64)

    @property
    def tiles_in_use(self) -> int:
        """Tiles that some particle refers to."""
        return int(np.count_nonzero(self.references))

    @property
    def bytes(self) -> int:
        """Memory of all maps: the pool with its spare tiles, and the tables."""
        return sum(a.nbytes for a in (self.tiles, self.obstacles, self.references, self.table))

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
        wanted = _wanted(self.table, needed, self.references)
        begin = np.concatenate([[0], np.cumsum(wanted)])
        free = np.flatnonzero(self.references == 0)
        if free.size < begin[-1]:
            self._enlarge(int(begin[-1]) - free.size)
            free = np.flatnonzero(self.references == 0)
        left = np.full(begin[-1], NO_TILE, np.int32)
        _make_writable(
            self.table, needed, self.references, self.tiles, self.obstacles, free, begin, left
        )
        self.references[free[: begin[-1]]] = 1
        left = left[left != NO_TILE]
        self.references -= np.bincount(left, minlength=len(self.references)).astype(np.int32)

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
        """By an eighth at least: memory is a matter of N and of what was seen, not of doubling."""
        capacity = max(len(self.tiles) + missing, len(self.tiles) * 9 // 8)
        self.tiles, self.obstacles, self.references = (
            np.concatenate([a, np.zeros((capacity - len(a), *a.shape[1:]), a.dtype)])
            for a in (self.tiles, self.obstacles, self.references)
        )


@njit(cache=True, nogil=True, parallel=True)
def _wanted(table, needed, references):
    """How many new tiles each particle needs: for places without one, or with a shared one."""
    particles, rows, columns = table.shape
    wanted = np.zeros(particles, np.int64)
    for k in prange(particles):
        count = 0
        for row in range(rows):
            for column in range(columns):
                number = table[k, row, column]
                if needed[k, row, column] and (number == NO_TILE or references[number] > 1):
                    count += 1
        wanted[k] = count
    return wanted


@njit(cache=True, nogil=True, parallel=True)
def _make_writable(table, needed, references, tiles, obstacles, free, begin, left):
    """Particle k takes the tiles free[begin[k]:begin[k + 1]]; `left`: the ones it leaves."""
    particles, rows, columns = table.shape
    for k in prange(particles):
        taken = begin[k]
        for row in range(rows):
            for column in range(columns):
                old = table[k, row, column]
                if not needed[k, row, column] or (old != NO_TILE and references[old] == 1):
                    continue
                new = free[taken]
                if old == NO_TILE:
                    tiles[new] = UNKNOWN
                    obstacles[new] = 0
                else:
                    tiles[new] = tiles[old]
                    obstacles[new] = obstacles[old]
                    left[taken] = old
                taken += 1
                table[k, row, column] = new
