"""`beemap calibrate mount` over rendered and damaged recordings."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from calibration.rig import Mount, load_rig, save_rig
from calibration.yamlfile import dump_yaml
from pipeline.commands.simulate import simulate
from pipeline.mount import reduced
from pipeline.recordings import open_recording
from pipeline.recordings.base import read_image
from tests.simulation_rooms import room_sheet
from tests.stereo_rigs import straight_rig


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A carpeted room with a crate on each side."""
    crates = [
        {"material": "wood", "at": [4.5, 2.6, 0.4], "size": [0.6, 0.5, 0.8]},
        {"material": "cardboard", "at": [3.2, 1.2, 0.2], "size": [0.4, 0.4, 0.4]},
    ]
    path = tmp_path_factory.mktemp("scene") / "room.yaml"
    path.write_text(dump_yaml(room_sheet(*crates)))
    return path


@pytest.mark.parametrize(
    ("pitch", "height", "roll"), [(-5.0, 0.1, 0.0), (10.0, 0.3, 3.0), (25.0, 0.6, -2.0)]
)
def test_the_mount_of_a_rendered_recording_is_found(beemap, tmp_path, scene, pitch, height, roll):
    recording = tmp_path / "recording"
    arguments = ["office", "-o", recording, "--scene", scene, "--duration", 1.5, "--quiet"]
    arguments += ["--size", "320x240", "--pitch", pitch, "--height", height, "--roll", roll]
    result = CliRunner().invoke(simulate, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0
    rig = open_recording(recording).rig
    assert rig is not None
    file = tmp_path / "rig.yaml"
    save_rig(replace(rig, mount=None), file)  # nothing is known before
    outcome = beemap("calibrate", "mount", recording, "--rig", file, "--json")
    assert outcome.code == 0, outcome.err
    told = json.loads(outcome.out)
    assert told["before"] is None
    assert told["mount"]["height_m"] == pytest.approx(height, rel=0.01)
    assert told["mount"]["pitch_deg"] == pytest.approx(pitch, abs=0.2)
    assert told["mount"]["roll_deg"] == pytest.approx(roll, abs=0.2)
    for name in ("height_m", "pitch_deg", "roll_deg"):
        truth = {"height_m": height, "pitch_deg": pitch, "roll_deg": roll}[name]
        assert abs(told["mount"][name] - truth) < 4.0 * told["sigma"][name]
    # Four pairs in a row tell nothing of yaw and place.
    assert told["kept"] == ["yaw", "x", "y"]
    assert told["notes"][0].startswith("only ")
    written = load_rig(file).mount
    assert written is not None
    assert written.height == told["mount"]["height_m"]
    assert math.degrees(written.pitch) == pytest.approx(told["mount"]["pitch_deg"])


def test_wheels_tell_yaw_and_place_and_nothing_in_the_file_is_lost(beemap, office, tmp_path):
    rig = open_recording(office).rig
    assert rig is not None
    file = tmp_path / "rig.yaml"
    odd = sorted((office / "mav0" / "cam1" / "data").iterdir())[0]
    cv2.imwrite(str(odd), read_image(odd)[:100])  # of another size than the rest
    sections = {"devices": {"left": "/dev/video0"}, "calibration": {"stereo_rms_px": 0.2}}
    before = Mount(height=0.25, pitch=0.1, roll=0.0, yaw=0.3, x=0.5, y=-0.5)
    save_rig(replace(rig, mount=before, sections=sections), file)
    outcome = beemap("calibrate", "mount", office, "--rig", file)
    assert outcome.code == 0, outcome.err
    found = load_rig(file)
    assert found.mount is not None
    assert found.mount.height == pytest.approx(0.30, rel=0.01)
    assert math.degrees(found.mount.pitch) == pytest.approx(0.0, abs=0.2)
    assert math.degrees(found.mount.yaw) == pytest.approx(0.0, abs=1.0)
    assert found.left == rig.left
    assert found.sections["devices"] == sections["devices"]
    told = found.sections["calibration"]
    assert told["stereo_rms_px"] == 0.2
    assert told["mount"]["before"]["x"] == 0.5
    assert told["mount"]["before"]["yaw"] == pytest.approx(math.degrees(0.3))
    assert "(was 0.2500)" in outcome.out
    # Floor and motion both looked at it; it is one image.
    assert "skipped: damaged or unfit image: 1 (" in outcome.out
    # Twenty seconds turn little: the place is told within its sigma, or it stays and says so.
    if "x" in told["mount"]["sigma"]:
        sigma = told["mount"]["sigma"]
        assert abs(found.mount.x - 0.10) < 4.0 * sigma["x"]
        assert abs(found.mount.y - 0.06) < 4.0 * sigma["y"]
    else:
        assert (found.mount.x, found.mount.y) == (0.5, -0.5)
        assert "note: x and y stay" in outcome.out


def test_without_wheels_only_the_floor_tells(beemap, office, tmp_path):
    shutil.rmtree(office / "mav0" / "odom0")
    damaged = sorted((office / "mav0" / "cam0" / "data").iterdir())[0]
    damaged.write_bytes(damaged.read_bytes()[:500])
    output = tmp_path / "new" / "rig.yaml"
    outcome = beemap("calibrate", "mount", office, "-o", output, "--pairs", 6)
    assert outcome.code == 0, outcome.err
    assert "no wheel ticks in the recording: yaw, x and y stay as they were" in outcome.out
    assert "skipped: damaged or unfit image: 1 (" in outcome.out
    assert "floor in 5 of 5 pairs" in outcome.out
    mount = load_rig(output).mount
    assert mount is not None
    assert mount.height == pytest.approx(0.30, rel=0.01)
    again = tmp_path / "again.yaml"
    assert beemap("calibrate", "mount", office, "-o", again, "--pairs", 6, "--quiet").out == ""
    assert again.read_bytes() == output.read_bytes()


def test_no_floor_in_view_is_one_line(refused, office, tmp_path):
    # Upside down the floor is a ceiling.
    for camera in ("cam0", "cam1"):
        for image in (office / "mav0" / camera / "data").iterdir():
            cv2.imwrite(str(image), read_image(image)[::-1])
    line = refused(
        "calibrate", "mount", office, "-o", tmp_path / "rig.yaml", "--pairs", 6, "--quiet"
    )
    assert "no floor in view" in line
    assert not (tmp_path / "rig.yaml").exists()


def test_mistakes_are_one_line(refused, office, tmp_path):
    assert "give --rig rig.yaml" in refused("calibrate", "mount", office)
    assert "is a folder" in refused("calibrate", "mount", office, "-o", tmp_path)
    taken = tmp_path / "taken.yaml"
    taken.write_text("mine")
    assert "give --force" in refused("calibrate", "mount", office, "-o", taken)
    assert "not a rig file" in refused("calibrate", "mount", office, "--rig", taken)
    assert taken.read_text() == "mine"
    save_rig(straight_rig().scaled(2.0), taken)
    assert "is calibrated for 640x480" in refused(
        "calibrate", "mount", office, "--rig", taken, "--quiet"
    )
    assert "no such folder" in refused("calibrate", "mount", tmp_path / "none", "--rig", taken)


def test_large_images_arereduced_with_their_rig():
    large = straight_rig().scaled(5.0)  # 1600 x 1200
    small, scale = reduced(large)
    assert small.image_size == (800, 600)
    v, u = np.indices((1200, 1600))
    pixels = np.array([[400.5, 300.5], [1200.5, 800.5]])
    rays = (pixels - (large.left.cx, large.left.cy)) / large.left.fx
    halved = np.stack([scale(i.astype(np.float32)) for i in (u, v)], axis=-1)
    for pixel, ray in zip(pixels, rays, strict=True):
        place = ray * small.left.fx + (small.left.cx, small.left.cy)
        x, y = np.rint(place).astype(int)
        assert np.allclose(place, (x, y), atol=1e-9)
        assert np.allclose(halved[y, x], pixel)
