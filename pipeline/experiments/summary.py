"""Runs of many seeds in a few numbers: mean, median, worst, and losses with their interval."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pipeline.experiments.batch import Run

K = TypeVar("K", bound=Hashable)

Z95 = 1.959964  # two-sided 95 % of the normal distribution


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


def wilson(failures: int, runs: int) -> tuple[float, float]:
    """95 % interval of a rate of which `failures` of `runs` were seen (Wilson, 1927)."""
    if runs == 0:
        return 0.0, 1.0
    p, z2 = failures / runs, Z95**2
    middle = (p + z2 / (2.0 * runs)) / (1.0 + z2 / runs)
    half = Z95 * math.sqrt(p * (1.0 - p) / runs + z2 / (4.0 * runs**2)) / (1.0 + z2 / runs)
    return max(middle - half, 0.0), min(middle + half, 1.0)


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
