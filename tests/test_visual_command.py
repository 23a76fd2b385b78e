"""`beemap map --motion visual` and `fused` on a piece of the shipped recording."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from calibration.rig import save_rig
from pipeline.evaluate_path import evaluate_path_files
from pipeline.recordings import open_recording

SAME = ("trajectory.tum", "odometry.tum", "map.pgm", "health.csv")


@pytest.fixture
def without_wheels(office) -> Path:
    """The recording without odom0, and beside it its rig with the mount, which is lost with it."""
    rig = open_recording(office).rig
    assert rig is not None
    save_rig(rig, office / "rig.yaml")
    shutil.rmtree(office / "mav0" / "odom0")
    return office


def spoil_wheel(recording: Path, first: int, last: int, ticks: int) -> None:
    """The left wheel spins: so many ticks more between two lines of the table, none after."""
    table = recording / "mav0" / "odom0" / "data.csv"
    header, *lines = table.read_text().splitlines()
    added = np.interp(np.arange(len(lines)), [first, last], [0, ticks]).astype(int)
    spoilt = []
    for line, more in zip(lines, added.tolist(), strict=True):
        stamp, left, right = line.split(",")
        spoilt.append(f"{stamp},{(int(left) + more) % 65536},{right}")
    table.write_text("\n".join([header, *spoilt]) + "\n")


def test_a_recording_without_wheels_is_mapped_by_its_images(beemap, without_wheels, tmp_path):
    damaged = sorted((without_wheels / "mav0" / "cam0" / "data").iterdir())[10]
    damaged.write_bytes(damaged.read_bytes()[:1000])
    runs = [tmp_path / "one", tmp_path / "three"]
    for run, threads in zip(runs, (1, 3), strict=True):
        rig = without_wheels / "rig.yaml"
        outcome = beemap("map", without_wheels, "-o", run, "--rig", rig, "--threads", threads)
        assert outcome.code == 0
    assert "note: no wheel ticks in the recording: its motion is found from the images" in (
        outcome.err
    )
    assert f"skipped: unreadable pair: 1 ({damaged}" in outcome.out
    for name in SAME:
        assert (runs[0] / name).read_bytes() == (runs[1] / name).read_bytes(), name
    summary = json.loads((runs[0] / "run.json").read_text())
    assert summary["motion"] == "visual"
    assert summary["counts"]["pairs used"] == 39
    assert summary["odometry"]["visual_lost_pairs"] == 0
    assert summary["odometry"]["visual_inliers_median"] > 100
    for path in ("trajectory.tum", "odometry.tum"):
        score = evaluate_path_files(runs[0] / path, runs[0] / "truth.tum")
        assert score.ate_max < 0.05
        assert score.heading_rmse < np.radians(0.5)


def test_a_spinning_wheel_does_not_bend_the_path(beemap, office, tmp_path):
    # 20 readings a second; 2000 ticks a turn: the left wheel makes 0.24 m too much from 5 to 6 s.
    spoil_wheel(office, 100, 120, 1000)
    outcome = beemap("map", office, "-o", tmp_path / "run", "--motion", "fused")
    assert outcome.code == 0
    assert "health: wheels slipped once (" in outcome.out
    (slip,) = [line for line in outcome.out.splitlines() if "wheels slipped" in line]
    assert "5.0 to 6.0 s, 0.1" in slip or "4.5 to 6.0 s, 0.1" in slip
    summary = json.loads((tmp_path / "run" / "run.json").read_text())
    assert summary["odometry"]["slips"] == 1
    score = evaluate_path_files(tmp_path / "run/odometry.tum", tmp_path / "run/truth.tum")
    assert score.ate_max < 0.05
