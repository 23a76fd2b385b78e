"""Recordings that the simulator writes: layout, round trip, and the one that ships."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from calibration.exchange.euroc import camera_sheets
from calibration.rig import RigError, load_rig, minibee, save_rig
from calibration.yamlfile import read_yaml
from mapping.grid import OccupancyGrid
from odometry.encoders import encoder_parameters
from odometry.tick_log import read_tick_log
from pipeline.commands.simulate import simulate
from pipeline.commands.simulate_rendered import PRESETS
from pipeline.errors import InputError
from pipeline.map_files import write_map_server
from pipeline.recordings import asl
from pipeline.recordings.asl_writer import AslWriter, ImageFormat
from simulation import filming
from simulation.drive import drive
from simulation.faults import FaultError
from simulation.renderer import StereoRenderer
from simulation.rigs import bent_minibee
from simulation.scene import load_scene
from simulation.true_scans import load_true_scans
from simulation.wheels import MINIBEE_ENCODERS, WheelNoise
from stereo.ranger import StereoRanger
from tests.simulation_rooms import room_sheet, small_rig

SHIPPED = Path(__file__).parents[1] / "data" / "office"
# Mean difference of grey levels; JPEG of quality 90 alone makes about 2.
TOLERANCE = 3.0


def run(*arguments: str):
    result = CliRunner().invoke(simulate, ["office", *arguments], catch_exceptions=True)
    if result.exception is not None:
        raise result.exception
    return result


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory) -> Path:
    from calibration.yamlfile import dump_yaml

    path = tmp_path_factory.mktemp("scene") / "room.yaml"
    path.write_text(dump_yaml(room_sheet()))
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory, scene_file) -> Path:
    """Three seconds with depth, PNG, on a tilted mount."""
    folder = tmp_path_factory.mktemp("recordings") / "short"
    run(
        *("-o", str(folder), "--scene", str(scene_file), "--seed", "3", "--duration", "3"),
        *("--size", "160x120", "--pitch", "4", "--roll", "-2", "--height", "0.42"),
        *("--depth", "--format", "png"),
    )
    return folder


def test_the_command_writes_every_file(recording):
    stamps = [1_000_000_000_000 + i * 500_000_000 for i in range(7)]
    for part in ("cam0", "cam1", "depth0"):
        names = sorted(path.name for path in (recording / "mav0" / part / "data").iterdir())
        assert names == [f"{stamp}.png" for stamp in stamps]
    lines = (recording / "mav0" / "cam0" / "data.csv").read_text().splitlines()
    assert lines[0] == "#timestamp [ns],filename"
    assert lines[1:] == [f"{stamp},{stamp}.png" for stamp in stamps]
    assert sorted(path.name for path in (recording / "truth").iterdir()) == [
        "command.txt", "floorplan.pgm", "floorplan.yaml", "scans.npz", "seen.pgm", "seen.yaml",
    ]  # fmt: skip
    command = (recording / "truth" / "command.txt").read_text()
    assert command.startswith("beemap simulate office -o ")
    assert "--seed 3" in command
    assert "--depth" in command
    assert "--noise-along" not in command


def test_the_recording_is_read_back(recording):
    read = asl.read(recording)
    assert len(read.pairs) == 7
    assert not read.skipped
    rig = read.rig
    assert rig is not None
    assert rig.mount is not None
    wanted = bent_minibee(0.25)
    assert rig.image_size == (160, 120)
    assert rig.left == wanted.left
    assert rig.right == wanted.right
    np.testing.assert_allclose(rig.R, wanted.R, atol=1e-12)
    np.testing.assert_allclose(rig.T, wanted.T, atol=1e-12)
    assert rig.mount.height == pytest.approx(0.42)
    assert math.degrees(rig.mount.pitch) == pytest.approx(4.0)
    assert math.degrees(rig.mount.roll) == pytest.approx(-2.0)
    assert read.encoders == MINIBEE_ENCODERS
    assert read.poses is not None
    np.testing.assert_allclose(read.poses.poses[-1], (0.34 * 3.0, 0.0, 0.0), atol=1e-6)


def test_truth_has_the_asl_layout(recording):
    table = recording / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    header, *rows = table.read_text().splitlines()
    assert header.count(",") == 16
    assert {row.count(",") for row in rows} == {16}


def test_depth_is_in_millimetres(recording):
    depth = cv2.imread(
        str(recording / "mav0" / "depth0" / "data" / "1000000000000.png"), cv2.IMREAD_UNCHANGED
    )
    assert depth is not None
    assert depth.dtype == np.uint16
    # The east wall, 4.9 m ahead of a camera that looks 4 degrees down.
    above = 0.42 + 4.9 * math.tan(math.radians(16.0))
    assert above < 2.5
    assert 4500 < depth[10, 80] < 5200


def test_true_ranges_lie_beside_the_pairs(recording):
    scans = load_true_scans(recording / "truth" / "scans.npz")
    read = asl.read(recording)
    assert scans.stamp.tolist() == [pair.stamp for pair in read.pairs]
    assert read.rig is not None
    camera = StereoRanger(read.rig).camera
    ahead = np.abs(scans.bearing) < 0.1
    assert scans.bearing.size == camera.width
    away = 6.0 - 1.1 - 0.17 * np.arange(7)  # to the east wall, at 0.34 m/s
    expected = away[:, None] / np.cos(camera.yaw + scans.bearing[ahead])
    np.testing.assert_allclose(scans.range[:, ahead], expected, atol=2e-3)
    assert np.isfinite(scans.texture[:, ahead]).all()


def test_same_command_same_bytes(recording, scene_file, tmp_path, monkeypatch):
    again = tmp_path / "again"
    monkeypatch.setattr(filming, "WORKERS", 1)
    run(
        *("-o", str(again), "--scene", str(scene_file), "--seed", "3", "--duration", "1"),
        *("--size", "160x120", "--pitch", "4", "--roll", "-2", "--height", "0.42"),
        *("--format", "png", "--quiet"),
    )
    for camera in ("cam0", "cam1"):
        for path in (again / "mav0" / camera / "data").iterdir():
            assert path.read_bytes() == (recording / path.relative_to(again)).read_bytes()


def test_faults_rate_and_mount_error_are_recorded(scene_file, tmp_path):
    out = tmp_path / "spoilt"
    result = run(
        *("-o", str(out), "--scene", str(scene_file), "--duration", "0.4", "--rate", "5"),
        *("--size", "80x60", "--pitch", "3", "--mount-error", "0.5", "--baseline", "60"),
        *("--camera", "cheap", "--fault", "shutter=0.01", "--fault", "exposure_left=2"),
        *("--quality", "60"),
    )
    assert "pairs/s" in result.output
    read = asl.read(out)
    assert [pair.stamp for pair in read.pairs] == [10**12 + i * 200_000_000 for i in range(3)]
    assert read.rig is not None
    assert read.rig.mount is not None
    true = load_rig(out / "truth" / "rig.yaml")
    assert true.mount is not None
    assert math.degrees(read.rig.mount.pitch) == pytest.approx(3.5)
    assert math.degrees(true.mount.pitch) == pytest.approx(3.0)
    assert read.rig.baseline == pytest.approx(0.06)
    # The middle between the cameras stays where it was.
    middle = 0.5 * minibee().baseline
    assert true.mount.y - 0.03 == pytest.approx(minibee().mount.y - middle, abs=2e-4)  # type: ignore[union-attr]
    pair = read.pairs[0].load()
    assert pair.left.mean() > 1.15 * pair.right.mean()
    command = (out / "truth" / "command.txt").read_text()
    assert "--fault shutter=0.01 --fault exposure_left=2" in command
    assert "--rate 5.0" in command
    # The command tells all: run again it makes the same.
    again = tmp_path / "again"
    words = command.replace(str(out), str(again)).split()
    run(*words[3:], "--quiet")
    for path in (out / "mav0" / "cam1" / "data").iterdir():
        assert path.read_bytes() == (again / path.relative_to(out)).read_bytes()


def test_any_rig_can_be_filmed_with(scene_file, tmp_path):
    rig = minibee().scaled(0.125)
    save_rig(replace(rig, mount=None), tmp_path / "rig.yaml")
    arguments = ("--rig", str(tmp_path / "rig.yaml"), "--scene", str(scene_file))
    run("-o", str(tmp_path / "r"), *arguments, "--duration", "0", "--height", "0.4")
    read = asl.read(tmp_path / "r")
    assert read.rig is not None
    assert read.rig.left == rig.left
    assert read.rig.mount is not None
    assert read.rig.mount.height == pytest.approx(0.4)
    with pytest.raises(InputError, match=r"--size.*--rig"):
        run("-o", str(tmp_path / "s"), *arguments, "--size", "80x60")


def test_a_straight_lens_is_straight(scene_file, tmp_path):
    arguments = ("--scene", str(scene_file), "--size", "80x60", "--lens", "straight")
    run("-o", str(tmp_path / "r"), *arguments, "--duration", "0")
    read = asl.read(tmp_path / "r")
    assert read.rig is not None
    assert not np.any(read.rig.left.D)
    np.testing.assert_allclose(read.rig.R, np.eye(3), atol=1e-12)


def test_wrong_options_are_refused_before_any_work(tmp_path):
    with pytest.raises(FaultError, match=r"shutter is 3\.0"):
        run("-o", str(tmp_path / "r"), "--fault", "shutter=3")
    with pytest.raises(InputError, match="--quality"):
        run("-o", str(tmp_path / "r"), "--format", "png", "--quality", "80")
    assert not (tmp_path / "r").exists()


def test_every_preset_is_a_command_with_its_scene():
    for name, (scene, _) in PRESETS.items():
        assert load_scene(scene).route.duration > 60.0
        told = CliRunner().invoke(simulate, [name, "--help"]).output
        assert "rolling" in told  # the faults are listed
    paper = CliRunner().invoke(simulate, ["paper", "--help"]).output
    assert "--positions" in paper  # the simulator of scan logs keeps its name


def test_an_existing_folder_is_refused_without_force(scene_file, tmp_path):
    (tmp_path / "mav0").mkdir()
    (tmp_path / "kept").write_text("mine")
    arguments = ("-o", str(tmp_path), "--scene", str(scene_file), "--duration", "0")
    with pytest.raises(InputError, match="--force"):
        run(*arguments)
    with pytest.raises(InputError, match="holds other things"):
        run(*arguments, "--size", "80x60", "--force")
    assert (tmp_path / "kept").read_text() == "mine"
    arguments = ("-o", str(tmp_path / "rec"), *arguments[2:], "--size", "80x60")
    run(*arguments)
    run(*arguments, "--force")
    assert len(asl.read(tmp_path / "rec").pairs) == 1


@pytest.mark.parametrize("size", ["320", "320x200", "0x0", "axb"])
def test_a_wrong_size_is_named(size, tmp_path):
    with pytest.raises(InputError, match="--size"):
        run("-o", str(tmp_path / "r"), "--size", size)


def test_writer_appends_line_by_line(tmp_path):
    image = np.full((120, 160), 90, np.uint8)
    writer = AslWriter(tmp_path, small_rig(), 2.0, {"track": 0.3}, ImageFormat("jpg", 90))
    with writer:
        writer.add_pair(5, image, image)
        writer.add_ticks(4, 65535, 1)
        writer.add_ticks(6, 3, 2)
        # Readable before the writer is closed.
        log = read_tick_log(tmp_path / "mav0" / "odom0" / "data.csv")
    assert log.left.tolist() == [65535, 3]
    assert log.stamps.tolist() == [4, 6]
    assert (tmp_path / "mav0" / "cam1" / "data" / "5.jpg").is_file()


def test_a_lens_the_layout_cannot_hold_is_refused():
    rig = small_rig()
    odd = replace(rig.left, distortion=(-0.1, 0.02, 0.0, 0.0, 0.01))
    with pytest.raises(RigError, match="radtan"):
        camera_sheets(replace(rig, left=odd), 2.0)
    fine = replace(rig.left, distortion=(-0.1, 0.02, 0.0, 0.0, 0.0))
    sheet = camera_sheets(replace(rig, left=fine), 2.0)["cam0"]
    assert sheet["distortion_coefficients"] == [-0.1, 0.02, 0.0, 0.0]


def test_maps_are_written_for_map_server(tmp_path):
    probability = np.array([[0.0, 1.0, np.nan], [1.0, 0.0, 0.0]], np.float32)
    write_map_server(tmp_path, OccupancyGrid(probability, (-1.0, 2.0), 0.05), "plan")
    image = cv2.imread(str(tmp_path / "plan.pgm"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.tolist() == [[0, 254, 254], [254, 0, 205]]  # the top row is the highest y
    assert read_yaml(tmp_path / "plan.yaml") == {
        "image": "plan.pgm", "mode": "trinary", "resolution": 0.05, "origin": [-1.0, 2.0, 0.0],
        "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196,
    }  # fmt: skip


def test_the_shipped_recording_is_what_its_command_makes():
    command = (SHIPPED / "truth" / "command.txt").read_text().strip()
    assert command == "beemap simulate office -o data/office --seed 1 --size 320x240"
    scene = load_scene("office")
    trip = drive(scene.route, MINIBEE_ENCODERS, WheelNoise(), seed=1)
    read = asl.read(SHIPPED)
    assert [pair.stamp for pair in read.pairs] == trip.stamps.tolist()
    log = read_tick_log(SHIPPED / "mav0" / "odom0" / "data.csv")
    assert np.abs(np.stack([log.left, log.right], axis=1) - trip.ticks).max() <= 1
    renderer = StereoRenderer(scene, bent_minibee(0.5), seed=1)
    for frame in (0, len(trip.stamps) // 2):
        pair, stored = renderer.render(trip.poses[frame], frame), read.pairs[frame].load()
        for own, shipped in ((pair.left, stored.left), (pair.right, stored.right)):
            assert np.abs(own.astype(float) - shipped).mean() < TOLERANCE


def test_the_shipped_recording_is_small_enough():
    sizes = [path.stat().st_size for path in SHIPPED.rglob("*") if path.is_file()]
    assert sum(sizes) <= 25e6
    sheet = read_yaml(SHIPPED / "mav0" / "odom0" / "sensor.yaml")
    assert encoder_parameters(sheet, "sensor.yaml") == MINIBEE_ENCODERS
