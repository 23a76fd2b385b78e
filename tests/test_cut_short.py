"""Recordings and runs that were cut off: they open as they are, and go on to the same bytes."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.device_rig import load_device_rig
from odometry.counters import TickReading
from pipeline.checkpoint import Checkpoint
from pipeline.errors import InputError
from pipeline.frontend import Observation
from pipeline.live.recording_files import RecordingFiles
from pipeline.recordings import open_recording
from stereo.camera import CapturedPair, Frame
from stereo.scan import RangeScan
from tests.conftest import OFFICE
from tests.stereo_rigs import texture

PAIRS = 6
RESULTS = ("map.npz", "map.pgm", "map.png", "trajectory.tum", "health.csv", "cloud.ply")
QUICK = ("--quiet", "--set", "mapping.particles=20", "--threads", "1")
RIG = """beemap_rig: 1
image_size: [32, 24]
left: {fx: 30.0, fy: 30.0, cx: 15.5, cy: 11.5}
right: {fx: 30.0, fy: 30.0, cx: 15.5, cy: 11.5}
R: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
T: [-0.12, 0.0, 0.0]
devices: {left: /dev/video0, right: /dev/video2, encoders: /dev/ttyUSB0}
mount: {height: 0.3, pitch: 12.5}
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A recording as `beemap record` writes it, whole."""
    import cv2

    place = tmp_path_factory.mktemp("recorded")
    (place / "rig.yaml").write_text(RIG)
    (place / "rec").mkdir()
    encoders = {
        "ticks_per_revolution": 2000.0, "left_radius": 0.075, "right_radius": 0.075,
        "track": 0.3, "counter_bits": 16, "reversed": [True, False],
    }  # fmt: skip
    files = RecordingFiles(
        place / "rec", load_device_rig(place / "rig.yaml"), 10.0, False, encoders
    )
    jpeg = cv2.imencode(".jpg", texture((24, 32), 1))[1].tobytes()
    for number in range(PAIRS):
        stamp = 1_000_000_000 + number * 100_000_000
        files.add_readings(
            [TickReading(stamp + k * 20_000_000, 12345 + k, 54321, 0, 0) for k in range(5)]
        )
        files.add_pair(CapturedPair(Frame(stamp, jpeg), Frame(stamp + 1000, jpeg), 1000))
    files.add_note(stamp, "the end")
    files.close()
    return place / "rec"


def test_a_recording_is_what_was_recorded(recorded):
    recording = open_recording(recorded)
    assert recording.skipped == {}
    assert len(recording.pairs) == PAIRS
    assert recording.rig is not None
    assert recording.rig.mount is not None
    assert np.degrees(recording.rig.mount.pitch) == pytest.approx(12.5)
    assert recording.ticks is not None
    assert len(recording.ticks) == 5 * PAIRS
    assert recording.encoders is not None
    assert recording.encoders.reversed == (True, False)


@settings(max_examples=60)
@given(data=st.data())
def test_every_file_may_be_cut_anywhere(recorded, tmp_path_factory, data):
    """It opens, and what it still tells is true."""
    names = sorted(str(f.relative_to(recorded)) for f in recorded.rglob("*") if f.is_file())
    name = data.draw(st.sampled_from(names))
    place = tmp_path_factory.mktemp("cut") / "rec"
    shutil.copytree(recorded, place)
    content = (place / name).read_bytes()
    keep = data.draw(st.integers(0, len(content)))
    (place / name).write_bytes(content[:keep])
    whole, cut = open_recording(recorded), open_recording(place)
    stamps = {pair.stamp for pair in whole.pairs}
    assert {pair.stamp for pair in cut.pairs} <= stamps
    # A list that was cut right after its first lines tells of the later ones to nobody.
    if not name.endswith("data.csv"):
        assert len(cut.pairs) == PAIRS
    damaged = []
    for pair in cut.pairs:
        try:
            pair.load()
        except ValueError as error:
            damaged.append(str(error))
    assert all(name in error for error in damaged)
    assert len(damaged) <= 1
    if cut.rig is not None and whole.rig is not None:
        assert cut.rig.mount == whole.rig.mount or cut.rig_source != whole.rig_source
    if cut.encoders is not None:
        assert cut.encoders == whole.encoders
    if cut.ticks is not None and whole.ticks is not None:
        known = set(zip(whole.ticks.stamps, whole.ticks.left, whole.ticks.right, strict=True))
        assert set(zip(cut.ticks.stamps, cut.ticks.left, cut.ticks.right, strict=True)) <= known
    shutil.rmtree(place)


def observation(stamp: int) -> Observation:
    bearing = np.linspace(-0.5, 0.5, 9)
    ranges = np.where(np.arange(9) == stamp % 9, np.nan, 1.0 + stamp / 7.0)
    scan = RangeScan(stamp, (0.1, 0.0, 0.0), bearing, ranges, 0.01 * ranges, 5.0)
    if stamp % 3:
        return Observation(scan)
    return Observation(scan, points=np.ones((4, 3), np.float32), colours=np.ones((4, 3), np.uint8))


@settings(max_examples=60)
@given(data=st.data())
def test_a_checkpoint_cut_anywhere_holds_what_came_before(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("checkpoint") / "run.checkpoint"
    checkpoint = Checkpoint.start(path, {"input": "x"})
    head = path.stat().st_size
    for stamp in range(8):
        checkpoint.add(stamp, observation(stamp))
    checkpoint.close()
    content = path.read_bytes()
    keep = data.draw(st.integers(head, len(content)))
    damage = data.draw(st.binary(max_size=20))
    path.write_bytes(content[:keep] + damage)
    again = Checkpoint.resume(path)
    assert again.asked == {"input": "x"}
    for stamp in range(8):
        seen, wanted = again.get(stamp), observation(stamp)
        if stamp < len(again):
            assert seen is not None
            assert seen.scan is not None
            assert wanted.scan is not None
            np.testing.assert_array_equal(seen.scan.range, wanted.scan.range)
            np.testing.assert_array_equal(seen.scan.bearing, wanted.scan.bearing)
            assert (seen.points is None) == (wanted.points is None)
        else:
            assert seen is None
            again.add(stamp, wanted)
    again.close()
    assert len(Checkpoint.resume(path)) == 8


def test_a_killed_run_goes_on_to_the_same_bytes(office, tmp_path, beemap):
    assert beemap("map", office, "-o", tmp_path / "whole", *QUICK).code == 0
    assert not (tmp_path / "whole.checkpoint").exists()
    command = [sys.executable, "-m", "pipeline.cli", "map", office, "-o", tmp_path / "cut", *QUICK]
    process = subprocess.Popen([str(word) for word in command], cwd=OFFICE.parent.parent)
    log = tmp_path / "cut.checkpoint"
    while process.poll() is None and not (log.exists() and log.stat().st_size > 80_000):
        time.sleep(0.002)
    process.kill()
    process.wait()
    assert log.exists()
    outcome = beemap("map", "--resume", tmp_path / "cut")
    assert outcome.code == 0, outcome.err
    assert "goes on after" in outcome.err
    for name in RESULTS:
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert not log.exists()
    assert not list(tmp_path.glob(".cut.part-*"))


def test_what_cannot_be_resumed_is_refused(tmp_path, refused, office):
    assert "no checkpoint" in refused("map", "--resume", tmp_path / "run")
    (tmp_path / "run.checkpoint").write_text("{}\n")
    assert "not a checkpoint of this version" in refused("map", "--resume", tmp_path / "run")
    Checkpoint.start(tmp_path / "run.checkpoint", {"input": 3}).add(1, observation(1))
    assert "not a checkpoint of a run" in refused("map", "--resume", tmp_path / "run")
    assert "give neither again" in refused("map", office, "--resume", tmp_path / "run")


def test_a_checkpoint_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "no").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        Checkpoint.start(tmp_path / "no" / "run.checkpoint", {})
