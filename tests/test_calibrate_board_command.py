"""`beemap calibrate board`: the sheet has the paper's size, and the board on it its own."""

import io
import re

import cv2
import numpy as np
import pytest

from calibration.board import parse_board
from calibration.board_pdf import PAPERS, board_sheet
from calibration.detection import find_board
from calibration.errors import CalibrationError

DOTS = 300 / 0.0254  # a metre
BOARDS = ["chessboard:9x6", "charuco:8x6", "circles:7x5", "acircles:4x11", "aprilgrid:4x5"]
SQUARES = {"chessboard": 0.025, "charuco": 0.03, "circles": 0.03, "acircles": 0.02}


def printed(text: str, paper: str = "a4") -> np.ndarray:
    """The sheet as a printer of 300 dots an inch makes it, grey uint8 (H, W)."""
    board = parse_board(text, SQUARES.get(text.partition(":")[0], 0.04))
    file = io.BytesIO()
    board_sheet(board, paper).savefig(file, format="png", dpi=300)
    image = cv2.imdecode(np.frombuffer(file.getvalue(), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return image


@pytest.mark.parametrize("text", BOARDS)
def test_the_printed_board_has_its_size_to_a_fraction_of_a_thousandth(text):
    board = parse_board(text, SQUARES.get(text.partition(":")[0], 0.04))
    image = printed(text)
    sighting = find_board(cv2.GaussianBlur(image, (0, 0), 1.5), board)
    assert sighting is not None
    assert len(sighting.ids) == len(board.points)
    plane = board.points[sighting.ids, :2]
    # Turn, shift and scale that carry the board to the sheet: only the scale is to be known.
    similarity, _ = cv2.estimateAffinePartial2D(plane, sighting.corners / DOTS)
    assert np.hypot(*similarity[:, 0]) == pytest.approx(1, abs=2e-4)
    off = sighting.corners / DOTS - (plane @ similarity[:, :2].T + similarity[:, 2])
    assert np.linalg.norm(off, axis=1).max() < 2e-5  # m


def test_the_ruler_is_as_long_as_it_says():
    image = printed("circles:7x5")
    # The long thin line below the board
    dark = image < 128
    lengths = dark.sum(axis=1)
    row = int(np.flatnonzero(lengths > 0.08 * DOTS)[-1])
    columns = np.flatnonzero(dark[row])
    assert (columns[-1] - columns[0]) / DOTS == pytest.approx(0.1, abs=2e-4)


def test_the_pdf_has_the_papers_size_and_the_same_bytes_every_time(beemap, tmp_path):
    for name, paper in (("a.pdf", "a3"), ("b.pdf", "a3")):
        outcome = beemap(
            *("calibrate", "board", "--board", "charuco:8x6", "--square", "42mm"),
            *("--paper", paper, "-o", tmp_path / name),
        )
        assert outcome.code == 0, outcome
        assert "beemap calibrate cameras LEFT RIGHT --board charuco:8x6" in outcome.out
        assert "--marker 31.5mm --dictionary 4x4_50" in outcome.out
    data = (tmp_path / "a.pdf").read_bytes()
    assert data == (tmp_path / "b.pdf").read_bytes()
    box = re.search(rb"/MediaBox \[ 0 0 ([0-9.]+) ([0-9.]+) \]", data)
    assert box is not None
    millimetres = [float(side) / 72 * 25.4 for side in box.groups()]
    assert millimetres == pytest.approx([420, 297], abs=0.01)


@pytest.mark.parametrize(
    ("text", "square", "paper", "remedy"),
    [
        ("charuco:8x6", 0.06, "a4", "480 x 360 mm, too large for a4: give --paper a2"),
        ("charuco:8x6", 0.034, "letter", "too large for letter: give --paper a3"),
        ("chessboard:9x6", 0.3, "a3", "too large for a3 and for any other paper"),
    ],
)
def test_a_board_too_large_for_the_paper_names_one_that_is_not(text, square, paper, remedy):
    with pytest.raises(CalibrationError, match=remedy) as caught:
        board_sheet(parse_board(text, square), paper)
    assert len(str(caught.value).splitlines()) == 1
    named = re.search("--paper (a[0-9])", str(caught.value))
    if named:
        width, height = np.array(board_sheet(parse_board(text, square), named[1]).get_size_inches())
        assert sorted((width * 25.4, height * 25.4)) == pytest.approx(list(PAPERS[named[1]]))


def test_mistakes_are_one_line_and_a_file_is_not_replaced(refused, beemap, tmp_path):
    def words(square="30mm", board="charuco:8x6"):
        target = tmp_path / "board.pdf"
        return ("calibrate", "board", "--board", board, "--square", square, "-o", target)

    assert "give the unit, as in 30mm" in refused(*words("30"))
    assert "write KIND:COLUMNSxROWS" in refused(*words(board="chess:8x6"))
    assert "--marker '22': give the unit" in refused(*words(), "--marker", 22)
    assert "give --paper a2" in refused(*words("60mm"))
    assert list(tmp_path.iterdir()) == []
    assert beemap(*words()).code == 0
    assert "already exists: give --force" in refused(*words())
    assert beemap(*words("25mm"), "--force", "--quiet").out == ""
