"""`beemap export`: bags that any reader decodes, on the recording's stamps, frames consistent."""

from __future__ import annotations

import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.highlevel import AnyReader

from odometry.motion import compose
from pipeline.cli import cli
from pipeline.map_request import MapRequest
from pipeline.recordings import open_recording
from pipeline.run import make_ranger
from pipeline.settings import Settings
from pipeline.trajectory import read_tum
from tests import nav2_map
from tests.conftest import PAIRS

# bag -> what it is called.
NAMES = {"mcap": "out.mcap", "ros1": "out.bag", "sqlite3": "out"}
LATCHED = ("/map", "/path", "/tf_static")

Bag = dict[str, list[tuple[int, Any]]]


def content(path: Path) -> tuple[Bag, list[Any]]:
    """topic -> (time, message), decoded by the definitions that the bag itself holds."""
    found: Bag = defaultdict(list)
    with AnyReader([path]) as reader:
        connections = list(reader.connections)
        for connection, time, data in reader.messages():
            found[connection.topic].append((time, reader.deserialize(data, connection.msgtype)))
    return found, connections


def stamp(header: Any) -> int:
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def planar(transform: Any) -> np.ndarray:
    """(x, y, theta) of a Transform or a Pose message."""
    where = getattr(transform, "translation", None) or transform.position
    turn = getattr(transform, "rotation", None) or transform.orientation
    assert turn.x == turn.y == where.z == 0.0
    return np.array([where.x, where.y, 2.0 * np.arctan2(turn.z, turn.w)])


@pytest.fixture(scope="module")
def bags(office_run, tmp_path_factory) -> dict[str, Path]:
    """The run in each container; ROS 1 and the folder without images."""
    folder = tmp_path_factory.mktemp("export")
    for name in NAMES.values():
        options = [] if name.endswith(".mcap") else ["--no-images"]
        done = CliRunner().invoke(
            cli, ["export", str(office_run), "-o", str(folder / name), *options]
        )
        assert done.exit_code == 0, done
    return {container: folder / name for container, name in NAMES.items()}


@pytest.fixture(scope="module")
def mcap(bags) -> Bag:
    return content(bags["mcap"])[0]


def test_every_message_decodes_in_every_container(bags, mcap):
    count = {topic: len(messages) for topic, messages in mcap.items()}
    assert count["/map"] == count["/path"] == 1
    assert count["/odom"] == count["/tf"] == PAIRS
    assert 0 < count["/scan"] <= PAIRS
    images = {topic for topic in count if topic.startswith("/stereo")}
    assert len(images) == 4
    assert all(count[topic] == PAIRS for topic in images)
    for name in ("ros1", "sqlite3"):
        found, connections = content(bags[name])
        assert {t: len(m) for t, m in found.items()} == {
            topic: n for topic, n in count.items() if topic not in images
        }
        for topic in LATCHED:
            (ext,) = [c.ext for c in connections if c.topic == topic]
            if name == "ros1":
                assert ext.latching == 1
            else:
                assert ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
    assert (bags["sqlite3"] / "metadata.yaml").is_file()


def test_another_reader_finds_nothing_wrong_with_the_mcap(bags):
    cli = pytest.importorskip("rerun_cli", reason="rerun is in the extra view")
    program = Path(cli.__file__).parent / "rerun"
    command = [program, "mcap", "check", bags["mcap"]]
    done = subprocess.run(command, env={"CI": "true"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    rows = [line.split() for line in done.stdout.splitlines() if "/scan" in line or "/map" in line]
    assert [row[0] for row in rows] == ["ok", "ok"]


def test_stamps_are_those_of_the_recording(mcap, office_piece):
    pairs = [pair.stamp for pair in open_recording(office_piece).pairs]
    for topic, messages in mcap.items():
        for time, message in messages:
            heads = [t.header for t in message.transforms] if "tf" in topic else [message.header]
            assert {stamp(head) for head in heads} == {time}
        if topic not in (*LATCHED, "/scan"):
            assert [time for time, _ in messages] == pairs
    assert {mcap[topic][0][0] for topic in LATCHED} == {pairs[0]}
    assert {time for time, _ in mcap["/scan"]} <= set(pairs)


def test_frames_lead_from_the_map_to_the_path(mcap, office_run):
    path, odometry = (read_tum(office_run / f"{n}.tum") for n in ("trajectory", "odometry"))
    for n, (_, message) in enumerate(mcap["/tf"]):
        links = {(t.header.frame_id, t.child_frame_id): t.transform for t in message.transforms}
        assert set(links) == {("map", "odom"), ("odom", "base_link")}
        moved = planar(links["odom", "base_link"])
        np.testing.assert_allclose(moved[:2], odometry.poses[n, :2], atol=1e-9)
        placed = compose(planar(links["map", "odom"]), moved)
        np.testing.assert_allclose(placed[:2], path.poses[n, :2], atol=1e-9)
        assert np.cos(placed[2] - path.poses[n, 2]) == pytest.approx(1.0)
    (_, whole), = mcap["/path"]  # fmt: skip
    assert whole.header.frame_id == "map"
    assert [stamp(pose.header) for pose in whole.poses] == path.stamps.tolist()
    poses = np.array([planar(pose.pose) for pose in whole.poses])
    np.testing.assert_allclose(poses[:, :2], path.poses[:, :2], atol=1e-9)


def test_odometry_is_the_wheels_with_a_doubt_that_grows(mcap, office_run):
    odometry = read_tum(office_run / "odometry.tum")
    messages = [message for _, message in mcap["/odom"]]
    assert {(m.header.frame_id, m.child_frame_id) for m in messages} == {("odom", "base_link")}
    poses = np.array([planar(message.pose.pose) for message in messages])
    np.testing.assert_allclose(poses[:, :2], odometry.poses[:, :2], atol=1e-9)
    covariances = np.array([message.pose.covariance.reshape(6, 6) for message in messages])
    heading = covariances[:, 5, 5]
    assert heading[0] == 0.0
    assert (np.diff(heading) >= 0.0).all()
    assert heading[-1] > 0.0
    assert not covariances[:, 2:5].any()  # nothing is told of height, roll and pitch
    seconds = np.diff(odometry.stamps) / 1e9
    speed = [message.twist.twist.linear.x for message in messages[1:]]
    driven = np.hypot(*np.diff(odometry.poses[:, :2], axis=0).T) / seconds
    np.testing.assert_allclose(np.abs(speed), driven, rtol=0.02, atol=1e-3)


def test_the_grid_is_what_nav2_makes_of_map_yaml(mcap, office_run):
    (_, grid), = mcap["/map"]  # fmt: skip
    loaded = nav2_map.load(office_run / "map.yaml")
    assert grid.header.frame_id == "map"
    assert (grid.info.width, grid.info.height) == (loaded.width, loaded.height)
    assert grid.info.resolution == pytest.approx(loaded.resolution)
    assert planar(grid.info.origin) == pytest.approx(np.array(loaded.origin))
    assert grid.data.tolist() == loaded.data


def test_scans_are_the_columns_and_stand_where_the_camera_looks(mcap, office_piece):
    recording = open_recording(office_piece)
    assert recording.rig is not None
    ranger = make_ranger(recording.rig, Settings())
    pairs = {pair.stamp: pair for pair in recording.pairs}
    for time, scan in mcap["/scan"][::8]:
        true = ranger(pairs[time].load())
        assert scan.header.frame_id == "base_scan"
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        assert angles[-1] == pytest.approx(scan.angle_max, abs=1e-5)
        nearest = np.abs(true.bearing[:, None] - angles).argmin(axis=0)
        assert np.abs(true.bearing[nearest] - angles).max() < np.diff(true.bearing).max()
        np.testing.assert_allclose(scan.ranges, true.range[nearest], rtol=1e-6)
        assert scan.range_max == pytest.approx(true.max_range)
    _, static = mcap["/tf_static"][-1]
    links = {t.child_frame_id: t for t in static.transforms}
    assert {t.header.frame_id for t in static.transforms} == {
        "base_link",
        "left_camera_optical_frame",
    }
    where = links["base_scan"].transform.translation
    assert (where.x, where.y) == pytest.approx(true.origin[:2])


def test_images_come_along_so_that_the_bag_is_a_recording_again(
    bags, mcap, office_piece, tmp_path, beemap
):
    done = beemap("import", bags["mcap"], "-o", tmp_path / "rec")
    assert done.code == 0, done.err
    assert "mount from tf base_link -> left_camera_optical_frame: 0.300 m up" in done.err
    for camera in ("cam0", "cam1"):
        for image in (office_piece / "mav0" / camera / "data").iterdir():
            copy = tmp_path / "rec" / "mav0" / camera / "data" / image.name
            assert copy.read_bytes() == image.read_bytes()
    again, true = open_recording(tmp_path / "rec").rig, open_recording(office_piece).rig
    assert again is not None
    assert true is not None
    assert (again.left, again.right) == (true.left, true.right)
    np.testing.assert_allclose(again.T, true.T, atol=1e-12)
    (_, static) = mcap["/tf_static"][-1]
    (right,) = [t for t in static.transforms if t.child_frame_id.startswith("right")]
    p = right.transform.translation
    np.testing.assert_allclose([p.x, p.y, p.z], -true.R.T @ true.T, atol=1e-12)


def test_without_the_recording_what_the_folder_holds_is_written(
    moved_run, office_piece, tmp_path, refused, beemap
):
    bare = tmp_path / "bare.mcap"
    done = beemap("export", moved_run, "-o", bare)
    assert done.code == 0
    assert f"its input {tmp_path / 'gone'} is not there any more (--recording says" in done.err
    found, _ = content(bare)
    assert set(found) == {"/map", "/path", "/odom", "/tf"}
    assert not found["/odom"][-1][1].pose.covariance.any()
    assert "already exists: give --force" in refused("export", moved_run, "-o", bare)
    options = ("--force", "--recording", office_piece, "--no-images")
    assert "LaserScan" in beemap("export", moved_run, "-o", bare, *options).out
    assert len(content(bare)[0]["/odom"]) == PAIRS


def test_a_run_of_a_scan_log(log_run, tmp_path, beemap):
    assert beemap("export", log_run, "-o", tmp_path / "out.mcap").code == 0
    found, _ = content(tmp_path / "out.mcap")
    assert set(found) == {"/map", "/path", "/odom", "/tf", "/tf_static", "/scan"}
    job, _ = MapRequest(str(log_run.parent / "room.log")).prepare(None, (), 1)
    due = [look.stamp for look in job.looks() if look.scan is not None]
    assert [time for time, _ in found["/scan"]] == due
    assert 3 < len(due) < 40


def test_what_cannot_be_exported(office_run, tmp_path, refused, monkeypatch):
    assert "no result folder (it has no run.json)" in refused(
        "export", tmp_path, "-o", tmp_path / "a.mcap"
    )
    line = refused("export", office_run, "-o", tmp_path / "a.zip")
    assert "a.zip: give a name that ends in .mcap or in .bag" in line
    monkeypatch.setitem(sys.modules, "rosbags", None)
    line = refused("export", office_run, "-o", tmp_path / "a.mcap")
    assert "pip install 'beemap[ros]'" in line
    assert not list(tmp_path.iterdir())
