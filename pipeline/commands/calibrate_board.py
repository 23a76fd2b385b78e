"""`beemap calibrate board`: a board to print, at exact scale."""

from __future__ import annotations

from pathlib import Path

import click

from calibration.papers import PAPERS


@click.command()
@click.option(
    "--board",
    "board_text",
    required=True,
    metavar="KIND:COLSxROWS",
    help="charuco:8x6 (squares), chessboard:9x6 (inner corners), circles:7x5, acircles:4x11, "
    "aprilgrid:6x6 (tags).",
)
@click.option(
    "--square",
    required=True,
    metavar="LENGTH",
    help="Side of a square, or from one circle, row of circles or tag to the next, as in 30mm.",
)
@click.option(
    "--marker",
    metavar="LENGTH",
    help="Side of a marker: of a square by default 0.75 (charuco), 0.769 (aprilgrid).",
)
@click.option(
    "--dictionary", metavar="NAME", help="Of the markers, as in 4x4_50: by default the smallest."
)
@click.option(
    "--paper",
    default="a4",
    show_default=True,
    type=click.Choice(list(PAPERS)),
    help="Upright or sideways, as the board fits.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="PDF",
    help="The file to write.",
)
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def board(
    board_text: str,
    square: str,
    marker: str | None,
    dictionary: str | None,
    paper: str,
    output: Path,
    force: bool,
    quiet: bool,
) -> None:
    """Draw a calibration board at exact scale, with a ruler to check the printer.

    A ChArUco board is the best choice: any part of it counts, so that it may reach over the edges
    of the image, where a lens is hardest to know.

    \b
    beemap calibrate board --board charuco:8x6 --square 30mm -o board.pdf
    """
    from calibration.board import parse_board, parse_length
    from calibration.board_pdf import describe, write_sheet
    from pipeline.new_files import check_free, new_files

    side = parse_length(marker, "--marker") if marker else None
    printed = parse_board(board_text, parse_length(square), side, dictionary)
    check_free([output], force)
    with new_files([output], force) as folder:
        write_sheet(printed, paper, folder / output.name)
    if not quiet:
        click.echo(f"written        {output}")
        click.echo("next: print it at 100 %, check the ruler, glue it on something flat, then")
        click.echo(f"beemap calibrate cameras LEFT RIGHT {describe(printed)} -o rig.yaml")
