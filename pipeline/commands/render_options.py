"""Options of the commands that render recordings, and the rig and the faults they tell."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.errors import InputError
from simulation.faults import CAMERAS, CameraFaults, described, with_faults

if TYPE_CHECKING:
    from calibration.rig import StereoRig

FAULTS_TOLD = "\b\nFaults for --fault NAME=VALUE, each alone or with others:\n" + "\n".join(
    f"  {name:<15}{unit:<6} {meaning}" for name, unit, meaning in described()
)


def _number(name: str, default: float | None, metavar: str, limits: Any, told: str) -> Any:
    return click.option(
        name, default=default, show_default=default is not None, metavar=metavar, type=limits,
        help=told,
    )  # fmt: skip


_OPTIONS = (
    click.option(
        "-o",
        "--output",
        required=True,
        type=click.Path(path_type=Path),
        metavar="REC",
        help="Folder of the recording.",
    ),
    click.option(
        "--seed",
        default=1,
        show_default=True,
        type=click.IntRange(min=0),
        help="Seed of the image noise and of the wheels' errors.",
    ),
    click.option(
        "--scene",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Scene file (YAML) in place of the preset's.",
    ),
    click.option(
        "--size",
        default="640x480",
        show_default=True,
        metavar="WxH",
        help="Image size; the lens is the same for every multiple of 4x3.",
    ),
    _number("--duration", None, "S", click.FloatRange(min=0), "Stop after so many seconds."),
    _number("--rate", 2.0, "HZ", click.FloatRange(0.1, 60), "Pairs a second."),
    _number(
        "--noise-along", 10.0, "MM", click.FloatRange(min=0),
        "Standard deviation of the wheels along the path per 0.2 m.",
    ),
    _number(
        "--noise-turn", 0.3, "DEG", click.FloatRange(min=0),
        "Standard deviation of the wheels' heading per 0.2 m.",
    ),
    _number(
        "--wheel-error", 0.2, "PERCENT", click.FloatRange(-20, 20),
        "So much larger is the right wheel than the robot believes.",
    ),
    _number("--height", 0.30, "M", click.FloatRange(0.02, 2.0), "Camera above the floor."),
    _number("--pitch", 0.0, "DEG", click.FloatRange(-60, 60), "Tilt, nose down positive."),
    _number("--roll", 0.0, "DEG", click.FloatRange(-45, 45), "Roll of the cameras."),
    _number(
        "--mount-error", 0.0, "DEG", click.FloatRange(-20, 20),
        "The recording states a pitch so much larger than the true one (truth/rig.yaml).",
    ),
    _number("--baseline", 120.0, "MM", click.FloatRange(10, 1000), "Between the cameras."),
    click.option(
        "--lens",
        default="bent",
        show_default=True,
        type=click.Choice(["bent", "straight"]),
        help="Distorting lenses, slightly out of line; or perfect ones in line.",
    ),
    click.option(
        "--rig",
        "rig_file",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Any rig (rig.yaml) in place of --size, --baseline and --lens.",
    ),
    click.option(
        "--camera",
        default="plain",
        show_default=True,
        type=click.Choice(list(CAMERAS)),
        help="plain: noise alone; cheap: uneven exposure, vignetting, more noise, JPEG.",
    ),
    click.option(
        "--fault",
        "faults",
        multiple=True,
        metavar="NAME=VALUE",
        help="One more fault of the cameras, listed below; repeatable.",
    ),
    click.option(
        "--depth", is_flag=True, help="Also write the true depth of the left images."
    ),
    click.option(
        "--format",
        "ending",
        default="jpg",
        show_default=True,
        type=click.Choice(["jpg", "png"]),
        help="Of the image files.",
    ),
    click.option(
        "--quality",
        default=90,
        show_default=True,
        type=click.IntRange(1, 100),
        metavar="PERCENT",
        help="Of JPEG files.",
    ),
    click.option("--force", is_flag=True, help="Replace an existing folder."),
    click.option("--quiet", is_flag=True, help="No progress bar and no summary."),
)  # fmt: skip


def render_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add all options of a rendered recording."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def given(context: click.Context, name: str) -> bool:
    """Whether the user wrote this option himself."""
    return context.get_parameter_source(name) is not click.core.ParameterSource.DEFAULT


def true_rig(context: click.Context) -> StereoRig:
    """The rig that stands on the robot.

    Raises:
        InputError, RigError: an option or the rig's file that cannot be used.
    """
    from dataclasses import replace

    from calibration.rig import Mount, load_rig

    options = context.params
    turned = {
        name: value if name == "height" else math.radians(value)
        for name in ("height", "pitch", "roll")
        if given(context, name) or options["rig_file"] is None
        for value in (options[name],)
    }
    if options["rig_file"] is None:
        rig = _virtual_rig(options)
        assert rig.mount is not None
        return rig.with_mount(replace(rig.mount, **turned))
    for name in ("size", "baseline", "lens"):
        if given(context, name):
            raise InputError(f"--{name}: the rig of --rig has its own: give one of them")
    rig = load_rig(options["rig_file"])
    return rig.with_mount(replace(rig.mount or Mount(), **turned))


def stated_rig(rig: StereoRig, options: dict[str, Any]) -> StereoRig:
    """The rig as the recording tells it: a wrong pitch with --mount-error."""
    from dataclasses import replace

    assert rig.mount is not None
    wrong = rig.mount.pitch + math.radians(options["mount_error"])
    return rig.with_mount(replace(rig.mount, pitch=wrong))


def camera_faults(options: dict[str, Any]) -> CameraFaults:
    """The faults of --camera and --fault. Raises FaultError."""
    return with_faults(CAMERAS[options["camera"]], options["faults"])


def _virtual_rig(options: dict[str, Any]) -> StereoRig:
    from calibration.rig import minibee
    from simulation.rigs import bent_minibee, with_baseline

    nominal = minibee()
    width, height = _size(options["size"])
    if width * nominal.image_size[1] != height * nominal.image_size[0]:
        raise InputError(f"--size {options['size']}: not 4:3: give 320x240 or 640x480")
    factor = width / nominal.image_size[0]
    rig = nominal.scaled(factor) if options["lens"] == "straight" else bent_minibee(factor)
    return with_baseline(rig, options["baseline"] / 1000.0)


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdecimal() and 16 <= int(part) <= 4096 for part in parts):
        raise InputError(f"--size {text}: expected WIDTHxHEIGHT in pixels: give 320x240 or 640x480")
    return int(parts[0]), int(parts[1])
