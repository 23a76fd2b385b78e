"""`beemap calibrate capture`: take pairs of a board by itself, then calibrate."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.commands.web_options import check_web, served, web_options
from pipeline.errors import InputError

if TYPE_CHECKING:
    from calibration.board import Board
    from calibration.calibrate import CalibrationResult
    from pipeline.web.capture_state import CaptureState

MOST_PAIRS = 60
FEWEST_PAIRS = 3


@click.command("capture")
@click.argument("rig_file", metavar="RIG", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="IMAGES",
    help="Folder for the pairs: left/ and right/.",
)
@click.option("--board", "board_text", required=True, help="As of 'calibrate cameras'.")
@click.option("--square", required=True, help="Side of a square with its unit, as in 25mm.")
@click.option("--marker", help="Side of a marker's black square, with its unit.")
@click.option("--dictionary", help="Of the markers, as in 4x4_50.")
@click.option("--baseline", help="Distance between the lenses by a ruler, as in 84mm.")
@click.option("--pairs", type=click.IntRange(3, 500), help="Stop at so many, enough or not.")
@click.option("--no-calibrate", is_flag=True, help="Take the pairs only.")
@web_options
@click.option("--quiet", is_flag=True, help="No bars.")
def capture(
    rig_file: Path,
    output: Path,
    board_text: str,
    square: str,
    marker: str | None,
    dictionary: str | None,
    baseline: str | None,
    pairs: int | None,
    no_calibrate: bool,
    web: bool,
    host: str | None,
    port: int | None,
    quiet: bool,
) -> None:
    """Take pairs of a board with the cameras that RIG names, until there are enough.

    Hold the board where 'now:' says, still for a moment: pairs that are sharp, still and new are
    taken by themselves. When every part of the images was covered, with the board tilted to all
    sides, near and far, RIG is calibrated: the result is written into it, its devices stay.
    Ctrl-C ends early with the pairs so far. With --web a page shows where to hold the board, large
    enough to be read from afar, and the verdict.

    \b
    beemap calibrate capture rig.yaml -o shots --board charuco:8x6 --square 30mm --web
    """
    from calibration.board import parse_board, parse_length
    from calibration.device_rig import load_device_rig
    from pipeline.board_capture import BoardCapture
    from pipeline.commands.calibrate_cameras import REDO_CODE
    from pipeline.commands.capture_bars import CaptureBars
    from pipeline.output_lock import locked
    from pipeline.pair_taking import take_pairs
    from pipeline.signals import until_interrupted
    from stereo.camera_settings import camera_settings

    check_web(web, host, port)
    side = parse_length(marker, "--marker") if marker else None
    board = parse_board(board_text, parse_length(square), side, dictionary)
    ruler = parse_length(baseline, "--baseline") if baseline else None
    source = load_device_rig(rig_file)
    cameras = camera_settings(source.devices, str(rig_file))
    _make_folders(output)
    taking = BoardCapture(board)
    with _shown(web, host, port, board, rig_file, output) as page:
        watchers = [watcher for watcher in (page, None if quiet else CaptureBars()) if watcher]
        with locked(output), until_interrupted() as stop:
            if page is not None:
                page.button = stop
            take_pairs(cameras, taking, output, pairs or MOST_PAIRS, stop, watchers)
        count, missing = len(taking.kept), taking.wanted()
        left = f"; still missing: {'; '.join(missing[:3])}" if missing else ": enough"
        told = f"{count} pairs in {output}{left}"
        if taking.damaged:
            told += f"; {taking.damaged} damaged pairs were left out"
        click.echo(told)
        if no_calibrate or count < FEWEST_PAIRS:
            if page is not None:
                page.ended(told)
            return
        result = _calibrate(rig_file, output, board, ruler, page)
    if result.judgement.verdict == "redo":
        sys.exit(REDO_CODE)


def _make_folders(output: Path) -> None:
    # Folders without a file are what a run leaves that could not begin.
    if output.is_file() or any(not place.is_dir() for place in output.rglob("*")):
        raise InputError(f"{output}: already exists: choose a new folder for the pairs")
    try:
        for side in ("left", "right"):
            (output / side).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be made ({error.strerror})") from None


@contextmanager
def _shown(
    web: bool, host: str | None, port: int | None, board: Board, rig_file: Path, output: Path
) -> Iterator[CaptureState | None]:
    """What to tell about the capture, so that it is seen on a page; None where none is wanted."""
    if not web:
        yield None
        return
    from pipeline.web.capture_page import CapturePage
    from pipeline.web.capture_state import CaptureState

    state = CaptureState(board)
    with served(CapturePage(state, rig_file, output), host, port):
        try:
            yield state
        except Exception as error:
            state.ended(str(error))
            raise
        state.ended()


def _calibrate(
    rig_file: Path, output: Path, board: Board, ruler: float | None, page: CaptureState | None
) -> CalibrationResult:
    """The pairs, into the rig file; its devices and encoders stay."""
    from pipeline.calibration_report.files import PAGE
    from pipeline.commands.calibrate_cameras import calibrate_pairs, report_beside
    from pipeline.signals import until_interrupted
    from pipeline.web.capture_state import Solved

    report = report_beside(rig_file)
    if page is None:
        return calibrate_pairs(str(output), None, board, ruler, rig_file, report, force=True)
    page.solving(0, 0)
    result = calibrate_pairs(
        str(output), None, board, ruler, rig_file, report, force=True, looked=page.solving
    )
    with until_interrupted() as over:
        page.shows(Solved(result, report / PAGE), over)
        click.echo("the page stays; Ctrl-C, or Done on the page, ends it", err=True)
        over.wait()
    return result
