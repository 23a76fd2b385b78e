"""Eqs (1) and (2) of the paper as steps of log-odds.

With L = ln(p / (1 - p)), Bayes' rule adds ln P(O|E)/P(O|notE) to a cell in which an obstacle is
observed (eq (1)) and ln P(notO|E)/P(notO|notE) to one that is seen free (eq (2), whose numerator
is misprinted: P(O|E) stands where P(notO|E) is meant).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mapping.settings import MappingSettings

# Beyond this a cell would take longer to unlearn than a robot stays (p = .9955).
CLAMP = 5.4


def log_odds(p: float) -> float:
    """ln(p / (1 - p))."""
    return math.log(p / (1.0 - p))


def probability(L: np.ndarray) -> np.ndarray:
    """Inverse of `log_odds`."""
    return 1.0 / (1.0 + np.exp(-np.asarray(L, np.float64)))


@dataclass(frozen=True)
class SensorModel:
    """What one observation adds to a cell's log-odds, and where decisions are drawn.

    occupied_above: of an obstacle in the global map; local_occupied_above, local_free_below: of
    a cell of a local map.
    """

    occupied_step: float
    free_step: float
    occupied_above: float
    local_occupied_above: float
    local_free_below: float

    @staticmethod
    def of(settings: MappingSettings) -> SensorModel:
        """From P(O|E), P(O|notE) and the thresholds on p."""
        hit, false_hit = settings.hit, settings.false_hit
        return SensorModel(
            occupied_step=math.log(hit / false_hit),
            free_step=math.log((1.0 - hit) / (1.0 - false_hit)),
            occupied_above=log_odds(settings.occupied),
            # One look alone would never free a cell by the thresholds: it decides directly.
            local_occupied_above=0.0 if settings.per_scan else log_odds(settings.occupied),
            local_free_below=0.0 if settings.per_scan else log_odds(settings.free),
        )
