"""`beemap odometry calibrate`: wheels, camera place and time offset from a driven recording."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.errors import InputError
from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from calibration.rig import StereoRig
    from odometry.encoders import EncoderParameters
    from pipeline.recordings.base import Recording
    from pipeline.recordings.scan_log import ScanLog
    from pipeline.wheel_calibration import WheelEstimate


@click.command("calibrate")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--rig", "rig_file", type=click.Path(path_type=Path), help="Rig file to start from.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Rig file to write.")
@click.option("--force", is_flag=True, help="Replace the file that -o names.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def calibrate_wheels(
    recording: Path,
    rig_file: Path | None,
    output: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Calibrate the odometry from RECORDING, driven anywhere with turns both ways.

    The motion that the cameras (or the laser of a scan log with wheel ticks) saw is held against
    the wheels: wheel radii, track, x, y and yaw of the camera on the robot, and the time between
    ticks and images, each with its standard deviation. Metres are the cameras': a wrong baseline
    makes wrong radii. The longer the drive, the better: 200 m tell radii to about 0.2 %. What the
    recording does not tell well enough stays as it was.
    """
    from pipeline.new_files import check_free
    from pipeline.recordings import open_input
    from pipeline.recordings.scan_log import ScanLog

    if output is not None:
        in_place = rig_file is not None and output.resolve() == rig_file.resolve()
        check_free([output], force)
        output.parent.mkdir(parents=True, exist_ok=True)
        if in_place and not force:
            raise InputError(f"{output}: already exists: give --force to replace it")
    opened = open_input(recording)
    if isinstance(opened, ScanLog):
        if rig_file is not None or output is not None:
            raise InputError(f"{recording}: is a scan log: it has no rig, leave --rig and -o out")
        before, found = _of_log(opened)
        rig = None
    else:
        rig, before, found = _of_recording(opened, rig_file, quiet or as_json)
    if output is not None and rig is not None:
        from calibration.rig import save_rig

        save_rig(_changed(rig, before, found), output)
    if as_json:
        click.echo(json.dumps(_as_json(before, found), indent=2))
    elif not quiet:
        _print(before, found)
        for reason, names in opened.skipped.items():
            click.echo(f"skipped: {len(names)} {reason}")
        if output is not None:
            click.echo(f"written  {output}")


def _of_recording(
    recording: Recording, rig_file: Path | None, quiet: bool
) -> tuple[StereoRig, EncoderParameters, WheelEstimate]:
    from odometry.settings import OdometrySettings
    from odometry.source import EncoderOdometry
    from pipeline.motion import choose_motion, wheels_of
    from pipeline.rig import choose_rig
    from pipeline.sensor_motion import visual_motions
    from pipeline.wheel_calibration import estimate_wheels

    settings = OdometrySettings()
    rig, notes = choose_rig(recording, rig_file)
    source = choose_motion("encoders", recording, rig, settings, 0)
    assert isinstance(source, EncoderOdometry)
    parameters = wheels_of(recording, rig)
    with progress_bar("looking", "pairs", quiet) as progress:
        motions = visual_motions(recording, rig, progress)
    found = estimate_wheels(source.track, parameters, motions, settings)
    return rig, parameters, replace(found, notes=[*notes, *found.notes])


def _of_log(log: ScanLog) -> tuple[EncoderParameters, WheelEstimate]:
    from odometry.source import EncoderOdometry
    from odometry.walk import walk
    from pipeline.sensor_motion import scan_motions
    from pipeline.settings import load_settings
    from pipeline.wheel_calibration import estimate_wheels

    if log.ticks is None or log.encoders is None:
        raise InputError(f"{log.path}: holds odometry, but no wheel ticks to calibrate")
    settings = load_settings(None, (), log.fitting)
    source = EncoderOdometry(log.ticks, log.encoders, settings.odometry)
    scans = log.taken(settings.laser, settings.mapping.max_range)
    wheels = walk(log.stamps, log.odometry, settings.odometry)
    motions = scan_motions(scans, wheels, log.origins[0], settings.mapping)
    return log.encoders, estimate_wheels(source.track, log.encoders, motions, settings.odometry)


def _changed(rig: StereoRig, before: EncoderParameters, found: WheelEstimate) -> StereoRig:
    """The rig with what was found; the wheels of before and the doubt under `calibration`."""
    from calibration.rig import Mount
    from odometry.encoders import encoder_section

    mount = rig.mount or Mount()
    if found.position is not None:
        mount = replace(mount, x=found.position[0], y=found.position[1])
    if found.yaw is not None:
        mount = replace(mount, yaw=found.yaw)
    known = rig.sections.get("calibration")
    told = {"stretches": found.stretches, "before": encoder_section(before)}
    told["sigma"] = {name: sigma for name, _, sigma, *_ in _rows(before, found)}
    calibration = {**(known if isinstance(known, dict) else {}), "odometry": told}
    sections = {"encoders": encoder_section(found.parameters), "calibration": calibration}
    return replace(rig, mount=mount, sections={**rig.sections, **sections})


def _rows(
    before: EncoderParameters, found: WheelEstimate
) -> list[tuple[str, float, float, str, bool]]:
    """Name, value, standard deviation, unit and whether it is used, of all that was found."""
    values, sigma = found.found.values.tolist(), found.found.sigma.tolist()
    new, degree = found.parameters, math.degrees(1.0)
    radii = new.left_radius != before.left_radius
    rows = [
        ("left_radius", values[0] * before.left_radius, sigma[0] * before.left_radius, "m", radii),
        (
            "right_radius",
            values[1] * before.right_radius,
            sigma[1] * before.right_radius,
            "m",
            radii,
        ),
        ("track", values[2], sigma[2], "m", new.track != before.track),
        ("x", values[3], sigma[3], "m", found.position is not None),
        ("y", values[4], sigma[4], "m", found.position is not None),
        ("yaw", degree * values[5], degree * sigma[5], "deg", found.yaw is not None),
    ]
    if found.offset is not None:
        seconds = before.time_offset + found.offset.seconds
        rows.append(("time_offset", seconds, found.offset.sigma, "s", found.offset_used))
    return rows


def _as_json(before: EncoderParameters, found: WheelEstimate) -> dict[str, Any]:
    return {
        **{
            name: {"value": value, "sigma": sigma, "unit": unit, "used": used}
            for name, value, sigma, unit, used in _rows(before, found)
        },
        "covariance": found.found.covariance.tolist(),
        "stretches": found.stretches,
        "stretches_used": found.found.used,
        "distance_m": found.distance,
        "time_offset_peak": found.offset.peak if found.offset else None,
        "notes": found.notes,
    }


def _print(before: EncoderParameters, found: WheelEstimate) -> None:
    old = {name: getattr(before, name, None) for name in ("left_radius", "right_radius", "track")}
    for name, value, sigma, unit, used in _rows(before, found):
        was = old.get(name)
        change = f"({100 * (value / was - 1):+.2f} % of {was:.4f})" if was else ""
        kept = "" if used else "  not taken over"
        click.echo(f"{name:<12} {value:9.5f} +- {sigma:.5f} {unit:<4}{change}{kept}".rstrip())
    click.echo(
        f"{found.stretches} stretches, {found.distance:.1f} m; {found.found.used} agree; they "
        f"scatter {found.found.scatter[0]:.1f} (distance) and {found.found.scatter[1]:.1f} (turn) "
        "times as far as the settings of odometry expect"
    )
    for note in found.notes:
        click.echo(f"note: {note}")
