"""Kuemmerle's metric: hand-computed values, exact stamps, every relation accounted for."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from odometry.motion import compose, inverse
from pipeline.evaluate_relations import Relations, evaluate_relations, read_relations
from pipeline.recordings.carmen import read_carmen
from pipeline.trajectory import Trajectory, write_tum

REAL = os.environ.get("BEEMAP_REAL_DATA")
STAMPS = (976052896784509000, 976052905167303000, 976052911885496000, 976052913712702000)
NAMES = tuple(f"{s // 10**9}.{s % 10**9 // 1000:06d}" for s in STAMPS)
# Ahead 2 m, a quarter turn to the left on the spot, ahead 1 m.
PATH = np.array([[0, 0, 0], [2, 0, 0], [2, 0, math.pi / 2], [2, 1, math.pi / 2]], float)


def tum(path: Path, poses: np.ndarray = PATH, stamps: tuple[int, ...] = STAMPS) -> Path:
    write_tum(path, Trajectory(np.array(stamps, np.int64), poses))
    return path


def relation(i: int, j: int, x: float, y: float, yaw: float) -> str:
    return f"{NAMES[i]} {NAMES[j]} {x:.6f} {y:.6f} 0.000000 0.000000 0.000000 {yaw:.6f}"


def relations(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_hand_computed(beemap, tmp_path):
    est = tum(tmp_path / "e.tum")
    truth = relations(
        tmp_path / "t.relations",
        relation(0, 1, 2.0, 0.0, 0.0),  # exact
        relation(0, 1, 2.3, 0.4, 0.0),  # 0.5 m off
        relation(1, 3, 0.0, 1.0, math.pi / 2 - 0.1),  # 0.1 rad off
        relation(3, 1, -1.0, 0.0, -math.pi / 2 + 0.2),  # backwards in time; exact place
    )
    score = json.loads(beemap("evaluate", "relations", est, truth, "--json").out)
    assert (score["relations"], score["scored"], score["scored_share"]) == (4, 4, 1.0)
    assert score["missing"] == score["damaged_lines"] == []
    # Seen from pose 3, pose 1 lies 1 m behind: errors 0, 0.5, 0, 0 m.
    assert score["translation_mean_m"] == pytest.approx(0.125, abs=1e-6)
    assert score["translation_sd_m"] == pytest.approx(0.5 * math.sqrt(3) / 4, abs=1e-6)
    assert score["translation_max_m"] == pytest.approx(0.5, abs=1e-6)
    turns = np.degrees([0.0, 0.0, 0.1, 0.2])
    assert score["rotation_mean_deg"] == pytest.approx(turns.mean(), abs=1e-3)
    assert score["rotation_sd_deg"] == pytest.approx(turns.std(), abs=1e-3)

    text = beemap("evaluate", "relations", est, truth).out
    assert "scored          4 of 4 relations (100.0%)" in text
    assert "0.1250 ± 0.2165 m" in text


def test_turns_are_taken_the_short_way(tmp_path):
    poses = np.array([[0, 0, math.pi - 0.1], [0, 0, -math.pi + 0.1]])
    truth = Relations(np.array([[0, 1]]), np.array([[0, 0, 0.3]]), ["0 1"], [])
    score = evaluate_relations(Trajectory(np.array([0, 1]), poses), truth)
    assert score.rotation == pytest.approx(0.1)


def test_stamps_must_be_exact_and_missing_ones_are_named(beemap, refused, tmp_path):
    off = (STAMPS[0], STAMPS[1] + 1, *STAMPS[2:])
    est = tum(tmp_path / "e.tum", PATH, off)
    truth = relations(
        tmp_path / "t.relations", relation(0, 1, 2, 0, 0), relation(2, 3, 1, 0, 0), "", "# 1"
    )
    outcome = beemap("evaluate", "relations", est, truth)
    assert "scored          1 of 2 relations (50.0%)" in outcome.out
    assert f"missing         1 ({NAMES[0]} {NAMES[1]})" in outcome.out
    score = json.loads(beemap("evaluate", "relations", est, truth, "--json").out)
    assert score["missing"] == [f"{NAMES[0]} {NAMES[1]}"]
    assert score["translation_mean_m"] == pytest.approx(0.0, abs=1e-6)

    none = relations(tmp_path / "n.relations", relation(0, 1, 2, 0, 0))
    line = refused("evaluate", "relations", est, none)
    assert "holds the times of none of the 1 relations" in line


def test_the_first_of_repeated_stamps_counts():
    stamps = np.array([5, 7, 5, 7])
    poses = np.array([[0, 0, 0], [1, 0, 0], [9, 9, 0], [8, 8, 0]], float)
    truth = Relations(np.array([[5, 7]]), np.array([[1.0, 0, 0]]), ["5 7"], [])
    assert evaluate_relations(Trajectory(stamps, poses), truth).translation == 0.0


def test_damaged_lines_are_counted_and_a_file_without_relations_refused(beemap, refused, tmp_path):
    est = tum(tmp_path / "e.tum")
    good = relation(0, 1, 2, 0, 0)
    truth = relations(
        tmp_path / "t.relations", good, good[:30], good + " 1", good.replace("2.0", "nan"), "x " * 8
    )
    outcome = beemap("evaluate", "relations", est, truth)
    assert "scored          1 of 1 relations" in outcome.out
    assert "damaged         4 (line 2, line 3, line 4 and 1 more): not 8 numbers" in outcome.out
    for content in ("", "a b c\n"):
        truth.write_text(content)
        assert "holds no relation: expected lines 't1 t2 x y" in refused(
            "evaluate", "relations", est, truth
        )
    assert "no such file" in refused("evaluate", "relations", est, tmp_path / "gone")
    assert "no such file" in refused("evaluate", "relations", tmp_path / "gone", truth)


pose = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-3, 3))


@given(st.lists(pose, min_size=2, max_size=6), pose)
def test_a_path_moved_as_a_whole_has_no_error(poses, moved):
    """The metric looks at motion only: no alignment is needed."""
    p = np.array(poses)
    n = len(p)
    stamps = np.arange(n) * 10
    pairs = np.array([(i, j) for i in range(n) for j in range(n) if i != j])
    truth = Relations(
        stamps[pairs], compose(inverse(p[pairs[:, 0]]), p[pairs[:, 1]]), ["a"] * len(pairs), []
    )
    score = evaluate_relations(Trajectory(stamps, compose(np.array(moved), p)), truth)
    assert score.scored == len(pairs)
    assert score.translation_max == pytest.approx(0.0, abs=1e-9)
    assert score.rotation_max == pytest.approx(0.0, abs=1e-9)


@pytest.mark.skipif(REAL is None, reason="BEEMAP_REAL_DATA is not set")
@pytest.mark.parametrize(("name", "count", "error"), [("intel", 2984, 7.4), ("aces", 1279, 0.55)])
def test_raw_odometry_of_real_logs_scores_as_published(name, count, error):
    assert REAL is not None
    folder = Path(REAL) / "laser" / name
    log = read_carmen(folder / f"{name}.clf.bz2")
    truth = read_relations(folder / f"{name}.relations")
    score = evaluate_relations(Trajectory(log.stamps, log.odometry), truth)
    assert (score.scored, score.relations) == (count, count)
    assert score.translation == pytest.approx(error, rel=0.01)
