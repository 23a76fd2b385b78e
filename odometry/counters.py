"""CounterTracker: raw counters made continuous; wraps taken out, restarts and wild values found."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from odometry.encoders import EncoderParameters, shortest_difference, within_counter

# A step is plausible up to this many times the greatest speed, over its time and this jitter [s].
MARGIN = 1.5
JITTER_S = 0.03
# So many readings that agree with one another outweigh the reading that they contradict.
CONFIRM = 3
# After so long [s] a wheel that may have turned by half the counter's range cannot be followed.
SILENCE_S = 0.5
# Counters that stand within NEAR_ZERO of zero [m] after a step of RESTART_STEP towards it began
# anew; where a restart was announced, a smaller step tells it.
NEAR_ZERO = 0.3
RESTART_STEP = 0.15
ANNOUNCED_STEP = 0.03


class TickReading(NamedTuple):
    """One reading. stamp: host's monotonic clock [ns], strictly increasing.

    left, right: counters as read; left_total, right_total: the same made continuous.
    reset: the counters began anew since the reading before: the totals stand still, and how far
    the robot went meanwhile is not known.
    """

    stamp: int
    left: int
    right: int
    left_total: int
    right_total: int
    reset: bool = False


class Limits:
    """What two counters can tell, in metres: the length of steps, and which to believe.

    max_speed: of a wheel [m/s].
    """

    def __init__(self, parameters: EncoderParameters, max_speed: float) -> None:
        self.bits = parameters.counter_bits
        self._left, self._right = np.abs(parameters.metres_per_tick).tolist()
        self._speed = MARGIN * max_speed
        self._rounding = 2.0 * max(self._left, self._right)
        self._half = min(self._left, self._right) * (1 << (self.bits - 1))

    def wheels(self, left, right):
        """Path(s) of both wheels for differences of their counters, any wrap taken out [m]."""
        return (
            abs(shortest_difference(left, self.bits)) * self._left,
            abs(shortest_difference(right, self.bits)) * self._right,
        )

    def believable(self, seconds, step, before, after):
        """Whether step(s) are motion: of lengths `step` in `seconds`, the counters standing
        `before` and `after` away from zero (each the longer of both wheels) [m]."""
        limit = self._speed * (seconds + JITTER_S) + self._rounding
        followed = (limit < self._half) | (seconds <= SILENCE_S)
        no_restart = (after > NEAR_ZERO) | (step <= RESTART_STEP) | (after >= before)
        return (step <= limit) & followed & no_restart


class CounterTracker:
    """Follows two counters, reading by reading.

    A step that is not believable is held back: when a later reading agrees with those before it,
    it was a glitch (`implausible`); when `CONFIRM` readings in a row agree with one another, the
    counters began anew, near zero (`resets`) or elsewhere (`jumps`). All of this depends on the
    readings alone, so that a recording of the readings taken gives the same again.
    """

    def __init__(self, limits: Limits) -> None:
        self.counts: Counter[str] = Counter()
        self.events: list[str] = []
        self._limits = limits
        self._last: TickReading | None = None
        self._held: list[tuple[int, int, int]] = []
        self._announced = False

    def announce_restart(self) -> None:
        """The port was opened anew, or the board said words: zero counters now mean a restart."""
        self._announced = True

    def take(self, stamp: int, left: int, right: int, reset: bool = False) -> list[TickReading]:
        """The readings that are certain with this one; stamps must increase.

        reset: it is known that the counters began anew.
        """
        bits = self._limits.bits
        if not (within_counter(left, bits) and within_counter(right, bits)):
            self.counts["out_of_range"] += 1
            return []
        new = (stamp, left, right)
        last = self._last
        if last is None:
            self._last = TickReading(stamp, left, right, left, right)
            return [self._last]
        announced, self._announced = self._announced, False
        if reset or (announced and self._began_anew(last, new)):
            self._drop_held()
            return self._anew([new], "resets")
        if self._follows(last[:3], new):
            self._drop_held()
            return [self._step(new)]
        if self._held and not self._follows(self._held[-1], new):
            self._drop_held()
        self._held.append(new)
        if len(self._held) < CONFIRM:
            return []
        held, self._held = self._held, []
        return self._anew(held, "resets" if self._away(*held[0][1:]) <= NEAR_ZERO else "jumps")

    def _step(self, new: tuple[int, int, int]) -> TickReading:
        stamp, left, right = new
        last, bits = self._last, self._limits.bits
        assert last is not None
        self._last = TickReading(
            stamp,
            left,
            right,
            last.left_total + shortest_difference(left - last.left, bits),
            last.right_total + shortest_difference(right - last.right, bits),
        )
        return self._last

    def _anew(self, readings: list[tuple[int, int, int]], what: str) -> list[TickReading]:
        last = self._last
        assert last is not None
        stamp, left, right = readings[0]
        self.counts[what] += 1
        self.events.append(
            f"encoders: the counters {'restarted' if what == 'resets' else 'jumped'} from "
            f"{last.left}, {last.right} to {left}, {right} after "
            f"{(stamp - last.stamp) / 1e9:.2f} s: taken as no motion, with much doubt"
        )
        self._last = TickReading(stamp, left, right, last.left_total, last.right_total, True)
        return [self._last, *(self._step(reading) for reading in readings[1:])]

    def _drop_held(self) -> None:
        if self._held:
            self.counts["implausible"] += len(self._held)
            self._held = []

    def _follows(self, before: tuple[int, int, int], after: tuple[int, int, int]) -> bool:
        step = self._away(after[1] - before[1], after[2] - before[2])
        seconds = (after[0] - before[0]) * 1e-9
        return self._limits.believable(
            seconds, step, self._away(*before[1:]), self._away(*after[1:])
        )

    def _away(self, left: int, right: int) -> float:
        return max(self._limits.wheels(left, right))

    def _began_anew(self, last: TickReading, new: tuple[int, int, int]) -> bool:
        step = self._away(new[1] - last.left, new[2] - last.right)
        return self._away(*new[1:]) <= NEAR_ZERO and step > ANNOUNCED_STEP


def all_believable(stamps: np.ndarray, raw: np.ndarray, limits: Limits) -> bool:
    """Whether a tracker would take every row of counters (n, 2) at `stamps` (n,) ns as motion."""
    away = np.maximum(*limits.wheels(raw[:, 0], raw[:, 1]))
    step = np.maximum(*limits.wheels(*np.diff(raw, axis=0).T))
    return bool(limits.believable(np.diff(stamps) * 1e-9, step, away[:-1], away[1:]).all())
