"""rig.yaml: what is written is read back, and every mistake in it is one clear line."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.rig import (
    CameraModel,
    Mount,
    RigError,
    load_rig,
    minibee,
    rig_from_dict,
    rig_to_dict,
    save_rig,
)
from tests.calibration_views import distorted_rig

angles = st.floats(-math.pi, math.pi)
mounts = st.builds(
    Mount,
    height=st.floats(0.01, 5.0),
    pitch=st.floats(-1.5, 1.5),
    roll=angles,
    yaw=angles,
    x=st.floats(-1, 1),
    y=st.floats(-1, 1),
)


def test_every_number_survives_the_file(tmp_path):
    sections = {
        "encoders": {"ticks_per_revolution": 2000, "reversed": [False, True]},
        "calibration": {"stereo_rms_px": 0.1 + 0.2},
    }
    rig = replace(distorted_rig(), mount=Mount(0.3, 0.1, -0.02, 0.03, 0.1, 0.06))
    rig = replace(rig, sections=sections, rectified=True)
    save_rig(rig, tmp_path / "rig.yaml")
    again = load_rig(tmp_path / "rig.yaml")
    assert (again.image_size, again.left, again.right) == (rig.image_size, rig.left, rig.right)
    np.testing.assert_array_equal(again.R, rig.R)
    np.testing.assert_array_equal(again.T, rig.T)
    assert again.rectified is True
    assert again.sections == sections
    assert again.mount is not None
    assert again.mount.pitch == pytest.approx(0.1, rel=1e-15)
    assert [p.name for p in tmp_path.iterdir()] == ["rig.yaml"]


def test_sections_are_written_in_one_order_whatever_order_they_came_in():
    named = {"calibration": {"a": 1}, "devices": {"b": 2}, "encoders": {"c": 3}}
    keys = list(rig_to_dict(replace(minibee(), sections=named)))
    assert keys[-3:] == ["encoders", "devices", "calibration"]


@given(mounts)
def test_a_mount_is_found_again_from_its_pose(mount):
    again = Mount.from_pose(mount.rotation, mount.position)
    np.testing.assert_allclose(again.rotation, mount.rotation, atol=1e-9)
    np.testing.assert_allclose(again.position, mount.position)
    assert again.pitch == pytest.approx(mount.pitch, abs=1e-7)


@given(mounts)
def test_a_mount_survives_the_file_in_degrees(mount):
    data = rig_to_dict(minibee().with_mount(mount))
    again = rig_from_dict(data, "rig.yaml").mount
    assert again is not None
    np.testing.assert_allclose(again.rotation, mount.rotation, atol=1e-12)


def test_pitch_looks_down_and_yaw_looks_left():
    forward = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(Mount().rotation @ forward, [1, 0, 0], atol=1e-15)
    down = Mount(pitch=math.radians(30)).rotation @ forward
    np.testing.assert_allclose(down, [math.cos(math.pi / 6), 0, -0.5], atol=1e-15)
    left = Mount(yaw=math.radians(90)).rotation @ forward
    np.testing.assert_allclose(left, [0, 1, 0], atol=1e-15)


def test_half_the_image_sees_the_same_rays():
    rig = replace(minibee(), left=CameraModel(500.0, 510.0, 300.0, 250.0))
    half = rig.scaled(0.5)
    assert half.image_size == (320, 240)
    # The corner of the image, half a pixel outside the first pixel's centre, stays the corner.
    for a, b in ((rig.left, half.left), (rig.right, half.right)):
        assert (-0.5 - a.cx) / a.fx == pytest.approx((-0.5 - b.cx) / b.fx)
        assert (479.5 - a.cy) / a.fy == pytest.approx((239.5 - b.cy) / b.fy)


MISTAKES = [
    ("beemap_rig", 2, "beemap_rig is 2; this version reads 1"),
    ("baseline", 0.12, "unknown field 'baseline' .known: beemap_rig, image_size"),
    ("image_size", [640], "image_size: .* list of 2 numbers"),
    ("image_size", [640, "480"], r"image_size\[1\]: '480' is not a number"),
    ("image_size", [640.5, 480], "image_size: .* whole pixels"),
    ("image_size", [640, 0], "image_size: .* whole pixels"),
    ("rectified", "no", "rectified: 'no' is neither true nor false"),
    ("R", [[1, 0, 0], [0, 1, 0]], "R: .* list of 3 lists"),
    ("R", [[1, 0, 0], [0, 1, 0], [0, 0, math.nan]], r"R\[2\]\[2\]: nan is not a number"),
    ("R", [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "R is not a rotation matrix"),
    ("T", [-120, 0, 0], "T has length 120 m; .* metres"),
    ("T", [0, 0, 0], "T has length 0 m"),
    ("left", 5, "left: 5 is not a camera"),
    ("left.f", 500, "left: unknown field 'f' .known: fx, fy"),
    ("left.fx", None, "left.fx: None is not a number"),
    ("left.fx", -1, "left.fx: -1.0 must be positive"),
    ("left.cx", True, "left.cx: True is not a number"),
    ("left.cy", 10**400, "left.cy: 1000+ is not a number"),
    ("right.distortion_model", "brown", "'brown' unknown .known: none, radtan"),
    ("right.distortion_model", ["radtan"], "distortion_model: .* unknown"),
    ("right.distortion_model", "radtan", "distortion: 0 numbers given, 'radtan' takes 4 or 5"),
    ("right.distortion", [0.1], "distortion: 1 numbers given, 'none' takes 0"),
    ("right.distortion", 0.1, "distortion: 0.1 is not a list"),
    ("mount", [0.3], r"mount: \[0.3\] is not a mount"),
    ("mount", {"pitch": 3}, "mount.height: missing"),
    ("mount.height", 0, "mount.height: 0 m; expected 0 to 10 m"),
    ("mount.height", 300, "mount.height: 300 m; .* metres"),
    ("mount.pitch", 95, "mount.pitch: 95 must lie between -90 and 90 degrees"),
    ("mount.tilt", 5, "mount: unknown field 'tilt' .known: height, pitch"),
]


@pytest.mark.parametrize(("field", "value", "message"), MISTAKES)
def test_a_mistake_names_file_field_and_value(field, value, message):
    data = rig_to_dict(minibee())
    *parents, key = field.split(".")
    target = data[parents[0]] if parents else data
    target[key] = value
    with pytest.raises(RigError, match=message) as caught:
        rig_from_dict(data, "my/rig.yaml")
    assert str(caught.value).startswith("my/rig.yaml: ")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("field", ["image_size", "left", "right", "R", "T"])
def test_a_missing_field_names_the_command_that_makes_one(field):
    data = rig_to_dict(minibee())
    del data[field]
    with pytest.raises(RigError, match=f"'{field}' is missing: run 'beemap calibrate cameras'"):
        rig_from_dict(data, "rig.yaml")


def test_a_missing_focal_length_is_named():
    data = rig_to_dict(minibee())
    del data["left"]["fy"]
    with pytest.raises(RigError, match=r"left\.fy: missing"):
        rig_from_dict(data, "rig.yaml")


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=6,
)


@given(st.sampled_from(sorted(rig_to_dict(minibee()))), values)
def test_any_content_is_a_rig_or_a_rig_error(key, value):
    data = {**rig_to_dict(minibee()), key: value}
    try:
        rig = rig_from_dict(data, "rig.yaml")
    except RigError:
        return
    assert rig_to_dict(rig).keys() >= {"image_size", "left", "right", "R", "T"}


def test_files_that_are_no_rigs_are_one_line(tmp_path):
    (tmp_path / "list.yaml").write_text("[1, 2]")
    (tmp_path / "broken.yaml").write_text("beemap_rig: 1\nleft: {fx: 1\n")
    for name, message in (
        ("none.yaml", "no such file"),
        ("list.yaml", "not a rig file"),
        ("broken.yaml", "line 3: not valid YAML"),
    ):
        with pytest.raises(RigError, match=f"{name}.*{message}"):
            load_rig(tmp_path / name)


def test_a_rig_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "rig.yaml"
    save_rig(minibee(), path)
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("calibration.rig.os.replace", full)
    with pytest.raises(RigError, match=r"rig.yaml: cannot be written \(No space left"):
        save_rig(distorted_rig(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["rig.yaml"]
