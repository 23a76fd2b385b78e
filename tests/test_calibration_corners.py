"""What image files show, looked at once, several at a time; and numbering within a pair."""

import cv2
import numpy as np
import pytest

from calibration.board import Board, parse_board
from calibration.corners import look, look_at_all
from calibration.correspondence import pair_sightings, symmetries
from calibration.detection import find_board
from calibration.detections_cache import default_cache_folder
from calibration.imagesource import ImageSource
from calibration.sighting import Sighting
from tests.calibration_drawings import photograph, view
from tests.calibration_views import BOARD, SMALL_RIG, board_poses, project, render

SYMMETRIC = Board(6, 4, 0.03)


def whole(corners: np.ndarray) -> Sighting:
    return Sighting(np.arange(len(corners)), corners)


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """Image files of the board, one of them without it."""
    folder = tmp_path_factory.mktemp("shots")
    for number, pose in enumerate(board_poses(3, seed=5, distance=(0.45, 0.6))):
        cv2.imwrite(str(folder / f"{number}.png"), render(SMALL_RIG, pose)[0])
    cv2.imwrite(str(folder / "wall.png"), np.full((240, 320), 90, np.uint8))
    return sorted(folder.iterdir())


@pytest.mark.parametrize("seed", range(4))
def test_corners_of_a_drawn_board_are_found_to_a_tenth_of_a_pixel(seed):
    (pose,) = board_poses(1, seed, distance=(0.45, 0.6))
    truth, _ = project(SMALL_RIG, pose)
    image, _ = render(SMALL_RIG, pose)
    found = find_board(image, BOARD)
    assert found is not None
    # OpenCV may number this board from its other end.
    off = [np.linalg.norm(c - truth, axis=1) for c in (found.corners, found.corners[::-1])]
    assert min(np.sqrt(np.mean(o**2)) for o in off) < 0.1


def test_a_badly_blurred_board_is_still_found():
    (pose,) = board_poses(1, 1, distance=(0.45, 0.5))
    image, _ = render(SMALL_RIG, pose)
    blurred = cv2.GaussianBlur(image, (0, 0), 3.5)
    squares_only = cv2.findChessboardCorners(blurred, (BOARD.columns, BOARD.rows))[0]
    assert not squares_only
    assert find_board(blurred, BOARD) is not None


def test_a_cut_board_gives_none():
    (pose,) = board_poses(1, 1)
    image, _ = render(SMALL_RIG, pose)
    image[:, 160:] = 110
    assert find_board(image, BOARD) is None


def test_an_image_of_no_use_says_why(tmp_path):
    (tmp_path / "torn.png").write_bytes(b"\x89PNG\r\n\x1a\n torn")
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((240, 320), 90, np.uint8))
    assert look(tmp_path / "torn.png", BOARD).reason == "torn.png cannot be read"
    assert look(tmp_path / "none.png", BOARD).reason == "none.png cannot be read"
    seen = look(tmp_path / "wall.png", BOARD)
    assert (seen.size, seen.reason) == ((320, 240), "no whole board in wall.png")
    coded = look(tmp_path / "wall.png", parse_board("charuco:8x6", 0.03))
    assert coded.reason == "no board in wall.png"


def test_colour_and_16_bit_images_show_the_same_board(shots, tmp_path):
    grey = cv2.imread(str(shots[0]), cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    cv2.imwrite(str(tmp_path / "colour.png"), cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
    # A camera of 12 bits in a file of 16
    cv2.imwrite(str(tmp_path / "deep.png"), grey.astype(np.uint16) * 16)
    expected = look(shots[0], BOARD).sighting
    assert expected is not None
    for name in ("colour.png", "deep.png"):
        sighting = look(tmp_path / name, BOARD).sighting
        assert sighting is not None
        np.testing.assert_allclose(sighting.corners, expected.corners, atol=0.02)


def test_a_half_of_a_side_by_side_image_is_an_image(shots, tmp_path):
    images = [ImageSource(path).read() for path in shots[:2]]
    both = np.hstack([image for image in images if image is not None])
    cv2.imwrite(str(tmp_path / "both.png"), both)
    for half, alone in zip(("left", "right"), shots[:2], strict=True):
        seen = look(ImageSource(tmp_path / "both.png", half), BOARD, tmp_path / "cache")
        expected = look(alone, BOARD).sighting
        assert seen.size == (320, 240)
        assert seen.name == f"both.png ({half} half)"
        assert seen.sighting is not None
        assert expected is not None
        np.testing.assert_array_equal(seen.sighting.corners, expected.corners)


def test_all_images_in_order_whatever_the_workers(shots):
    done = []
    one = look_at_all(shots, BOARD, progress=lambda *now: done.append(now), workers=1)
    many = look_at_all(shots, BOARD, workers=4)
    assert done == [(n, 4) for n in (1, 2, 3, 4)]
    assert [image.path for image in many] == shots
    assert [image.reason for image in many] == [None] * 3 + ["no whole board in wall.png"]
    for a, b in zip(one[:3], many[:3], strict=True):
        assert a.sighting is not None
        assert b.sighting is not None
        np.testing.assert_array_equal(a.sighting.corners, b.sighting.corners)
        assert a.blur == b.blur


def test_a_second_look_decodes_nothing_and_gives_the_same(shots, tmp_path, monkeypatch):
    first = look_at_all(shots, BOARD, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(ImageSource, "decode", lambda *_: pytest.fail("decoded"))
        second = look_at_all(shots, BOARD, tmp_path)
        # The squares' size is no part of what is seen.
        look_at_all(shots, Board(9, 6, 0.031), tmp_path)
    for a, b in zip(first, second, strict=True):
        assert (a.path, a.size, a.blur, a.missing) == (b.path, b.size, b.blur, b.missing)
        if a.sighting is not None and b.sighting is not None:
            np.testing.assert_array_equal(a.sighting.ids, b.sighting.ids)
            np.testing.assert_array_equal(a.sighting.corners, b.sighting.corners)
    assert look(shots[0], SYMMETRIC, tmp_path).sighting is None


@pytest.mark.parametrize(
    "damage",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b'{"size": [320, 240], "ids": [0], "corners": [[1, null]], "blur": 1, "missing": null}',
        b'{"size": [320, 240], "ids": [54], "corners": [[1, 2]], "blur": 1, "missing": null}',
        b'{"size": [320, 240], "ids": [0, 0], "corners": [[1, 2], [1, 2]], "blur": 1}',
        b'{"size": [320, 240], "ids": [0], "corners": [[1, NaN]], "blur": 1, "missing": null}',
        b"\xff\xfe",
    ],
)
def test_a_damaged_cache_is_made_again(shots, tmp_path, damage):
    expected = look(shots[0], BOARD, tmp_path)
    (kept,) = tmp_path.rglob("*.json")
    good = kept.read_bytes()
    kept.write_bytes(damage)
    seen = look(shots[0], BOARD, tmp_path)
    assert seen.sighting is not None
    assert expected.sighting is not None
    np.testing.assert_array_equal(seen.sighting.corners, expected.sighting.corners)
    assert kept.read_bytes() == good


def test_a_cache_that_cannot_be_written_costs_nothing_but_time(shots, tmp_path):
    (tmp_path / "file").touch()
    assert look(shots[0], BOARD, tmp_path / "file" / "cache").sighting is not None


def test_the_cache_is_where_the_desktop_puts_it(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_cache_folder() == tmp_path / "beemap" / "boards"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert default_cache_folder() == tmp_path / "home" / ".cache" / "beemap" / "boards"


@pytest.mark.parametrize(
    ("text", "ways"),
    [
        ("chessboard:6x4", 2),
        ("chessboard:5x5", 4),
        ("circles:7x5", 2),
        ("circles:5x5", 4),
        ("acircles:4x11", 1),
        ("acircles:4x10", 2),
        ("charuco:6x6", 1),
        ("aprilgrid:4x4", 1),
    ],
)
def test_a_board_numbered_from_another_side_is_put_right(text, ways):
    board = parse_board(text, 0.03)
    turned = symmetries(board)
    assert len(turned) == ways
    for seed, ids in enumerate(turned):
        (pose,) = board_poses(1, seed, board)
        left, right = project(SMALL_RIG, pose, board)
        pair, changed = pair_sightings(whole(left), whole(right[ids]), board)
        assert changed == (seed != 0)
        np.testing.assert_array_equal(pair.right.ids, np.arange(len(left)))
        np.testing.assert_array_equal(pair.right.corners, right)


def test_a_coded_board_seen_in_part_keeps_its_numbers():
    board = parse_board("charuco:6x6", 0.03)
    (pose,) = board_poses(1, 0, board)
    left, right = project(SMALL_RIG, pose, board)
    pair, changed = pair_sightings(
        Sighting(np.arange(10), left[:10]), Sighting(np.arange(5, 25), right[5:25]), board
    )
    assert not changed
    ids, in_left, in_right = pair.common()
    np.testing.assert_array_equal(ids, np.arange(5, 10))
    np.testing.assert_array_equal(in_left, left[5:10])
    np.testing.assert_array_equal(in_right, right[5:10])


def test_opencvs_numbering_of_symmetric_boards_is_put_right_in_photographs():
    board = parse_board("circles:5x5", 0.03)
    homography, _ = view(board, 1)
    shifted = np.array([[1, 0, -30], [0, 1, 2], [0, 0, 1.0]]) @ homography
    in_left, in_right = (
        find_board(photograph(board, seen, (640, 480)), board) for seen in (homography, shifted)
    )
    assert in_left is not None
    assert in_right is not None
    # One image numbered from the other end, as a detector may.
    ids = symmetries(board)[1]
    turned = Sighting(np.arange(25), in_right.corners[ids])
    pair, _ = pair_sightings(in_left, turned, board)
    ids, left, right = pair.common()
    assert len(ids) == 25
    np.testing.assert_allclose(left - right, np.tile([30, -2], (25, 1)), atol=0.15)
