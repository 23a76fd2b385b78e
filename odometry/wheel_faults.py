"""Wiring and unit faults of wheel encoders, recognised by a motion known from elsewhere.

Every combination of exchanged sides, reversed counters, a whole factor and increments written for
totals is a hypothesis that predicts the wheels' paths from the counts; the true one fits far better
than the wheels as stated, which an error of calibration does not make possible.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from odometry.encoders import EncoderParameters, shortest_difference, unwrap_counts
from odometry.motion import Motion
from odometry.tick_log import TickLog

MIN_STEPS = 10
MIN_TRAVEL = 1.0  # m, of both wheels together
MIN_TURNING = 0.5  # m that one wheel goes farther than the other, in sum
MAX_FACTOR = 100
# A factor is a whole one (or one over it) to this share: wheels are measured better.
WHOLE = 0.1
# What a hypothesis leaves unexplained, as a share of the wheels' paths: a true one at most the
# first; the wheels as stated at least so many times as much as the true one, and the last.
MAX_LEFT, TIMES, MIN_STATED = 0.3, 3.0, 0.4
# Of hypotheses that leave about the same the simplest one is taken.
SAME = 0.02


@dataclass(frozen=True)
class WheelFault:
    """What the counts must be made of to be right.

    exchanged: the left counter is the right wheel's; reversed: (left, right) wheel counts the
    other way than stated; factor: true path over the stated one, 1 where it is right; increments:
    the counts are those since the reading before.
    """

    exchanged: bool = False
    reversed: tuple[bool, bool] = (False, False)
    factor: float = 1.0
    increments: bool = False

    @property
    def simple(self) -> int:
        """How many things are wrong."""
        return self.exchanged + any(self.reversed) + (self.factor != 1.0) + self.increments


def find_wheel_fault(
    ticks: TickLog, parameters: EncoderParameters, motions: Sequence[Motion]
) -> WheelFault | None:
    """The fault with which the counts agree with the motions; None: none is certain.

    motions: of the robot between two stamps [ns] each, from images.
    """
    stamps = ticks.stamps + round(parameters.time_offset * 1e9)
    known = [m for m in motions if stamps[0] <= m.first < m.last <= stamps[-1]]
    if len(known) < MIN_STEPS:
        return None
    true = np.array([_wheel_paths(motion, parameters.track) for motion in known])
    if np.abs(true).sum() < MIN_TRAVEL:
        return None
    times = np.array([(motion.first, motion.last) for motion in known])
    stated = _left_over(_counted(ticks, stamps, times, parameters, False), true)
    fits: list[tuple[float, WheelFault]] = []
    for increments in (False, True):
        counted = _counted(ticks, stamps, times, parameters, increments)
        for exchanged, *signs in itertools.product((False, True), repeat=3):
            paths = counted[:, ::-1] if exchanged else counted
            paths = np.where(signs, -paths, paths)
            factor = _whole_factor(paths, true)
            if factor is not None:
                fault = WheelFault(exchanged, (signs[0], signs[1]), factor, increments)
                fits.append((_left_over(factor * paths, true), fault))
    if not fits:
        return None
    least = min(left for left, _ in fits)
    left, fault = min(
        ((left, fault) for left, fault in fits if left <= least + SAME),
        key=lambda fit: (fit[1].simple, fit[0]),
    )
    certain = left <= MAX_LEFT and stated >= max(TIMES * left, MIN_STATED)
    return fault if certain and fault.simple else None


def _wheel_paths(motion: Motion, track: float) -> tuple[float, float]:
    """Paths of the left and right wheel [m] on the arc that leads there."""
    x, y, turn = motion.increment.tolist()
    # The chord's direction is half of the turn; sinc(t) is sin(pi t) / (pi t).
    along = x * np.cos(0.5 * turn) + y * np.sin(0.5 * turn)
    travel = float(along / np.sinc(turn / (2.0 * np.pi)))
    return travel - 0.5 * track * turn, travel + 0.5 * track * turn


def _counted(
    ticks: TickLog,
    stamps: np.ndarray,
    times: np.ndarray,
    parameters: EncoderParameters,
    increments: bool,
) -> np.ndarray:
    """Paths (n, 2) of both wheels by the counts between the times (n, 2) ns [m]."""
    sides = []
    for raw in (ticks.left, ticks.right):
        if increments:
            total = np.cumsum(shortest_difference(raw, parameters.counter_bits))
        else:
            total = unwrap_counts(raw, parameters.counter_bits)
        # In seconds from the first: a float holds nanoseconds of today badly.
        at = np.interp((times - stamps[0]) / 1e9, (stamps - stamps[0]) / 1e9, total)
        sides.append(at[:, 1] - at[:, 0])
    return np.stack(sides, axis=1) * parameters.metres_per_tick


def _whole_factor(paths: np.ndarray, true: np.ndarray) -> float | None:
    """1, a whole number, or one over it, times which the paths are as long as the true ones."""
    far = np.abs(paths).sum(axis=1) > 0
    if far.sum() < MIN_STEPS:
        return None
    ratio = float(np.median(np.abs(true[far]).sum(axis=1) / np.abs(paths[far]).sum(axis=1)))
    whole = round(max(ratio, 1.0 / ratio)) if ratio > 0 else 0
    if not 1 <= whole <= MAX_FACTOR:
        return None
    factor = float(whole) if ratio >= 1.0 else 1.0 / whole
    return factor if abs(ratio / factor - 1.0) < WHOLE else None


def _left_over(paths: np.ndarray, true: np.ndarray) -> float:
    """What is not explained (RMS) as a share of the true paths (RMS): of travel or of turning,
    where more is left. One wild step counts as no more than three times its length."""
    shares = []
    for sides, least in (((0.5, 0.5), 0.0), ((-1.0, 1.0), MIN_TURNING)):
        aim, off = true @ sides, (paths - true) @ sides
        if np.abs(aim).sum() >= least:
            most = 3.0 * np.abs(true).max(axis=1)
            shares.append(np.sum(np.minimum(np.abs(off), most) ** 2) / np.sum(aim**2))
    return float(np.sqrt(max(shares)))
