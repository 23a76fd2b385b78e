"""Left and right images find their partners by name."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.imagepairs import RECORDING_PAIRS, find_pairs
from calibration.imagesource import ImageSource


@pytest.fixture
def shots(tmp_path):
    """A maker of empty files, by their paths under one folder."""

    def make(*names: str) -> Path:
        for name in names:
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        return tmp_path

    return make


def names(found) -> list[tuple[str, str]]:
    return [(pair.left.name, pair.right.name) for pair in found.pairs]


def test_globs_match_by_number_and_name_the_images_alone(shots):
    folder = shots("left01.png", "left02.png", "left10.png", "right10.png", "right1.png")
    found = find_pairs(f"{folder}/left*", f"{folder}/right*")
    assert names(found) == [("left01.png", "right1.png"), ("left10.png", "right10.png")]
    assert [path.name for path in found.unmatched] == ["left02.png"]
    assert found.matched_by == "number"


def test_folders_match_and_other_files_are_passed_over(shots):
    folder = shots("a/7.JPG", "a/8.JPG", "a/notes.txt", "b/8.png", "b/7.png")
    found = find_pairs(f"{folder}/a", f"{folder}/b")
    assert names(found) == [("7.JPG", "7.png"), ("8.JPG", "8.png")]


def test_a_camera_number_at_the_end_is_not_the_pairs_number(shots):
    folder = shots("p2_cam0.png", "p1_cam0.png", "p1_cam1.png", "p2_cam1.png")
    found = find_pairs(f"{folder}/*cam0*", f"{folder}/*cam1*")
    assert names(found) == [("p1_cam0.png", "p1_cam1.png"), ("p2_cam0.png", "p2_cam1.png")]


@pytest.mark.parametrize(
    "files",
    [
        ("a/front.png", "a/tilted.png", "b/one.png", "b/two.png"),
        ("a/1.png", "a/2.png", "b/11.png", "b/12.png"),
    ],
)
def test_without_common_numbers_equal_counts_pair_in_order(shots, files):
    folder = shots(*files)
    found = find_pairs(f"{folder}/a", f"{folder}/b")
    assert [pair.left.name for pair in found.pairs] == [Path(f).name for f in files[:2]]
    assert [pair.right.name for pair in found.pairs] == [Path(f).name for f in files[2:]]
    assert found.matched_by == "order"


@pytest.mark.parametrize(
    ("files", "left", "right", "message"),
    [
        (("a/x.png", "b/y.png", "b/z.png"), "a", "b", "a has 1 images and .*b has 2"),
        (("a/1.png",), "nowhere", "a", "nowhere: no such folder"),
        (("a/1.png", "b/1.txt"), "a", "b", "b: no image in this folder"),
        (("a/1.png",), "a", "right*", r"right\*: no image matches"),
        (("a/1.png",), "a", "a/*.png", "same images"),
    ],
)
def test_what_cannot_be_matched_is_one_line(shots, files, left, right, message):
    folder = shots(*files)
    with pytest.raises(CalibrationError, match=message) as caught:
        find_pairs(f"{folder}/{left}", f"{folder}/{right}")
    assert len(str(caught.value).splitlines()) == 1


def test_a_recording_is_one_argument(shots):
    stamps = [1403715273262142976 + n * 50_000_000 for n in range(3)]
    folder = shots(*(f"rec/mav0/cam{c}/data/{stamp}.png" for c in (0, 1) for stamp in stamps))
    shots("rec/mav0/cam0/data.csv", "rec/mav0/cam0/sensor.yaml")
    for source in (folder / "rec", folder / "rec" / "mav0"):
        found = find_pairs(str(source))
        assert names(found) == [(f"{stamp}.png", f"{stamp}.png") for stamp in stamps]
        assert {pair.left.path.parent.parent.name for pair in found.pairs} == {"cam0"}
        assert {pair.right.path.parent.parent.name for pair in found.pairs} == {"cam1"}


def test_of_a_long_recording_pairs_from_all_of_it_are_looked_at(shots):
    count = 3 * RECORDING_PAIRS + 7
    folder = shots(*(f"rec/cam{c}/{n:06d}.jpg" for c in (0, 1) for n in range(count)))
    found = find_pairs(str(folder / "rec"))
    assert len(found.pairs) == RECORDING_PAIRS
    assert found.passed_over == count - RECORDING_PAIRS
    numbers = [int(pair.left.path.stem) for pair in found.pairs]
    assert numbers[0] == 0
    assert numbers[-1] >= count - 4
    assert set(np.diff(numbers)) == {3, 4}


def test_subfolders_left_and_right_are_one_argument(shots):
    folder = shots("Left/7.png", "Left/8.png", "Right/7.png", "Right/8.png", "notes.txt")
    assert names(find_pairs(str(folder))) == [("7.png", "7.png"), ("8.png", "8.png")]


def test_left_and_right_in_the_names_are_one_argument(shots):
    folder = shots("left01.png", "right01.png", "left02.png", "Right02.png", "rig.png")
    for source in (str(folder), f"{folder}/*.png"):
        found = find_pairs(source)
        assert names(found) == [("left01.png", "right01.png"), ("left02.png", "Right02.png")]
        assert [path.name for path in found.unmatched] == ["rig.png"]


def test_images_side_by_side_are_split(tmp_path):
    both = np.zeros((48, 128), np.uint8)
    both[:, 64:] = 200
    for n in (1, 2):
        cv2.imwrite(str(tmp_path / f"{n}.png"), both)
    found = find_pairs(str(tmp_path))
    assert found.matched_by == "halves"
    left, right = found.pairs[1].left, found.pairs[1].right
    assert (left, right.name) == (ImageSource(tmp_path / "2.png", "left"), "2.png (right half)")
    images = left.read(), right.read()
    assert [None if i is None else (i.shape, int(i.mean())) for i in images] == [
        ((48, 64), 0),
        ((48, 64), 200),
    ]


def test_one_argument_that_holds_no_pairs_says_so(tmp_path):
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((48, 64), np.uint8))
    with pytest.raises(CalibrationError, match=r"1\.png of 64x48 pixels does not hold two images"):
        find_pairs(str(tmp_path))
    (tmp_path / "1.png").write_bytes(b"torn")
    with pytest.raises(CalibrationError, match="none of the 1 images can be read"):
        find_pairs(str(tmp_path))
    with pytest.raises(CalibrationError, match="no such folder"):
        find_pairs(str(tmp_path / "nowhere"))


def test_a_recording_with_other_frames_in_each_camera_names_those_alone(shots):
    folder = shots(*(f"mav0/cam0/data/{n}.png" for n in (10, 20, 30)), "mav0/cam1/data/20.png")
    found = find_pairs(str(folder))
    assert names(found) == [("20.png", "20.png")]
    assert [path.name for path in found.unmatched] == ["10.png", "30.png"]
