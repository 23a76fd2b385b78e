"""Every kind of board, photographed as it is printed, is found where it is."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.board import Board, parse_board
from calibration.chessboards import search_chessboard
from calibration.corners import look_at_all
from calibration.correspondence import symmetries
from calibration.detection import detect, find_board
from tests.calibration_drawings import photograph, view

REAL_DATA = os.environ.get("BEEMAP_REAL_DATA")


def off_truth(board: Board, sighting, truth: np.ndarray) -> np.ndarray:
    """How far (n,) px each corner is from the truth, in that numbering that fits best."""
    off = [
        np.linalg.norm(sighting.corners - truth[ids][sighting.ids], axis=1)
        for ids in symmetries(board)
    ]
    return min(off, key=np.sum)


@pytest.mark.parametrize(
    ("text", "rms", "share"),
    [
        ("chessboard:9x6", 0.05, 1.0),
        ("chessboard:6x9", 0.05, 1.0),
        ("charuco:8x6", 0.06, 1.0),
        ("charuco:9x7", 0.06, 1.0),
        ("circles:7x5", 0.03, 1.0),
        ("acircles:4x11", 0.03, 1.0),
        ("aprilgrid:6x5", 0.08, 0.9),
    ],
)
def test_corners_are_where_they_were_printed(text, rms, share):
    board = parse_board(text, 0.03)
    for seed in range(3):
        homography, truth = view(board, seed)
        sighting = find_board(photograph(board, homography, (640, 480), seed=seed), board)
        assert sighting is not None
        assert len(sighting.ids) >= share * len(board.points)
        assert np.all(np.diff(sighting.ids) > 0)
        off = off_truth(board, sighting, truth)
        assert np.sqrt(np.mean(off**2)) < rms
        assert off.max() < 6 * rms


@pytest.mark.parametrize("text", ["chessboard:9x6", "charuco:8x6", "acircles:4x11"])
def test_a_large_image_gives_the_same_fraction_of_a_pixel(text):
    board = parse_board(text, 0.03)
    homography, truth = view(board, 1, (2200, 1650))
    sighting = find_board(photograph(board, homography, (2200, 1650)), board)
    assert sighting is not None
    assert np.sqrt(np.mean(off_truth(board, sighting, truth) ** 2)) < 0.06


@pytest.mark.parametrize(
    "text", ["chessboard:9x6", "charuco:8x6", "circles:7x5", "acircles:4x11", "aprilgrid:6x5"]
)
def test_a_strongly_bent_image_is_no_obstacle(text):
    board = parse_board(text, 0.03)
    homography, flat = view(board, 1, share=0.9)
    K = np.array([[350.0, 0, 320], [0, 350, 240], [0, 0, 1]])
    lens = np.array([-0.28, 0.07, 0, 0])
    pixels = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1).reshape(-1, 1, 2)
    seen_from = cv2.undistortPoints(pixels, K, lens, P=K).reshape(480, 640, 2).astype(np.float32)
    wider = np.array([[1, 0, 320], [0, 1, 240], [0, 0, 1]])
    straight = photograph(board, wider @ homography, (1280, 960), noise=0)
    seen_from += np.array([320, 240], np.float32)
    u, v = seen_from[..., 0], seen_from[..., 1]
    bent = cv2.remap(straight, u, v, cv2.INTER_LINEAR, borderValue=(110,))
    rays = np.column_stack([(flat - K[:2, 2]) / 350, np.ones(len(flat))])
    truth = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, lens)[0].reshape(-1, 2)
    assert np.linalg.norm(truth - flat, axis=1).max() > 20
    sighting = find_board(bent, board)
    assert sighting is not None
    assert len(sighting.ids) > 0.9 * len(board.points)
    assert np.sqrt(np.mean(off_truth(board, sighting, truth) ** 2)) < 0.15


@pytest.mark.parametrize("text", ["charuco:8x6", "aprilgrid:6x5"])
def test_a_part_of_a_coded_board_keeps_its_numbers(text):
    board = parse_board(text, 0.03)
    homography, truth = view(board, 2, share=1.6)
    inside = np.all((truth > 0) & (truth < (639, 479)), axis=1)
    assert 0.2 < inside.mean() < 0.9
    sighting = find_board(photograph(board, homography, (640, 480)), board)
    assert sighting is not None
    assert 0.5 * inside.sum() < len(sighting.ids) <= inside.sum()
    assert np.linalg.norm(sighting.corners - truth[sighting.ids], axis=1).max() < 0.4


def test_a_corner_under_a_finger_is_not_invented():
    board = parse_board("charuco:8x6", 0.03)
    homography, truth = view(board, 3)
    image = photograph(board, homography, (640, 480))
    u, v = np.rint(truth[17]).astype(int).tolist()
    cv2.circle(image, (u, v), 16, (140,), -1)
    sighting = find_board(image, board)
    assert sighting is not None
    assert np.linalg.norm(sighting.corners - truth[sighting.ids], axis=1).max() < 0.5
    assert len(sighting.ids) > 25


def test_too_little_of_a_board_says_how_many_corners_are_seen():
    board = parse_board("charuco:8x6", 0.03)
    homography, truth = view(board, 0)
    image = photograph(board, homography, (640, 480))
    image[:, int(truth[:, 0].min() + 40) :] = 110
    found = detect(image, board)
    assert found.sighting is None
    assert found.missing in ("no board", "only 5 corners of the board (at least 6, off a line)")


@pytest.mark.parametrize("rows", [6, 7])
@pytest.mark.parametrize("legacy", [False, True])
def test_opencvs_charuco_boards_old_and_new_are_recognised_with_their_dictionary(rows, legacy):
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    drawn = cv2.aruco.CharucoBoard((8, rows), 0.04, 0.03, known)
    drawn.setLegacyPattern(legacy)
    image = drawn.generateImage((640 + 80, rows * 80 + 80), marginSize=40)
    board = parse_board(f"charuco:8x{rows}", 0.04)
    sighting = find_board(cv2.GaussianBlur(image, (0, 0), 0.8), board)
    assert sighting is not None
    assert len(sighting.ids) == len(board.points)
    truth = board.points[:, :2] / 0.04 * 80 + 40 + 80 - 0.5
    np.testing.assert_allclose(sighting.corners, truth, atol=0.15)
    turned = Board(8, rows, 0.04, "charuco", 0.03, "6x6_50")
    assert find_board(image, turned) is None


@pytest.mark.parametrize("half_turns", [0, 1, 2, 3])
def test_tags_with_kalibrs_wide_border_count_whichever_way_up_they_are_printed(half_turns):
    board = parse_board("aprilgrid:5x4", 0.13, 0.1)
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    image = np.full((600, 740), 255, np.uint8)
    tags = np.rint(board.points[:, :2].reshape(-1, 4, 2) * 1000).astype(int) + 45
    for number, corners in enumerate(tags):
        tag = cv2.aruco.generateImageMarker(known, number, 100, borderBits=2)
        (u, v) = corners[0]
        image[v : v + 100, u : u + 100] = np.rot90(tag, half_turns)
        for x, y in ((u - 30, v - 30), (u + 100, v - 30), (u - 30, v + 100), (u + 100, v + 100)):
            image[y : y + 30, x : x + 30] = 0
    sighting = find_board(cv2.GaussianBlur(image, (0, 0), 1.0), board)
    assert sighting is not None
    assert len(sighting.ids) == 80
    truth = tags.reshape(-1, 2)[sighting.ids] - 0.5
    np.testing.assert_allclose(sighting.corners, truth, atol=0.2)


@pytest.mark.parametrize("size", ["8x6", "9x5", "7x4", "6x4", "5x4", "4x3"])
def test_a_part_of_a_larger_chessboard_is_no_board(size):
    board = parse_board("chessboard:9x6", 0.03)
    smaller = parse_board(f"chessboard:{size}", 0.03)
    for seed in range(2):
        image = photograph(board, view(board, seed, (400, 300))[0], (400, 300))
        assert search_chessboard(image, smaller) is None
        assert search_chessboard(image, board) is not None


def test_asymmetric_circles_are_not_taken_for_symmetric_ones():
    board = parse_board("acircles:4x11", 0.03)
    images = [photograph(board, view(board, seed)[0], (640, 480)) for seed in range(3)]
    symmetric = parse_board("circles:4x11", 0.03)
    assert all(find_board(image, symmetric) is None for image in images)


def test_white_circles_on_black_are_found_too():
    board = parse_board("circles:7x5", 0.03)
    homography, truth = view(board, 0)
    sighting = find_board(255 - photograph(board, homography, (640, 480)), board)
    assert sighting is not None
    assert off_truth(board, sighting, truth).max() < 0.1


@pytest.mark.parametrize("text", ["chessboard:9x6", "charuco:6x4", "circles:7x5"])
def test_blur_is_measured_in_pixels(text):
    board = parse_board(text, 0.03)
    homography, _ = view(board, 1, share=0.8)
    told = []
    for blur in (0.4, 1.5, 2.0):
        found = detect(photograph(board, homography, (640, 480), blur=blur), board)
        assert found.blur is not None
        told.append(found.blur)
    assert 0.6 < told[0] < 1.1
    assert told[1:] == pytest.approx([1.5, 2.0], rel=0.15)


@pytest.mark.parametrize(
    "text", ["chessboard:9x6", "charuco:8x6", "circles:7x5", "acircles:4x11", "aprilgrid:6x5"]
)
@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (12, 20), (40, 40), (60, 80)])
def test_noise_and_specks_of_images_show_no_board(text, shape):
    board = parse_board(text, 0.03)
    rng = np.random.default_rng(3)
    for image in (rng.integers(0, 256, shape), np.where(rng.random(shape) > 0.5, 255, 0)):
        assert detect(image.astype(np.uint8), board).sighting is None


@pytest.mark.skipif(not REAL_DATA, reason="BEEMAP_REAL_DATA is not set")
@pytest.mark.parametrize(
    ("name", "text", "smaller"),
    [
        ("opencv-sample", "chessboard:9x6", "chessboard:8x6"),
        ("opencv-sample", "chessboard:9x6", "chessboard:6x4"),
        ("bumblebee2-chess", "chessboard:4x6", "chessboard:4x5"),
    ],
)
def test_real_boards_are_found_in_all_images_and_never_as_smaller_ones(name, text, smaller):
    files = sorted((Path(REAL_DATA or "") / "calibration" / name).glob("*.jpg"))
    seen = look_at_all(files, parse_board(text, 0.03))
    assert [image.name for image in seen if image.sighting is None] == []
    assert all(0.6 < (image.blur or 0) < 2 for image in seen)
    assert all(image.sighting is None for image in look_at_all(files, parse_board(smaller, 0.03)))


class FailingDetector:
    """OpenCV's, which fails on some whole images where it refines corners along outlines."""

    fails = (cv2.aruco.CORNER_REFINE_CONTOUR,)

    def __init__(self, dictionary, settings, real=cv2.aruco.ArucoDetector):
        self.real, self.refines = real(dictionary, settings), settings.cornerRefinementMethod

    def detectMarkers(self, image):  # noqa: N802 - OpenCV's name
        if self.refines in self.fails:
            cv2.solve(np.zeros((2, 3)), np.zeros((1, 1)))  # throws
        return self.real.detectMarkers(image)


def test_an_image_on_which_opencv_fails_costs_neither_its_board_nor_the_others(
    monkeypatch, tmp_path
):
    board = parse_board("charuco:8x6", 0.03)
    homography, truth = view(board, 1)
    image = photograph(board, homography, (640, 480), seed=1)
    monkeypatch.setattr(cv2.aruco, "ArucoDetector", FailingDetector)
    sighting = find_board(image, board)
    assert sighting is not None
    assert np.sqrt(np.mean(off_truth(board, sighting, truth) ** 2)) < 0.1
    monkeypatch.setattr(
        FailingDetector, "fails", (cv2.aruco.CORNER_REFINE_CONTOUR, cv2.aruco.CORNER_REFINE_NONE)
    )
    cv2.imwrite(str(tmp_path / "a.png"), image)
    (seen,) = look_at_all([tmp_path / "a.png"], board)
    assert seen.sighting is None
    assert seen.reason is not None
    assert "nothing that OpenCV can search" in seen.reason
