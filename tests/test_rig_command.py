"""`beemap rig`: real commands over small files."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import pytest

from calibration.rig import load_rig, save_rig
from pipeline.recordings import open_recording
from pipeline.rig import choose_rig
from tests.rig_files import assert_same_rig, one_rig

REAL = os.environ.get("BEEMAP_REAL_DATA")
real_data = pytest.mark.skipif(REAL is None, reason="BEEMAP_REAL_DATA is not set")


@pytest.fixture
def rig_file(tmp_path) -> Path:
    path = tmp_path / "rig.yaml"
    save_rig(one_rig(), path)
    return path


@pytest.mark.parametrize(
    ("out", "kind", "files"),
    [
        ("ros", "ros", ["left.yaml", "right.yaml"]),
        ("mav0", None, ["cam0", "cam1"]),
        ("camchain.yaml", None, None),
        ("cv.yml", None, None),
        ("cv.yaml", "opencv", None),
        ("cv.xml", None, None),
        ("cv", "opencv", ["extrinsics.yml", "intrinsics.yml"]),
    ],
)
def test_there_and_back_again(beemap, rig_file, tmp_path, out, kind, files):
    to = ["--to", kind] if kind else []
    outcome = beemap("rig", "convert", rig_file, "-o", tmp_path / out, *to)
    assert outcome.code == 0
    assert "warning: " in outcome.err  # the mount
    if files:
        assert sorted(p.name for p in (tmp_path / out).iterdir()) == files
    outcome = beemap("rig", "convert", tmp_path / out, "-o", tmp_path / "again-rig.yaml")
    assert (outcome.code, outcome.err) == (0, "")
    assert_same_rig(load_rig(tmp_path / "again-rig.yaml"), one_rig(), 1e-9)


def test_nothing_is_replaced_without_force(refused, beemap, rig_file, tmp_path):
    beemap("rig", "convert", rig_file, "-o", tmp_path / "ros", "--to", "ros")
    (tmp_path / "ros" / "left.yaml").unlink()
    before = (tmp_path / "ros" / "right.yaml").read_bytes()
    line = refused("rig", "convert", rig_file, "-o", tmp_path / "ros", "--to", "ros")
    assert "right.yaml: already exists: give --force" in line
    assert [p.name for p in (tmp_path / "ros").iterdir()] == ["right.yaml"]
    assert (
        beemap("rig", "convert", rig_file, "-o", tmp_path / "ros", "--to", "ros", "--force").code
        == 0
    )
    assert (tmp_path / "ros" / "right.yaml").read_bytes() == before
    line = refused("rig", "convert", rig_file, "-o", rig_file, "--to", "kalibr", "--force")
    assert "is what is converted" in line
    assert_same_rig(load_rig(rig_file), one_rig())


def test_a_rig_file_that_is_replaced_keeps_its_mount(beemap, refused, rig_file, tmp_path):
    other = one_rig(image_size=(320, 240), mount=None, sections={})
    save_rig(other, tmp_path / "new.yaml")
    chain = tmp_path / "camchain.yaml"
    beemap("rig", "convert", tmp_path / "new.yaml", "-o", chain)
    outcome = beemap("rig", "convert", chain, "-o", rig_file, "--force")
    assert "kept from the replaced file: mount, encoders" in outcome.out
    again = load_rig(rig_file)
    assert again.image_size == (320, 240)
    assert again.mount is not None
    assert again.mount.height == 0.31
    assert again.sections == {"encoders": {"track": 0.3}}  # the calibration is another one
    rig_file.write_text("beemap_rig: 1\n")
    line = refused("rig", "convert", chain, "-o", rig_file, "--force")
    assert "mend or delete it, its mount would be lost" in line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rig.yaml", "-o", "x.yaml"], "give --to with one of beemap, ros"),
        (["rig.yaml", "-o", "x.txt", "--to", "opencv"], "OpenCV knows the endings .yml"),
        (["rig.yaml", "rig.yaml", "-o", "x.yml"], "takes 1 file.s., not these"),
        (["none.yaml", "-o", "x.yml"], "none.yaml: no such file"),
        (["empty", "-o", "x.yml"], "no rig in this folder .looked for mav0/cam0/sensor.yaml"),
        (["left.yaml", "-o", "x.yml"], "holds one camera only: give the left and the right"),
        (["left.yaml", "rig.yaml", "-o", "x.yml"], "is beemap rig.yaml: give files of one format"),
        (["right.yaml", "left.yaml", "-o", "x.yml"], "give the left camera's file first"),
        (["left.yaml", "left.yaml", "-o", "x.yml"], "single cameras: calibrate .* stereo pair"),
        (["rig.yaml", "-o", "x.yml", "--size", "640"], "--size 640: expected WIDTHxHEIGHT"),
        (["rig.yaml", "-o", "x.yml", "--size", "64x48"], "made for images of 640x480"),
        (["rig.yaml", "-o", "x.yml", "--unit", "25"], "--unit '25': give the unit"),
        (["rig.yaml", "-o", "x.yml", "--unit", "25mm"], "counts metres: leave --unit out"),
        (["notes.yaml", "-o", "x.yml"], "not a rig file that is known here .beemap rig.yaml, ROS"),
        (["omni.yaml", "-o", "x.yml"], "cam0.camera_model: 'omni' .* --models pinhole-radtan"),
    ],
)
def test_a_mistake_is_one_line(
    beemap, refused, rig_file, tmp_path, monkeypatch, arguments, message
):
    beemap("rig", "convert", rig_file, "-o", tmp_path, "--to", "ros")
    beemap("rig", "convert", rig_file, "-o", tmp_path / "camchain.yaml")
    chain = (tmp_path / "camchain.yaml").read_text()
    (tmp_path / "omni.yaml").write_text(chain.replace("pinhole", "omni", 1))
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.yaml").write_text("colour: red\n")
    monkeypatch.chdir(tmp_path)
    assert re.search(message, refused("rig", "convert", *arguments))
    assert not (tmp_path / "x.yml").exists()


def test_ros_without_a_lens_model_is_plumb_bob_with_a_warning(beemap, rig_file, tmp_path):
    beemap("rig", "convert", rig_file, "-o", tmp_path / "ros", "--to", "ros")
    left = tmp_path / "ros" / "left.yaml"
    left.write_text(left.read_text().replace("distortion_model: plumb_bob\n", ""))
    outcome = beemap("rig", "convert", tmp_path / "ros", "-o", tmp_path / "again-rig.yaml")
    assert outcome.err == f"warning: {left}: no distortion_model: taken as plumb_bob " + (
        "(k1 k2 p1 p2 k3)\n"
    )
    assert_same_rig(load_rig(tmp_path / "again-rig.yaml"), one_rig(), 1e-9)


def test_show_tells_people_what_the_rig_is(beemap, rig_file):
    lines = dict(
        line.split(maxsplit=1) for line in beemap("rig", "show", rig_file).out.splitlines()
    )
    assert lines["images"] == "640 x 480 px"
    assert lines["baseline"].startswith("83.43 mm; the right camera is turned by 2.51 deg")
    assert lines["mount"].startswith("0.310 m high, pitch 12.00 (nose down), roll 0.57, yaw -1.15")
    assert "date 2026-01-02 (" in lines["calibration"]
    assert lines["encoders"] == "track 0.3"
    assert lines["distance"].split()[:2] == ["0.5", "m"]
    left = next(t for n, t in lines.items() if n == "left")
    assert "f 536.10 x 535.70 px, centre 342.30, 235.60; lens radtan" in left


def test_show_as_json_of_any_format(beemap, rig_file, tmp_path):
    shown = json.loads(beemap("rig", "show", rig_file, "--json").out)
    f = (536.1 + 535.7 + 539.2 + 538.8) / 4
    baseline = one_rig().baseline
    assert shown["baseline_m"] == pytest.approx(baseline)
    assert shown["rotation_deg"] == pytest.approx([0.8, 2.3, -0.6])
    rows = {row["distance_m"]: row for row in shown["depth"]["table"]}
    assert list(rows) == [0.5, 1.0, 2.0, 3.0, 5.0, 8.0]
    assert rows[2.0]["sigma_m"] == pytest.approx(4.0 / (f * baseline) * 0.25)
    assert rows[2.0]["disparity_px"] == pytest.approx(f * baseline / 2.0)
    assert shown["depth"]["usable_range_m"] == pytest.approx((0.1 * f * baseline / 0.25) ** 0.5)
    # A barrel lens sees more than a pinhole of its focal length.
    wide, straight = (
        shown["left"][k] for k in ("field_of_view_deg", "field_of_view_without_distortion_deg")
    )
    assert wide[0] > straight[0] + 1.0
    beemap("rig", "convert", rig_file, "-o", tmp_path / "camchain.yaml")
    again = json.loads(beemap("rig", "show", tmp_path / "camchain.yaml", "--json").out)
    assert again["mount"] is None
    assert again["left"] == shown["left"]


def test_show_says_where_the_cameras_are_exchanged(beemap, rig_file, tmp_path):
    rig = load_rig(rig_file)
    swapped = replace(rig, left=rig.right, right=rig.left, R=rig.R.T, T=-rig.R.T @ rig.T)
    save_rig(swapped, tmp_path / "swapped.yaml")
    beemap("rig", "convert", tmp_path / "swapped.yaml", "-o", tmp_path / "camchain.yaml")
    assert "stands to the left" in beemap("rig", "show", tmp_path / "camchain.yaml").err


def test_a_recording_is_read_with_a_rig_of_any_format(beemap, office, tmp_path):
    beemap("rig", "convert", office, "-o", tmp_path / "ros", "--to", "ros")
    recording = open_recording(office)
    rig, notes = choose_rig(recording, tmp_path / "ros")
    assert recording.rig is not None
    assert_same_rig(rig, recording.rig, 1e-9)
    told = " ".join(notes)
    assert f"{tmp_path / 'ros'}: read as ROS camera_info" in told
    assert "is used instead of the recording's" in told
    assert "the rig has no mount" in told


@real_data
def test_opencvs_own_single_calibration_is_not_taken_for_a_rig(refused):
    file = Path(REAL or "") / "calibration" / "opencv-sample" / "left_intrinsics.yml"
    assert "holds one camera only" in refused("rig", "show", file)
    assert "the pose between the cameras is not known" in refused("rig", "show", file, file)


@real_data
def test_boofcvs_calibration_of_the_bumblebee_is_read(beemap, refused):
    file = Path(REAL or "") / "calibration" / "bumblebee2-chess" / "stereo.yaml"
    assert "--unit 1mm" in refused("rig", "show", file)
    shown = json.loads(beemap("rig", "show", file, "--unit", "1mm", "--json").out)
    assert shown["baseline_m"] == pytest.approx(0.12005, abs=1e-5)
    assert shown["left"]["distortion"][:2] == [-0.3625365821238732, 0.17532754393079863]
