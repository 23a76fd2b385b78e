"""`beemap simulate rig`: a virtual robot behind real interfaces, to try live runs on."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.commands.simulate_rendered import PRESETS, rendered
from pipeline.errors import InputError

if TYPE_CHECKING:
    from simulation.virtual_faults import Fault
    from simulation.virtual_rig import VirtualRig

PROTOCOLS = ("stream", "arduino_bridge", "roboclaw", "odrive")
# What may stand in the folder that is used again.
OURS = ("rig.yaml", "ttyENC0", "ttyENC1")
SPEED_ODOMETRY_BELIEVES = 3.0


@click.command()
@click.argument("recording", required=False, type=click.Path(path_type=Path), metavar="[REC]")
@click.option(
    "--preset", type=click.Choice(list(PRESETS)), help="Render this drive (once: it is kept)."
)
@click.option("--size", default="320x240", show_default=True, help="Images of the preset.")
@click.option(
    "--rate",
    default=2.0,
    show_default=True,
    type=click.FloatRange(0.1, 100),
    help="Pairs a second of the preset.",
)
@click.option("--duration", type=click.FloatRange(min=1), help="Seconds of the preset's drive.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("virtual-rig"),
    show_default=True,
    help="Folder of rig.yaml and of the encoders' port.",
)
@click.option(
    "--protocol",
    type=click.Choice(PROTOCOLS),
    default="stream",
    show_default=True,
    help="What the encoders speak.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="KIND@TIME[:LENGTH]",
    help="unplug, move, garbage, restart, wrap, mute; stall, drop, corrupt, lost (also "
    "stall-left, ...), skew: as in unplug@12s or skew@20s:40ms.",
)
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    type=click.FloatRange(0.01, 1000),
    help="Times as fast as it was recorded.",
)
@click.option(
    "--port", default=0, type=click.IntRange(0, 65535), help="Of the cameras; 0: a free one."
)
@click.option("--uncalibrated", is_flag=True, help="Write devices only, as before calibration.")
def rig(
    recording: Path | None,
    preset: str | None,
    size: str,
    rate: float,
    duration: float | None,
    output: Path,
    protocol: str,
    faults: tuple[str, ...],
    speed: float,
    port: int,
    uncalibrated: bool,
) -> None:
    """Drive a virtual robot through REC, an EuRoC recording, or through a preset.

    Its cameras are MJPEG streams on this machine alone, its encoders a serial port (a
    pseudo-terminal). It drives off when both cameras are watched, and stands where its drive
    ends; when nobody watches any more it is put back at the start. Ctrl-C ends it.

    \b
    beemap simulate rig --preset office --fault unplug@12s
    beemap live virtual-rig/rig.yaml -o run          (in another terminal)
    """
    from pipeline.recordings import open_recording
    from pipeline.virtual_rig import recorded_drive, write_rig_file
    from simulation.virtual_faults import parse_fault
    from simulation.virtual_rig import VirtualRig

    if (recording is None) == (preset is None):
        raise InputError("give a recording, or --preset office")
    parsed = tuple(parse_fault(fault) for fault in faults)
    path = recording or _rendered(preset or "", size, rate, duration)
    drive, cameras = recorded_drive(open_recording(path))
    with _folder(output), VirtualRig(drive, output, protocol, parsed, speed, port) as virtual:
        file = output / "rig.yaml"
        write_rig_file(file, cameras, virtual, not uncalibrated)
        _tell(file, path, virtual, speed)
        _watch(virtual, parsed)


def _rendered(preset: str, size: str, rate: float, duration: float | None) -> Path:
    """The preset's recording, rendered when it is asked for the first time."""
    base = os.environ.get("XDG_CACHE_HOME")
    cache = (Path(base) if base else Path.home() / ".cache") / "beemap" / "drives"
    name = f"{preset}-{size}-{rate:g}" + (f"-{duration:g}s" if duration else "")
    path = cache / name
    if not path.is_dir():
        click.echo(f"rendering the drive into {path} (once) ...")
        cache.mkdir(parents=True, exist_ok=True)
        arguments = ["-o", str(path), "--size", size, "--rate", f"{rate:g}"]
        arguments += ["--duration", f"{duration:g}"] if duration else []
        rendered(preset).main(arguments, standalone_mode=False)
    return path


@contextmanager
def _folder(output: Path) -> Iterator[None]:
    """The folder, free of an earlier rig; what was put there is taken away again."""
    try:
        output.mkdir(parents=True, exist_ok=True)
        others = {entry.name for entry in output.iterdir()} - set(OURS)
    except OSError as error:
        raise InputError(f"{output}: cannot be used ({error.strerror})") from None
    if others:
        raise InputError(f"{output}: holds {sorted(others)[0]}, too: choose another folder")
    try:
        yield
    finally:
        for name in OURS:
            (output / name).unlink(missing_ok=True)


def _tell(file: Path, path: Path, virtual: VirtualRig, speed: float) -> None:
    drive = virtual.drive
    seconds = (drive.stamps[-1] - drive.stamps[0]) / 1e9 / speed
    click.echo(
        f"virtual rig: {file} ({path.name}: {len(drive.stamps)} pairs in {seconds:.0f} s, "
        f"encoders speak {virtual.protocol})"
    )
    faster = ""
    if speed > SPEED_ODOMETRY_BELIEVES:
        faster = f" --set odometry.max_speed={1.5 * speed:g}"
    click.echo(f"in another terminal: beemap live {file} -o run{faster}")
    click.echo("it drives off when both cameras are watched; Ctrl-C ends it")


def _watch(virtual: VirtualRig, faults: tuple[Fault, ...]) -> None:
    """Say what happens until Ctrl-C."""
    timeline, told, driving = virtual.timeline, set(), False
    never = threading.Event()
    try:
        while not never.wait(0.05):
            seconds = timeline.seconds()
            if driving != (seconds >= 0):
                driving = seconds >= 0
                told.clear()
                click.echo("drives off" if driving else "nobody watches: back at the start")
            for fault in faults:
                if seconds >= fault.begin and fault not in told:
                    told.add(fault)
                    click.echo(f"{fault.begin:.1f} s: {fault.kind} for {fault.length:g} s")
            if timeline.finished.is_set() and None not in told:
                told.add(None)
                click.echo("the drive is over: the robot stands; end the live run with Ctrl-C")
    except KeyboardInterrupt:
        click.echo("virtual rig ended")
