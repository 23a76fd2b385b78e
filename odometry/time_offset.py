"""The constant offset between the encoders' stamps and the camera's, by correlating turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SEARCH_S = 1.0  # offsets looked at, either way
GRID_S = 0.005
LEAST_STEPS = 20
# The offset is clear where the turns agree so well, and nothing far from the peak nearly as well.
CLEAR_PEAK = 0.9
CLEAR_SIGMA_S = 0.02
APART_S = 0.5
RIVAL = 0.98
HUBER = 2.0


@dataclass(frozen=True)
class TimeOffset:
    """seconds: to be added to the encoders' stamps, with its standard deviation sigma; peak:
    correlation of the turns there, at most 1; rival: the highest of those `APART_S` and more away.
    """

    seconds: float
    sigma: float
    peak: float
    rival: float

    @property
    def clear(self) -> bool:
        """Whether it is determined beyond doubt."""
        return (
            self.peak >= CLEAR_PEAK
            and self.sigma <= CLEAR_SIGMA_S
            and self.rival <= RIVAL * self.peak
            and abs(self.seconds) < SEARCH_S - GRID_S
        )


def time_offset(
    stamps: np.ndarray, headings: np.ndarray, spans: np.ndarray, turns: np.ndarray
) -> TimeOffset | None:
    """Offset that makes the encoders turn when the camera does.

    Args:
        stamps: (n,) ns, increasing; headings: (n,) rad by the wheels, not wrapped.
        spans: (k, 2) first and last stamp of the camera's steps [ns]; turns: (k,) rad.

    None: fewer than `LEAST_STEPS` steps lie within the wheels' time at every offset.
    """
    margin = SEARCH_S * 1e9
    inside = (spans[:, 0] - margin >= stamps[0]) & (spans[:, 1] + margin <= stamps[-1])
    spans, turns = spans[inside], turns[inside]
    if len(spans) < LEAST_STEPS or not turns.any():
        return None
    time, steps = (stamps - stamps[0]) / 1e9, (spans - stamps[0]) / 1e9

    def wheels(offset: float) -> np.ndarray:
        ends = np.interp(steps - offset, time, headings)
        return ends[:, 1] - ends[:, 0]

    grid = np.arange(-SEARCH_S, SEARCH_S + 0.5 * GRID_S, GRID_S)
    match = np.array([_correlation(wheels(offset), turns) for offset in grid])
    best = int(np.argmax(match))
    offset, sigma = _refined(wheels, turns, float(grid[best]))
    far = np.abs(grid - grid[best]) >= APART_S
    return TimeOffset(offset, sigma, float(match[best]), float(match[far].max(initial=-1.0)))


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0.0 else 0.0


def _refined(wheels, turns: np.ndarray, offset: float) -> tuple[float, float]:
    """Least squares about the peak, for the offset and the scale of the turns, Huber's weights."""
    sigma = np.inf
    for _ in range(5):
        slope = (wheels(offset + GRID_S) - wheels(offset - GRID_S)) / (2.0 * GRID_S)
        turned = wheels(offset)
        scale = float(turned @ turns) / max(float(turned @ turned), 1e-12)
        residual = turns - scale * turned
        spread = max(1.4826 * float(np.median(np.abs(residual))), 1e-9)
        weight = 1.0 / np.maximum(np.abs(residual) / (HUBER * spread), 1.0)
        J = np.stack([scale * slope, turned], axis=1)
        information = (J * weight[:, None]).T @ J + 1e-12 * np.eye(2)
        step = np.linalg.solve(information, (J * weight[:, None]).T @ residual)
        offset += float(np.clip(step[0], -GRID_S, GRID_S))
        sigma = spread * float(np.sqrt(np.linalg.inv(information)[0, 0]))
    return offset, sigma
