"""Motion between the stamps of images, from ticks and from poses."""

from __future__ import annotations

import itertools
import math
import os
from pathlib import Path

import numpy as np
import pytest

from odometry.encoders import EncoderParameters
from odometry.errors import OdometryError
from odometry.motion import compose, inverse
from odometry.poses import FLOOR_M, PoseOdometry
from odometry.settings import OdometrySettings
from odometry.source import EncoderOdometry
from odometry.tick_log import TickLog

MS = 1_000_000
START = 1403715273262142976
FINE = EncoderParameters(1_000_000, 0.075, 0.075, 0.3, 32)


def circle_ticks(parameters: EncoderParameters, n: int = 41, period: int = 25 * MS) -> TickLog:
    """A circle of radius 0.5 m driven at 0.4 m/s, read every 25 ms."""
    stamps = START + period * np.arange(n)
    angle = 0.8 * (stamps - START) / 1e9
    paths = np.stack([(0.5 - 0.15) * angle, (0.5 + 0.15) * angle], axis=1)
    counts = np.rint(paths / parameters.metres_per_tick).astype(np.int64)
    wrapped = counts % (1 << parameters.counter_bits)
    return TickLog(stamps, wrapped[:, 0], wrapped[:, 1])


def circle_pose(stamp: int) -> np.ndarray:
    angle = 0.8 * (stamp - START) / 1e9
    return np.array([0.5 * math.sin(angle), 0.5 - 0.5 * math.cos(angle), angle])


def test_motion_between_readings_on_a_circle_is_exact():
    source = EncoderOdometry(circle_ticks(FINE), FINE, OdometrySettings())
    stamps = [START + 7 * MS, START + 9 * MS, START + 400 * MS, START + 913 * MS, START + 1000 * MS]
    first = source.until(stamps[0])
    assert first is not None
    assert not first.increment.any()
    assert not first.covariance.any()
    for before, after in itertools.pairwise(stamps):
        motion = source.until(after)
        assert motion is not None
        truth = compose(inverse(circle_pose(before)), circle_pose(after))
        assert motion.increment == pytest.approx(truth, abs=3e-6)
        assert (motion.first, motion.last) == (before, after)
        assert np.linalg.eigvalsh(motion.covariance).min() > 0.0


def test_coarse_wrapping_reversed_counters_stay_within_their_rounding():
    coarse = EncoderParameters(2000, 0.075, 0.075, 0.3, 12, (True, False))
    source = EncoderOdometry(circle_ticks(coarse, 400), coarse, OdometrySettings())
    pose = np.zeros(3)
    for k in range(0, 400, 20):
        motion = source.until(START + 25 * MS * k)
        assert motion is not None
        pose = compose(pose, motion.increment)
    truth = circle_pose(START + 25 * MS * 380)
    assert pose[:2] == pytest.approx(truth[:2], abs=0.003)


def test_stamps_without_ticks_get_none_and_the_next_answer_spans_them():
    source = EncoderOdometry(circle_ticks(FINE), FINE, OdometrySettings())
    assert source.until(START - 1) is None
    assert source.until(START) is not None
    assert source.until(START + 2000 * MS) is None
    motion = source.until(START + 1000 * MS)
    assert motion is not None
    assert motion.first == START
    assert motion.increment == pytest.approx(circle_pose(START + 1000 * MS), abs=3e-6)
    assert source.until(START + 500 * MS) is None
    again = source.until(START + 1000 * MS)
    assert again is not None
    assert not again.increment.any()
    assert source.report()["pairs_without_motion"] == 3


def test_a_gap_is_bridged_with_more_doubt_and_reported():
    whole = circle_ticks(FINE)
    keep = np.ones(41, bool)
    keep[11:30] = False
    holed = TickLog(whole.stamps[keep], whole.left[keep], whole.right[keep])
    motions = {}
    for name, log in (("whole", whole), ("holed", holed)):
        source = EncoderOdometry(log, FINE, OdometrySettings())
        source.until(START)
        motions[name] = source.until(START + 1000 * MS)
        report = source.report()
    assert motions["holed"].increment == pytest.approx(motions["whole"].increment, abs=1e-5)
    assert (np.diag(motions["holed"].covariance) > 3.0 * np.diag(motions["whole"].covariance)).all()
    assert report["tick_gaps"] == 1
    assert report["longest_tick_gap_s"] == pytest.approx(0.5)


def test_counters_wider_than_stated_are_an_error_and_single_wild_counts_are_skipped():
    narrow = EncoderParameters(2000, 0.075, 0.075, 0.3, 16)
    stamps = START + 10 * MS * np.arange(1000)
    counts = np.arange(1000) * 100
    with pytest.raises(OdometryError, match=r"counter_bits: 16 does not fit.*99900"):
        EncoderOdometry(TickLog(stamps, counts, counts), narrow, OdometrySettings())
    counts = counts % 65536
    wild = counts.copy()
    wild[500] = 10**9
    sources = [
        EncoderOdometry(TickLog(stamps, left, counts), narrow, OdometrySettings())
        for left in (counts, wild)
    ]
    for source in sources:
        source.until(START)
    ends = [source.until(START + 9000 * MS) for source in sources]
    assert ends[0] is not None
    assert ends[1] is not None
    assert ends[1].increment == pytest.approx(ends[0].increment)
    assert sources[1].report()["ticks_out_of_range"] == 1


def line_poses(n: int = 11) -> tuple[np.ndarray, np.ndarray]:
    stamps = START + 100 * MS * np.arange(n)
    return stamps, np.stack([0.1 * np.arange(n), np.full(n, 2.0), np.zeros(n)], axis=1)


def test_poses_are_interpolated_the_shorter_way_round():
    stamps = np.array([0, 100 * MS])
    poses = np.array([[0.0, 0.0, math.pi - 0.1], [1.0, 0.0, -math.pi + 0.1]])
    source = PoseOdometry(stamps, poses, OdometrySettings(), seed=0)
    source.until(0)
    motion = source.until(50 * MS)
    assert motion is not None
    assert motion.increment[2] == pytest.approx(0.1)
    assert np.hypot(*motion.increment[:2]) == pytest.approx(0.5)


def test_poses_answer_a_millisecond_beyond_their_ends():
    source = PoseOdometry(*line_poses(), OdometrySettings(), seed=0)
    assert source.until(START - 2 * MS) is None
    assert source.until(START - MS) is not None
    motion = source.until(START + 1001 * MS)
    assert motion is not None
    assert motion.increment == pytest.approx([1.0, 0.0, 0.0])
    assert math.sqrt(motion.covariance[0, 0]) == pytest.approx(FLOOR_M)
    assert source.until(START + 1002 * MS) is None
    assert source.until(START) is None
    assert source.report()["pairs_without_motion"] == 3


def increments(seed: int, settings: OdometrySettings, n: int = 2001):
    stamps, poses = line_poses(n)
    source = PoseOdometry(stamps, poses, settings, seed)
    motions = [m for stamp in stamps if (m := source.until(int(stamp)))][1:]
    return np.array([m.increment for m in motions]), motions


def test_noise_and_bias_are_as_set_and_the_covariance_tells_the_noise():
    settings = OdometrySettings(noise=(0.05, 0.5), bias=0.2)
    values, motions = increments(1, settings)
    error = values - [0.1, 0.0, 0.0]
    degrees = np.degrees(error[:, 2])
    # 2000 steps: five standard errors of mean and of standard deviation.
    assert error[:, :2].std(axis=0) == pytest.approx([0.005, 0.005], rel=0.08)
    assert np.abs(error[:, :2].mean(axis=0)).max() < 5 * 0.005 / math.sqrt(2000)
    assert degrees.mean() == pytest.approx(0.2, abs=5 * 0.5 / math.sqrt(2000))
    assert degrees.std() == pytest.approx(0.5, rel=0.08)
    covariance = motions[0].covariance
    assert covariance[0, 0] == pytest.approx(0.005**2 + 0.1 * FLOOR_M**2)
    assert math.degrees(math.sqrt(covariance[2, 2])) == pytest.approx(0.5, rel=0.01)


def test_noise_depends_on_the_seed_alone():
    settings = OdometrySettings(noise=(0.02, 0.5), bias=0.5)
    one, _ = increments(1, settings, 20)
    assert np.array_equal(one, increments(1, settings, 20)[0])
    assert not np.array_equal(one, increments(2, settings, 20)[0])


def test_unusable_poses_are_left_out_and_counted():
    stamps, poses = line_poses()
    poses[3] = np.nan
    stamps[6] = stamps[5]
    source = PoseOdometry(stamps, poses, OdometrySettings(), seed=0)
    assert source.report() == {"poses": 9, "poses_skipped": 2, "pairs_without_motion": 0}
    with pytest.raises(OdometryError, match="none of 11 poses"):
        PoseOdometry(stamps, poses * np.nan, OdometrySettings(), seed=0)


@pytest.mark.skipif(
    "BEEMAP_REAL_DATA" not in os.environ, reason="BEEMAP_REAL_DATA (real recordings) is not set"
)
def test_a_real_rovers_ticks_give_the_length_of_its_path():
    log = Path(os.environ["BEEMAP_REAL_DATA"], "laser", "mines-exp1", "exp1.dat")
    columns = [[int(line.split()[k]) for k in (0, 2, 3)] for line in log.open()]
    t_us, left, right = np.array(columns).T
    parameters = EncoderParameters(2000, 0.077, 0.077, 0.33, 32)
    source = EncoderOdometry(TickLog(t_us * 1000, left, right), parameters, OdometrySettings())
    motions = [m for t in t_us if (m := source.until(int(t) * 1000))]
    assert len(motions) == 756
    length = sum(np.hypot(*m.increment[:2]) for m in motions)
    assert length == pytest.approx(46.0, rel=0.02)
