"""Boards and lengths as they are written on the command line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.board import KINDS, Board, parse_board, parse_length
from calibration.errors import CalibrationError
from calibration.markernames import MARKERS_IN, dictionary_name, smallest_dictionaries


def test_columns_and_rows_are_inner_corners():
    board = parse_board("chessboard:9x6", 0.025)
    assert board == Board(columns=9, rows=6, square=0.025)
    assert board.name == "chessboard:9x6"


def test_points_run_along_the_rows_in_metres():
    points = Board(4, 3, 0.03).points
    assert points.shape == (12, 3)
    np.testing.assert_allclose(points[[0, 1, 4]], [[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0]])


def test_a_charuco_board_has_the_corners_between_its_squares_and_a_usual_marker():
    board = parse_board("charuco:8x6", 0.04)
    assert len(board.points) == 7 * 5
    assert board.marker == pytest.approx(0.03)
    assert board.dictionary is None  # recognised in the images
    given_marker = parse_board("charuco:8x6", 0.04, 0.022, "DICT_5X5_100")
    assert (given_marker.marker, given_marker.dictionary) == (0.022, "5x5_100")


def test_rows_of_asymmetric_circles_are_shifted_by_half_a_step():
    points = parse_board("acircles:4x11", 0.02).points
    np.testing.assert_allclose(points[[1, 4]], [[0.04, 0, 0], [0.02, 0.02, 0]])


def test_an_aprilgrid_has_four_corners_a_tag_and_tag_0_at_the_lower_left():
    board = parse_board("aprilgrid:3x2", 0.05, 0.04)
    corners = board.points[:, :2].reshape(6, 4, 2)
    np.testing.assert_allclose(corners[0], [[0, 0.05], [0.04, 0.05], [0.04, 0.09], [0, 0.09]])
    np.testing.assert_allclose(corners[1, 0], [0.05, 0.05])
    np.testing.assert_allclose(corners[3, 0], [0, 0])
    kalibr = parse_board("aprilgrid:6x6", 0.0715)
    assert kalibr.marker == pytest.approx(0.055)  # gaps of 0.3 tags


@pytest.mark.parametrize(
    ("text", "apart"),
    [
        ("chessboard:9x6", 0.03),
        ("charuco:8x6", 0.03),
        ("circles:7x5", 0.03),
        ("acircles:4x11", 0.03 * 2**0.5),
        ("aprilgrid:4x3", 0.03 - 0.03 / 1.3),
    ],
)
def test_neighbours_are_the_points_nearest_to_each_other(text, apart):
    board = parse_board(text, 0.03)
    first, second = board.points[board.neighbours].transpose(1, 0, 2)
    np.testing.assert_allclose(np.linalg.norm(second - first, axis=1), apart)
    assert len(np.unique(board.neighbours)) == (
        len(board.points) if board.kind != "aprilgrid" else len(board.points) - 4
    )


@pytest.mark.parametrize(
    "text", ["9x6", "chessboard:9", "checker:8x6", "chessboard:9x-6", "", "Charuco:8x6"]
)
def test_a_board_that_is_none_says_how_to_write_one(text):
    with pytest.raises(CalibrationError, match="chessboard:9x6"):
        parse_board(text, 0.025)


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        ("chessboard:9x2", {}, "at least 3 inner corners"),
        ("charuco:2x6", {}, "at least 3 squares$"),
        ("aprilgrid:1x6", {}, "at least 2 tags"),
        ("chessboard:999x999", {}, "more than 2000 inner corners"),
        ("chessboard:9x6", {"marker": 0.02}, "--marker: chessboard:9x6 has no markers"),
        ("circles:7x5", {"dictionary": "4x4_50"}, "--dictionary: circles:7x5 has no markers"),
        ("charuco:8x6", {"marker": 0.03}, "30 mm does not fit a --square of 25 mm"),
        ("charuco:8x6", {"marker": 0.002}, "2 mm does not fit"),
        ("charuco:8x6", {"dictionary": "4x4"}, "--dictionary '4x4': unknown: give one of 4x4_50"),
        ("charuco:15x9", {"dictionary": "4x4_50"}, "has 50 markers, charuco:15x9 needs 67"),
    ],
)
def test_a_board_that_cannot_be_is_one_line(text, more, message):
    with pytest.raises(CalibrationError, match=message) as caught:
        parse_board(text, 0.025, **more)
    assert len(str(caught.value).splitlines()) == 1


@given(
    st.sampled_from(sorted(KINDS)),
    st.integers(0, 1200),
    st.integers(0, 1200),
    st.floats(1e-3, 2.0),
)
def test_a_board_reads_back_as_it_is_written(kind, columns, rows, square):
    try:
        board = parse_board(f"{kind}:{columns}x{rows}", square)
    except CalibrationError:
        assert min(columns, rows) < KINDS[kind][2] or columns * rows > 500
        return
    assert board == parse_board(board.name, square)
    assert (board.columns, board.rows, board.square) == (columns, rows, square)


@given(st.text(max_size=20))
def test_any_text_is_a_board_or_an_error(text):
    try:
        board = parse_board(text, 0.03)
    except CalibrationError:
        return
    assert len(board.points) > 0


@given(st.sampled_from(sorted(MARKERS_IN)))
def test_dictionaries_are_known_by_opencvs_names_too(name):
    assert dictionary_name(f" DICT_{name.upper()} ") == name


def test_of_every_family_the_smallest_dictionary_that_is_large_enough():
    assert smallest_dictionaries(24)[:4] == ["4x4_50", "5x5_50", "6x6_50", "7x7_50"]
    assert smallest_dictionaries(51)[0] == "4x4_100"
    assert "apriltag_16h5" not in smallest_dictionaries(31)


@pytest.mark.parametrize(
    ("text", "metres"), [("25mm", 0.025), ("2.5cm", 0.025), ("0.025m", 0.025), (" 30 mm ", 0.03)]
)
def test_lengths_carry_their_unit(text, metres):
    assert parse_length(text) == pytest.approx(metres, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("25", "give the unit, as in 25mm"),
        ("25in", "unknown unit 'in' .known: mm, cm, m"),
        ("25MM", "unknown unit 'MM'"),
        ("-25mm", "length with its unit"),
        ("mm", "length with its unit"),
        ("25m", "check the unit"),
        ("0mm", "check the unit"),
    ],
)
def test_a_wrong_length_names_the_option_and_the_remedy(text, remedy):
    with pytest.raises(CalibrationError, match=f"--square '{text}'.*{remedy}"):
        parse_length(text)
    with pytest.raises(CalibrationError, match=f"--baseline '{text}'"):
        parse_length(text, "--baseline")


@given(st.text(max_size=12))
def test_any_text_is_a_length_or_an_error(text):
    try:
        length = parse_length(text)
    except CalibrationError:
        return
    assert 1e-3 <= length <= 2.0
