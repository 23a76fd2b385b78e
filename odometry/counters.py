"""CounterTracker: raw counters made continuous; wraps taken out, restarts and wild values found."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from odometry.encoders import EncoderParameters, shortest_difference, within_counter

# A step is plausible up to this many times the greatest speed, over its time and this jitter [s].
MARGIN = 1.5
JITTER_S = 0.03
# And where it departs from the speed of before by no more than this acceleration explains [m/s^2].
ACCELERATION = 10.0
# So many readings that agree with one another outweigh the reading that they contradict.
CONFIRM = 3
# After so long [s], and so many times the interval before, counters may have begun anew unnoticed,
# and a wheel that may have turned by half the counter's range cannot be followed.
SILENCE_S = 0.25
SILENCE_INTERVALS = 3.0
# Speeds before a silence are those of the last SPEED_OVER to twice that [ns].
SPEED_OVER = 400_000_000
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
        self.per_count = np.abs(parameters.metres_per_tick)  # (2,) m
        self._left, self._right = self.per_count.tolist()
        self._speed = MARGIN * max_speed
        self._rounding = 2.0 * max(self._left, self._right)
        self._half = min(self._left, self._right) * (1 << (self.bits - 1))
        # Steps of at most this [m], or of so many counts, are motion whatever their interval, if
        # there is no silence.
        self.sure_step = min(self._speed * JITTER_S, RESTART_STEP)
        self.sure = self.sure_step / max(self._left, self._right)

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

    def explained(self, seconds: float, departure: float) -> bool:
        """Whether a wheel may depart so far [m] from where its speed would have brought it."""
        return departure <= self.sure_step + ACCELERATION * seconds**2

    def reachable(self, seconds: float) -> float:
        """How far a counter may stand from zero if it began anew within so many seconds [m]."""
        return NEAR_ZERO + self._speed * seconds

    def signed(self, left: float, right: float) -> np.ndarray:
        """Signed paths (2,) of both wheels for differences of their counters [m]."""
        half = 1 << (self.bits - 1)
        counts = (np.array([left, right]) + half) % (2 * half) - half
        return counts * self.per_count


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
        # Readings held back, as they are if the counters began anew with the first of them; and
        # the tracker that read them so.
        self._held: list[TickReading] = []
        self._anew: CounterTracker | None = None
        self._announced = False
        self._interval = 0  # between the last two readings [ns]
        self._anchors: list[TickReading] = []  # two earlier readings, for the speeds
        self._half = 1 << (limits.bits - 1)

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
        # Nearly all readings are told by this alone.
        size, half = 2 * self._half, self._half
        moved_left = (left - last.left + half) % size - half
        moved_right = (right - last.right + half) % size - half
        sure, interval = self._limits.sure, stamp - last.stamp
        usual = not (reset or self._announced) and interval <= SILENCE_S * 1e9
        if usual and -sure < moved_left < sure and -sure < moved_right < sure:
            self._drop_held()
            return [self._step(new, moved_left, moved_right)]
        if reset:
            self._drop_held()
            self._hold(new, last)
            return self._begin_anew("resets")
        doubtful = self._announced or self._silence(interval)
        began_anew = doubtful and self._began_anew(last, new)
        if not began_anew and self._follows(last[:3], new):
            self._drop_held()
            return [self._step(new, moved_left, moved_right)]
        agreeing = self._anew.take(*new) if self._anew else []
        if agreeing:
            self._held += agreeing
        else:
            self._drop_held()
            self._hold(new, last)
        if len(self._held) < CONFIRM:
            return []
        near_zero = began_anew or self._away(*self._held[0][1:3]) <= NEAR_ZERO
        return self._begin_anew("resets" if near_zero else "jumps")

    def _step(self, new: tuple[int, int, int], left: int, right: int) -> TickReading:
        """The next reading, so many counts on."""
        last = self._last
        assert last is not None
        self._interval, self._announced = new[0] - last.stamp, False
        self._last = TickReading(*new, last.left_total + left, last.right_total + right)
        if not self._anchors or new[0] - self._anchors[-1].stamp > SPEED_OVER:
            self._anchors = [*self._anchors[-1:], self._last]
        return self._last

    def _hold(self, new: tuple[int, int, int], last: TickReading) -> None:
        """Hold a reading back: perhaps the counters began anew with it.

        What follows is judged as it will be where the readings taken are read again.
        """
        reading = TickReading(*new, last.left_total, last.right_total, True)
        self._held = [reading]
        self._anew = CounterTracker(self._limits)
        self._anew._last = reading

    def _begin_anew(self, what: str) -> list[TickReading]:
        """The readings held back, which are taken."""
        last, taken, tracker = self._last, self._held, self._anew
        assert last is not None
        assert tracker is not None
        first = taken[0]
        self.counts[what] += 1
        self.events.append(
            f"encoders: the counters {'restarted' if what == 'resets' else 'jumped'} from "
            f"{last.left}, {last.right} to {first.left}, {first.right} after "
            f"{(first.stamp - last.stamp) / 1e9:.2f} s: taken as no motion, with much doubt"
        )
        self._last, self._interval, self._anchors = taken[-1], tracker._interval, tracker._anchors
        self._announced, self._held, self._anew = False, [], None
        return taken

    def _drop_held(self) -> None:
        if self._held:
            self.counts["implausible"] += len(self._held)
            self._held, self._anew = [], None

    def _follows(self, before: tuple[int, int, int], after: tuple[int, int, int]) -> bool:
        seconds = (after[0] - before[0]) * 1e-9
        limits = self._limits
        step = limits.signed(after[1] - before[1], after[2] - before[2])
        size = float(np.abs(step).max())
        if not limits.believable(seconds, size, self._away(*before[1:]), self._away(*after[1:])):
            return False
        departure = float(np.abs(step - self._speeds() * seconds).max())
        return size <= limits.sure_step or limits.explained(seconds, departure)

    def _away(self, left: int, right: int) -> float:
        return max(self._limits.wheels(left, right))

    def _silence(self, interval: int) -> bool:
        return interval > SILENCE_S * 1e9 and interval > SILENCE_INTERVALS * self._interval > 0

    def _began_anew(self, last: TickReading, new: tuple[int, int, int]) -> bool:
        """Whether counters that went on from zero explain a reading better than those of before.

        Both went on at the speed of before or more slowly: after a silence either may be.
        """
        seconds = (new[0] - last.stamp) * 1e-9
        step = self._limits.signed(new[1] - last.left, new[2] - last.right)
        place = self._limits.signed(new[1], new[2])
        if np.abs(step).max() <= ANNOUNCED_STEP:
            return False
        if np.abs(place).max() > self._limits.reachable(seconds):
            return False
        driven = self._speeds() * seconds
        low, high = np.minimum(driven, 0.0), np.maximum(driven, 0.0)
        went_on = np.abs(step - np.clip(step, low, high)).max()
        from_zero = np.abs(place - np.clip(place, low, high)).max()
        # In doubt anew: that costs certainty, not truth.
        return bool(from_zero <= went_on + NEAR_ZERO * (np.abs(place).max() <= NEAR_ZERO))

    def _speeds(self) -> np.ndarray:
        """Speeds (2,) of both wheels in the last moments [m/s]."""
        last = self._last
        if last is None or not self._anchors or self._anchors[0].stamp == last.stamp:
            return np.zeros(2)
        first = self._anchors[0]
        moved = np.array([last.left_total - first.left_total, last.right_total - first.right_total])
        return moved * self._limits.per_count / ((last.stamp - first.stamp) * 1e-9)


def all_believable(stamps: np.ndarray, raw: np.ndarray, limits: Limits) -> bool:
    """Whether a tracker would surely take every row of counters (n, 2) at `stamps` (n,) ns as
    motion."""
    intervals = np.diff(stamps)
    before = intervals[:-1] * SILENCE_INTERVALS
    if ((intervals[1:] > SILENCE_S * 1e9) & (intervals[1:] > before)).any():
        return False
    away = np.maximum(*limits.wheels(raw[:, 0], raw[:, 1]))
    step = np.maximum(*limits.wheels(*np.diff(raw, axis=0).T))
    believed = limits.believable(intervals * 1e-9, step, away[:-1], away[1:])
    return bool((believed & (step <= limits.sure_step)).all())
