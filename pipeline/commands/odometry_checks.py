"""`beemap odometry straight` and `umbmark`: wheels calibrated with a tape measure."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from odometry.encoders import EncoderParameters

SHEET = """\
UMBmark: drive a square of {side:g} m, five times round to the left (counter-clockwise) and five
times to the right (clockwise), slowly, stopping at the corners. Before the start and after the
end measure where the robot stands, from two walls: x ahead, y to the left of the start, metres.
Subtract what odometry says of the end (zero, where it steers by odometry). Then:

    beemap odometry umbmark --side {side:g} --rig rig.yaml --ends ends.csv

with ends.csv as below; or give each end as --cw X Y and --ccw X Y.

    way,x,y
    cw,____,____      (5 lines)
    ccw,____,____     (5 lines)

A square cannot tell the size of both wheels together: run 'beemap odometry straight', too."""


@click.command()
@click.argument("recording", required=False, type=click.Path(path_type=Path))
@click.option(
    "--length",
    required=True,
    type=click.FloatRange(min=0.1),
    help="Of the straight run by the tape [m].",
)
@click.option(
    "--ticks",
    nargs=4,
    type=int,
    help="Left and right counter at the start, left and right at the end, instead of RECORDING.",
)
@click.option("--rig", "rig_file", type=click.Path(path_type=Path), help="Rig with the encoders.")
def straight(
    recording: Path | None,
    length: float,
    ticks: tuple[int, int, int, int] | None,
    rig_file: Path | None,
) -> None:
    """Wheel radii from a straight run of --length metres along a tape.

    The run is all of RECORDING, a folder with odom0, or the counters given by --ticks.
    """
    if (recording is None) == (ticks is None):
        raise InputError("give either a recording of the straight run, or --ticks and --rig")
    parameters, (left, right) = (
        _driven(recording, rig_file)
        if recording is not None
        else _counted(ticks or (0, 0, 0, 0), rig_file)
    )
    if min(left, right) <= 0.0:
        raise InputError(
            f"the wheels went {left:.3f} and {right:.3f} m: drive forward, and check "
            "encoders.reversed"
        )
    turn = (right - left) / parameters.track
    if abs(turn) > math.radians(20.0):
        raise InputError(
            f"the robot turned by {math.degrees(turn):.0f} deg by its wheels: that run is not "
            "straight (or left and right are exchanged)"
        )
    for name, path in (("left_radius", left), ("right_radius", right)):
        radius = getattr(parameters, name)
        click.echo(
            f"{name:<12} {radius * length / path:.5f} m  "
            f"({100 * (length / path - 1):+.2f} % of {radius:.5f})"
        )
    click.echo(
        f"a tape read to 2 mm makes this good to {0.2 / length:.2f} %; a robot that did not "
        "drive quite straight makes the radii unequal: trust their mean"
    )


@click.command()
@click.option("--side", default=4.0, show_default=True, type=click.FloatRange(min=0.2), help="[m]")
@click.option("--cw", nargs=2, type=float, multiple=True, help="An end clockwise: x y [m].")
@click.option("--ccw", nargs=2, type=float, multiple=True, help="An end counter-clockwise.")
@click.option("--ends", type=click.Path(path_type=Path), help="CSV of them: way,x,y.")
@click.option("--rig", "rig_file", type=click.Path(path_type=Path), help="Rig with the encoders.")
def umbmark(
    side: float,
    cw: tuple[tuple[float, float], ...],
    ccw: tuple[tuple[float, float], ...],
    ends: Path | None,
    rig_file: Path | None,
) -> None:
    """Radii and track from squares driven both ways round; without ends, the sheet to fill."""
    import numpy as np

    from odometry.umbmark import umbmark as fit

    runs = {"cw": [*cw], "ccw": [*ccw]}
    if ends is not None:
        _read_ends(ends, runs)
    if not (runs["cw"] or runs["ccw"]):
        click.echo(SHEET.format(side=side))
        return
    wheels = _wheels(rig_file)
    found = fit(
        np.reshape(runs["cw"], (-1, 2)), np.reshape(runs["ccw"], (-1, 2)), side, wheels.track
    )
    click.echo(f"E_d          {found.E_d:.5f} +- {found.sigma[0]:.5f}  right over left diameter")
    click.echo(f"E_b          {found.E_b:.5f} +- {found.sigma[1]:.5f}  track over the rig's")
    click.echo(f"left_radius  {wheels.left_radius * found.left:.5f} m")
    click.echo(f"right_radius {wheels.right_radius * found.right:.5f} m")
    click.echo(f"track        {wheels.track * found.E_b:.5f} m")
    click.echo(f"E_max,syst   {found.worst:.3f} m, {found.rest:.3f} m with these wheels")


def _wheels(rig_file: Path | None) -> EncoderParameters:
    from odometry.encoders import encoder_parameters
    from pipeline.textfiles import read_fields

    if rig_file is None:
        raise InputError("whose wheels are these? give --rig rig.yaml")
    return encoder_parameters(read_fields(rig_file).get("encoders"), f"{rig_file}: encoders")


def _driven(recording: Path, rig_file: Path | None) -> tuple[EncoderParameters, np.ndarray]:
    """Paths (2,) of both wheels over a whole recording."""
    from odometry.settings import OdometrySettings
    from odometry.source import EncoderOdometry
    from pipeline.recordings import open_recording

    opened = open_recording(recording)
    if opened.ticks is None:
        raise InputError(f"{recording}: holds no wheel ticks (odom0/data.csv)")
    wheels = opened.encoders if rig_file is None and opened.encoders else _wheels(rig_file)
    track = EncoderOdometry(opened.ticks, wheels, OdometrySettings()).track
    return wheels, track.paths[-1]


def _counted(
    ticks: tuple[int, int, int, int], rig_file: Path | None
) -> tuple[EncoderParameters, np.ndarray]:
    import numpy as np

    wheels = _wheels(rig_file)
    return wheels, np.subtract(ticks[2:], ticks[:2]) * wheels.metres_per_tick


def _read_ends(path: Path, runs: dict[str, list[tuple[float, float]]]) -> None:
    from pipeline.textfiles import read_lines

    for number, row in enumerate(csv.reader(read_lines(path)), start=1):
        way = row[0].strip().lower() if row else ""
        if not way or way == "way" or way.startswith("#"):
            continue
        try:
            x, y = (float(value) for value in row[1:])
            runs[way].append((x, y))
        except (ValueError, KeyError):
            raise InputError(
                f"{path}: line {number}: {','.join(row)!r}: expected cw,x,y or ccw,x,y in metres"
            ) from None
