"""Stage 2: local maps become the global map by a Rao-Blackwellized particle filter.

Paper Sec. III-B, for every local map z_t with the motion u_t since the one before:

    1a  sample a pose for every particle from p(x_t | x_{t-1}, u_t)            eq (5)
    1b  weigh it by how its own map matches the local map                      eqs (6), (8)
    1c  update its map by the local map's obstacle and free cells              eqs (1), (2)
    2   resample when too few particles carry the weight                       eq (7)
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from mapping.global_kernels import (
    FREE,
    NEAR_OCCUPIED,
    OBSERVED,
    OCCUPIED,
    POSSIBLE,
    match,
    touched,
    update,
)
from mapping.grid import OccupancyGrid
from mapping.local_map import LocalMap
from mapping.sensor_model import SensorModel, probability
from mapping.settings import MappingSettings
from mapping.tiles import STEPS_PER_LOG_ODDS, TileMaps
from odometry.motion import Motion, compose


@dataclass(frozen=True)
class FilterHealth:
    """How one step of the filter went; `overlap` (|S|) and `matched` (n / |S|) of the best."""

    stamp: int
    observations: int
    n_eff: float
    resampled: bool
    overlap: int
    matched: float
    judged: int
    answered: float
    tiles: int


class ParticleFilter:
    """N particles, each with a path, a map and an accumulated likelihood."""

    def __init__(self, settings: MappingSettings | None = None, seed: int = 0):
        self.settings = settings or MappingSettings()
        self.seed = seed
        self.model = SensorModel.of(self.settings)
        N = self.settings.particles
        self.poses = np.zeros((N, 3))
        self.log_weights = np.zeros(N)
        self.log_likelihood = np.zeros(N)  # summed over each particle's whole ancestry
        self.maps = TileMaps(N)
        self.health: list[FilterHealth] = []
        self._history: list[np.ndarray] = [self.poses]  # poses after each step
        self._ancestors: list[np.ndarray] = []  # of each step, in the step before

    def add(self, local: LocalMap) -> FilterHealth:
        """One step of the algorithm above."""
        bits = classify(local, self.model, self.settings.match_tolerance)
        self.poses = self._sample(local.motion)
        overlap, matched = self._match(bits, local)
        log_l = log_likelihoods(overlap, matched, self.settings)
        self.log_weights = self.log_weights + log_l
        self.log_likelihood = self.log_likelihood + log_l
        self._update(bits, local)
        best = self.best
        n_eff, resampled = self._resample()
        health = FilterHealth(
            stamp=local.stamp,
            observations=local.observations,
            n_eff=n_eff,
            resampled=resampled,
            overlap=int(overlap[best]),
            matched=float(matched[best] / overlap[best]) if overlap[best] else 0.0,
            judged=int(np.count_nonzero(overlap >= max(self.settings.min_overlap, 1))),
            answered=local.answered,
            tiles=self.maps.tiles_in_use,
        )
        self.health.append(health)
        return health

    @property
    def best(self) -> int:
        """The particle with the largest likelihood summed over its whole ancestry."""
        return int(np.argmax(self.log_likelihood))

    def path(self, particle: int | None = None) -> np.ndarray:
        """Poses (steps + 1, 3) of a particle's ancestry, the start first; None: the best's."""
        k = self.best if particle is None else particle
        path = [self.poses[k]]
        for poses, ancestors in zip(
            reversed(self._history[:-1]), reversed(self._ancestors), strict=True
        ):
            k = ancestors[k]
            path.append(poses[k])
        return np.array(path[::-1])

    def grid(self, particle: int | None = None) -> OccupancyGrid:
        """A particle's map; None: the best's."""
        log_odds, corner = self.maps.log_odds(self.best if particle is None else particle)
        cell = self.settings.cell
        return OccupancyGrid(
            probability(log_odds).astype(np.float32), (corner[0] * cell, corner[1] * cell), cell
        ).trimmed()

    def _sample(self, motion: Motion) -> np.ndarray:
        """Eq (5): every particle moves by the motion and its own draw of the odometry's error."""
        step = len(self._ancestors)
        rng = np.random.default_rng((self.seed, step))
        values, vectors = np.linalg.eigh(motion.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        noise = rng.standard_normal((len(self.poses), 3)) @ root.T
        return compose(self.poses, motion.increment + noise)

    def _match(self, bits: np.ndarray, local: LocalMap) -> tuple[np.ndarray, np.ndarray]:
        threshold = self.model.occupied_above * STEPS_PER_LOG_ODDS
        maps = self.maps
        return match(
            maps.tiles,
            maps.table,
            maps.corner,
            self.poses,
            bits,
            *local.origin,
            local.cell,
            threshold,
        )

    def _update(self, bits: np.ndarray, local: LocalMap) -> None:
        maps = self.maps
        maps.cover(*self._cells_reached(bits, local))
        needed = touched(maps.table, maps.corner, self.poses, bits, *local.origin, local.cell)
        maps.make_writable(needed)
        update(
            maps.tiles,
            maps.table,
            maps.corner,
            needed,
            self.poses,
            bits,
            *local.origin,
            local.cell,
            round(self.model.occupied_step * STEPS_PER_LOG_ODDS),
            round(self.model.free_step * STEPS_PER_LOG_ODDS),
        )

    def _cells_reached(self, bits: np.ndarray, local: LocalMap) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest global cell (row, column) that any particle's local map touches."""
        height, width = bits.shape
        x0, y0 = local.origin
        x1, y1 = x0 + width * local.cell, y0 + height * local.cell
        corners = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x0, y1, 0.0], [x1, y1, 0.0]])
        xy = compose(self.poses[:, None, :], corners[None])[..., :2]
        cells = np.floor(xy.reshape(-1, 2)[:, ::-1] / local.cell).astype(np.int64)
        return cells.min(axis=0), cells.max(axis=0)

    def _resample(self) -> tuple[float, bool]:
        """Eq (7), then systematic resampling when N_eff < N/2 (Kitagawa 1996)."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        weights /= weights.sum()
        n_eff = 1.0 / float(np.sum(weights**2))
        N = len(weights)
        ancestors = np.arange(N)
        resampled = n_eff < self.settings.resample_below * N
        if resampled:
            rng = np.random.default_rng((self.seed, len(self._ancestors), 1))
            ancestors = systematic_resample(weights, rng.random())
            self.poses = self.poses[ancestors]
            self.log_likelihood = self.log_likelihood[ancestors]
            self.log_weights = np.zeros(N)
            self.maps.resample(ancestors)
        self._history.append(self.poses)
        self._ancestors.append(ancestors)
        return n_eff, resampled


def systematic_resample(weights: np.ndarray, offset: float) -> np.ndarray:
    """Ancestors (N,) drawn by low-variance resampling; `offset` in [0, 1) is the one draw."""
    N = len(weights)
    edges = np.cumsum(weights)
    edges[-1] = 1.0
    points = np.minimum((np.arange(N) + offset) / N, np.nextafter(1.0, 0.0))
    return np.searchsorted(edges, points, side="right")


def log_likelihoods(
    overlap: np.ndarray, matched: np.ndarray, settings: MappingSettings
) -> np.ndarray:
    """Eq (8) with the sign that rewards a match: ln l = -k (1 - n / |S|), per particle (N,).

    A particle that sees too little of its own map is not judged: it gets the mean likelihood
    of the others, so that neither seeing nothing nor seeing much is a merit.
    """
    judged = overlap >= max(settings.min_overlap, 1)
    if not judged.any():
        return np.zeros(len(overlap))
    log_l = -settings.match_weight * (1.0 - matched / np.maximum(overlap, 1))
    top = log_l[judged].max()
    mean = top + np.log(np.mean(np.exp(log_l[judged] - top)))
    return np.where(judged, log_l, mean)


def classify(local: LocalMap, model: SensorModel, tolerance: int) -> np.ndarray:
    """Bits (H, W) uint8 of each local cell; see `global_kernels`.

    The map is updated where obstacles most likely stand. A match is sought there, within
    `tolerance` cells, and with half the merit wherever the doubt of an obstacle reaches: the
    first alone is too brittle for a few hundred particles, the second alone too blunt.
    """
    L = local.log_odds
    occupied = np.greater(L, model.occupied_above)
    free = np.less(L, model.free_below)
    around = np.ones((2 * tolerance + 1, 2 * tolerance + 1), np.uint8)
    near, possible = (
        cv2.dilate(mask.astype(np.uint8), around) for mask in (occupied, local.possible)
    )
    return (
        np.where(np.isnan(L), 0, OBSERVED)
        | np.where(occupied, OCCUPIED, 0)
        | np.where(free, FREE, 0)
        | np.where(near, NEAR_OCCUPIED, 0)
        | np.where(possible, POSSIBLE, 0)
    ).astype(np.uint8)
