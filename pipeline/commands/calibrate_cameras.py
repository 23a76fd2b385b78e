"""`beemap calibrate cameras`: from images of a board to a rig file, and a verdict on it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.errors import InputError
from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from calibration.board import Board
    from calibration.calibrate import CalibrationResult
    from calibration.imagepairs import PairList
    from pipeline.rig import Replaced

LENSES = ("auto", "radtan4", "radtan5", "rational", "fisheye")
REDO_CODE = 3  # exit code of a calibration that has to be made again


@click.command()
@click.argument("left")
@click.argument("right", required=False)
@click.option(
    "--board",
    "board_text",
    required=True,
    help="chessboard:9x6 (inner corners), charuco:8x6 (squares), circles:7x5, acircles:4x11, "
    "aprilgrid:6x6 (tags): columns x rows.",
)
@click.option(
    "--square",
    required=True,
    help="Side of a square (spacing of circles or tags) with its unit, as in 25mm.",
)
@click.option("--marker", help="Side of a marker's black square, with its unit.")
@click.option("--dictionary", help="Of the markers, as in 4x4_50; recognised where it is missing.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, help="Rig file to write."
)
@click.option(
    "--baseline", help="Distance between the lenses by a ruler, as in 84mm: checks the squares."
)
@click.option(
    "--lens",
    type=click.Choice(LENSES),
    default="auto",
    show_default=True,
    help="Lens model; auto takes a richer one only when pairs left out say so.",
)
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    help="Folder of report.html and its figures.  [default: RIG-report beside the rig file]",
)
@click.option("--no-report", is_flag=True, help="Write no report.")
@click.option("--force", is_flag=True, help="Replace an existing rig file; its mount stays.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def cameras(
    left: str,
    right: str | None,
    board_text: str,
    square: str,
    marker: str | None,
    dictionary: str | None,
    output: Path,
    baseline: str | None,
    lens: str,
    report: Path | None,
    no_report: bool,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find both cameras' lenses and the pose between them from images of a board.

    LEFT and RIGHT are folders of images or quoted globs ('shots/left*.png'); images are matched
    by the number in their names. One argument may be a recording, a folder with left and right
    images in it, or images that hold both halves side by side.

    \b
    beemap calibrate cameras 'shots/left*.jpg' 'shots/right*.jpg' \\
        --board chessboard:9x6 --square 25mm --baseline 84mm -o rig.yaml

    The verdict goes by the rectified row error on pairs left out of the solve: excellent below
    0.15 px RMS, good below 0.3, usable below 0.5, else redo (exit code 3; results are written).
    """
    from calibration.board import parse_board, parse_length

    parsed = parse_board(
        board_text,
        parse_length(square),
        parse_length(marker, "--marker") if marker else None,
        dictionary,
    )
    ruler = parse_length(baseline, "--baseline") if baseline else None
    folder = None if no_report else report or report_beside(output)
    result = calibrate_pairs(
        left, right, parsed, ruler, output, folder,
        lens=lens, force=force, as_json=as_json, quiet=quiet,
    )  # fmt: skip
    if result.judgement.verdict == "redo":
        sys.exit(REDO_CODE)


def report_beside(rig_file: Path) -> Path:
    """The folder of the report on a rig file, where none is given."""
    return rig_file.with_name(f"{rig_file.stem}-report")


def calibrate_pairs(
    left: str,
    right: str | None,
    board: Board,
    ruler: float | None,
    output: Path,
    report: Path | None,
    *,
    lens: str = LENSES[0],
    force: bool = False,
    as_json: bool = False,
    quiet: bool = False,
    looked: Callable[[int, int], None] = lambda done, total: None,
) -> CalibrationResult:
    """Calibrate, write the rig file and the report, and tell what was found.

    looked: told how many of the images were looked at.

    Raises:
        InputError, CalibrationError: in one line, what is wrong.
    """
    from calibration.calibrate import calibrate_cameras
    from calibration.detections_cache import default_cache_folder
    from calibration.imagepairs import find_pairs
    from calibration.rig import save_rig
    from pipeline.rig import with_kept

    replaced = _rig_to_replace(output, force)
    if report is not None:
        _check_report(report, force)
    found = find_pairs(left, right)
    with progress_bar("finding the board", "images", quiet or as_json) as bar:

        def progress(done: int, total: int) -> None:
            bar(done, total)
            looked(done, total)

        result = calibrate_cameras(
            found.pairs, board, lens, ruler, default_cache_folder(), progress
        )
    rig, kept = with_kept(result.rig, replaced)
    result = replace(result, rig=rig)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output.parent}: cannot be made ({error.strerror})") from None
    save_rig(result.rig, output)
    _tell(result, found, output, kept, as_json, quiet)
    if report is not None:
        _write_report(result, found, output, report, quiet or as_json)
    return result


def _rig_to_replace(output: Path, force: bool) -> Replaced | None:
    from pipeline.rig import rig_to_replace

    if output.is_dir():
        raise InputError(f"{output}: is a folder: give the name of a file, as in rig.yaml")
    if not output.exists():
        return None
    if not force:
        raise InputError(f"{output}: already exists: give --force to replace it")
    return rig_to_replace(output)


def _check_report(folder: Path, force: bool) -> None:
    from pipeline.calibration_report.files import report_files
    from pipeline.new_files import check_free

    if folder.is_file():
        raise InputError(f"{folder}: is a file, not a folder: give another --report")
    check_free(report_files(folder), force)


def _tell(
    result: CalibrationResult,
    found: PairList,
    output: Path,
    kept: list[str],
    as_json: bool,
    quiet: bool,
) -> None:
    if as_json:
        from pipeline.calibration_report.as_json import as_json as told

        click.echo(json.dumps(told(result, found.unmatched), indent=2))
    elif not quiet:
        from pipeline.calibration_report.screen import print_result

        print_result(result, found, output, kept)


def _write_report(
    result: CalibrationResult, found: PairList, output: Path, folder: Path, silent: bool
) -> None:
    from pipeline.calibration_report.page import write_report

    page = write_report(result, found.unmatched, output, folder)
    if not silent:
        click.echo(f"report: {page}")
