"""`beemap calibrate mount`: how the cameras sit on the robot, from a recording."""

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
    from calibration.rig import Mount, StereoRig
    from pipeline.mount import MountEstimate
    from pipeline.recordings.base import Recording

# Of each field of the mount: unit shown, factor from SI to it, decimals.
SHOWN = {
    "height": ("m", 1.0, 4),
    "pitch": ("deg", math.degrees(1.0), 3),
    "roll": ("deg", math.degrees(1.0), 3),
    "yaw": ("deg", math.degrees(1.0), 3),
    "x": ("m", 1.0, 4),
    "y": ("m", 1.0, 4),
}


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--rig",
    "rig_file",
    type=click.Path(path_type=Path),
    help="Rig file; the mount is written into it. Default: the recording's own calibration.",
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Write another rig file instead."
)
@click.option(
    "--pairs",
    default=40,
    show_default=True,
    type=click.IntRange(3, 1000),
    help="Pairs, spread evenly, in which the floor is looked at.",
)
@click.option("--fps", type=click.FloatRange(min=0, min_open=True), help="Of plain image folders.")
@click.option("--force", is_flag=True, help="Replace the file that -o names.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def mount(
    recording: Path,
    rig_file: Path | None,
    output: Path | None,
    pairs: int,
    fps: float | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find how the cameras sit on the robot and write it into the rig file.

    Height, pitch and roll come from the floor in RECORDING. With wheel ticks in it the motion
    seen is held against the motion driven: straight driving tells yaw, turning both ways tells
    x and y. What the recording does not tell stays as it was. The mount of before is kept in the
    file under calibration.mount.before.

    \b
    beemap calibrate mount REC --rig rig.yaml
    """
    from calibration.rig import save_rig
    from pipeline.mount import estimate_mount
    from pipeline.new_files import check_free
    from pipeline.recordings import open_recording

    target = output or rig_file
    if target is None:
        raise InputError(
            "where shall the mount be written? give --rig rig.yaml, or -o for the recording's rig"
        )
    if target.is_dir():
        raise InputError(f"{target}: is a folder: give the name of a file, as in rig.yaml")
    if output is not None and (rig_file is None or output.resolve() != rig_file.resolve()):
        check_free([output], force)
    opened = open_recording(recording, fps)
    rig = _rig(opened, rig_file, in_place=output is None)
    with progress_bar("looking", "pairs", quiet or as_json) as progress:
        found = estimate_mount(opened, rig, pairs, progress)
    target.parent.mkdir(parents=True, exist_ok=True)
    save_rig(_with_mount(rig, found), target)
    if as_json:
        click.echo(json.dumps(_as_json(rig.mount, found, opened, target), indent=2))
    elif not quiet:
        _print(rig.mount, found, opened, target)


def _rig(recording: Recording, path: Path | None, in_place: bool) -> StereoRig:
    """The rig as it is: one without a mount stays without."""
    from calibration.exchange.formats import KINDS, read_rig

    if path is None:
        if recording.rig is None:
            raise InputError(
                f"{recording.path}: holds no calibration: give --rig rig.yaml "
                "('beemap calibrate cameras' makes one)"
            )
        return recording.rig
    found = read_rig(path)
    if in_place and found.kind != "beemap":
        raise InputError(
            f"{path}: {KINDS[found.kind]} holds no mount: give -o rig.yaml to write one that does"
        )
    return found.rig


def _with_mount(rig: StereoRig, found: MountEstimate) -> StereoRig:
    """The rig with the new mount; its doubt and the mount of before in the calibration section."""
    told: dict[str, Any] = {
        "pairs": found.floor.frames,
        "sigma": {key: _shown(key, value) for key, value in found.sigma.items()},
    }
    if rig.mount is not None:
        told["before"] = _fields(rig.mount)
    known = rig.sections.get("calibration")
    calibration = {**(known if isinstance(known, dict) else {}), "mount": told}
    return replace(rig, mount=found.mount, sections={**rig.sections, "calibration": calibration})


def _shown(key: str, value: float) -> float:
    return float(value * SHOWN[key][1])


def _fields(mount: Mount) -> dict[str, float]:
    return {key: _shown(key, getattr(mount, key)) for key in SHOWN}


def _as_json(
    before: Mount | None, found: MountEstimate, recording: Recording, target: Path
) -> dict[str, Any]:
    def named(values: dict[str, float]) -> dict[str, float]:
        return {f"{key}_{SHOWN[key][0]}": value for key, value in values.items()}

    hand_eye = found.hand_eye
    return {
        "rig": str(target),
        "mount": named(_fields(found.mount)),
        "sigma": named({key: _shown(key, value) for key, value in found.sigma.items()}),
        "kept": [key for key in SHOWN if key not in found.sigma],
        "before": None if before is None else named(_fields(before)),
        "pairs_with_floor": found.floor.frames,
        "pairs_looked_at": found.pairs,
        "steps": hand_eye.steps if hand_eye else 0,
        "wheel_scale": hand_eye.scale if hand_eye else None,
        "wheel_scale_sigma": hand_eye.scale_sigma if hand_eye else None,
        "skipped": recording.skipped,
        "notes": found.notes,
    }


def _print(before: Mount | None, found: MountEstimate, recording: Recording, target: Path) -> None:
    from pipeline.recordings.base import counted

    for reason, names in recording.skipped.items():
        click.echo(f"skipped: {reason}: {counted(names)}")
    for key, (unit, factor, decimals) in SHOWN.items():
        value = f"{getattr(found.mount, key) * factor:9.{decimals}f}"
        doubt = (
            f"+- {found.sigma[key] * factor:.{decimals}f} {unit}"
            if key in found.sigma
            else f"{unit}, not measured"
        )
        old = f"(was {getattr(before, key) * factor:.{decimals}f})" if before else ""
        click.echo(f"{key:<8} {value} {doubt:<18} {old}".rstrip())
    steps = f"; {found.hand_eye.steps} steps of wheels and cameras" if found.hand_eye else ""
    click.echo(f"floor in {found.floor.frames} of {found.pairs} pairs{steps}")
    for note in found.notes:
        click.echo(f"note: {note}")
    click.echo(f"written  {target}")
