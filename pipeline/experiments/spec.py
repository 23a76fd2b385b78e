"""What decides a simulated run, what is measured of it, and the key that ties the two."""

from __future__ import annotations

import hashlib
from functools import cache
from typing import Literal

import msgspec
import numpy as np

from mapping.settings import MappingSettings
from pipeline.tasks.identity import source_digest
from simulation.route import Route
from simulation.world import World, load_route, load_world
from simulation.world_sheet import WorldError

# What of the source decides a result: a row made by another mapper must not pass for this one's.
DECIDING = (
    "mapping/*.py",
    "odometry/*.py",
    "simulation/*.py",
    "stereo/scan.py",
    "pipeline/dissimilarity.py",
    "pipeline/evaluate_*.py",
    "pipeline/experiments/measure.py",
    "pipeline/experiments/consistency.py",
    "pipeline/experiments/scores.py",
)


class RunSpec(msgspec.Struct, frozen=True, kw_only=True):
    """All that decides a simulated run.

    preset, varied: its names in tables and figures; they decide nothing.
    world, route: a shipped name or a file; route null: the world's own.
    alpha, blocks, false_depth, positions: of the simulator (`simulation.paper.PaperSettings`).
    sigma: use the ranges' doubt. score_map: compare the map with the ideals. keep_map: leave the
    map in the folder `maps` of the experiment.
    """

    preset: str
    varied: str = ""
    world: str
    route: str | None = None
    seed: int
    alpha: float
    blocks: int = 1
    false_depth: Literal["nearest", "replace"] = "nearest"
    positions: int
    sigma: bool
    mapping: MappingSettings
    threads: int = 1
    score_map: bool = True
    keep_map: bool = False

    @property
    def method(self) -> str:
        """hierarchical or per-scan."""
        return self.mapping.method

    @property
    def key(self) -> str:
        """12 hexadecimal digits of all that decides: settings, world, route and source."""
        decides = msgspec.to_builtins(self)
        for name in ("preset", "varied"):
            del decides[name]
        decides["world"] = _place_digest(self.world, self.route)
        decides["source"] = source_digest(DECIDING)
        return hashlib.sha256(msgspec.json.encode(decides, order="sorted")).hexdigest()[:12]

    def __str__(self) -> str:
        varied = f", {self.varied}" if self.varied else ""
        return (
            f"{self.preset} {self.method}{varied}, alpha {self.alpha:.3g}, blocks {self.blocks}, "
            f"{self.false_depth}, N {self.mapping.particles}, seed {self.seed}"
        )


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """What one run yields; NaN where it was not measured.

    ate, dead_reckoning: RMSE over all positions after SE(2) alignment [m]. lost: ATE > 1 m.
    E, E_cut, decided, f1, precision, recall: against the common ideal, what perfect sensors on
    the true path see of the floor plan (`pipeline.evaluate_map`). E_own: against the map that the
    same mapper makes of the same route with perfect sensors. known_m2: area of the map's known
    cells. travelled_m: length of the true path. cpu_s, wall_s: of mapping alone. maps_mb: most
    memory of all particles' maps together. n_eff: mean share N_eff / N; resampled: share of the
    filter's steps. nees: of the filter's poses along the run (`consistency`), blanks between.
    """

    ate: float
    dead_reckoning: float
    lost: int
    E: float
    E_cut: float
    decided: float
    f1: float
    precision: float
    recall: float
    E_own: float
    known_m2: float
    travelled_m: float
    cpu_s: float
    wall_s: float
    maps_mb: float
    n_eff: float
    resampled: float
    nees: str

    @property
    def nees_series(self) -> np.ndarray:
        """`nees` as numbers (closings,)."""
        return np.array([float(value) for value in self.nees.split()])


@cache
def place(world: str, route: str | None) -> tuple[World, Route]:
    """The world and the route through it.

    Raises:
        WorldError: one of them cannot be used, or there is no route.
    """
    loaded = load_world(world)
    if route is not None:
        return loaded, load_route(route)
    if loaded.route is None:
        raise WorldError(f"{world}: holds no route: give one with --route FILE")
    return loaded, loaded.route


@cache
def _place_digest(world: str, route: str | None) -> str:
    """Digest of the cells and of the route, whatever files they came from."""
    loaded, way = place(world, route)
    digest = hashlib.sha256()
    cells = (loaded.solid, np.array([loaded.cell, *loaded.origin]))
    for array in (*cells, way.start, way.length, way.curvature):
        digest.update(str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
