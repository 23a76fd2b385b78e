"""95 % confidence intervals: of rates of runs, and of what is counted in frames.

Runs with different seeds are independent: Wilson's interval (1927). Neighbouring columns of one
frame share their errors, so a thousand columns are not a thousand observations: whole frames are
drawn anew (Efron and Tibshirani 1993, ch. 8). Where nothing, or everything, was seen the bootstrap
has nothing to vary: Wilson's interval for as many observations as there are frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Z95 = 1.959964  # two-sided 95 % of the normal distribution
ROUNDS = 1000
FEWER_ROUNDS = 200  # where every round sorts all values


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % confidence interval; NaN where nothing was observed."""

    value: float
    low: float
    high: float


def wilson(failures: int, runs: int) -> tuple[float, float]:
    """95 % interval of a rate of which `failures` of `runs` were seen (Wilson, 1927)."""
    if runs == 0:
        return 0.0, 1.0
    p, z2 = failures / runs, Z95**2
    middle = (p + z2 / (2.0 * runs)) / (1.0 + z2 / runs)
    half = Z95 * math.sqrt(p * (1.0 - p) / runs + z2 / (4.0 * runs**2)) / (1.0 + z2 / runs)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def share(part: np.ndarray, whole: np.ndarray, seed: int = 0) -> Estimate:
    """sum(part) / sum(whole) of counts (n,), one a frame; a proportion between 0 and 1."""
    total, seen = int(np.sum(whole)), int(np.sum(part))
    if total == 0:
        return Estimate(math.nan, math.nan, math.nan)
    if seen in (0, total):
        frames = int(np.count_nonzero(whole))
        return Estimate(seen / total, *wilson(frames if seen else 0, frames))
    found = ratio(part, whole, seed)
    return Estimate(found.value, max(found.low, 0.0), min(found.high, 1.0))


def ratio(part: np.ndarray, whole: np.ndarray, seed: int = 0) -> Estimate:
    """sum(part) / sum(whole) of sums (n,), one a frame: a mean, or a number a frame."""
    if not np.sum(whole):
        return Estimate(math.nan, math.nan, math.nan)
    chosen = _draws(len(part), ROUNDS, seed)
    with np.errstate(invalid="ignore", divide="ignore"):
        drawn = np.sum(part[chosen], axis=1) / np.sum(whole[chosen], axis=1)
    return _estimate(float(np.sum(part) / np.sum(whole)), drawn)


def of_values(
    frames: Sequence[np.ndarray], statistic: Callable[[np.ndarray], float], seed: int = 0
) -> Estimate:
    """A statistic of all values; frames: the values (k,) of each frame."""
    values = np.concatenate([np.empty(0), *frames])
    if not values.size:
        return Estimate(math.nan, math.nan, math.nan)
    drawn = []
    for chosen in _draws(len(frames), FEWER_ROUNDS, seed):
        again = np.concatenate([frames[index] for index in chosen])
        drawn.append(statistic(again) if again.size else math.nan)
    return _estimate(statistic(values), np.array(drawn))


def _draws(frames: int, rounds: int, seed: int) -> np.ndarray:
    return np.random.default_rng((seed, frames)).integers(frames, size=(rounds, frames))


def _estimate(value: float, drawn: np.ndarray) -> Estimate:
    drawn = drawn[np.isfinite(drawn)]
    low, high = np.quantile(drawn, (0.025, 0.975)) if drawn.size else (math.nan, math.nan)
    return Estimate(value, float(low), float(high))
