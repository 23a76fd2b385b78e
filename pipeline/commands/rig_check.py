"""`beemap rig check`: does a calibration still fit its cameras?"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.progress import progress_bar

if TYPE_CHECKING:
    import numpy as np

    from calibration.rig import StereoRig
    from pipeline.recordings.base import Recording
    from pipeline.rig_check import DriftCheck

DRIFTED = 3  # exit code


@click.command()
@click.argument("rig_file", metavar="RIG", type=click.Path(path_type=Path))
@click.argument("images", metavar="RECORDING | LEFT RIGHT", nargs=-1, required=True)
@click.option(
    "--pairs",
    default=30,
    show_default=True,
    type=click.IntRange(1, 1000),
    help="Pairs to look at, spread evenly.",
)
@click.option(
    "--pictures",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Also write each pair as PNG: rectified, with row lines, and its disparity.",
)
@click.option("--force", is_flag=True, help="Replace pictures that are there.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def check(
    rig_file: Path,
    images: tuple[str, ...],
    pairs: int,
    pictures: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Tell from ordinary scenes whether a calibration still fits.

    The same point must lie on the same row of both rectified images. Scene points are matched
    and their rows compared: no board is needed. IMAGES are a recording, a folder of images whose
    names say left and right, or two folders or quoted globs. Exit code 0: fine; 3: drifted.

    \b
    beemap rig check rig.yaml REC
    beemap rig check rig.yaml 'shots/left*.png' 'shots/right*.png' --pictures pictures
    """
    from calibration.exchange.formats import read_rig
    from pipeline.pair_sources import open_pairs
    from pipeline.rig_check import check_rig

    if len(images) > 2:
        raise click.UsageError("give one recording, or two folders (or quoted globs) of images")
    rig = read_rig(rig_file).rig
    recording = open_pairs(images)
    with progress_bar("matching", "pairs", quiet or as_json) as progress:
        found = check_rig(rig, recording, pairs, progress)
    drawn = _draw(pictures, force, rig, recording, pairs) if pictures else []
    if as_json:
        click.echo(json.dumps(_as_json(found, recording, drawn), indent=2))
    elif not quiet:
        _print(found, recording, drawn)
    if found.drifted:
        raise SystemExit(DRIFTED)


def _draw(
    folder: Path, force: bool, rig: StereoRig, recording: Recording, pairs: int
) -> list[Path]:
    """One PNG a pair, all of them or none; pairs that cannot be read have none."""
    import cv2

    from pipeline.errors import InputError
    from pipeline.frontend import IMAGE_ERRORS
    from pipeline.new_files import new_files
    from pipeline.rectified_picture import draw_pair
    from pipeline.whole_images import spread, whole_rectifier

    rectify = whole_rectifier(rig)
    files = spread(recording.pairs, pairs)
    targets = [folder / f"{pair.name}.png" for pair in files]
    drawn = {}
    for target, pair in zip(targets, files, strict=True):
        try:
            loaded = pair.load()
            drawn[target] = draw_pair(loaded.left, loaded.right, rectify)
        except IMAGE_ERRORS:
            continue  # counted when its rows were looked at
    with new_files(list(drawn), force) as partial:
        for target, picture in drawn.items():
            if not cv2.imwrite(str(partial / target.name), picture):
                raise InputError(f"{target}: cannot be written: is the disk full?")
    return list(drawn)


def _as_json(found: DriftCheck, recording: Recording, drawn: list[Path]) -> dict[str, Any]:
    rows = found.rows
    return {
        "verdict": _verdict(found),
        "row_rms_px": rows.rms,
        "row_bias_px": rows.bias,
        "row_systematic_px": rows.systematic,
        "row_noise_px": rows.noise,
        "limit_px": found.limit,
        "turned_deg": _degrees(rows.turned),
        "turned_sigma_deg": _degrees(rows.turned_sigma),
        "stretched": rows.stretched,
        "pair_scatter_px": rows.scatter,
        "matches": rows.matches,
        "false_matches": rows.false_matches,
        "pairs_used": found.pairs,
        "pairs_given": len(recording.pairs),
        "skipped": recording.skipped,
        "notes": found.notes,
        "pictures": [str(path) for path in drawn],
    }


def _degrees(angles: np.ndarray) -> dict[str, float]:
    return {
        name: math.degrees(angle)
        for name, angle in zip(("pitch", "yaw", "roll"), angles, strict=True)
    }


def _verdict(found: DriftCheck) -> str:
    return "drifted" if found.drifted else "fine"


def _print(found: DriftCheck, recording: Recording, drawn: list[Path]) -> None:
    from pipeline.recordings.base import counted

    rows = found.rows
    for reason, names in recording.skipped.items():
        click.echo(f"skipped: {reason}: {counted(names)}")
    click.echo(
        f"matches        {rows.matches} in {found.pairs} pairs "
        f"({rows.false_matches} more did not agree)"
    )
    click.echo(f"row error      {rows.rms:.3f} px RMS, median {rows.bias:+.3f} px")
    click.echo(
        f"of this        {rows.systematic:.3f} px systematic (limit {found.limit:.2f}), "
        f"{rows.noise:.3f} px noise of matching"
    )
    turned, sigma = _degrees(rows.turned), _degrees(rows.turned_sigma)
    angles = ", ".join(f"{name} {turned[name]:+.3f} +- {sigma[name]:.3f}" for name in turned)
    click.echo(f"as if the right camera had turned by [deg]: {angles}")
    for note in found.notes:
        click.echo(f"note: {note}")
    if drawn:
        click.echo(f"pictures       {len(drawn)} in {drawn[0].parent}")
    remedy = ": calibrate again ('beemap calibrate cameras')" if found.drifted else ""
    click.echo(f"verdict: {_verdict(found)}{remedy}")
