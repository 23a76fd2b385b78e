"""Boards and lengths as they are written on the command line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.board import Board, parse_board, parse_length
from calibration.errors import CalibrationError


def test_columns_and_rows_are_inner_corners():
    board = parse_board("chessboard:9x6", 0.025)
    assert board == Board(columns=9, rows=6, square=0.025)
    assert board.name == "chessboard:9x6"


def test_points_run_along_the_rows_in_metres():
    points = Board(4, 3, 0.03).points
    assert points.shape == (12, 3)
    np.testing.assert_allclose(points[[0, 1, 4]], [[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0]])


@pytest.mark.parametrize("text", ["9x6", "chessboard:9", "charuco:8x6", "chessboard:9x-6", ""])
def test_a_board_that_is_none_says_how_to_write_one(text):
    with pytest.raises(CalibrationError, match="chessboard:9x6"):
        parse_board(text, 0.025)


def test_a_side_needs_three_corners():
    with pytest.raises(CalibrationError, match="at least 3 inner corners"):
        parse_board("chessboard:9x2", 0.025)


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


@given(st.text(max_size=12))
def test_any_text_is_a_length_or_an_error(text):
    try:
        length = parse_length(text)
    except CalibrationError:
        return
    assert 1e-3 <= length <= 2.0
