"""`beemap evaluate path`: known errors are measured, alignment does not matter."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from odometry.motion import compose
from pipeline.commands.evaluate import evaluate
from pipeline.errors import InputError
from pipeline.evaluate_path import evaluate_path, match
from pipeline.trajectory import Trajectory, write_tum

SECOND = 1_000_000_000


def figure_eight(n: int = 200) -> Trajectory:
    """About 12 m in 20 s, heading along the path."""
    t = np.linspace(0.0, 2.0 * math.pi, n)
    x, y = 2.0 * np.sin(t), np.sin(2.0 * t)
    heading = np.arctan2(2.0 * np.cos(2.0 * t), 2.0 * np.cos(t))
    stamps = np.arange(n) * (SECOND // 10) + 1_403_715_273 * SECOND
    return Trajectory(stamps, np.stack([x, y, heading], axis=1))


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi))
def test_errors_do_not_depend_on_where_the_estimate_was_drawn(x, y, theta):
    true = figure_eight()
    rng = np.random.default_rng(1)
    found = true.poses + rng.normal(0.0, [0.05, 0.05, 0.02], true.poses.shape)
    plain = evaluate_path(Trajectory(true.stamps, found), true)
    elsewhere = compose(np.array([x, y, theta]), found)
    moved = evaluate_path(Trajectory(true.stamps, elsewhere), true)
    for name in vars(plain):
        assert getattr(moved, name) == pytest.approx(getattr(plain, name), abs=1e-9)
    assert plain.ate_rmse == pytest.approx(0.05 * math.sqrt(2.0), rel=0.1)
    assert plain.heading_rmse == pytest.approx(0.02, rel=0.2)


def test_hand_computed_errors():
    """A straight line of 0.5 m steps; the third of five poses is 0.5 m to the side."""
    true = np.array([[0.5 * k, 0.0, 0.0] for k in range(5)])
    found = true.copy()
    found[2, 1] = 0.5
    stamps = np.arange(5) * SECOND
    score = evaluate_path(Trajectory(stamps, found), Trajectory(stamps, true))
    # Alignment takes off the mean: +0.1 for four poses, 0.4 left at the third.
    assert score.ate_rmse == pytest.approx(math.sqrt((4 * 0.1**2 + 0.4**2) / 5))
    assert score.ate_mean == pytest.approx((4 * 0.1 + 0.4) / 5)
    assert score.ate_median == pytest.approx(0.1)
    assert score.ate_max == pytest.approx(0.4)
    # Stretches 0-2, 1-3, 2-4: off by 0.5, 0, 0.5.
    assert score.relative_segments == 3
    assert score.relative_translation == pytest.approx(math.sqrt(0.5 / 3))
    assert score.relative_rotation == pytest.approx(0.0)
    assert score.reference_length == pytest.approx(2.0)
    assert score.length == pytest.approx(1.0 + 2.0 * math.hypot(0.5, 0.5))


def test_a_constant_turn_of_the_headings_is_a_heading_error():
    true = figure_eight()
    found = true.poses + np.array([0.0, 0.0, math.radians(3.0)])
    score = evaluate_path(Trajectory(true.stamps, found), true)
    assert math.degrees(score.heading_rmse) == pytest.approx(3.0)
    assert score.ate_rmse == pytest.approx(0.0, abs=1e-9)


def test_the_reference_is_interpolated_but_not_across_its_gaps():
    stamps = np.array([0, 1, 2, 5, 6]) * SECOND
    reference = Trajectory(stamps, np.stack([stamps / 1e9] * 2 + [np.zeros(5)], axis=1))
    asked = np.array([-0.02, -0.01, 0.5, 1.999, 2.009, 2.02, 4.995, 6.0, 6.009, 6.02])
    estimate = Trajectory(np.round(asked * SECOND).astype(np.int64), np.zeros((10, 3)))
    index, poses = match(estimate, reference)
    assert index.tolist() == [1, 2, 3, 4, 6, 7, 8]
    assert poses[:, 0] == pytest.approx([0.0, 0.5, 1.999, 2.0, 5.0, 6.0, 6.0])


def test_interpolated_headings_take_the_shorter_way():
    stamps = np.array([0, SECOND])
    reference = Trajectory(stamps, np.array([[0, 0, 3.0], [0, 0, -3.0]]))
    _, poses = match(Trajectory(np.array([SECOND // 2]), np.zeros((1, 3))), reference)
    assert math.cos(poses[0, 2]) == pytest.approx(-1.0)


@pytest.fixture
def tum_files(tmp_path):
    true = figure_eight()
    found = Trajectory(true.stamps[::3], compose(np.array([5.0, 1.0, 2.0]), true.poses[::3]))
    write_tum(tmp_path / "true.tum", true)
    write_tum(tmp_path / "found.tum", found)
    return tmp_path


def test_the_command_in_words_and_as_json(tum_files):
    files = [str(tum_files / name) for name in ("found.tum", "true.tum")]
    words = CliRunner().invoke(evaluate, ["path", *files])
    assert words.exit_code == 0
    assert "67 of 67 poses" in words.output
    assert "0.000 m RMSE" in words.output
    result = CliRunner().invoke(evaluate, ["path", *files, "--json"])
    fields = json.loads(result.output)
    assert fields["matched"] == 67
    assert fields["ate_rmse_m"] < 1e-5
    assert fields["length_m"] == pytest.approx(fields["reference_length_m"], rel=1e-4)


def test_a_path_too_short_for_the_relative_error(tmp_path):
    stamps = np.arange(3) * SECOND
    write_tum(tmp_path / "a.tum", Trajectory(stamps, np.zeros((3, 3))))
    arguments = ["path", str(tmp_path / "a.tum"), str(tmp_path / "a.tum")]
    assert "shorter than 1 m" in CliRunner().invoke(evaluate, arguments).output
    fields = json.loads(CliRunner().invoke(evaluate, [*arguments, "--json"]).output)
    assert fields["relative_translation_rmse_m"] is None
    assert fields["relative_segments"] == 0


def test_paths_of_different_times_name_both_files_and_spans(tum_files):
    stamps = np.arange(5) * SECOND
    write_tum(tum_files / "other.tum", Trajectory(stamps, np.zeros((5, 3))))
    arguments = ["path", str(tum_files / "other.tum"), str(tum_files / "true.tum")]
    error = CliRunner().invoke(evaluate, arguments).exception
    assert isinstance(error, InputError)
    for words in ("other.tum (0.000 to 4.000 s)", "true.tum (1403715273.000 to", "0.01 s"):
        assert words in str(error)
    assert "\n" not in str(error)


def test_a_missing_path_is_named(tum_files):
    arguments = ["path", str(tum_files / "none.tum"), str(tum_files / "true.tum")]
    error = CliRunner().invoke(evaluate, arguments).exception
    assert isinstance(error, InputError)
    assert "none.tum: no such file" in str(error)
