"""What the tests of the experiments share: a tiny world, its runs, and stand-ins for the work."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np

from pipeline.experiments.options import Options
from pipeline.experiments.presets import HIERARCHICAL, PAPER
from pipeline.experiments.spec import Result, RunSpec
from pipeline.tasks.runner import Workers

WORLD = """
beemap_world: 1
size: [5, 4]
walls:
  - {from: [0, 0], to: [5, 0]}
  - {from: [5, 0], to: [5, 4]}
  - {from: [5, 4], to: [0, 4]}
  - {from: [0, 4], to: [0, 0]}
furniture:
  box: {size: [0.6, 0.4], at: [[2.4, 2.0], [4.6, 2.2, 90]]}
route: {waypoints: [[1, 1], [4, 1], [4, 3], [1, 3]], fillet: 0.4}
"""


def tiny_world(folder: Path, wall: int = 5) -> Path:
    """A room of 4 m by `wall` m with a route of 7 m: 37 positions."""
    file = folder / "tiny.yaml"
    file.write_text(WORLD.replace("[5, ", f"[{wall}, "))
    return file


def options(folder: Path, world: str | Path, seeds: int = 1, *settings: str) -> Options:
    """Quiet, one process."""
    return Options(folder, seeds, 1, Workers(1), str(world), settings=settings, quiet=True)


def spec(world: Path, seed: int = 1, *settings: str, **simulated) -> RunSpec:
    """A run of the paper's settings with three particles."""
    few = (*HIERARCHICAL, "mapping.particles=3", *settings)
    return options(world.parent, world).spec(PAPER, seed, *few, **simulated)


def result(**values) -> Result:
    """A result with these values, 0 elsewhere."""
    zero = dict.fromkeys(Result.__struct_fields__, 0)
    return Result(**{**zero, "nees": "1 2.5 inf", **values})


def noted(task: tuple[RunSpec, Path]) -> Result:
    """Stands in for `measure`: leaves a file for every run that is really done."""
    spec, folder = task
    (folder / f"did-{spec.seed}-{time.monotonic_ns()}").touch()
    return result(ate=0.1 * spec.seed, cpu_s=1.0 / 3.0, E=np.nan)


def failing(task: tuple[RunSpec, Path]) -> Result:
    """The second seed is a bug, the third kills its process."""
    if task[0].seed == 2:
        raise ZeroDivisionError("no such\nthing")
    if task[0].seed == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return noted(task)


def slow(task: tuple[RunSpec, Path]) -> Result:
    """The first two seeds are quick."""
    if task[0].seed > 2:
        time.sleep(60.0)
    return noted(task)
