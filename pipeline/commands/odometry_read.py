"""`beemap odometry read`: encoders on a serial port, or a raw log replayed, as ticks."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.errors import InputError

if TYPE_CHECKING:
    from odometry.counters import TickReading
    from odometry.devices import EncoderDevice
    from odometry.encoders import EncoderParameters
    from odometry.reader import LiveEncoders

READY_S = 8.0  # a board that restarts when its port is opened needs some seconds


@click.command()
@click.argument("rig_file", metavar="RIG", type=click.Path(path_type=Path))
@click.option("--seconds", type=click.FloatRange(min=0, min_open=True), help="Default: to Ctrl-C.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Ticks as odom0/data.csv.")
@click.option("--raw", type=click.Path(path_type=Path), help="Log every raw byte to a new file.")
@click.option("--replay", type=click.Path(path_type=Path), help="Such a log, instead of the port.")
@click.option("--force", is_flag=True, help="Replace the file that -o names.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors and what went wrong.")
def read(
    rig_file: Path,
    seconds: float | None,
    output: Path | None,
    raw: Path | None,
    replay: Path | None,
    force: bool,
    quiet: bool,
) -> None:
    """Read the encoders that RIG names under `devices`, and say what goes wrong.

    With --replay a raw log gives exactly the readings of the run that wrote it.
    """
    from odometry.reader import open_encoders, replay_encoders
    from odometry.settings import OdometrySettings
    from pipeline.new_files import check_free

    if replay is not None and (raw is not None or seconds is not None):
        raise InputError("--replay reads a whole log: leave --raw and --seconds out")
    if output is not None:
        check_free([output], force)
    device, parameters = _of_rig(rig_file)
    if replay is not None:
        encoders = replay_encoders(replay, device, parameters, OdometrySettings())
        readings = encoders.readings()
    else:
        with open_encoders(device, parameters, OdometrySettings(), raw) as encoders:
            encoders.wait_ready(READY_S)
            readings = _follow(encoders, seconds, quiet)
        readings += encoders.readings()  # what came while it was being closed
    for event in encoders.events():
        click.echo(event)
    if output is not None:
        _write(readings, output, force)
    if not quiet:
        told = ", ".join(f"{name} {n}" for name, n in encoders.report().items())
        click.echo(told.replace("_", " ") + (f"; written {output}" if output else ""))


def _of_rig(path: Path) -> tuple[EncoderDevice, EncoderParameters]:
    """Device and wheels of a rig file, which need not hold calibrated cameras."""
    from odometry.devices import encoder_device
    from odometry.encoders import encoder_parameters
    from pipeline.textfiles import read_fields

    rig = read_fields(path)
    wheels = encoder_parameters(rig.get("encoders"), f"{path}: encoders")
    return encoder_device(rig.get("devices"), str(path)), wheels


def _follow(encoders: LiveEncoders, seconds: float | None, quiet: bool) -> list[TickReading]:
    """The readings until the time is up or Ctrl-C, with a line of the latest."""
    readings: list[TickReading] = []
    end = None if seconds is None else time.monotonic() + seconds
    try:
        while end is None or time.monotonic() < end:
            left = 0.5 if end is None else min(0.5, max(end - time.monotonic(), 0.0))
            time.sleep(left)
            new = encoders.readings()
            readings += new
            for event in encoders.events():
                click.echo(event)
            if not quiet and new:
                rate = len(new) / max((new[-1].stamp - new[0].stamp) / 1e9, 1e-3)
                last = new[-1]
                click.echo(f"left {last.left:>10}  right {last.right:>10}  {rate:6.0f} a second")
    except KeyboardInterrupt:
        click.echo("stopped", err=True)
    return readings


def _write(readings: list[TickReading], output: Path, force: bool) -> None:
    from odometry.tick_log import HEADER, tick_lines
    from pipeline.new_files import new_files

    with new_files([output], force) as folder:
        text = HEADER + "".join(map(tick_lines, readings))
        (folder / output.name).write_text(text, encoding="ascii")
