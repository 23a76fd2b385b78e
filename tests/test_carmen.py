"""The CARMEN reader: beams, stamps, odometry, what a log says of itself, and damage."""

from __future__ import annotations

import bz2
import gzip
import lzma
import math
import os
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from odometry.motion import compose
from pipeline.errors import InputError
from pipeline.recordings import open_input
from pipeline.recordings.carmen import read_carmen
from pipeline.recordings.carmen_writer import write_carmen
from pipeline.recordings.laser import LaserSettings
from pipeline.recordings.scan_log import ScanLog
from pipeline.settings import load_settings
from stereo.scan import RangeScan
from tests.scan_logs import BEAMS, drive, write_log

REAL = os.environ.get("BEEMAP_REAL_DATA")
needs_real_data = pytest.mark.skipif(REAL is None, reason="BEEMAP_REAL_DATA is not set")


def read(tmp_path: Path, *lines: str) -> ScanLog:
    return read_carmen(write_log(tmp_path / "a.log", list(lines)))


def flaser(ranges: list[object], pose: str = "1 2 0.5", stamp: str = "10.25") -> str:
    numbers = " ".join(map(str, ranges))
    return f"FLASER {len(ranges)} {numbers} 9 9 9 {pose} {stamp} host 3.5"


def robotlaser(ranges: str, poses: str = "1 2 0.5 1 2 0.5", maximum: object = 8.0) -> str:
    n = len(ranges.split())
    return (
        f"ROBOTLASER1 0 -0.5 1.0 0.25 {maximum} 0.01 0 {n} {ranges} 0 {poses} "
        "0 0 0 0 0 10.25 host 3.5"
    )


# What a line means


def test_a_flaser_line(tmp_path):
    log = read(tmp_path, "PARAM robot_frontlaser_offset 0.3 nohost 0", flaser([1.5, 2.5, 3.25]))
    assert log.stamps.tolist() == [10_250_000_000]
    assert log.odometry.tolist() == [[1.0, 2.0, 0.5]]  # the robot's, not the laser's 9 9 9
    scan = log.scans[0]
    assert scan.stamp == 10_250_000_000
    assert scan.origin == (0.3, 0.0, 0.0)
    assert scan.range.tolist() == [1.5, 2.5, 3.25]
    assert np.degrees(scan.bearing).tolist() == pytest.approx([-90.0, 0.0, 90.0])
    assert scan.sigma == pytest.approx(0.02)


def test_a_robotlaser_line(tmp_path):
    log = read(tmp_path, robotlaser("1.5 8.0 8.1 0.0 -1.0", maximum=8.0))
    scan = log.scans[0]
    assert scan.bearing.tolist() == pytest.approx([-0.5, -0.25, 0.0, 0.25, 0.5])
    assert scan.max_range == 8.0
    assert np.isnan(scan.range).tolist() == [False, True, True, True, True]
    free = log.taken(LaserSettings(maximum="free"))[0]
    assert free.range.tolist()[:3] == [1.5, math.inf, math.inf]
    assert np.isnan(free.range[3:]).all()
    assert np.isnan(free.sigma[1:]).all()


def test_stamps_are_exact_beyond_the_precision_of_a_float(tmp_path):
    log = read(tmp_path, flaser([1, 2, 3], stamp="1976052857.337530123"))
    assert log.stamps.tolist() == [1_976_052_857_337_530_123]


def test_scans_stay_in_file_order(tmp_path):
    lines = [
        flaser([i + 1, 1, 1], f"{i} 0 0", stamp) for i, stamp in enumerate(["5", "3", "3", "9"])
    ]
    log = read(tmp_path, *lines)
    assert (log.stamps / 1e9).tolist() == [5, 3, 3, 9]
    assert log.odometry[:, 0].tolist() == [0, 1, 2, 3]
    assert [scan.range[0] for scan in log.scans] == [1, 2, 3, 4]
    assert log.counts["times stepping backwards"] == 1
    assert log.counts["times repeated"] == 1
    assert log.skipped == {}


def test_both_kinds_of_line_may_be_mixed_and_change_their_beams(tmp_path):
    log = read(tmp_path, flaser([1, 2]), robotlaser("1 2 3"), flaser([1, 2]), flaser([1] * 4))
    assert [scan.range.size for scan in log.scans] == [2, 3, 2, 4]
    assert log.counts["changes of the beam count"] == 3


@pytest.mark.parametrize("place", [(0.25, 0.0, 0.0), (0.1, -0.2, 0.5), (-0.3, 0.0, 3.1415926)])
def test_the_place_of_the_scanner_follows_from_the_two_poses(tmp_path, place):
    lines = []
    for robot in ([0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [4.0, -2.0, -3.0]):
        laser = compose(np.array(robot), np.array(place))
        lines.append(robotlaser("1 2 3", " ".join(map(str, [*laser, *robot]))))
    log = read(tmp_path, "PARAM robot_frontlaser_offset 0.7 nohost 0", *lines)
    assert log.origins[:, :2] == pytest.approx(np.tile(place[:2], (3, 1)))
    assert np.cos(log.origins[:, 2] - place[2]) == pytest.approx(1.0)


def test_poses_that_do_not_tell_the_scanners_place_leave_it_to_the_parameter(tmp_path):
    for poses in (("1 2 0.5 1 2 0.5",) * 2, ("1 2 0.5 1 2 0.5", "7 8 0.1 2 2 0.5")):
        lines = [robotlaser("1 2 3", p) for p in poses]
        log = read(tmp_path, "PARAM robot_frontlaser_offset 0.7 nohost 0", *lines)
        assert log.origins.tolist() == [[0.7, 0.0, 0.0]] * 2


# What the log says of itself


def test_suggestions_lie_between_defaults_and_the_users_settings(tmp_path):
    log = read(
        tmp_path,
        "PARAM beemap_laser_noise 0.02 nohost 0",
        "PARAM beemap_laser_max_range 8 nohost 0",
        "PARAM beemap_laser_maximum free nohost 0",
        "PARAM beemap_odometry_along 4e-2",
        "PARAM beemap_mapping_particles 30 nohost 0",
        flaser([1, 2, 9]),
    )
    assert log.suggested == {
        "laser": {"noise": 0.02, "max_range": 8, "maximum": "free"},
        "odometry": {"along": 0.04},
        "mapping": {"particles": 30},
    }
    assert log.scans[0].range[2] == math.inf
    file = tmp_path / "settings.yaml"
    file.write_text("mapping: {particles: 40}\nlaser:\n")
    chosen = load_settings(file, ("odometry.along=0.5",), log.suggested)
    assert (chosen.laser.noise, chosen.laser.max_range) == (0.02, 8.0)
    assert chosen.mapping.particles == 40
    assert chosen.odometry.along == 0.5
    assert chosen.odometry.across == load_settings(None).odometry.across


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("PARAM beemap_laser_noise much nohost 0", "laser.noise is 'much'"),
        ("PARAM beemap_laser_nose 0.1 nohost 0", "unknown key 'laser.nose'"),
        ("PARAM beemap_stereo_band 0.1 nohost 0", "no such stage (known: odometry, laser, mapping"),
        ("PARAM beemap_mapping_particles -3 nohost 0", "mapping.particles is -3"),
        ("PARAM beemap_mapping_cell [1 nohost 0", "not valid YAML"),
    ],
)
def test_a_wrong_suggestion_is_reported_and_not_taken(tmp_path, line, told):
    log = read(tmp_path, line, flaser([1, 2]))
    assert all(not values for values in log.suggested.values())
    (reason,) = log.skipped["parameter not understood"]
    assert reason.startswith("line 3: ")
    assert told in reason


# Damage


GOOD = flaser([1, 2, 3])


@pytest.mark.parametrize(
    "line",
    [
        *(GOOD[:length] for length in (7, 9, 12, 20, len(GOOD) - 5)),
        GOOD.replace("FLASER 3", "FLASER 4"),
        GOOD.replace("FLASER 3", "FLASER x"),
        GOOD.replace("FLASER 3", "FLASER -3"),
        GOOD.replace(" 2 3 9", " 2 3# 9"),
        GOOD.replace("0.5", "nan"),
        GOOD.replace("0.5", "1e300"),
        GOOD.replace("10.25", "now"),
        GOOD.replace("10.25", "1e300"),
        GOOD + GOOD,
        "FLASER 0 9 9 9 1 2 0.5 10.25 host 3.5",
        robotlaser("1 2 3")[:-9],
        robotlaser("1 2 3").replace(" 3 1 2 3 0 ", " 3 1 2 3 1 "),
        robotlaser("1 2 3").replace("-0.5 1.0 0.25", "-0.5 0 0"),
        robotlaser("1 2 3").replace("-0.5 1.0 0.25", "-0.5 1.0 25"),
        "ODOM 1 2 3",
        "PARAM robot_frontlaser_offset",
        "PARAM robot_frontlaser_offset far nohost 0",
    ],
)
def test_a_damaged_line_is_counted_and_named(tmp_path, line):
    log = read(tmp_path, GOOD, line, GOOD)
    assert len(log) == 2
    assert log.skipped == {"damaged line": ["line 4"]}


def test_other_messages_are_counted_and_unknown_ones_named(tmp_path):
    rear = GOOD.replace("FLASER", "RLASER")
    log = read(tmp_path, "SYNC start 1 host 0", rear, "TRUEPOS 1 2", GOOD, "FOO 1", "\xff\xfe", "")
    assert log.counts["SYNC"] == log.counts["RLASER"] == log.counts["TRUEPOS"] == 1
    assert len(log) == 1
    named = log.skipped["unknown message type"]
    assert len(named) == 2
    assert named[0] == "FOO, line 7"


def test_nan_is_a_beam_without_an_answer(tmp_path):
    log = read(tmp_path, flaser(["1", "nan", "2", "-nan"]))
    assert np.isnan(log.scans[0].range).tolist() == [False, True, False, True]
    assert log.counts["beams without a number"] == 2
    assert log.skipped == {}


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(0, 400), extra=st.binary(max_size=30), where=st.integers(0, 400))
def test_no_damage_is_fatal(tmp_path, cut, extra, where):
    """One line garbled at random: the others stand as they were."""
    bad = robotlaser("1 2 3 4").encode()[:cut]
    bad = (bad[:where] + extra + bad[where:]).replace(b"\n", b"").replace(b"\r", b"")
    file = tmp_path / "b.log"
    file.write_bytes(b"\n".join([GOOD.encode(), bad, GOOD.encode()]) + b"\n")
    log = read_carmen(file)
    assert log.odometry[[0, -1]].tolist() == [[1.0, 2.0, 0.5]] * 2
    assert np.isfinite(log.odometry).all()
    assert len(log) == len(log.readings) == len(log.beams) == len(log.origins)
    for scan in log.scans:
        assert (np.diff(scan.bearing) > 0).all()


# Files


@pytest.mark.parametrize(
    ("name", "pack"),
    [
        ("a.log", bytes),
        ("a.clf.gz", gzip.compress),
        ("a.log.bz2", bz2.compress),
        ("a.carmen.xz", lzma.compress),
        ("packed, but not named so", bz2.compress),
    ],
)
def test_packed_logs(tmp_path, name, pack):
    path = tmp_path / name
    path.write_bytes(pack(b"\xef\xbb\xbf" + GOOD.encode().replace(b" ", b"\t") + b"\r\n"))
    log = open_input(path)
    assert isinstance(log, ScanLog)
    assert log.scans[0].range.tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    "pack", [gzip.compress, bz2.compress, partial(lzma.compress, preset=0)], ids=["gz", "bz2", "xz"]
)
def test_a_packed_log_cut_short_is_read_as_far_as_it_goes(tmp_path, pack):
    path = tmp_path / "a.log.packed"
    rng = np.random.default_rng(1)
    lines = [flaser(rng.integers(1, 10**6, 300).tolist()) for _ in range(1000)]
    data = pack("\n".join(lines).encode())
    path.write_bytes(data[: len(data) * 2 // 3])
    log = read_carmen(path)
    assert 100 < len(log) < 1000
    assert log.skipped["packed file damaged"] == ["the rest of it"]
    assert len(log.skipped["damaged line"]) <= 1


def test_the_truth_beside_a_log_is_found(tmp_path):
    (tmp_path / "paper.seed1.tum").write_text("")
    for name in ("paper.seed1.log", "paper.seed1.clf.bz2", "other.log"):
        (tmp_path / name).write_text(GOOD)
        truth = read_carmen(tmp_path / name).truth_file
        assert truth == (tmp_path / "paper.seed1.tum" if name.startswith("paper") else None)


@pytest.mark.parametrize(
    "content", [b"", b"# nothing\n", b"\x89PNG\r\n\x1a\n\0\0", b"ODOM 1\n" * 9]
)
def test_a_file_without_scans_is_refused(tmp_path, content):
    path = tmp_path / "a.log"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.log: holds no laser scan .* give a CARMEN log"):
        read_carmen(path)


def test_missing_and_unreadable_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        open_input(tmp_path / "gone.log")
    with pytest.raises(InputError, match="Is a directory"):
        read_carmen(tmp_path)


# Writer and reader, and real logs


coordinate = st.floats(-1e4, 1e4, allow_nan=False)
reading = st.one_of(st.floats(0.01, 7.99), st.just(math.inf), st.just(math.nan))


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    scans=st.lists(
        st.tuples(
            st.lists(reading, min_size=2, max_size=5),
            st.tuples(coordinate, coordinate, st.floats(-3.1, 3.1)),
            st.integers(0, 2**61),
        ),
        min_size=1,
        max_size=5,
    )
)
def test_what_is_written_is_read(tmp_path, scans):
    written = []
    for ranges, _, stamp in scans:
        r = np.array(ranges)
        bearing = np.linspace(-0.5, 0.5, len(r))
        written.append(RangeScan(stamp, (0.0, 0.0, 0.0), bearing, r, np.full(len(r), 0.02), 8.0))
    odometry = np.array([pose for _, pose, _ in scans])
    write_carmen(tmp_path / "c.log", written, odometry, (), {"laser": {"maximum": "free"}})
    log = read_carmen(tmp_path / "c.log")
    assert log.skipped == {}
    assert log.stamps.tolist() == [scan.stamp for scan in written]
    assert np.array_equal(log.odometry, odometry)
    for scan, back in zip(written, log.scans, strict=True):
        assert back.bearing == pytest.approx(scan.bearing)
        np.testing.assert_allclose(back.range, scan.range, atol=1.01e-4)


def test_a_drive_is_read_alike_in_both_forms(tmp_path):
    d = drive(5)
    forms = [
        read_carmen(write_log(tmp_path / f"{form}.log", [getattr(d, form)(i) for i in range(5)]))
        for form in ("flaser", "robotlaser")
    ]
    for log in forms:
        assert [scan.range.size for scan in log.scans] == [BEAMS] * 5
        assert log.odometry == pytest.approx(d.odometry, abs=1e-6)
    for a, b in zip(forms[0].scans, forms[1].scans, strict=True):
        assert a.bearing == pytest.approx(b.bearing, abs=1e-8)
        assert a.range.tolist() == b.range.tolist()


@needs_real_data
def test_real_logs_are_read_whole_and_fast():
    assert REAL is not None
    begin = time.process_time()
    intel = read_carmen(Path(REAL) / "laser" / "intel" / "intel.clf.bz2")
    assert time.process_time() - begin < 2.0  # 1.0 s measured
    assert len(intel) == 13631
    assert intel.counts["times stepping backwards"] == 631
    assert intel.counts["ODOM"] == 26915
    assert intel.skipped == {}
    assert intel.scans[0].max_range == 80.0
    assert np.mean([np.isnan(scan.range).mean() for scan in intel.scans]) == pytest.approx(
        0.0278, abs=1e-4
    )
    aces = read_carmen(Path(REAL) / "laser" / "aces" / "aces.clf.bz2")
    assert len(aces) == 7374
    assert aces.scans[0].max_range == 50.0
