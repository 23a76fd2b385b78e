"""One run: simulate it, map it, hold path and map against the truth.

scans, odometry, truth = simulate(world, route, alpha, blocks, ..., seed)
map, path              = mapper(scans, odometry)                       (timed)
ATE                    = path against truth, after SE(2) alignment
E, F1                  = map against what perfect sensors see of the floor plan
E_own                  = map against the same mapper's map of a perfect run
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import msgspec
import numba
import numpy as np

from mapping.grid import OccupancyGrid
from mapping.mapper import HierarchicalMapper
from mapping.settings import MappingSettings
from odometry.motion import Motion
from pipeline.evaluate_path import align, evaluate_path
from pipeline.experiments.consistency import nees
from pipeline.experiments.scores import best_score, frames, least_E
from pipeline.experiments.spec import Result, RunSpec, place
from pipeline.map_files import write_npz
from pipeline.trajectory import Trajectory, distance_travelled
from simulation.paper import PaperRun, PaperSettings, seen_plan, simulate
from stereo.scan import RangeScan

LOST = 1.0  # a run with a larger ATE is lost [m]
# The simulator and the filter key their random numbers alike, by (seed, purpose): with one seed
# for both the particles' draws could repeat the very errors they are to guess.
FILTER_SEED = 1_000_000
# A first stretch that is mapped before the clock runs: kernels are compiled or loaded then.
WARM_UP = 30


@dataclass
class Mapped:
    """What the mapper made of one run; `nees`: of the filter's steps it was asked about."""

    grid: OccupancyGrid
    path: np.ndarray
    cpu_s: float = 0.0
    wall_s: float = 0.0
    maps_mb: float = 0.0
    nees: list[float] = field(default_factory=list)
    n_eff: float = np.nan
    resampled: float = np.nan


def measure(task: tuple[RunSpec, Path]) -> Result:
    """Do the run of a spec; its map goes to `<folder>/maps/<key>.npz` where that is wanted.

    Raises:
        WorldError: the route does not fit.
    """
    spec, folder = task
    # Fewer threads than the process has are possible at any time, more are not.
    numba.set_num_threads(spec.threads)
    run = simulate(*place(spec.world, spec.route), paper_settings(spec), spec.seed)
    scans = run.scans if spec.sigma else as_points(run.scans)
    _warm_up(scans, run.motions, spec.mapping)
    mapped = map_run(scans, run, spec.mapping, FILTER_SEED + spec.seed)
    stamps = np.array([scan.stamp for scan in run.scans], np.int64)
    truth = Trajectory(stamps, run.truth)
    ate = evaluate_path(Trajectory(stamps, mapped.path), truth).ate_rmse
    known = np.count_nonzero(~np.isnan(mapped.grid.probability))
    score, own = None, np.nan
    if spec.score_map:
        places = frames(mapped.grid, align(mapped.path, run.truth))
        score = best_score(places, common_ideal(spec.world, spec.route, spec.positions))
        own = least_E(places, ideal_of(spec))
    if spec.keep_map:
        (folder / "maps").mkdir(exist_ok=True)
        write_npz(folder / "maps" / f"{spec.key}.npz", mapped.grid)
    return Result(
        ate=ate,
        dead_reckoning=evaluate_path(Trajectory(stamps, run.odometry), truth).ate_rmse,
        lost=int(ate > LOST),
        E=score.E if score else np.nan,
        E_cut=score.E_cut if score else np.nan,
        decided=score.decided if score else np.nan,
        f1=score.f1 if score else np.nan,
        precision=score.precision if score else np.nan,
        recall=score.recall if score else np.nan,
        E_own=own,
        known_m2=float(known) * mapped.grid.cell**2,
        travelled_m=float(distance_travelled(run.truth)[-1]),
        cpu_s=mapped.cpu_s,
        wall_s=mapped.wall_s,
        maps_mb=mapped.maps_mb,
        n_eff=mapped.n_eff,
        resampled=mapped.resampled,
        nees=" ".join(f"{value:.3g}" for value in mapped.nees),
    )


def paper_settings(spec: RunSpec) -> PaperSettings:
    """The simulator's settings of a run."""
    return PaperSettings(
        alpha=spec.alpha,
        blocks=spec.blocks,
        false_depth=spec.false_depth,
        positions=spec.positions,
    )


def as_points(scans: list[RangeScan]) -> list[RangeScan]:
    """The scans without the doubt of their ranges: every hit is a point."""
    return [replace(s, sigma=np.where(np.isfinite(s.range), 0.0, np.nan)) for s in scans]


def map_run(scans: list[RangeScan], run: PaperRun, settings: MappingSettings, seed: int) -> Mapped:
    """Map a run; only the mapper's own work is timed.

    NEES is taken after every local map (in the previous method: after as many observations).
    """
    mapper = HierarchicalMapper(settings, seed)
    stride = settings.window if settings.method == "per-scan" else 1
    cpu = wall = 0.0
    most, consistency = 0, []
    for scan, motion, true in zip(scans, run.motions, run.truth, strict=True):
        steps = len(mapper.filter.health)
        begin, begin_cpu = time.perf_counter(), time.process_time()
        mapper.add(scan, motion)
        cpu += time.process_time() - begin_cpu
        wall += time.perf_counter() - begin
        closed = len(mapper.filter.health)
        if closed > steps:
            most = max(most, mapper.filter.maps.bytes)
            if closed % stride == 0:
                poses, log_weights = mapper.filter.poses, mapper.filter.log_weights
                consistency.append(nees(poses, log_weights, true))
    begin, begin_cpu = time.perf_counter(), time.process_time()
    grid, path = mapper.finish()
    health = mapper.filter.health
    return Mapped(
        grid=grid,
        path=path,
        cpu_s=cpu + time.process_time() - begin_cpu,
        wall_s=wall + time.perf_counter() - begin,
        maps_mb=max(most, mapper.filter.maps.bytes) / 1e6,
        nees=consistency,
        n_eff=float(np.mean([step.n_eff for step in health])) / settings.particles,
        resampled=float(np.mean([step.resampled for step in health])),
    )


@lru_cache(maxsize=8)
def common_ideal(world: str, route: str | None, positions: int) -> OccupancyGrid:
    """What perfect sensors on the true path see of the floor plan."""
    settings = PaperSettings(positions=positions)
    perfect = simulate(*place(world, route), settings, seed=0, perfect=True)
    return seen_plan(place(world, route)[0], perfect.poses, settings)


@lru_cache(maxsize=8)
def _own_ideal(
    world: str, route: str | None, positions: int, sigma: bool, mapping: MappingSettings
) -> OccupancyGrid:
    settings = PaperSettings(positions=positions)
    perfect = simulate(*place(world, route), settings, seed=0, perfect=True)
    scans = perfect.scans if sigma else as_points(perfect.scans)
    return map_run(scans, perfect, mapping, FILTER_SEED).grid


def ideal_of(spec: RunSpec) -> OccupancyGrid:
    """The map that the mapper of this run makes of its route with perfect sensors and poses.

    Exact odometry keeps all particles in one place and leaves nothing to match: one particle
    gives the same map.
    """
    exact = msgspec.structs.replace(spec.mapping, particles=1, ego_motion="raw", proposal="motion")
    return _own_ideal(spec.world, spec.route, spec.positions, spec.sigma, exact)


_WARM: set[tuple[str, ...]] = set()


def _warm_up(scans: list[RangeScan], motions: list[Motion], settings: MappingSettings) -> None:
    """Once in a process for each way through the mapper."""
    way = (settings.method, settings.ego_motion, str(settings.matched_proposal))
    if way not in _WARM:
        mapper = HierarchicalMapper(msgspec.structs.replace(settings, particles=2))
        for scan, motion in zip(scans[:WARM_UP], motions[:WARM_UP], strict=True):
            mapper.add(scan, motion)
        mapper.finish()
        _WARM.add(way)
