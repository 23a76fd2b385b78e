"""Odometry kept as poses: doubted as the wheels' arcs are, and not believed where it leaps."""

from __future__ import annotations

import numpy as np
import pytest

from odometry.dead_reckoning import DeadReckoning
from odometry.motion import Motion, compose
from odometry.settings import OdometrySettings
from odometry.walk import AFTER_LEAP, walk
from pipeline.errors import InputError
from pipeline.motion import choose_motion, motion_of, usual_motion
from pipeline.recordings import open_recording
from pipeline.recordings.asl_writer import AslWriter
from pipeline.seeing import FusedMotion
from pipeline.settings import Settings

SETTINGS = OdometrySettings()
STAMPS = np.arange(11) * 100_000_000 + 5_000_000_000
POSES = np.stack([0.03 * np.arange(11), np.zeros(11), 0.05 * np.arange(11)], axis=1)


def motions(source: DeadReckoning, stamps: np.ndarray) -> list[Motion]:
    found = [source.until(int(stamp)) for stamp in stamps]
    assert None not in found
    return [motion for motion in found if motion is not None]


def test_at_its_own_stamps_it_moves_and_doubts_as_the_walk_does():
    found = motions(DeadReckoning(STAMPS, POSES, SETTINGS), STAMPS)
    for a, b in zip(found, walk(STAMPS, POSES, SETTINGS), strict=True):
        np.testing.assert_allclose(a.increment, b.increment, atol=1e-12)
        np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-15)
        assert (a.first, a.last) == (b.first, b.last)


def test_between_its_stamps_the_pose_is_interpolated():
    source = DeadReckoning(STAMPS, POSES, SETTINGS)
    first, half = motions(source, STAMPS[:1] + [0, 50_000_000][0:1]), source.until(5_050_000_000)
    assert not first[0].increment.any()
    assert half is not None
    assert half.increment == pytest.approx([0.015, 0.0, 0.025])
    assert source.until(4_000_000_000) is None
    assert source.until(7_000_000_000) is None
    assert source.report()["pairs_without_motion"] == 2


def test_where_it_leaps_the_robot_stands_still_in_much_doubt():
    """The board begins anew at (0, 0, 0) after the sixth pose, elsewhere than it was."""
    poses = POSES.copy()
    poses[:6] += (4.0, -2.0, 1.0)
    source = DeadReckoning(STAMPS, poses, SETTINGS)
    found = motions(source, STAMPS)
    assert source.report()["poses_leaps"] == 1
    for i, motion in enumerate(found[1:], start=1):
        calm = np.diag(motion.covariance) < AFTER_LEAP**2 / 100.0
        assert calm.all() == (i != 6)
        step = compose(-POSES[0], POSES[1]) if i != 6 else np.zeros(3)
        assert np.hypot(*motion.increment[:2]) == pytest.approx(np.hypot(*step[:2]), abs=1e-9)


def test_it_is_read_from_a_recording_and_taken_where_there_are_no_ticks(office, office_piece):
    recording = open_recording(office_piece)
    truth, rig = recording.poses, recording.rig
    assert truth is not None
    assert rig is not None
    assert usual_motion(recording, rig, SETTINGS) == ("fused", [])
    with pytest.raises(InputError, match="holds no odometry"):
        choose_motion("odometry", recording, rig, SETTINGS, 1)
    with AslWriter(office.parent / "written", rig, None) as writer:
        for stamp, pose in zip(truth.stamps.tolist(), truth.poses, strict=True):
            writer.add_odometry(stamp, pose)
    made = office.parent / "written" / "mav0" / "odometry0"
    made.rename(office / "mav0" / "odometry0")
    for file in (office / "mav0" / "odom0").iterdir():
        file.unlink()
    table = office / "mav0" / "odometry0" / "data.csv"
    table.write_text(table.read_text() + "12,not,a,pose\n99,1.0")
    recording = open_recording(office)
    assert recording.skipped["garbled line in the odometry"] == ["line 42", "line 43"]
    assert recording.odometry is not None
    np.testing.assert_array_equal(recording.odometry.poses, truth.poses)
    assert usual_motion(recording, rig, SETTINGS) == ("fused", [])
    assert isinstance(choose_motion("odometry", recording, rig, SETTINGS, 1), DeadReckoning)
    assert isinstance(motion_of("fused", recording, rig, Settings(), 1), FusedMotion)


def test_wheels_of_unknown_size_stop_no_run_that_has_images(beemap, refused, office, tmp_path):
    (office / "mav0" / "odom0" / "sensor.yaml").write_text("track: 0.3\n")
    recording = open_recording(office)
    assert recording.rig is not None
    choice, (note,) = usual_motion(recording, recording.rig, SETTINGS)
    assert choice == "visual"
    assert "odom0/sensor.yaml" in note
    assert note.endswith("motion is found from the images alone")
    line = refused("map", office, "-o", tmp_path / "run", "--motion", "fused")
    assert "odom0/sensor.yaml" in line
