"""`beemap odometry`, and the log of a rover with raw ticks."""

from __future__ import annotations

import json
import math
import threading

import numpy as np
import pytest

from calibration.rig import load_rig
from odometry.encoders import encoder_parameters
from odometry.motion import Motion, compose, inverse
from odometry.tick_log import read_tick_log
from pipeline.recordings import open_input
from pipeline.recordings.mines import BEAMS, LASER_AHEAD, ROVER, STEP
from pipeline.recordings.scan_log import ScanLog
from tests.conftest import OFFICE
from tests.serial_devices import board, sketch_line

WHEELS = """\
encoders: {ticks_per_revolution: 2000, left_radius: 0.075, right_radius: 0.075, track: 0.3,
  counter_bits: 16}
"""


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(WHEELS + f"devices: {{encoders: {tmp_path}/tty, left: /dev/video0}}\n")
    return path


def test_encoders_are_read_and_replayed(tmp_path, rig, beemap):
    raw, ticks, again = tmp_path / "raw.log", tmp_path / "ticks.csv", tmp_path / "again.csv"
    over = threading.Event()
    with board(str(tmp_path / "tty")) as sender:

        def send() -> None:
            k = 0
            while not over.wait(0.005):
                k += 1
                sender.send(sketch_line(5000 * k, (65500 + k) % 65536, k))

        thread = threading.Thread(target=send)
        thread.start()
        try:
            done = beemap("odometry", "read", rig, "--seconds", 0.3, "--raw", raw, "-o", ticks)
        finally:
            over.set()
            thread.join()
    log = read_tick_log(ticks)
    assert len(log) > 20
    assert set(np.diff(log.right).tolist()) == {1}
    assert f"readings {len(log)}" in done.out
    replayed = beemap("odometry", "read", rig, "--replay", raw, "-o", again)
    assert f"readings {len(log)}" in replayed.out
    assert again.read_bytes() == ticks.read_bytes()


def test_reading_says_what_is_wrong(rig, refused):
    assert "tty: no such port" in refused("odometry", "read", rig)
    wrong = refused("odometry", "read", rig, "--replay", "x", "--raw", "y")
    assert "leave --raw and --seconds out" in wrong
    rig.write_text(WHEELS)
    assert "rig.yaml: devices.encoders: missing" in refused("odometry", "read", rig)


def test_a_straight_run(rig, beemap, refused):
    per_metre = 2000 / (2 * math.pi * 0.075)
    counts = [str(round(3.03 * per_metre)), str(round(3.0 * per_metre))]
    done = beemap(
        *("odometry", "straight", "--length", "3", "--rig", str(rig), "--ticks", "0", "0", *counts)
    )
    left, right = done.out.splitlines()[:2]
    assert left.startswith("left_radius  0.0742")
    assert "(-0.99 % of 0.07500)" in left
    assert right.startswith("right_radius 0.07500")
    command = ("odometry", "straight", "--length", "3")
    assert "either a recording of the straight run, or --ticks" in refused(*command)
    curved = refused(*command, "--rig", rig, "--ticks", 0, 0, 100, 9000)
    assert "that run is not straight" in curved


def test_the_umbmark_sheet_and_its_evaluation(tmp_path, rig, beemap, refused):
    assert "cw,____,____" in beemap("odometry", "umbmark").out
    from odometry.umbmark import square_end

    ends = tmp_path / "ends.csv"
    rows = [
        f"{name},{x:.4f},{y:.4f}\n"
        for name, way in (("cw", -1.0), ("ccw", 1.0))
        for x, y in [square_end(1.01, 1.03, 4.0, 0.3, way)[:2]] * 2
    ]
    ends.write_text("way,x,y\n" + "".join(rows))
    done = beemap("odometry", "umbmark", "--ends", str(ends), "--rig", str(rig))
    assert "E_d          1.01000" in done.out
    assert "track        0.30900 m" in done.out
    ends.write_text("cw,1\n")
    wrong = refused("odometry", "umbmark", "--ends", ends, "--rig", rig)
    assert "ends.csv: line 1: 'cw,1': expected cw,x,y" in wrong


def true_motions(recording, rig, progress):
    """What perfect cameras would see in a recording that holds its truth, with a little noise."""
    del progress
    rng = np.random.default_rng(8)
    place = np.array([rig.mount.x, rig.mount.y, rig.mount.yaw])
    sigma = np.array([0.004, 0.004, 0.002])
    poses, stamps = compose(recording.poses.poses, place), recording.poses.stamps
    seen = np.searchsorted(stamps, [pair.stamp for pair in recording.pairs])
    steps = compose(inverse(poses[seen[:-1]]), poses[seen[1:]])
    return [
        Motion(step + sigma * rng.standard_normal(3), np.diag(sigma**2), *stamps[[a, b]].tolist())
        for step, a, b in zip(steps, seen[:-1], seen[1:], strict=True)
    ]


def test_calibrating_a_recording(tmp_path, beemap, refused, monkeypatch):
    monkeypatch.setattr("pipeline.sensor_motion.visual_motions", true_motions)
    rig, office = tmp_path / "rig.yaml", OFFICE
    found = json.loads(beemap("odometry", "calibrate", office, "-o", rig, "--json").out)
    assert found["right_radius"]["sigma"] < 0.0005
    for name, true in (("left_radius", 0.075), ("right_radius", 0.07515), ("track", 0.3)):
        assert abs(found[name]["value"] - true) < 3.5 * found[name]["sigma"]
        assert found[name]["used"]
    written = load_rig(rig)
    wheels = encoder_parameters(written.sections["encoders"], "x")
    assert wheels.track == found["track"]["value"]
    assert written.mount is not None
    assert written.mount.x == pytest.approx(0.1, abs=0.02)
    assert written.sections["calibration"]["odometry"]["before"]["track"] == 0.3
    assert "already exists: give --force" in refused("odometry", "calibrate", office, "-o", rig)
    beemap("odometry", "calibrate", office, "--rig", rig, "-o", rig, "--force")
    assert load_rig(rig).sections["encoders"]["track"] == pytest.approx(wheels.track, abs=2e-4)


def test_too_short_a_recording_is_told(office, refused):
    told = refused("odometry", "calibrate", office, "--quiet")
    assert "stretches with" in told
    assert "drive further, with turns both ways" in told


def rover_log(path, seconds: float = 12.0) -> np.ndarray:
    """A rover's log of a square room, 4 m wide, in which it drives a circle; the true poses.

    Each scan is older than the ticks beside it.
    """
    times = np.arange(0.0, seconds, 0.1)
    turn = 0.3 * times
    seen = 0.3 * (times - ROVER.time_offset)
    true = np.stack([np.sin(seen), -np.cos(seen), seen], axis=1)
    half = ROVER.track / 2
    paths = np.stack([(1.0 - half) * turn, (1.0 + half) * turn], axis=1)
    counts = np.rint(paths / ROVER.metres_per_tick + (29000.0, 25000.0)).astype(int)
    bearings = (np.arange(BEAMS) - (BEAMS - 1) / 2) * STEP
    lines = []
    for time, pose, (left, right) in zip(times, true, counts.tolist(), strict=True):
        x, y, heading = compose(pose, np.array([LASER_AHEAD, 0.0, 0.0]))
        c, s = np.cos(heading + bearings), np.sin(heading + bearings)
        with np.errstate(divide="ignore"):
            r = np.minimum((2.0 - np.sign(c) * x) / abs(c), (2.0 - np.sign(s) * y) / abs(s))
        ranges = np.rint(1000 * r).astype(int)
        ranges[::50] = 7
        stamp = round(1e6 * time) + 212387282
        head = [stamp, 14710, left, right, *[0] * 3, 170.1, *[0] * 16]
        lines.append(" ".join(map(str, [*head, *ranges])) + " \n")
    path.write_text("".join(lines))
    return true


def test_a_rovers_ticks_become_odometry(tmp_path):
    path = tmp_path / "exp.dat"
    true = rover_log(path)
    log = open_input(path)
    assert isinstance(log, ScanLog)
    assert log.kind == "Mines rover log"
    assert len(log) == 120
    # The first two scans were taken before the first ticks.
    moved = compose(inverse(true[2]), true[-1])
    assert log.odometry[-1] == pytest.approx(moved, abs=0.01)
    scan = log.scans[5]
    assert np.isnan(scan.range[0])
    assert np.isfinite(scan.range[1:50]).all()
    assert scan.origin == (LASER_AHEAD, 0.0, 0.0)


def test_a_rovers_damaged_lines_are_named_and_other_files_are_no_such_log(tmp_path, refused):
    path = tmp_path / "exp.dat"
    rover_log(path, 3.0)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:5], lines[5][:300] + "\n", *lines[6:9], lines[2], *lines[9:]]))
    log = open_input(path)
    assert log.skipped == {"damaged line": ["line 6"], "time not after the last": ["line 10"]}
    path.write_text("1 2 3\n")
    assert "exp.dat" in refused("info", path)


def test_a_rovers_log_is_mapped(tmp_path, beemap, refused):
    path, run = tmp_path / "exp.dat", tmp_path / "run"
    rover_log(path, 25.0)
    done = beemap("map", path, "-o", run, "--set", "mapping.particles=10", "--quiet")
    assert done.code == 0
    health = json.loads((run / "run.json").read_text())["health"]
    assert any("odometry and matched path part by" in line for line in health)
    assert "are needed: drive further" in refused("odometry", "calibrate", path)
