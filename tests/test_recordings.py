"""Recordings of every format are recognised and read; damage is counted and named."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.recordings import open_recording
from pipeline.recordings.base import (
    PAIR_TOLERANCE,
    DamagedFrameError,
    Recording,
    counted,
    looks_damaged,
    match_pairs,
    read_image,
)
from pipeline.rig import choose_rig
from tests.conftest import PAIRS
from tests.stereo_rigs import texture

P_LEFT = [100.0, 0.0, 15.5, 0.0, 0.0, 100.0, 11.5, 0.0, 0.0, 0.0, 1.0, 0.0]
P_RIGHT = [100.0, 0.0, 15.5, -50.0, 0.0, 100.0, 11.5, 0.0, 0.0, 0.0, 1.0, 0.0]


def write_images(folder: Path, names: list[str], ending: str = "png") -> None:
    folder.mkdir(parents=True)
    for i, name in enumerate(names):
        assert cv2.imwrite(str(folder / f"{name}.{ending}"), texture((24, 32), i))


def kitti(folder: Path, names: list[str], sides=("image_0", "image_1"), labels=True) -> Path:
    for side in sides:
        write_images(folder / side, names)
    rows = [" ".join(f"{v:.6e}" for v in row) for row in (P_LEFT, P_RIGHT)]
    if labels:
        rows = [f"P{i}: {row}" for i, row in enumerate(rows)] + ["Tr: 1 0 0"]
    (folder / "calib.txt").write_text("\n".join(rows) + "\n")
    return folder


def plain(folder: Path, left: list[str], right: list[str]) -> Path:
    write_images(folder / "left", left)
    write_images(folder / "right", right)
    return folder


def stamps(recording: Recording) -> list[int]:
    return [pair.stamp for pair in recording.pairs]


# EuRoC/ASL


def test_the_native_recording_is_read_whole(office):
    recording = open_recording(office)
    assert recording.kind == "EuRoC/ASL folder"
    assert len(recording.pairs) == 40
    assert set(np.diff(stamps(recording))) == {500_000_000}
    assert recording.skipped == {}
    rig = recording.rig
    assert rig is not None
    assert rig.image_size == (320, 240)
    assert rig.baseline == pytest.approx(0.12, abs=1e-3)
    assert rig.mount is not None
    assert rig.mount.height == pytest.approx(0.3)
    assert recording.encoders is not None
    assert recording.encoders.counter_bits == 16
    assert recording.ticks is not None
    assert recording.ticks.stamps[0] <= stamps(recording)[0] < recording.ticks.stamps[-1]
    assert recording.poses is not None
    assert recording.poses.stamps.tolist() == stamps(recording)
    pair = recording.pairs[0].load()
    assert pair.left.shape == pair.right.shape == (240, 320)


def test_the_inner_folder_and_a_link_to_it_are_recognised_too(office, tmp_path):
    assert len(open_recording(office / "mav0").pairs) == 40
    (tmp_path / "a link").symlink_to(office)
    assert len(open_recording(tmp_path / "a link").pairs) == 40


def test_without_wheels_the_body_is_no_robot(office):
    (office / "mav0" / "odom0" / "data.csv").unlink()
    recording = open_recording(office)
    assert recording.ticks is None
    assert recording.rig is not None
    assert recording.rig.mount is None


def edit(table: Path, change) -> None:
    lines = change(table.read_text().splitlines())
    table.write_text("\n".join(lines) + "\n")


def test_tables_of_other_programs_are_read(office):
    """A byte order mark, Windows line ends, blanks, no header, blank lines."""
    for camera in ("cam0", "cam1"):
        table = office / "mav0" / camera / "data.csv"
        lines = [line.replace(",", " , ") for line in table.read_text().splitlines()[1:]]
        table.write_bytes(b"\xef\xbb\xbf" + "\r\n".join([*lines, "", " "]).encode())
    recording = open_recording(office)
    assert len(recording.pairs) == 40
    assert recording.skipped == {}


def test_damage_in_the_lists_is_counted_and_named(office):
    cam0, cam1 = office / "mav0" / "cam0", office / "mav0" / "cam1"
    garbled = ["1#$%,x", "²,a.jpg", "9" * 25 + ",b"]
    edit(cam0 / "data.csv", lambda lines: [*lines[:5], *garbled, *lines[5:]])
    edit(cam1 / "data.csv", lambda lines: lines[:10] + lines[11:])
    (cam0 / "data" / "1003000000000.jpg").unlink()
    recording = open_recording(office)
    assert len(recording.pairs) == 38
    assert recording.skipped == {
        "garbled line in an image list": [f"cam0/data.csv line {n}" for n in (6, 7, 8)],
        "listed image is missing": ["cam0/data/1003000000000.jpg"],
        "left image without a right one": ["1004500000000.jpg"],
        "right image without a left one": ["1003000000000.jpg"],
    }


def test_damage_in_the_truth_is_counted(office):
    table = office / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    bad = ["1003,1,2", "x,0,0,0,1,0,0,0", "1005000000000,0,0,0,nan,0,0,0"]
    edit(table, lambda lines: [*lines[:3], *bad, *lines[3:]])
    recording = open_recording(office)
    assert recording.skipped == {"garbled line in the ground truth": ["line 4", "line 5", "line 6"]}
    assert recording.poses is not None
    assert len(recording.poses) == 40


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("intrinsics: [246.4,", "intrinsics: [.nan,", "intrinsics: expected 4 numbers"),
        ("intrinsics: [246.4,", "intrinsics: [-246.4,", "left.fx: -246.4 must be positive"),
        ("radial-tangential", "wavy", "distortion_model 'wavy' is not known"),
        ("data: [0.0, 0.0, 1.0,", "data: [0.0, 0.0, 0.0,", "no rotation matrix"),
        ("data: [0.0, 0.0,", "data: [0.0,", "T_BS.data: expected 16 numbers"),
        ("resolution: [320, 240]", "resolution: 320", "resolution: expected 2 numbers"),
        ("sensor_type", "{sensor_type", "not valid YAML"),
    ],
)
def test_a_wrong_calibration_is_named_and_the_recording_opens(office, old, new, message):
    sheet = office / "mav0" / "cam0" / "sensor.yaml"
    text = sheet.read_text()
    assert old in text
    sheet.write_text(text.replace(old, new))
    recording = open_recording(office)
    assert recording.rig is None
    with pytest.raises(InputError, match=message) as error:
        choose_rig(recording, None)
    assert "sensor.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_lone_camera_is_no_stereo_recording(office):
    (office / "mav0" / "cam1" / "data.csv").unlink()
    with pytest.raises(InputError, match=r"cam1/data\.csv: missing: a stereo recording needs"):
        open_recording(office)


@pytest.mark.parametrize("content", ["", "#timestamp [ns],filename\n", "\n\n"])
def test_an_empty_list_is_refused_where_no_name_of_an_image_is_a_stamp(office, content):
    cam0 = office / "mav0" / "cam0"
    (cam0 / "data.csv").write_text(content)
    assert len(open_recording(office).pairs) == PAIRS
    for image in (cam0 / "data").iterdir():
        image.rename(image.with_name(f"x{image.name}"))
    with pytest.raises(InputError, match=r"cam0/data\.csv: lists no image"):
        open_recording(office)


# KITTI


@pytest.mark.parametrize("sides", [("image_0", "image_1"), ("image_l", "image_r")])
@pytest.mark.parametrize("labels", [True, False])
def test_kitti_folders_are_read(tmp_path, sides, labels):
    folder = kitti(tmp_path, ["000000", "000001", "000002"], sides, labels)
    recording = open_recording(folder)
    assert recording.kind == "KITTI odometry folder"
    assert stamps(recording) == [0, 100_000_000, 200_000_000]
    rig = recording.rig
    assert rig is not None
    assert rig.rectified
    assert rig.baseline == pytest.approx(0.5)
    assert rig.image_size == (32, 24)
    assert (rig.left.fx, rig.left.cx) == (100.0, 15.5)
    assert recording.poses is None


def test_kitti_times_and_poses_belong_to_the_frames(tmp_path):
    names = ["000000", "000001", "000002", "000003"]
    folder = kitti(tmp_path, names)
    (folder / "times.txt").write_text("0.0\n1.5e-01\n0.300000001\n0.45\n")
    # Two metres forward a frame, half a metre to the left, turned by 30 deg to the left.
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    rows = [[c, 0, -s, -0.5 * i, 0, 1, 0, 0, s, 0, c, 2.0 * i] for i in range(4)]
    (folder / "poses.txt").write_text("\n".join(" ".join(map(str, row)) for row in rows))
    (folder / "image_0" / "000001.png").unlink()
    (folder / "image_1" / "000002.png").unlink()
    recording = open_recording(folder)
    assert stamps(recording) == [0, 450_000_000]
    assert recording.skipped == {
        "left image without a right one": ["000002.png"],
        "right image without a left one": ["000001.png"],
    }
    assert recording.poses is not None
    assert recording.poses.stamps.tolist() == [0, 150_000_000, 300_000_001, 450_000_000]
    assert recording.poses.poses[3] == pytest.approx([6.0, 1.5, math.radians(30)])


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("calib.txt", "P0: 1 2 3\n", "needs two rows of 12 numbers"),
        ("calib.txt", "P0: a b c\n", "calib.txt, line 1: not numbers"),
        ("calib.txt", "0 " * 12 + "\n" + "0 " * 12, "focal lengths must be positive"),
        ("times.txt", "0.0\nsoon\n", "one time in seconds a line"),
        ("times.txt", "0.0\n", "1 times for 2 images"),
        ("poses.txt", "1 0 0\n", "poses.txt, line 1: expected 12 numbers"),
        ("poses.txt", "\n", "holds no pose"),
    ],
)
def test_wrong_kitti_tables_are_named(tmp_path, file, content, message):
    folder = kitti(tmp_path, ["000000", "000001"])
    (folder / file).write_text(content)
    with pytest.raises(InputError, match=message):
        open_recording(folder)


def test_exchanged_kitti_cameras_are_refused(tmp_path):
    folder = kitti(tmp_path, ["000000"])
    lines = (folder / "calib.txt").read_text().splitlines()
    text = "\n".join([lines[0].replace("P0", "P1"), lines[1].replace("P1", "P0")])
    (folder / "calib.txt").write_text(text)
    with pytest.raises(InputError, match="the second camera is not right of the first"):
        open_recording(folder)


# left/ and right/ folders


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (
            ["1403636579763555584", "1403636579813555456"],
            [1403636579763555584, 1403636579813555456],
        ),
        (["1000000000000000"], [1000000000000000]),
        (["12.5", "12.600000001"], [12_500_000_000, 12_600_000_001]),
        (["1403636579", "1403636580"], [1403636579_000_000_000, 1403636580_000_000_000]),
    ],
)
def test_stamps_come_from_the_names(tmp_path, names, expected):
    assert stamps(open_recording(plain(tmp_path, names, names))) == expected


def test_frames_numbered_need_a_rate(tmp_path):
    folder = plain(tmp_path, ["left_01", "left_02"], ["right_01", "right_02"])
    with pytest.raises(
        InputError, match=r"left_01.png: the name is no time in ns or s: give --fps"
    ):
        open_recording(folder)
    assert stamps(open_recording(folder, fps=4.0)) == [0, 250_000_000]


@pytest.mark.parametrize("fps", [2.0, 240.0])
def test_a_missing_image_does_not_shift_the_others(tmp_path, fps):
    left, right = [f"l{i:03}" for i in range(6)], [f"r{i:03}" for i in range(6)]
    del left[4], right[2]
    recording = open_recording(plain(tmp_path, left, right), fps)
    numbers = [tuple(file.stem[1:] for file in pair.files) for pair in recording.pairs]
    assert numbers == [("000", "000"), ("001", "001"), ("003", "003"), ("005", "005")]
    assert stamps(recording) == [i * round(1e9 / fps) for i in (0, 1, 3, 5)]
    assert recording.skipped == {
        "left image without a right one": ["l002.png"],
        "right image without a left one": ["r004.png"],
    }


def test_an_empty_side_is_named(tmp_path):
    folder = plain(tmp_path, ["1.0"], [])
    with pytest.raises(InputError, match="right: holds no image"):
        open_recording(folder)


# Whatever the format


def test_what_was_looked_for_is_told(tmp_path):
    (tmp_path / "photo.png").write_bytes(b"")
    with pytest.raises(InputError) as error:
        open_recording(tmp_path)
    for place in ("mav0/cam0/data.csv", "calib.txt with image_0/image_1", "left/ and right/"):
        assert place in str(error.value)
    with pytest.raises(InputError, match="gone: no such folder"):
        open_recording(tmp_path / "gone")
    with pytest.raises(InputError, match="not a recording I know"):
        open_recording(tmp_path / "photo.png")


def test_stamps_within_the_tolerance_are_pairs():
    recording = Recording(Path("here"), "", [])
    left = [(i * 100_000_000, Path(f"l{i}")) for i in range(4)]
    offsets = (PAIR_TOLERANCE, -PAIR_TOLERANCE, PAIR_TOLERANCE + 1, 0)
    right = [(left[i][0] + offset, Path(f"r{i}")) for i, offset in enumerate(offsets)]
    pairs = match_pairs(left, right, recording)
    assert [pair.left.name + pair.right.name for pair in pairs] == ["l0r0", "l1r1", "l3r3"]
    assert recording.skipped["left image without a right one"] == ["l2"]


def test_cameras_with_other_clocks_are_refused():
    recording = Recording(Path("here"), "", [])
    with pytest.raises(InputError, match="none of 1 left and 1 right images belong together"):
        match_pairs([(0, Path("l"))], [(10**9, Path("r"))], recording)


times = st.lists(st.integers(0, 200_000_000), min_size=1, max_size=30)


@given(times, times)
def test_every_image_is_used_once_or_named(left, right):
    recording = Recording(Path("here"), "", [])
    lefts = [(stamp, Path(f"l{i}")) for i, stamp in enumerate(left)]
    rights = [(stamp, Path(f"r{i}")) for i, stamp in enumerate(right)]
    try:
        pairs = match_pairs(lefts, rights, recording)
    except InputError:
        assert min(abs(a - b) for a in left for b in right) > PAIR_TOLERANCE
        return
    stamp_of = {path.name: stamp for stamp, path in lefts + rights}
    for pair in pairs:
        assert abs(stamp_of[pair.left.name] - stamp_of[pair.right.name]) <= PAIR_TOLERANCE
    used = [path.name for pair in pairs for path in (pair.left, pair.right)]
    lonely = [name for names in recording.skipped.values() for name in names]
    assert sorted(used + lonely) == sorted(stamp_of)


@pytest.mark.parametrize("ending", ["png", "jpg"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_images_cut_short_are_damaged(tmp_path, ending, share):
    file = tmp_path / f"a.{ending}"
    cv2.imwrite(str(file), texture((240, 320)))
    assert not looks_damaged(file)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    assert looks_damaged(file)
    with pytest.raises(DamagedFrameError, match=f"a.{ending}: "):
        read_image(file)
    # A power cut leaves zeros where the data should be.
    file.write_bytes(whole[: int(share * len(whole))].ljust(len(whole), b"\0"))
    with pytest.raises(DamagedFrameError):
        read_image(file)


def test_a_jpeg_padded_by_its_camera_is_whole(tmp_path):
    file = tmp_path / "a.jpg"
    cv2.imwrite(str(file), texture((24, 32)))
    expected = read_image(file)
    file.write_bytes(file.read_bytes() + bytes(1000))
    assert not looks_damaged(file)
    assert np.array_equal(read_image(file), expected)


@pytest.mark.parametrize("content", [b"hello", b"\x89PNG\r\n\x1a\n" + b"IEND", b"\xff\xd8\xff\xd9"])
def test_what_is_no_image_is_damaged(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(DamagedFrameError, match="not a readable image"):
        read_image(tmp_path / "a.png")
    with pytest.raises(DamagedFrameError, match="No such file"):
        read_image(tmp_path / "gone.png")


def test_images_of_every_depth_become_eight_bits(tmp_path):
    grey = texture((24, 32))
    cv2.imwrite(str(tmp_path / "deep.png"), grey.astype(np.uint16) * 257)
    cv2.imwrite(str(tmp_path / "colour.png"), cv2.merge([grey, grey // 2, grey // 4]))
    assert np.array_equal(read_image(tmp_path / "deep.png"), grey)
    colour = read_image(tmp_path / "colour.png")
    assert colour.shape == (24, 32, 3)
    assert colour.dtype == np.uint8
    assert np.array_equal(colour[..., 0], grey)


def test_long_lists_of_names_are_cut():
    assert counted(["a", "b"]) == "2 (a, b)"
    assert counted(list("abcde")) == "5 (a, b, c and 2 more)"
