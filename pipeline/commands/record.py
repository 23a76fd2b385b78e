"""`beemap record`: what cameras and encoders deliver, into a recording."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import click

from pipeline.errors import InputError


@click.command("record")
@click.argument("rig_file", metavar="RIG", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="REC",
    help="Folder of the recording.",
)
@click.option(
    "--duration", type=click.FloatRange(min=0, min_open=True), help="Seconds; else until Ctrl-C."
)
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="One setting.")
@click.option("--json", "as_json", is_flag=True, help="Print what came of it as JSON.")
@click.option("--quiet", is_flag=True, help="No status line, no summary.")
def record_command(
    rig_file: Path,
    output: Path,
    duration: float | None,
    overrides: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> None:
    """Record the devices that RIG names, calibrated or not, until Ctrl-C.

    Images are kept as the cameras send them, every byte of the encoders too. The folder is only
    appended to and synced each second: cut off at any moment it opens as it is.
    """
    from pipeline.commands.live_screen import Screen
    from pipeline.live.devices import load_live_rig
    from pipeline.live.record_run import record_run
    from pipeline.output_lock import locked
    from pipeline.settings import load_settings
    from pipeline.signals import until_interrupted

    settings = load_settings(None, overrides).odometry
    rig = load_live_rig(rig_file)
    check_new(output)
    screen = Screen(quiet or as_json)
    with locked(output), until_interrupted() as stop:
        report = record_run(rig, output, stop, settings, duration, screen.tell, screen.status)
    screen.end()
    if as_json:
        click.echo(json.dumps(report, indent=2))
    elif not quiet:
        summarise(report)
        click.echo(f"recording: {output} (beemap map {output} -o run)")


# What `Session.report` counts of pairs that came and were not recorded.
LEFT_OUT = {
    "late": "this machine was too slow to take them",
    "backwards": "stamped no later than the pair before",
}


def check_new(folder: Path) -> None:
    """Refuse a folder with something in it: a recording is never replaced."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: already exists: recordings are never replaced: another name")


def summarise(report: dict[str, Any]) -> None:
    """Print what was recorded and what went wrong, on standard error: the other may hold data."""
    say = functools.partial(click.echo, err=True)
    recorded, cameras = report["recorded"], report["cameras"]
    median, most = report["skew_ms"]
    readings = report["encoders"].get("readings", 0)
    say(
        f"{recorded['pairs']} pairs recorded, {recorded['dropped']} lost to the disk; left and "
        f"right {median:+.1f} ms apart (95 % within {most:.1f}); {readings} readings of the wheels"
    )
    for name in ("left", "right", "stereo"):
        wrong = {k: n for k, n in cameras.get(name, {}).items() if n and k != "frames"}
        if wrong:
            told = ", ".join(f"{n} {what}" for what, n in wrong.items())
            say(f"{name} camera: {told}")
    if cameras["lonely"]:
        say(f"{cameras['lonely']} images without a partner")
    for key, why in LEFT_OUT.items():
        if count := cameras.get(key):
            say(f"{count} pairs left out: {why}")
    wrong = {k: n for k, n in report["encoders"].items() if n and k != "readings"}
    if wrong:
        say("encoders: " + ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in wrong.items()))
