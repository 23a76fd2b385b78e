"""Encoder parameters, wrapping counters and recorded ticks in any state."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from odometry.encoders import EncoderParameters, encoder_parameters, unwrap_counts
from odometry.errors import OdometryError
from odometry.tick_log import parse_tick_log, read_tick_log

GOOD = {
    "ticks_per_revolution": 2000,
    "left_radius": 0.075,
    "right_radius": 0.076,
    "track": 0.3,
    "counter_bits": 16,
    "reversed": [False, True],
}
MS = 1_000_000


def test_parameters_of_a_rig_and_of_a_sensor_file():
    expected = EncoderParameters(2000.0, 0.075, 0.076, 0.3, 16, (False, True))
    assert encoder_parameters(GOOD, "rig.yaml: encoders") == expected
    assert encoder_parameters({"sensor_type": "encoders", **GOOD}, "sensor.yaml") == expected
    left, right = expected.metres_per_tick
    assert left == pytest.approx(2 * np.pi * 0.075 / 2000)
    assert right == pytest.approx(-2 * np.pi * 0.076 / 2000)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"track": 300}, ["track", "300", "0.01 to 5"]),
        ({"track": True}, ["track", "True", "number"]),
        ({"left_radius": "75 mm"}, ["left_radius", "'75 mm'", "number"]),
        ({"right_radius": float("nan")}, ["right_radius", "nan"]),
        ({"ticks_per_revolution": 0}, ["ticks_per_revolution", "0", "1 to 1e+07"]),
        ({"counter_bits": 64}, ["counter_bits", "64", "12 to 32"]),
        ({"counter_bits": None}, ["counter_bits", "None", "12 to 32"]),
        ({"reversed": True}, ["reversed", "True", "[left, right]"]),
        ({"sensor_type": "imu"}, ["sensor_type", "'imu'", "encoders"]),
        ({"ppr": 2000}, ["unknown field 'ppr'", "ticks_per_revolution"]),
    ],
)
def test_bad_parameters_are_one_line_with_field_value_and_remedy(change, words):
    with pytest.raises(OdometryError) as caught:
        encoder_parameters({**GOOD, **change}, "odom0/sensor.yaml")
    message = str(caught.value)
    assert message.startswith("odom0/sensor.yaml: ")
    assert "\n" not in message
    assert all(word in message for word in words)


@pytest.mark.parametrize("missing", ["track", "ticks_per_revolution", "counter_bits"])
def test_missing_parameters_are_named(missing):
    data = {key: value for key, value in GOOD.items() if key != missing}
    with pytest.raises(OdometryError, match=missing):
        encoder_parameters(data, "sensor.yaml")


def test_parameters_that_are_no_mapping():
    with pytest.raises(OdometryError, match="expected the fields"):
        encoder_parameters([1, 2], "sensor.yaml")


@given(st.data(), st.sampled_from([12, 16, 32]), st.booleans())
def test_a_wrapping_counter_is_undone(data, bits, signed):
    half = 1 << (bits - 1)
    steps = data.draw(st.lists(st.integers(-half, half - 1), min_size=1, max_size=50))
    start = data.draw(st.integers(-half, half - 1) if signed else st.integers(0, 2 * half - 1))
    total = start + np.concatenate([[0], np.cumsum(np.array(steps, np.int64))])
    raw = (total + half) % (2 * half) - half if signed else total % (2 * half)
    assert np.array_equal(unwrap_counts(raw, bits), total)


def log_text(stamps, counts=None):
    counts = range(len(stamps)) if counts is None else counts
    rows = [f"{s},{c},{-c}" for s, c in zip(stamps, counts, strict=True)]
    return "#timestamp [ns],left [ticks],right [ticks]\n" + "\n".join(rows) + "\n"


def test_a_whole_log_keeps_its_nanoseconds(tmp_path):
    stamps = [1403715273262142976 + 50 * MS * k + k for k in range(5)]
    path = tmp_path / "data.csv"
    path.write_text(log_text(stamps))
    log = read_tick_log(path)
    assert log.stamps.dtype == np.int64
    assert log.stamps.tolist() == stamps
    assert log.left.tolist() == [0, 1, 2, 3, 4]
    assert log.right.tolist() == [0, -1, -2, -3, -4]
    assert log.skipped == {}
    assert log.gaps.shape == (0, 2)


def test_spaces_windows_line_ends_and_blank_lines_are_no_damage():
    log = parse_tick_log("# t, l, r\r\n 10 , 1, +2 \r\n\r\n20,3,-4\r\n", "x")
    assert log.stamps.tolist() == [10, 20]
    assert log.right.tolist() == [2, -4]
    assert log.skipped == {}


def test_damaged_lines_are_skipped_and_counted(tmp_path):
    path = tmp_path / "data.csv"
    path.write_bytes(
        b"10,1,1\n20,2\n30,3,3,3\n40,x,4\n50,5.5,5\n\xff\xfe,6,6\n1_0,1,1\n"
        b"99999999999999999999,7,7\n60,6,6\n70,7,99999999999999999999999\n80,8,8\n90,9"
    )
    log = read_tick_log(path)
    assert log.stamps.tolist() == [10, 60, 80]
    assert log.skipped == {"fields": 3, "garbled": 6}


def test_time_that_stands_or_runs_backwards_is_skipped():
    log = parse_tick_log(log_text([10, 20, 20, 30, 15, 40]), "x")
    assert log.stamps.tolist() == [10, 20, 30, 40]
    assert log.skipped == {"backwards": 1, "repeated": 1}


def test_one_stamp_far_ahead_costs_one_line():
    log = parse_tick_log(log_text([10, 20, 9_000_000, 30, 40, 50]), "x")
    assert log.stamps.tolist() == [10, 20, 30, 40, 50]
    assert log.skipped == {"backwards": 1}


def test_a_clock_set_back_costs_the_shorter_part():
    log = parse_tick_log(log_text([1010, 1020, 30, 40, 50, 60]), "x")
    assert log.stamps.tolist() == [30, 40, 50, 60]


@given(st.lists(st.integers(0, 30), min_size=2, max_size=40))
def test_what_is_kept_increases_and_everything_is_counted(stamps):
    try:
        log = parse_tick_log(log_text(stamps), "x")
    except OdometryError:
        assert all(a >= b for a, b in itertools.pairwise(stamps))
        return
    assert (np.diff(log.stamps) > 0).all()
    assert len(log) + sum(log.skipped.values()) == len(stamps)


def test_gaps_are_found_where_they_stand_out():
    stamps = np.arange(20) * 50 * MS
    stamps[10:] += 400 * MS
    log = parse_tick_log(log_text(stamps.tolist()), "x")
    assert log.gaps.tolist() == [[450 * MS, 900 * MS]]
    # A slow but steady log has none, nor has a fast one with a hiccup of 100 ms.
    assert not len(parse_tick_log(log_text([0, 1000 * MS, 2000 * MS]), "x").gaps)
    hiccup = [0, 5 * MS, 10 * MS, 110 * MS, 115 * MS]
    assert not len(parse_tick_log(log_text(hiccup), "x").gaps)


@pytest.mark.parametrize("text", ["", "#timestamp\n", "10,1,1\n", "a,b,c\nd,e\n", "9,1,1\n5,1,1\n"])
def test_nothing_usable_is_an_error_that_names_the_file(text):
    with pytest.raises(OdometryError, match=r"odom0/data\.csv: [01] usable lines"):
        parse_tick_log(text, "odom0/data.csv")


def test_a_missing_file_and_a_folder(tmp_path):
    with pytest.raises(OdometryError, match="no such file"):
        read_tick_log(tmp_path / "none.csv")
    with pytest.raises(OdometryError, match="cannot be read"):
        read_tick_log(tmp_path)


@given(st.text(max_size=200))
def test_no_text_breaks_the_reader(text):
    log = parse_tick_log("1,0,0\n2,0,0\n" + text, "x")
    assert (np.diff(log.stamps) > 0).all()
