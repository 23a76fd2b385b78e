"""`beemap doctor`: is everything ready for a live run?"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from pipeline.doctor.check import Check

FAILED = 3  # exit code


@click.command("doctor")
@click.argument("rig_file", metavar="[RIG]", required=False, type=click.Path(path_type=Path))
@click.option(
    "--seconds",
    default=4.0,
    show_default=True,
    type=click.FloatRange(1, 600),
    help="How long to watch the devices; push the robot forward meanwhile.",
)
@click.option(
    "--disk",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=Path(),
    help="Folder that recordings go to.  [default: the current one]",
)
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings.")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="One setting.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def doctor_command(
    rig_file: Path | None,
    seconds: float,
    disk: Path,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Look at devices, calibration, disk and processor: PASS, WARN or FAIL, with what to do.

    Without RIG only the machine is looked at. Exit code 3 when something fails.

    \b
    beemap doctor rig.yaml      (push the robot forward while it watches)
    """
    from pipeline.commands.libraries import use_threads
    from pipeline.settings import load_settings

    settings = load_settings(settings_file, overrides)
    use_threads(2)
    checks: list[Check] = []

    def add(found: list[Check]) -> None:
        checks.extend(found)
        for check in () if as_json else found:
            click.echo(check.line)

    if not as_json and rig_file is not None:
        click.echo(f"watching for {seconds:g} s: push the robot forward", err=True)
    _look(rig_file, seconds, disk, settings, add)
    if as_json:
        click.echo(json.dumps([asdict(check) for check in checks], indent=2))
    if any(check.status == "FAIL" for check in checks):
        raise SystemExit(FAILED)


def _look(rig_file: Path | None, seconds: float, disk: Path, settings, add) -> None:
    from calibration.rig import minibee
    from pipeline.doctor.calibration import calibration_checks
    from pipeline.doctor.cameras import camera_checks
    from pipeline.doctor.check import PASS, Check, failed
    from pipeline.doctor.encoders import encoder_checks
    from pipeline.doctor.machine import disk_check, processor_check
    from pipeline.doctor.watch import watch
    from pipeline.live.devices import load_live_rig

    stereo_rig, pair_bytes, fps = minibee(), None, 10.0
    if rig_file is not None:
        try:
            rig = load_live_rig(rig_file)
        except ValueError as error:
            add([failed("rig file", error)])
            rig = None
        if rig is not None:
            add([Check("rig file", PASS, f"{rig_file}")])
            seen = watch(rig, seconds, settings.odometry)
            add(encoder_checks(rig, seen))
            add(camera_checks(rig, seen))
            add(calibration_checks(rig, seen))
            stereo_rig, fps = rig.source.rig or stereo_rig, rig.cameras.fps
            sizes = [
                sum(len(f.data) if isinstance(f.data, bytes) else f.data.nbytes for f in frames)
                for frames in ([p.left, *([p.right] if p.right else [])] for p in seen.pairs)
            ]
            pair_bytes = sum(sizes) / len(sizes) if sizes else None
    add([disk_check(disk, pair_bytes, fps)])
    add([processor_check(stereo_rig, settings)])
