"""Runs of many seeds in a few numbers: mean, median, worst, and losses with their interval."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pipeline.experiments.batch import Run
from pipeline.intervals import wilson

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Spread:
    """Of one quantity over the seeds; lower and upper are the quartiles. NaN without runs."""

    mean: float
    median: float
    lower: float
    upper: float
    worst: float


def spread(values: Iterable[float]) -> Spread:
    """The larger a value, the worse."""
    known = np.array([value for value in values if not math.isnan(value)])
    if not known.size:
        return Spread(*[math.nan] * 5)
    lower, median, upper = np.quantile(known, [0.25, 0.5, 0.75])
    return Spread(
        float(known.mean()), float(median), float(lower), float(upper), float(known.max())
    )


def of(runs: Sequence[Run], name: str) -> Spread:
    """Spread of a field of the results."""
    return spread(float(getattr(run.result, name)) for run in runs)


def lost(runs: Sequence[Run]) -> tuple[int, float, float]:
    """How many runs are lost, and the interval of their rate."""
    number = sum(run.result.lost for run in runs)
    return number, *wilson(number, len(runs))


def grouped(runs: Iterable[Run], key) -> dict:
    """Runs by key(spec), in the order in which the keys come."""
    groups: dict = {}
    for run in runs:
        groups.setdefault(key(run.spec), []).append(run)
    return groups
