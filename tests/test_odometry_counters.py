"""Counters that wrap, glitch, restart and jump, and the motion that is made of them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from odometry.clock import SenderClock
from odometry.counters import CounterTracker, Limits, TickReading, all_believable
from odometry.encoders import EncoderParameters
from odometry.settings import OdometrySettings
from odometry.source import EncoderOdometry
from odometry.tick_log import HEADER, TickLog, parse_tick_log, tick_lines
from tests.serial_devices import FINE, WHEELS

MS = 1_000_000
STEP = 20 * MS
TICK = float(WHEELS.metres_per_tick[0])


def run(counts, parameters=WHEELS, step=STEP, max_speed=1.5):
    """All readings, and the tracker, of (left, right) counts that come every `step` ns."""
    tracker = CounterTracker(Limits(parameters, max_speed))
    readings = [
        reading
        for k, (left, right) in enumerate(counts)
        for reading in tracker.take(1000 + k * step, left, right)
    ]
    return readings, tracker


@pytest.mark.parametrize("bits", [12, 16, 24, 32])
def test_wraps_either_way_are_no_event(bits):
    parameters = EncoderParameters(2000, 0.075, 0.075, 0.3, bits)
    true = [(5 + 60 * k, -7 * k) for k in range(-20, 300)]
    readings, tracker = run([(a % 2**bits, b % 2**bits) for a, b in true], parameters)
    assert np.diff([r.left_total for r in readings]).tolist() == [60] * 319
    assert np.diff([r.right_total for r in readings]).tolist() == [-7] * 319
    assert not tracker.counts
    assert not tracker.events


def test_one_wild_reading_is_left_out():
    readings, tracker = run([(20000, 0), (20010, 5), (31234, 10), (20030, 15)])
    assert [r.left_total for r in readings] == [20000, 20010, 20030]
    assert tracker.counts == {"implausible": 1}
    assert not any(r.reset for r in readings)


def test_a_restart_is_no_motion_and_what_follows_counts():
    counts = [(20000 + 10 * k, 30000) for k in range(5)] + [(3 + 10 * k, 0) for k in range(5)]
    readings, tracker = run(counts)
    assert [r.left_total for r in readings] == [20000, 20010, 20020, 20030, 20040] + [
        20040 + 10 * k for k in range(5)
    ]
    assert [r.reset for r in readings] == [False] * 5 + [True] + [False] * 4
    assert tracker.counts == {"resets": 1}
    assert "restarted from 20040, 30000 to 3, 0" in tracker.events[0]


def test_a_jump_elsewhere_is_told_apart_from_a_restart():
    readings, tracker = run([(100, 0)] * 3 + [(20000, 9000)] * 4)
    assert [r.reset for r in readings] == [False] * 3 + [True] + [False] * 3
    assert {r.left_total for r in readings} == {100}
    assert tracker.counts == {"jumps": 1}


def test_a_restart_near_zero_needs_an_announcement_to_be_seen():
    def restart(announced: bool) -> list[TickReading]:
        tracker = CounterTracker(Limits(WHEELS, 1.5))
        tracker.take(0, 250, 250)
        if announced:
            tracker.announce_restart()
        return [r for k in range(1, 4) for r in tracker.take(k * STEP, 10, 10)]

    silent, told = restart(False), restart(True)
    # 240 counts are 6 cm, which a robot may drive: a small error at worst.
    assert [(r.left_total, r.reset) for r in silent] == [(10, False)] * 3
    assert [(r.left_total, r.reset) for r in told] == [(250, True), (250, False), (250, False)]


def test_after_a_silence_zero_is_a_restart_even_where_the_way_back_is_possible():
    tracker = CounterTracker(Limits(WHEELS, 1.5))
    tracker.take(0, 5000, 5000)
    readings = [r for k in range(3) for r in tracker.take(2_000 * MS + k * STEP, 0, 0)]
    assert [r.reset for r in readings] == [True, False, False]
    tracker = CounterTracker(Limits(WHEELS, 1.5))
    tracker.take(0, 5000, 5000)
    (reading,) = tracker.take(2_000 * MS, 8000, 8000)
    assert (reading.left_total, reading.reset) == (8000, False)


def test_a_narrow_counter_cannot_be_followed_through_a_long_silence():
    narrow = EncoderParameters(2000, 0.075, 0.075, 0.3, 12)
    tracker = CounterTracker(Limits(narrow, 1.5))
    tracker.take(0, 3000, 3000)
    readings = [r for k in range(3) for r in tracker.take(3_000 * MS + k * STEP, 3100, 3100)]
    assert [r.reset for r in readings] == [True, False, False]


def test_beyond_the_counter_is_nothing():
    readings, tracker = run([(0, 0), (65536, 0), (0, -32769), (1, 1)])
    assert len(readings) == 2
    assert tracker.counts == {"out_of_range": 2}


@example([(0, 0), (0, 0), (0, -143), (0, 144), (0, 172), (287, -132)])
@given(st.lists(st.tuples(st.integers(-300, 70_000), st.integers(-300, 700)), max_size=60))
def test_totals_never_leap_and_taken_readings_give_the_same_again(counts):
    readings, tracker = run(counts)
    furthest = 1.5 * 1.5 * (0.02 * len(counts) + 0.03) + 3 * TICK
    for before, after in itertools.pairwise(readings):
        assert after.stamp > before.stamp
        assert abs(after.left_total - before.left_total) * TICK <= furthest
    again = CounterTracker(Limits(WHEELS, 1.5))
    repeated = [
        again_reading
        for r in readings
        for again_reading in again.take(r.stamp, r.left, r.right, r.reset)
    ]
    assert repeated == readings
    taken = len(readings) + tracker.counts["implausible"] + tracker.counts["out_of_range"]
    assert len(counts) - 2 <= taken <= len(counts)  # two may still be held back
    if len(counts) > 1:
        table = np.array(counts)
        inside = ((table >= -(2**15)) & (table < 2**16)).all()
        quick = all_believable(1000 + STEP * np.arange(len(table)), table, Limits(WHEELS, 1.5))
        undisturbed = len(readings) == len(counts) and not any(r.reset for r in readings)
        assert undisturbed or not (inside and quick)


def test_a_restart_in_a_recording_is_no_motion_with_much_doubt():
    left = np.concatenate([20000 + 20 * np.arange(100), 20 * np.arange(100)])
    stamps = 20 * MS * np.arange(200)
    stamps[100:] += 1500 * MS
    source = EncoderOdometry(TickLog(stamps, left, left), FINE, OdometrySettings())
    source.until(0)
    before = source.until(1980 * MS)
    within = source.until(3000 * MS)
    after = source.until(3500 * MS)
    assert before is not None
    assert within is not None
    assert after is not None
    # 20 counts in 20 ms: 0.24 m/s for 1.5 s, of which nothing is known.
    assert not within.increment.any()
    assert not after.increment.any()
    lost = within.then(after).covariance
    assert 0.3 < np.sqrt(lost[0, 0]) < 1.5
    assert 0.3 < np.sqrt(lost[2, 2]) < 1.5
    assert np.sqrt(before.covariance[0, 0]) < 0.05
    report = source.report()
    assert report["ticks_resets"] == 1
    assert report["tick_gaps"] == 1


def test_readings_are_recorded_with_their_resets():
    readings = [
        TickReading(10, 5, 6, 5, 6),
        TickReading(20, 1, 2, 5, 6, True),
        TickReading(30, 3, 4, 7, 8),
    ]
    text = HEADER + "".join(map(tick_lines, readings))
    assert "20,1,2" in text.splitlines()
    log = parse_tick_log(text, "x")
    assert log.reset.tolist() == [False, True, False]
    # The mark outlives its line.
    assert parse_tick_log(text.replace("20,1,2", "2x,1,2"), "x").reset.tolist() == [False, True]


def test_the_senders_clock_takes_out_the_delay_and_its_own_wrap():
    clock = SenderClock()
    sent = [2**32 - 50_000 + 10_000 * k for k in range(20)]
    delays = [3_000_000 * (k % 4) for k in range(20)]
    host = 5_000_000_000
    for k, (t_us, delay) in enumerate(zip(sent, delays, strict=True)):
        true_time = host + 10_000_000 * k
        assert clock.host_time(t_us % 2**32, true_time + delay) == pytest.approx(
            true_time, abs=100_000
        )
    assert clock.jumps == 0


def test_a_slow_senders_clock_is_followed_and_a_restart_costs_one_line():
    clock = SenderClock()
    arrival = stamp = 0
    for k in range(2000):
        arrival = 100_000_000 * k
        # 100 ppm slow: after 200 s it is 20 ms behind.
        stamp = clock.host_time(int(arrival * (1 - 1e-4)) // 1000, arrival)
    assert arrival - stamp < 100_000
    assert clock.host_time(123, arrival + 1000) == arrival + 1000
    assert clock.host_time(100_123, arrival + 100_001_000) == pytest.approx(
        arrival + 100_001_000, abs=100_000
    )
    assert clock.jumps == 1
