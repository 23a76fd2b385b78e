"""Stage 2: local maps become the global map by a Rao-Blackwellized particle filter.

Paper Sec. III-B, for every local map z_t with the motion u_t since the one before:

    1a  sample a pose for every particle from p(x_t | x_{t-1}, u_t)            eq (5)
    1b  weigh it by how its own map matches the local map                      eqs (6), (8)
    1c  update its map by the local map's obstacle and free cells              eqs (1), (2)
    2   resample when too few particles carry the weight                       eq (7)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mapping.global_kernels import match, touched, update
from mapping.grid import OccupancyGrid
from mapping.local_cells import LocalCells, PackedCells, classify
from mapping.local_map import LocalMap
from mapping.pose_estimate import estimate_pose
from mapping.proposal import propose
from mapping.sensor_model import SensorModel, probability
from mapping.settings import MappingSettings
from mapping.tiles import STEPS_PER_LOG_ODDS, TileMaps
from odometry.motion import Motion, compose

# Tells the uses of a run's seed from each other, and from those of the simulators.
_MOTION_STREAM, _RESAMPLING_STREAM = 0xF1, 0xF2


@dataclass(frozen=True)
class FilterHealth:
    """How one step of the filter went; `overlap` (|S|) and `matched` (n / |S|) of the best;
    `recovered`: all weights had vanished and were set equal."""

    stamp: int
    observations: int
    n_eff: float
    resampled: bool
    recovered: bool
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
        self._seen: list[PackedCells] = []  # what each step added to the maps

    def begin_in(self, maps: TileMaps, pose: np.ndarray) -> None:
        """Begin at a pose (3,) in a map made before; before the first step."""
        self.maps = maps
        self.poses = np.repeat(np.asarray(pose, float)[None], len(self.poses), axis=0)
        self._history = [self.poses]

    def add(self, local: LocalMap) -> FilterHealth:
        """One step of the algorithm above."""
        cells = classify(local, self.model, self.settings.match_tolerance)
        self.poses = self._sample(local)
        overlap, matched = self._match(self.maps, cells, self.poses)
        log_l = log_likelihoods(overlap, matched, self.settings)
        recovered = self._weigh(log_l)
        self._update(self.maps, cells, self.poses)
        self._seen.append(PackedCells.of(cells))
        best = self.best
        n_eff, resampled = self._resample()
        health = FilterHealth(
            stamp=local.stamp,
            observations=local.observations,
            n_eff=n_eff,
            resampled=resampled,
            recovered=recovered,
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

    def estimate(self) -> Motion:
        """From the map's origin to where the robot is, with its covariance (`pose_estimate`)."""
        return estimate_pose(self.poses, self.log_weights, self.health[-1].stamp)

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
        return self._as_grid(self.maps, self.best if particle is None else particle)

    def redrawn(self, poses: np.ndarray) -> tuple[OccupancyGrid, np.ndarray]:
        """The map drawn anew from all local maps, closed at poses (steps + 1, 3), the start first.

        Returns the map, and of each step the matched share n / |S| of eq (8) (steps,), NaN where
        too little was seen of what the steps before had drawn.
        """
        maps, share = TileMaps(1), np.full(len(self._seen), np.nan)
        for k, (packed, pose) in enumerate(zip(self._seen, poses[1:], strict=True)):
            cells = packed.cells()
            overlap, matched = self._match(maps, cells, pose[None])
            if overlap[0] >= max(self.settings.min_overlap, 1):
                share[k] = matched[0] / overlap[0]
            self._update(maps, cells, pose[None])
        return self._as_grid(maps, 0), share

    def _as_grid(self, maps: TileMaps, particle: int) -> OccupancyGrid:
        log_odds, corner = maps.log_odds(particle)
        cell = self.settings.cell
        return OccupancyGrid(
            probability(log_odds).astype(np.float32), (corner[0] * cell, corner[1] * cell), cell
        ).trimmed()

    def _sample(self, local: LocalMap) -> np.ndarray:
        """Eq (5): every particle moves by the motion and its own draw of the odometry's error, or
        about the best match to its own map."""
        motion, step = local.motion, len(self._ancestors)
        rng = np.random.default_rng((self.seed, _MOTION_STREAM, step))
        draws = rng.standard_normal((len(self.poses), 3))
        if self.settings.matched_proposal:
            predicted = compose(self.poses, motion.increment)
            return propose(
                self.maps, predicted, motion, local.points, local.kappa, local.cell, draws
            )
        values, vectors = np.linalg.eigh(motion.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return compose(self.poses, motion.increment + draws @ root.T)

    def _match(
        self, maps: TileMaps, cells: LocalCells, poses: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """|S| and n of eq (8), (N,) each, of a map at each of the poses (N, 3)."""
        return match(
            maps.obstacles,
            maps.table,
            maps.corner,
            poses,
            cells.bits,
            *cells.origin,
            cells.cell,
        )

    def _weigh(self, log_l: np.ndarray) -> bool:
        """Eq (6) with ln of the likelihoods (N,); whether all weights had vanished: they are then
        set equal, and the step judges no ancestry."""
        log_l = np.where(np.isnan(log_l), -np.inf, log_l)
        log_weights = self.log_weights + log_l
        recovered = not np.isfinite(log_weights.max())
        self.log_weights = np.zeros(len(log_l)) if recovered else log_weights
        if not recovered:
            self.log_likelihood = self.log_likelihood + log_l
        return recovered

    def _update(self, maps: TileMaps, cells: LocalCells, poses: np.ndarray) -> None:
        place = (*cells.origin, cells.cell)
        maps.cover(*cells.reached_from(poses))
        needed = touched(maps.table, maps.corner, poses, cells.bits, cells.near, *place)
        maps.make_writable(needed)
        update(
            maps.tiles,
            maps.obstacles,
            maps.table,
            maps.corner,
            needed,
            poses,
            cells.bits,
            cells.near,
            *place,
            round(self.model.occupied_step * STEPS_PER_LOG_ODDS),
            round(self.model.free_step * STEPS_PER_LOG_ODDS),
            self.model.occupied_above * STEPS_PER_LOG_ODDS,
        )

    def _resample(self) -> tuple[float, bool]:
        """Eq (7), then systematic resampling when N_eff < N/2 (Kitagawa 1996)."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        weights /= weights.sum()
        n_eff = 1.0 / float(np.sum(weights**2))
        N = len(weights)
        ancestors = np.arange(N)
        resampled = n_eff < self.settings.resample_below * N
        if resampled:
            rng = np.random.default_rng((self.seed, _RESAMPLING_STREAM, len(self._ancestors)))
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
    edges /= edges[-1]
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
