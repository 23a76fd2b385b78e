"""When no image shows the board: one line that says what was tried, what was seen, what to do."""

import re

import cv2
import numpy as np
import pytest

from calibration.board import parse_board
from calibration.corners import look_at_all
from calibration.no_board import explain_no_board
from tests.calibration_drawings import photograph, view


@pytest.fixture(scope="module")
def explained(tmp_path_factory):
    """A maker of the line for photographs of one board taken for another."""
    folder = tmp_path_factory.mktemp("boards")

    def explain(shown: str, given: str, dictionary: str | None = None) -> str:
        board = parse_board(shown, 0.03)
        files = [folder / f"{shown.replace(':', '-')}-{seed}.png" for seed in range(2)]
        for seed, file in enumerate(files):
            if not file.exists():
                image = photograph(board, view(board, seed, (480, 360))[0], (480, 360))
                cv2.imwrite(str(file), image)
        wanted = parse_board(given, 0.03, dictionary=dictionary)
        images = look_at_all(files, wanted)
        assert all(image.sighting is None for image in images)
        line = explain_no_board(images, wanted)
        assert line.startswith(f"no {given} in any of 2 images")
        assert len(line.splitlines()) == 1
        return line

    return explain


@pytest.mark.parametrize(
    ("shown", "given", "told"),
    [
        ("chessboard:7x5", "chessboard:8x6", "inner corners, not squares: give --board ch.*d:7x5$"),
        ("chessboard:7x5", "chessboard:6x4", "there is a chessboard of 7x5 inner corners"),
        ("chessboard:7x5", "charuco:8x6", "but there is a chessboard:7x5"),
        ("charuco:6x5", "charuco:5x6", "--board charuco:6x5$"),
        ("charuco:6x5", "charuco:5x4", "--board charuco:6x5$"),
        ("charuco:6x5", "chessboard:6x5", "markers of 4x4_50 with numbers up to 14: is it a Ch"),
        ("acircles:4x7", "circles:4x7", "--board acircles:4x7$"),
        ("circles:7x5", "acircles:7x5", "--board circles:7x5$"),
    ],
)
def test_the_board_that_is_there_is_named(explained, shown, given, told):
    assert re.search(told, explained(shown, given))


def test_markers_of_another_dictionary_than_given_are_recognised(explained):
    line = explained("charuco:6x5", "charuco:6x5", "5x5_50")
    assert "of another dictionary than 5x5_50: leave it out" in line


def test_where_nothing_is_seen_the_line_says_what_was_tried(tmp_path):
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((240, 320), 90, np.uint8))
    for text, told in (
        ("chessboard:9x6", "tried too: chessboard:8x5, chessboards of any size, any markers"),
        ("charuco:8x6", "tried too: charuco:6x8, charuco:9x7, charuco:7x9, "),
    ):
        board = parse_board(text, 0.03)
        line = explain_no_board(look_at_all([tmp_path / "wall.png"], board), board)
        assert told in line
        assert "--board counts" in line
