"""A local map as stage 2 takes it: cells decided by the two thresholds (paper Sec. III-C)."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import cv2
import numpy as np

from mapping.global_kernels import AROUND, FREE, MARGIN, NEAR_OCCUPIED, OBSERVED, OCCUPIED, POSSIBLE
from mapping.local_map import LocalMap
from mapping.sensor_model import SensorModel
from odometry.motion import compose


@dataclass(frozen=True)
class LocalCells:
    """bits: (H, W) uint8 of each cell, see `global_kernels`, with a margin of unobserved cells;
    near: (H, W) uint8, not zero within AROUND cells of a decided one; origin: (x, y) of
    the lower-left corner of cell [0, 0] in the robot's frame [m]."""

    bits: np.ndarray
    near: np.ndarray
    origin: tuple[float, float]
    cell: float

    def reached_from(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest global cell (row, column) touched from any of the poses (N, 3)."""
        height, width = self.bits.shape
        x0, y0 = self.origin
        x1, y1 = x0 + width * self.cell, y0 + height * self.cell
        corners = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x0, y1, 0.0], [x1, y1, 0.0]])
        xy = compose(poses[:, None, :], corners[None])[..., :2]
        cells = np.floor(xy.reshape(-1, 2)[:, ::-1] / self.cell).astype(np.int64)
        return cells.min(axis=0), cells.max(axis=0)


@dataclass(frozen=True)
class PackedCells:
    """Local cells kept for the length of a run: mostly empty, they pack to a few kB."""

    packed: bytes
    shape: tuple[int, int]
    origin: tuple[float, float]
    cell: float

    @staticmethod
    def of(cells: LocalCells) -> PackedCells:
        """Pack."""
        return PackedCells(
            zlib.compress(cells.bits.tobytes(), 1), cells.bits.shape, cells.origin, cells.cell
        )

    def cells(self) -> LocalCells:
        """Unpack."""
        bits = np.frombuffer(zlib.decompress(self.packed), np.uint8).reshape(self.shape)
        return LocalCells(bits, _near(bits), self.origin, self.cell)


def classify(local: LocalMap, model: SensorModel, tolerance: int) -> LocalCells:
    """Decide the cells of a local map.

    The map is updated where obstacles most likely stand. A match is sought there, within
    `tolerance` cells, and with half the merit wherever the doubt of an obstacle reaches: the
    first alone is too brittle for a few hundred particles, the second alone too blunt.
    """
    L = np.pad(local.log_odds, MARGIN, constant_values=np.nan)
    occupied = np.greater(L, model.local_occupied_above)
    free = np.less(L, model.local_free_below)
    likely = cv2.dilate(occupied.astype(np.uint8), _square(tolerance))
    possible = cv2.dilate(np.pad(local.possible, MARGIN).astype(np.uint8), _square(tolerance))
    bits = (
        np.where(np.isnan(L), 0, OBSERVED)
        | np.where(occupied, OCCUPIED, 0)
        | np.where(free, FREE, 0)
        | np.where(likely, NEAR_OCCUPIED, 0)
        | np.where(possible, POSSIBLE, 0)
    ).astype(np.uint8)
    margin = MARGIN * local.cell
    x, y = local.origin
    return LocalCells(bits, _near(bits), (x - margin, y - margin), local.cell)


def _near(bits: np.ndarray) -> np.ndarray:
    return cv2.dilate((bits & (OCCUPIED | FREE) > 0).astype(np.uint8), _square(AROUND))


def _square(reach: int) -> np.ndarray:
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
