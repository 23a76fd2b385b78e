"""`beemap calibrate`: from images of a board to a rig file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.errors import InputError
from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from calibration.calibrate import CalibrationResult
    from calibration.imagepairs import ImagePair, PairList
    from calibration.rig import StereoRig

# What a new calibration of the cameras does not touch in the rig file that it replaces.
KEPT_SECTIONS = ("encoders", "devices")


@click.group()
def calibrate() -> None:
    """Calibrate a new camera pair."""


@calibrate.command()
@click.argument("left")
@click.argument("right")
@click.option(
    "--board", "board_text", required=True, help="Inner corners, as in chessboard:9x6 (COLSxROWS)."
)
@click.option("--square", required=True, help="Side of a square with its unit, as in 25mm.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, help="Rig file to write."
)
@click.option("--force", is_flag=True, help="Replace an existing rig file; its mount stays.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def cameras(
    left: str,
    right: str,
    board_text: str,
    square: str,
    output: Path,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find both cameras' lenses and the pose between them from images of a chessboard.

    LEFT and RIGHT are folders of images or quoted globs ('shots/left*.png'). Images are matched
    by the number in their names.

    \b
    beemap calibrate cameras 'shots/left*.jpg' 'shots/right*.jpg' \\
        --board chessboard:9x6 --square 25mm -o rig.yaml
    """
    from calibration.board import parse_board, parse_length
    from calibration.calibrate import calibrate_cameras
    from calibration.imagepairs import find_pairs
    from calibration.rig import save_rig

    board = parse_board(board_text, parse_length(square))
    replaced = _rig_to_replace(output, force)
    found = find_pairs(left, right)
    with progress_bar("finding the board", "pairs", quiet or as_json) as progress:
        result = calibrate_cameras(_counted(found.pairs, progress), board)
    rig = _with_kept(result.rig, replaced)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output.parent}: cannot be made ({error.strerror})") from None
    save_rig(rig, output)
    if as_json:
        click.echo(json.dumps(_as_json(result, found), indent=2))
    elif not quiet:
        _print_result(result, found)
        _print_next(rig, replaced, output)


def _counted(pairs: list[ImagePair], progress: Callable[[int, int], None]) -> Iterator[ImagePair]:
    for done, pair in enumerate(pairs):
        progress(done, len(pairs))
        yield pair
    progress(len(pairs), len(pairs))


def _rig_to_replace(output: Path, force: bool) -> StereoRig | None:
    """The rig in the file that will be replaced, whose mount must not be lost."""
    from calibration.rig import RigError, load_rig

    if output.is_dir():
        raise InputError(f"{output}: is a folder: give the name of a file, as in rig.yaml")
    if not output.exists():
        return None
    if not force:
        raise InputError(f"{output}: already exists: give --force to replace it")
    try:
        return load_rig(output)
    except RigError as error:
        raise InputError(f"{error}: mend or delete it, its mount would be lost") from None


def _with_kept(rig: StereoRig, replaced: StereoRig | None) -> StereoRig:
    if replaced is None:
        return rig
    kept = {key: replaced.sections[key] for key in KEPT_SECTIONS if key in replaced.sections}
    return replace(rig, mount=replaced.mount, sections={**kept, **rig.sections})


def _as_json(result: CalibrationResult, found: PairList) -> dict:
    def pair(view) -> dict:
        left_rms, right_rms = view.rms or (None, None)
        return {
            "left": str(view.left.path),
            "right": str(view.right.path),
            "used": view.reason is None,
            "reason": view.reason,
            "left_rms_px": left_rms,
            "right_rms_px": right_rms,
        }

    return {
        "stereo_rms_px": result.stereo_rms,
        "row_rms_px": result.row_rms,
        "baseline_m": result.rig.baseline,
        "pairs_used": result.pairs_used,
        "pairs_given": len(result.views),
        "pairs": [pair(view) for view in result.views],
        "unmatched": [str(path) for path in found.unmatched],
    }


def _print_result(result: CalibrationResult, found: PairList) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    table = Table("left", "right", "left RMS px", "right RMS px", "remark", box=None)
    for view in result.views:
        numbers = [f"{rms:.3f}" for rms in view.rms] if view.rms else ["-", "-"]
        renumbered = "corner order put right" if view.renumbered else ""
        remark = f"not used: {view.reason}" if view.reason else renumbered
        table.add_row(view.left.path.name, view.right.path.name, *numbers, remark)
    console.print(table)
    if found.matched_by == "order":
        console.print("images matched by sorted order: their names share no numbers")
    for path in found.unmatched:
        console.print(f"no partner: {path}", soft_wrap=True)
    rig = result.rig
    console.print(f"\npairs used     {result.pairs_used} of {len(result.views)}")
    console.print(f"stereo RMS     {result.stereo_rms:.3f} px, rows {result.row_rms:.3f} px")
    console.print(f"baseline       {rig.baseline * 1e3:.2f} mm")
    for name, camera in (("left", rig.left), ("right", rig.right)):
        across, down = (
            math.degrees(2 * math.atan(size / (2 * focal)))
            for size, focal in zip(rig.image_size, (camera.fx, camera.fy), strict=True)
        )
        console.print(
            f"{name + ' camera':<14} focal length {camera.fx:.1f} x {camera.fy:.1f} px, "
            f"field of view {across:.1f} x {down:.1f} deg"
        )


def _print_next(rig: StereoRig, replaced: StereoRig | None, output: Path) -> None:
    kept = [key for key in KEPT_SECTIONS if key in rig.sections]
    if replaced is not None and (rig.mount or kept):
        names = ", ".join([*(["mount"] if rig.mount else []), *kept])
        click.echo(f"kept from the replaced file: {names}")
    click.echo(f"written        {output}")
    unknown = (
        "the mount is not known yet: measure the left camera's height (m) and pitch (deg, down "
        f"positive), write them into {output} under mount:, "
    )
    click.echo(
        f"next: {'' if rig.mount else unknown + 'then '}beemap map RECORDING -o OUT --rig {output}"
    )
