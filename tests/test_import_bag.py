"""`beemap import`: bags of all three containers become the recording that they were made of."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.rig import load_rig, save_rig
from pipeline.evaluate_path import evaluate_path
from pipeline.map_request import MapRequest
from pipeline.recordings import open_recording
from pipeline.recordings.recorded_rig import load_recorded_rig
from pipeline.trajectory import Trajectory, read_tum
from tests.conftest import PAIRS, QUICK
from tests.ros_bags import CONTAINERS, Message, Types, office_messages, write_bag

WHEELS = ("--wheel-radius", "0.075", "--track", "0.3", "--ticks-per-revolution", "2000")
LEFT, RIGHT = (f"/stereo/{side}/image_raw/compressed" for side in ("left", "right"))
INFO = "/stereo/left/camera_info"

Change = Callable[[Types, Message], Iterator[Message]]


@pytest.fixture(scope="module")
def bags(office_piece, tmp_path_factory) -> dict[str, Path]:
    """The piece of the office in each container."""
    folder = tmp_path_factory.mktemp("bags")
    messages = office_messages(office_piece)
    return {name: write_bag(folder / name, name, messages) for name in CONTAINERS}


@pytest.fixture
def changed(office_piece, tmp_path) -> Callable[..., Path]:
    """A ROS 2 bag of the office with each message as `change` has it."""

    def make(change: Change, container: str = "mcap", name: str = "changed") -> Path:
        def messages(types: Types) -> Iterator[Message]:
            for message in office_messages(office_piece)(types):
                yield from change(types, message)

        return write_bag(tmp_path / name, container, messages)

    return make


def without(*topics: str) -> Change:
    return lambda types, message: iter(() if message[0] in topics else (message,))


def files(folder: Path) -> dict[str, bytes]:
    """Content of all files below; that which names the bag is left out."""
    found = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*.*")}
    del found["meta.json"]
    return {name: data for name, data in found.items() if not name.endswith("/data")}


def test_all_containers_become_one_recording_with_the_map_of_the_original(
    bags, office_piece, office_run, tmp_path, beemap
):
    for name, bag in bags.items():
        done = beemap("import", bag, "-o", tmp_path / name, *WHEELS)
        assert done.code == 0, done.err
        assert f"{PAIRS} pairs of {PAIRS} left and {PAIRS} right images" in done.out
        assert "mount from tf base_footprint -> left_optical: 0.300 m up" in done.err
    recording = files(tmp_path / "mcap")
    assert files(tmp_path / "ros1") == files(tmp_path / "sqlite3") == recording
    for camera in ("cam0", "cam1"):  # every JPEG is the one that it was
        for image in (office_piece / "mav0" / camera / "data").iterdir():
            assert recording[f"mav0/{camera}/data/{image.name}"] == image.read_bytes()
    assert beemap("map", tmp_path / "mcap", "-o", tmp_path / "run", *QUICK).code == 0
    for result in ("map.npz", "map.pgm", "map.yaml"):
        assert (tmp_path / "run" / result).read_bytes() == (office_run / result).read_bytes()
    # Bags state the cameras' matrices, in which a rotation is not told to the last digit.
    for result in ("trajectory.tum", "odometry.tum"):
        found, expected = (read_tum(run / result).poses for run in (tmp_path / "run", office_run))
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_calibration_and_mount_are_those_of_the_recording(bags, office_piece, tmp_path, beemap):
    assert beemap("import", bags["ros1"], "-o", tmp_path / "rec", *WHEELS).code == 0
    rig = load_recorded_rig(tmp_path / "rec" / "rig.yaml")
    true = open_recording(office_piece).rig
    assert true is not None
    assert (rig.left, rig.right, rig.image_size) == (true.left, true.right, true.image_size)
    np.testing.assert_allclose(rig.R, true.R, atol=1e-12)
    np.testing.assert_allclose(rig.T, true.T, atol=1e-12)
    assert rig.mount is not None
    assert true.mount is not None
    np.testing.assert_allclose(rig.mount.rotation, true.mount.rotation, atol=1e-12)
    np.testing.assert_allclose(rig.mount.position, true.mount.position, atol=1e-12)


def test_odometry_is_the_motion_where_the_wheels_are_not_known(
    bags, office_piece, tmp_path, beemap
):
    done = beemap("import", bags["sqlite3"], "-o", tmp_path / "rec")
    assert "give --wheel-radius and --track in metres; /odom is taken without them" in done.err
    job, _ = MapRequest(str(tmp_path / "rec")).prepare(None, (), 1)
    assert job.facts()["motion"] == "fused"
    recording, truth = open_recording(tmp_path / "rec"), open_recording(office_piece).poses
    assert recording.odometry is not None
    assert truth is not None
    # It is the truth, told in a frame of its own.
    score = evaluate_path(Trajectory(truth.stamps, recording.odometry.poses), truth)
    assert score.ate_rmse < 1e-6
    assert recording.odometry.poses[0, :2] == pytest.approx([3.0, -1.0], abs=1e-6)


def test_topics_are_listed_with_what_they_are_taken_as(bags, beemap):
    done = beemap("import", bags["sqlite3"] / "sqlite3.db3", "--list")
    rows = [line.split(maxsplit=3) for line in done.out.splitlines()]
    told = {row[2]: (int(row[0]), row[1], row[3] if len(row) > 3 else "") for row in rows}
    assert told[LEFT] == (PAIRS, "sensor_msgs/CompressedImage", "taken as left camera")
    assert told[RIGHT] == (PAIRS, "sensor_msgs/CompressedImage", "taken as right camera")
    assert told[INFO][1:] == ("sensor_msgs/CameraInfo", "taken as calibration of the left camera")
    assert told["/odom"] == (PAIRS, "nav_msgs/Odometry", "taken as odometry")
    assert told["/joint_states"][1:] == ("sensor_msgs/JointState", "taken as wheels")
    assert told["/tf_static"] == (1, "tf2_msgs/TFMessage", "taken as mount of the camera")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--left", "/cam"], ["--left /cam: no such topic", f"{LEFT} (sensor_msgs/CompressedIma"]),
        (["--odom", "/tf_static"], ["is tf2_msgs/TFMessage, needed is nav_msgs/Odometry", "/odom"]),
        (["--wheels", "a,b"], ["--wheels a,b:", "wheel_left_joint, wheel_right_joint"]),
        (["--base", "arm"], ["--base arm: not above", "left_camera, base_link, base_footprint"]),
        (["--rig", "none.yaml"], ["none.yaml"]),
        (["--left", LEFT, "--right", LEFT], [f"--right {LEFT}: is the left camera's topic"]),
    ],
)
def test_what_is_not_there_is_named(bags, tmp_path, refused, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    line = refused("import", bags["mcap"], "-o", "REC", *WHEELS, *arguments)
    for word in words:
        assert word in line
    assert not list(tmp_path.iterdir())


def test_a_bag_without_calibration_needs_a_rig(changed, office_piece, tmp_path, refused, beemap):
    bag = changed(without(INFO))
    line = refused("import", bag, "-o", tmp_path / "rec", *WHEELS)
    assert f"no CameraInfo for {LEFT}: give --rig rig.yaml" in line
    assert "/stereo/right/camera_info (sensor_msgs/CameraInfo)" in line
    true = open_recording(office_piece).rig
    assert true is not None
    save_rig(replace(true, mount=None), tmp_path / "rig.yaml")
    done = beemap("import", bag, "-o", tmp_path / "rec", "--rig", tmp_path / "rig.yaml")
    assert done.code == 0, done.err
    rig = load_recorded_rig(tmp_path / "rec" / "rig.yaml")
    assert rig.left == load_rig(tmp_path / "rig.yaml").left
    assert rig.mount is not None  # tf tells it
    assert rig.mount.height == pytest.approx(0.3)


def test_wheels_alone_need_their_size(changed, tmp_path, refused):
    line = refused("import", changed(without("/odom")), "-o", tmp_path / "rec")
    assert "wheel_left_joint and wheel_right_joint, not their size" in line
    assert "give --wheel-radius and --track in metres" in line


def test_without_motion_and_tf_the_user_is_told(changed, tmp_path, beemap):
    bag = changed(without("/odom", "/joint_states", "/tf_static"))
    done = beemap("import", bag, "-o", tmp_path / "rec")
    assert done.code == 0
    assert "no odometry and no wheels: map finds the motion from the images" in done.err
    assert "no tf leads from the robot to the camera's 'left_optical'" in done.err
    assert load_recorded_rig(tmp_path / "rec" / "rig.yaml").mount is None


def test_no_cameras_and_no_bag(changed, tmp_path, refused):
    line = refused("import", changed(without(RIGHT)), "-o", tmp_path / "rec")
    assert "no two image topics that are called left and right" in line
    assert f"{LEFT} (sensor_msgs/CompressedImage)" in line
    assert "no such bag" in refused("import", tmp_path / "none.bag", "--list")
    (tmp_path / "a.bag").write_bytes(b"no bag at all")
    assert "a.bag: cannot be read as a bag" in refused("import", tmp_path / "a.bag", "--list")
    (tmp_path / "empty").mkdir()
    assert "no bag in this folder" in refused("import", tmp_path / "empty", "--list")


def test_a_recording_is_only_replaced_by_force(bags, tmp_path, refused, beemap):
    (tmp_path / "rec" / "mav0").mkdir(parents=True)
    arguments = ("import", bags["mcap"], "-o", tmp_path / "rec", "--quiet")
    assert "already exists: give --force" in refused(*arguments)
    done = beemap(*arguments, "--force")
    assert (done.code, done.out, done.err) == (0, "", "")
    made = json.loads((tmp_path / "rec" / "meta.json").read_text())
    assert made["imported"] == str(bags["mcap"])
    assert made["topics"][LEFT] == "cam0"


def test_without_the_extra_one_line_says_what_to_install(bags, refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags", None)
    line = refused("import", bags["mcap"], "--list")
    assert "pip install 'beemap[ros]'" in line


def test_damaged_messages_are_skipped_and_counted(changed, tmp_path, beemap):
    """Of the right images one is cut short, one is no image, one comes twice; a left one is
    missing; one wheel reading has no stamp."""
    right: list[Any] = []

    def change(types: Types, message: Message) -> Iterator[Message]:
        topic, kind, time, content = message
        if topic == RIGHT:
            right.append(content)
            if len(right) == 5:
                content.data = content.data[:-2000]
            if len(right) == 9:
                content.data = np.arange(200, dtype=np.uint8)
            if len(right) == 13:
                yield message
        if topic == LEFT and len(right) == 20:
            return
        if topic == "/joint_states" and time % 1_000_000_000 == 13_500_000:
            content.header.stamp.sec = content.header.stamp.nanosec = 0
        yield topic, kind, time, content

    done = beemap("import", changed(change), "-o", tmp_path / "rec", *WHEELS)
    assert done.code == 0, done.err
    assert f"{PAIRS - 3} pairs of {PAIRS - 1} left and {PAIRS - 2} right images" in done.out
    assert f"skipped: damaged image: 2 ({RIGHT} at 1002003000000, {RIGHT} at 100" in done.out
    assert f"skipped: message that repeats a stamp: 1 ({RIGHT} at 1006003000000)" in done.out
    assert "skipped: left image without a right one: 2" in done.out
    assert "skipped: right image without a left one: 1" in done.out
    assert "messages without a stamp: when received is taken" in done.out


def test_images_that_never_belong_together_are_refused(changed, tmp_path, refused):
    def late(types: Types, message: Message) -> Iterator[Message]:
        if message[0] == RIGHT:
            message[3].header.stamp.nanosec += 60_000_000
        yield message

    line = refused("import", changed(late), "-o", tmp_path / "rec", "--quiet")
    assert f"{tmp_path / 'rec'}: none of {PAIRS} left and {PAIRS} right images belong" in line
    assert not (tmp_path / "rec").exists()


def test_images_of_another_size_than_the_calibration_are_refused(changed, tmp_path, refused):
    def larger(types: Types, message: Message) -> Iterator[Message]:
        if message[0].endswith("camera_info"):
            message[3].width, message[3].height = 640, 480
        yield message

    line = refused("import", changed(larger), "-o", tmp_path / "rec")
    assert f"{LEFT}: images of 320x240, the calibration is made for 640x480" in line


def test_the_mount_may_stand_on_tf_as_it_once_did(changed, tmp_path, beemap):
    bag = changed(lambda types, m: iter([("/tf", *m[1:]) if m[0] == "/tf_static" else m]))
    done = beemap("import", bag, "-o", tmp_path / "rec")
    assert "mount from tf base_footprint -> left_optical: 0.300 m up" in done.err


def test_one_drive_in_several_bags(changed, bags, tmp_path, beemap):
    half = 1_010_000_000_000
    parts = [
        changed(lambda types, m: iter([m] if m[2] < half else []), "ros1", "one"),
        changed(lambda types, m: iter([m] if m[2] >= half else []), "ros1", "two"),
    ]
    assert beemap("import", *parts, "-o", tmp_path / "parts", *WHEELS).code == 0
    assert beemap("import", bags["ros1"], "-o", tmp_path / "whole", *WHEELS).code == 0
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
