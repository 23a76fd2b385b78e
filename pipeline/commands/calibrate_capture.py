"""`beemap calibrate capture`: take pairs of a board by itself, then calibrate."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.errors import InputError

if TYPE_CHECKING:
    from calibration.board import Board
    from pipeline.board_capture import BoardCapture, Look
    from stereo.camera import CapturedPair
    from stereo.camera_settings import CameraSettings

BAR = 8  # characters
MOST_PAIRS = 60
SILENT_S = 5.0


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
    quiet: bool,
) -> None:
    """Take pairs of a board with the cameras that RIG names, until there are enough.

    Hold the board where 'now:' says, still for a moment: pairs that are sharp, still and new are
    taken by themselves. When every part of the images was covered, with the board tilted to all
    sides, near and far, RIG is calibrated: the result is written into it, its devices stay.
    Ctrl-C ends early with the pairs so far.

    \b
    beemap calibrate capture rig.yaml -o shots --board charuco:8x6 --square 30mm
    """
    from calibration.board import parse_board, parse_length
    from calibration.device_rig import load_device_rig
    from pipeline.board_capture import BoardCapture
    from pipeline.commands.live_screen import until_interrupted
    from stereo.camera_settings import camera_settings

    side = parse_length(marker, "--marker") if marker else None
    board = parse_board(board_text, parse_length(square), side, dictionary)
    source = load_device_rig(rig_file)
    cameras = camera_settings(source.devices, str(rig_file))
    _make_folders(output)
    watching = BoardCapture(board)
    with until_interrupted() as stop:
        _take(cameras, watching, output, pairs or MOST_PAIRS, stop, quiet)
    missing = watching.wanted()
    click.echo(
        f"{len(watching.kept)} pairs in {output}"
        + (f"; still missing: {'; '.join(missing[:3])}" if missing else ": enough")
    )
    if no_calibrate or len(watching.kept) < 3:
        return
    _calibrate(rig_file, output, board, square, marker, dictionary, baseline)


def _make_folders(output: Path) -> None:
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise InputError(f"{output}: already exists: choose a new folder for the pairs")
    try:
        for side in ("left", "right"):
            (output / side).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be made ({error.strerror})") from None


def _take(
    cameras: CameraSettings, watching: BoardCapture, output: Path, most: int, stop, quiet: bool
) -> None:
    from stereo.errors import StereoError
    from stereo.stereo_camera import StereoCamera

    last = time.monotonic()
    with StereoCamera(cameras) as camera:
        while not stop.is_set() and len(watching.kept) < most and watching.wanted():
            pair = _latest(camera)
            if pair is None:
                if time.monotonic() - last > SILENT_S:
                    raise InputError(f"no pair for {SILENT_S:g} s: are both cameras running?")
                continue
            last = time.monotonic()
            try:
                look = watching.look(pair.load())
            except StereoError:
                continue  # a damaged image
            if look.kept:
                _write(output, len(watching.kept), pair)
            if not quiet:
                _show(watching, look)


def _latest(camera) -> CapturedPair | None:
    """The newest pair: the board is looked for more slowly than pairs come."""
    pair = camera.read(0.2)
    while pair is not None and (newer := camera.read(0.0)) is not None:
        pair = newer
    return pair


def _write(output: Path, number: int, pair: CapturedPair) -> None:
    """A JPEG as it was sent, pixels as PNG."""
    import cv2
    import numpy as np

    frames = [pair.left, pair.right]
    if pair.right is None:
        loaded = pair.load()
        images = [loaded.left, loaded.right]
    else:
        images = [frame.data for frame in frames if frame is not None]
    for side, image in zip(("left", "right"), images, strict=True):
        if isinstance(image, np.ndarray):
            data, ending = cv2.imencode(".png", image)[1].tobytes(), "png"
        else:
            data, ending = image, "jpg"
        (output / side / f"{number:03d}.{ending}").write_bytes(data)


def _show(watching: BoardCapture, look: Look) -> None:
    """One line: bars of what is there, what to do now, what became of the pair."""
    bars = " ".join(
        f"{name} {'#' * round(BAR * share):.<{BAR}}" for name, share in watching.bars().items()
    )
    blur = f", blur {look.blur:.1f} px" if look.blur is not None else ""
    wanted = watching.wanted()
    now = f"now: {wanted[0]}" if wanted else "enough"
    line = f"{bars} | {look.why}{blur} | {now}"
    if sys.stderr.isatty():
        click.echo(f"\r\x1b[K{line}" + ("\n" if look.kept else ""), err=True, nl=False)
    elif look.kept:
        click.echo(line, err=True)


def _calibrate(
    rig_file: Path,
    output: Path,
    board: Board,
    square: str,
    marker: str | None,
    dictionary: str | None,
    baseline: str | None,
) -> None:
    """`calibrate cameras` on the pairs, into the rig file; its devices and encoders stay."""
    from pipeline.commands.calibrate_cameras import cameras

    options = {"--marker": marker, "--dictionary": dictionary, "--baseline": baseline}
    given = [word for name, value in options.items() if value for word in (name, value)]
    arguments = [str(output), "--board", board.name, "--square", square, "-o", str(rig_file)]
    cameras.main([*arguments, "--force", *given], standalone_mode=False)
