"""A board on a sheet of paper, at exact scale, with a ruler to check the printer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.board import Board
from calibration.board_drawing import Drawing, draw_board, printed_dictionary
from calibration.errors import CalibrationError
from calibration.papers import PAPERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARGIN = 8.0  # mm; what most printers cannot print, and the board's white rim
FOOTER = 14.0  # mm below the board, for the ruler and the name
INCH = 25.4  # mm
RULER = 100.0  # mm
ADVICE = "Print at 100 %, not fitted to the page; glue it on something flat; measure the ruler."


def board_sheet(board: Board, paper: str) -> Figure:
    """The sheet with the board, as a figure of the paper's very size.

    Raises:
        CalibrationError: the board does not fit the paper (the message names one that it fits).
    """
    from matplotlib.figure import Figure

    drawing = draw_board(board)
    page = _page(drawing, paper)
    if page is None:
        raise CalibrationError(_too_large(board, drawing, paper))
    width, height = page
    figure = Figure(figsize=(width / INCH, height / INCH), facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(height, 0))  # mm from the upper left corner of the sheet
    axes.set_axis_off()
    left, top, right, bottom = (1e3 * edge for edge in drawing.extent)
    shift = np.array(
        [
            (width - (left + right)) / 2,
            MARGIN + (height - FOOTER - 2 * MARGIN - (bottom - top)) / 2 - top,
        ]
    )
    _add_shapes(axes, drawing, shift)
    _add_footer(axes, board, width, height)
    return figure


def write_sheet(board: Board, paper: str, target: Path) -> None:
    """Write `board_sheet` as PDF; the same board gives the same bytes."""
    import matplotlib

    with matplotlib.rc_context({"pdf.fonttype": 42, "svg.hashsalt": "beemap"}):
        figure = board_sheet(board, paper)
        figure.savefig(target, format="pdf", metadata={"CreationDate": None, "Title": board.name})


def _page(drawing: Drawing, paper: str) -> tuple[float, float] | None:
    """(width, height) of the sheet [mm], upright if the board fits so; None if it does not fit."""
    left, top, right, bottom = drawing.extent
    needed = 1e3 * (right - left) + 2 * MARGIN, 1e3 * (bottom - top) + 2 * MARGIN + FOOTER
    short, long = PAPERS[paper]
    for page in ((short, long), (long, short)):
        if needed[0] <= page[0] and needed[1] <= page[1]:
            return page
    return None


def _too_large(board: Board, drawing: Drawing, paper: str) -> str:
    left, top, right, bottom = drawing.extent
    size = f"{1e3 * (right - left):.0f} x {1e3 * (bottom - top):.0f} mm"
    problem = f"{board.name} of {1e3 * board.square:g} mm is {size}, too large for {paper}"
    fitting = [name for name in list(PAPERS)[list(PAPERS).index(paper) :] if _page(drawing, name)]
    if fitting:
        return f"{problem}: give --paper {fitting[0]} or a smaller --square"
    return f"{problem} and for any other paper: give a smaller --square"


def _add_shapes(axes, drawing: Drawing, shift: np.ndarray) -> None:
    """All shapes as one path: filled apart, neighbouring cells would show a hairline between."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    outlines = [
        Outline(
            1e3 * np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]]) + shift,
            closed=True,
        )
        for x, y, w, h in drawing.rectangles
    ]
    outlines += [Outline.circle(tuple(1e3 * d[:2] + shift), 1e3 * d[2]) for d in drawing.discs]
    outline = Outline.make_compound_path(*outlines)
    # Not snapped: a picture of the sheet has its edges where they are, not at the nearest pixel.
    axes.add_patch(PathPatch(outline, facecolor="black", linewidth=0, snap=False))


def _add_footer(axes, board: Board, width: float, height: float) -> None:
    base = height - MARGIN - 4
    start = (width - RULER) / 2
    for mm in range(int(RULER) + 1):
        length = 4.0 if mm % 10 == 0 else 3.0 if mm % 5 == 0 else 2.0
        axes.plot([start + mm] * 2, [base - length, base], color="black", linewidth=0.4)
        if mm % 10 == 0:
            axes.text(start + mm, base + 0.6, f"{mm}", fontsize=5, ha="center", va="top")
    axes.plot([start, start + RULER], [base, base], color="black", linewidth=0.4)
    axes.text(start + RULER + 3, base, "mm", fontsize=6, va="bottom")
    text = f"{describe(board)}    {ADVICE}"
    axes.text(width / 2, base + 4, text, fontsize=5.5, ha="center", va="top")


def describe(board: Board) -> str:
    """The options that name this board on the command line."""
    words = [f"--board {board.name}", f"--square {1e3 * board.square:g}mm"]
    if board.coded and board.marker is not None:
        words.append(f"--marker {1e3 * board.marker:.6g}mm")
        words.append(f"--dictionary {printed_dictionary(board)}")
    return " ".join(words)
