"""Left and right images find their partners by name."""

from pathlib import Path

import pytest

from calibration.errors import CalibrationError
from calibration.imagepairs import find_pairs


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
