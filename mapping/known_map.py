"""A map made before, in which a run begins: at a known pose, or at one that is searched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mapping.errors import MappingError
from mapping.grid import OccupancyGrid
from mapping.sensor_model import CLAMP, SensorModel
from mapping.settings import MappingSettings
from mapping.tiles import NO_TILE, STEPS_PER_LOG_ODDS, TILE, UNKNOWN, TileMaps

# Probabilities of a map are read from files that may say 0 and 1.
SUREST = 1.0 / (1.0 + np.exp(-CLAMP))


@dataclass(frozen=True, eq=False)
class KnownMap:
    """grid: the map; pose: (3,) where the run begins in it; None: to be searched."""

    grid: OccupancyGrid
    pose: np.ndarray | None = None


def tile_maps(grid: OccupancyGrid, particles: int, settings: MappingSettings) -> TileMaps:
    """The map as that of every particle; all share its tiles.

    Raises:
        MappingError: its cells have another size than the settings say.
    """
    if abs(grid.cell - settings.cell) > 1e-6:
        raise MappingError(
            f"the map has cells of {grid.cell:g} m: set mapping.cell={grid.cell:g} to go on in it"
        )
    corner = np.round(np.array(grid.origin[::-1]) / grid.cell).astype(np.int64)  # row, column
    first = np.floor_divide(corner, TILE)
    height, width = grid.probability.shape
    last = np.floor_divide(corner + np.array([height, width]) - 1, TILE) + 1
    rows, columns = (last - first).tolist()
    values = np.full((rows * TILE, columns * TILE), UNKNOWN, np.int8)
    row, column = (corner - first * TILE).tolist()
    values[row : row + height, column : column + width] = _steps(grid.probability)
    tiles = values.reshape(rows, TILE, columns, TILE).swapaxes(1, 2).reshape(-1, TILE, TILE)
    used = np.flatnonzero((tiles != UNKNOWN).any(axis=(1, 2)))
    maps = TileMaps(particles)
    maps.tiles = np.concatenate([tiles[used], maps.tiles])
    threshold = SensorModel.of(settings).occupied_above * STEPS_PER_LOG_ODDS
    bits = (tiles[used] > threshold) @ (1 << np.arange(TILE, dtype=np.int64))
    maps.obstacles = np.concatenate([bits.astype(np.uint32), maps.obstacles])
    shares = np.full(len(used), particles, np.int32)
    maps.references = np.concatenate([shares, maps.references])
    table = np.full(rows * columns, NO_TILE, np.int32)
    table[used] = np.arange(len(used))
    maps.table = np.repeat(table.reshape(1, rows, columns), particles, axis=0)
    maps.corner = first
    return maps


def _steps(probability: np.ndarray) -> np.ndarray:
    """Log-odds (H, W) int8 as tiles hold them."""
    p = np.clip(probability.astype(float), 1.0 - SUREST, SUREST)
    steps = np.rint(np.log(p / (1.0 - p)) * STEPS_PER_LOG_ODDS)
    return np.where(np.isnan(steps), float(UNKNOWN), np.clip(steps, -127, 127)).astype(np.int8)
