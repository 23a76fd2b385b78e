"""Rig files of other programs: what is written is read back, and damage is one clear line."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.exchange import opencv_storage
from calibration.exchange.formats import RigFile, read_rig, write_rig
from calibration.exchange.lenses import without_k3
from calibration.lens import lens_of, rays
from calibration.rig import CameraModel, RigError, StereoRig
from calibration.rotation import turn_matrix
from calibration.yamlfile import dump_yaml, parse_yaml
from tests.calibration_views import undistorted
from tests.rig_files import assert_same_rig, one_rig, rigs

# ROS tells R as R2^T R1 and EuRoC by way of the body: rounding is left.
ROUNDING = 1e-9
FOUR = ("none", "radtan", "fisheye")


def through(rig: StereoRig, kind: str, folder: Path, ending: str = "") -> RigFile:
    """The rig written in a format and read back."""
    texts, _ = write_rig(rig, kind, ending)
    target = folder / f"out{ending}"
    for name, text in texts.items():
        file = target / name if name else target
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    found = read_rig(target)
    assert found.kind == kind
    return found


@pytest.mark.parametrize("ending", [".yml", ".xml", ".json", ""])
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rig=rigs())
def test_opencv_holds_every_rig_exactly(rig, ending, tmp_path):
    found = through(rig, "opencv", tmp_path, ending)
    assert_same_rig(found.rig, rig)
    assert found.notes == []


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rig=rigs(FOUR))
def test_kalibr_holds_lenses_of_four_numbers_exactly(rig, tmp_path):
    found = through(rig, "kalibr", tmp_path, ".yaml")
    assert_same_rig(found.rig, rig)
    assert found.notes == []


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rig=rigs(FOUR))
def test_euroc_holds_lenses_of_four_numbers(rig, tmp_path):
    assert_same_rig(through(rig, "euroc", tmp_path).rig, rig, ROUNDING)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rig=rigs())
def test_ros_holds_every_rig(rig, tmp_path):
    found = through(rig, "ros", tmp_path)
    assert_same_rig(found.rig, rig, ROUNDING)
    assert found.notes == []


@pytest.mark.parametrize("model", ["radtan", "fisheye"])
@pytest.mark.parametrize("angle", [2e-9, 2e-7, 9e-6, 1e-4])
def test_ros_holds_the_smallest_rotation_between_the_cameras(angle, model, tmp_path):
    R = turn_matrix(np.array([0.3, -1.0, 0.5]) * angle)
    camera = CameraModel(500.0, 500.0, 320.0, 240.0, model, (0.01, 0.0, 0.0, 0.0))
    rig = StereoRig((640, 480), camera, camera, R, -R @ np.array([0.1, 0.001, 0.0]))
    assert_same_rig(through(rig, "ros", tmp_path).rig, rig, 1e-14)


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rig=rigs())
def test_our_own_file_is_one_of_the_formats(rig, tmp_path):
    assert_same_rig(through(rig, "beemap", tmp_path, ".yaml").rig, rig)


@pytest.mark.parametrize(("kind", "ending"), [("ros", ""), ("opencv", ".yml")])
def test_images_that_are_rectified_stay_so(kind, ending, tmp_path):
    left = CameraModel(500.0, 510.0, 320.0, 240.0)
    T = np.array([-0.12, 0.0, 0.0])
    rig = StereoRig((640, 480), left, replace(left, cx=351.0), np.eye(3), T, rectified=True)
    found = through(rig, kind, tmp_path, ending)
    assert_same_rig(found.rig, rig)
    assert found.rig.rectified
    assert not through(one_rig(), kind, tmp_path, ending).rig.rectified


def test_the_rectification_in_ros_puts_both_views_of_a_point_on_one_row():
    rig = one_rig()
    texts, _ = write_rig(rig, "ros")
    points = np.random.default_rng(4).uniform([-0.3, -0.2, 1.0], [0.3, 0.2, 3.0], (30, 3))
    rectified = []
    for name, camera, R, T in (
        ("left", rig.left, np.eye(3), np.zeros(3)),
        ("right", rig.right, rig.R, rig.T),
    ):
        raw, _ = cv2.projectPoints(points, cv2.Rodrigues(R)[0], T, camera.K, camera.D)
        sheet = parse_yaml(texts[f"{name}.yaml"], name)
        K, D, R1, P = (
            np.array(sheet[key]["data"]).reshape(sheet[key]["rows"], -1)
            for key in (
                "camera_matrix",
                "distortion_coefficients",
                "rectification_matrix",
                "projection_matrix",
            )
        )
        rectified.append(undistorted(raw, K, D, R1, P))
        focal_times_baseline = -P[0, 3]
    left, right = rectified
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-6)
    # Its depth is that along the rectified axis.
    R1 = np.array(parse_yaml(texts["left.yaml"], "left")["rectification_matrix"]["data"])
    depth = points @ R1.reshape(3, 3)[2]
    np.testing.assert_allclose(focal_times_baseline / (left - right)[:, 0], depth, rtol=1e-6)


def test_cv2_itself_reads_what_is_written(tmp_path):
    rig = one_rig()
    for ending in (".yml", ".xml", ".json"):
        file = tmp_path / f"cv{ending}"
        file.write_text(write_rig(rig, "opencv", ending)[0][""])
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
        np.testing.assert_array_equal(storage.getNode("M2").mat(), rig.right.K)
        np.testing.assert_array_equal(storage.getNode("T").mat().ravel(), rig.T)
        assert storage.getNode("image_width").real() == 640


def test_the_files_of_opencvs_sample_need_size_and_unit(tmp_path):
    """stereo_calib: a board of squares of length 1, D of 14 numbers, no image size."""
    rig = one_rig()
    values = opencv_storage.values(rig)
    D = {name: np.hstack([values[name], np.zeros((1, 10))]) for name in ("D1", "D2")}
    first = {"M1": values["M1"], "D1": D["D1"], "M2": values["M2"], "D2": D["D2"]}
    second = {"R": values["R"], "T": values["T"] / 0.025}
    for name, part in (("intrinsics.yml", first), ("extrinsics.yml", second)):
        (tmp_path / name).write_text(opencv_storage.write(part, ".yml"))
    files = [tmp_path / "extrinsics.yml", tmp_path / "intrinsics.yml"]
    found = read_rig(files, size=(640, 480), unit=0.025)
    assert_same_rig(found.rig, rig, 1e-15)
    assert_same_rig(read_rig(tmp_path, size=(640, 480), unit=0.025).rig, rig, 1e-15)
    with pytest.raises(RigError, match=r"T has length 3\.33\d.*--unit 25mm"):
        read_rig(files, size=(640, 480))
    with pytest.raises(RigError, match="--size, as in 640x480"):
        read_rig(files, unit=0.025)
    with pytest.raises(RigError, match=r"intrinsics\.yml: R is missing"):
        read_rig(tmp_path / "intrinsics.yml")


def test_what_a_format_cannot_hold_is_said():
    rig = one_rig()
    for kind in ("ros", "kalibr", "opencv", "euroc"):
        told = " ".join(write_rig(rig, kind)[1])
        assert "the mount" in told
        assert "does not hold encoders, calibration: keep the rig file" in told
    assert write_rig(rig, "beemap")[1] == []
    assert write_rig(replace(rig, mount=None, sections={}), "kalibr")[1] == []


def test_the_mount_comes_back_from_euroc_beside_wheel_ticks(tmp_path):
    rig = one_rig()
    assert rig.mount is not None
    assert through(rig, "euroc", tmp_path).rig.mount is None
    (tmp_path / "out" / "odom0").mkdir()
    (tmp_path / "out" / "odom0" / "data.csv").write_text("#\n")
    mount = read_rig(tmp_path / "out").rig.mount
    assert mount is not None
    np.testing.assert_allclose(mount.rotation, rig.mount.rotation, atol=1e-12)
    np.testing.assert_allclose(mount.position, rig.mount.position, atol=1e-12)


def test_without_k3_the_lens_stays_as_near_as_is_told():
    camera = CameraModel(536.0, 536.0, 342.0, 236.0, "radtan", (-0.27, -0.04, 0.002, 0.0, 0.24))
    fitted, worst = without_k3(camera, (640, 480))
    assert len(fitted.distortion) == 4
    u, v = np.meshgrid(np.arange(0, 640, 20.0), np.arange(0, 480, 20.0))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    lens = lens_of(fitted)
    again, _, _ = lens.project(lens.intrinsics(fitted), rays(camera, pixels))
    moved = np.hypot(*(again - pixels).T)
    assert moved.max() <= worst * 1.01
    # Leaving k3 out would do far more harm.
    cut = replace(camera, distortion=camera.distortion[:4])
    again, _, _ = lens.project(lens.intrinsics(cut), rays(camera, pixels))
    assert np.hypot(*(again - pixels).T).max() > 3 * worst


def test_k3_in_kalibr_is_a_warning_and_a_rational_lens_is_refused():
    rig = one_rig()
    five = replace(rig.left, distortion=(*rig.left.distortion, 0.03))
    for kind in ("kalibr", "euroc"):
        (line, *_) = write_rig(replace(rig, left=five), kind)[1]
        assert "has no k3" in line
        assert "left camera" in line
        rational = replace(rig.left, distortion_model="rational", distortion=(0.1,) * 8)
        with pytest.raises(RigError, match=r"rational lens \(left camera\): convert to ros"):
            write_rig(replace(rig, left=rational), kind)


def test_a_fisheye_beside_another_lens_is_refused():
    rig = one_rig()
    mixed = replace(rig, left=replace(rig.left, distortion_model="fisheye"))
    with pytest.raises(RigError, match="same lens model"):
        write_rig(mixed, "ros")


# Where a value is replaced: (format, file, path of keys), and what is put there.
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=6,
)
SHEETS = {
    kind: {name: parse_yaml(text, name) for name, text in write_rig(one_rig(), kind)[0].items()}
    for kind in ("ros", "kalibr", "euroc")
}


def paths(value, here=()):
    """Every place in nested dicts and lists."""
    if here:
        yield here
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from paths(inner, (*here, key))


PLACES = [place for kind, sheets in SHEETS.items() for place in paths(sheets, (kind,))]


@settings(max_examples=80)
@given(place=st.sampled_from([p for p in PLACES if len(p) > 2]), value=ANYTHING)
def test_any_value_anywhere_is_a_rig_or_a_rig_error(place, value):
    kind, name, *keys = place
    sheets = parse_yaml(dump_yaml(SHEETS[kind]), "copy")
    inner = sheets[name]
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "out"
        for file, sheet in sheets.items():
            path = target / file if file else target
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(dump_yaml(sheet), encoding="utf-8")
        one_line_or_a_rig(target)


STORAGE = {e: write_rig(one_rig(), "opencv", e)[0][""] for e in (".yml", ".xml", ".json")}


@settings(max_examples=100)
@given(
    ending=st.sampled_from(sorted(STORAGE)),
    at=st.floats(0, 1),
    length=st.integers(0, 40),
    new=st.text(alphabet="0123456789.e-[]{}<>/:!,\"' \nMDRTabc", max_size=6),
)
def test_a_damaged_storage_is_a_rig_or_a_rig_error(ending, at, length, new):
    text = STORAGE[ending]
    start = int(at * len(text))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"cv{ending}"
        file.write_text(text[:start] + new + text[start + length :], encoding="utf-8")
        one_line_or_a_rig(file)


def one_line_or_a_rig(path: Path) -> None:
    try:
        rig = read_rig(path).rig
    except RigError as error:
        message = str(error)
    else:
        assert np.isfinite(rig.T).all()
        assert rig.left.fx > 0
        return
    assert str(path) in message
    assert len(message) < 600
