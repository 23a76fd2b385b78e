"""`beemap simulate`: recordings of rendered scenes, with the truth beside them."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.commands.simulate_degrade import degrade
from pipeline.commands.simulate_paper import paper
from pipeline.commands.simulate_rig import rig
from pipeline.errors import InputError
from pipeline.folders import check_target, new_folder
from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from calibration.rig import StereoRig
    from simulation.drive import Drive
    from simulation.scene import Scene


@click.group()
def simulate() -> None:
    """Make recordings and runs out of nothing, with the truth beside them."""


simulate.add_command(paper)
simulate.add_command(degrade)
simulate.add_command(rig)


@simulate.command()
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="REC",
    help="Folder of the recording.",
)
@click.option(
    "--seed",
    default=1,
    show_default=True,
    type=click.IntRange(min=0),
    help="Seed of the image noise and of the wheels' errors.",
)
@click.option(
    "--scene",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Scene file (YAML) in place of the office.",
)
@click.option(
    "--size",
    default="320x240",
    show_default=True,
    metavar="WxH",
    help="Image size; the lens is the same for every multiple of 4x3.",
)
@click.option(
    "--duration",
    type=click.FloatRange(min=0),
    metavar="S",
    help="Stop after so many seconds instead of at the route's end.",
)
@click.option(
    "--rate",
    default=2.0,
    show_default=True,
    type=click.FloatRange(0.1, 100),
    metavar="HZ",
    help="Pairs a second.",
)
@click.option(
    "--noise-along",
    default=10.0,
    show_default=True,
    type=click.FloatRange(min=0),
    metavar="MM",
    help="Standard deviation of the wheels along the path per 0.2 m.",
)
@click.option(
    "--noise-turn",
    default=0.3,
    show_default=True,
    type=click.FloatRange(min=0),
    metavar="DEG",
    help="Standard deviation of the wheels' heading per 0.2 m.",
)
@click.option(
    "--height",
    default=0.30,
    show_default=True,
    metavar="M",
    type=click.FloatRange(0.02, 2.0),
    help="Camera above the floor.",
)
@click.option(
    "--pitch",
    default=0.0,
    show_default=True,
    metavar="DEG",
    type=click.FloatRange(-60, 60),
    help="Tilt of the cameras, nose down positive.",
)
@click.option(
    "--roll",
    default=0.0,
    show_default=True,
    metavar="DEG",
    type=click.FloatRange(-45, 45),
    help="Roll of the cameras about their view.",
)
@click.option("--depth", is_flag=True, help="Also write the true depth of the left images.")
@click.option(
    "--format",
    "ending",
    default="jpg",
    show_default=True,
    type=click.Choice(["jpg", "png"]),
    help="JPEG of quality 90, or PNG.",
)
@click.option("--force", is_flag=True, help="Replace an existing folder.")
@click.option("--quiet", is_flag=True, help="No progress bar and no summary.")
@click.pass_context
def office(context: click.Context, **options: Any) -> None:
    """Drive the virtual robot through a furnished office and record what it sees.

    Writes stereo pairs, wheel ticks, true poses and true maps. About a minute for 200 s of
    driving.

    Example: beemap simulate office -o office --seed 1
    """
    from simulation.drive import drive
    from simulation.scene import load_scene
    from simulation.wheels import MINIBEE_ENCODERS, WheelNoise

    check_target(options["output"], options["force"])
    cameras = _rig(options)
    scene = load_scene(options["scene"] or "office")
    noise = WheelNoise(
        along=options["noise_along"] / 1000.0, turn=math.radians(options["noise_turn"])
    )
    duration = math.inf if options["duration"] is None else options["duration"]
    trip = drive(scene.route, MINIBEE_ENCODERS, noise, options["seed"], duration, options["rate"])
    with new_folder(options["output"], options["force"]) as folder:
        _write(folder, scene, cameras, trip, options)
        _write_truth(folder / "truth", scene, cameras, trip, _command_line(context))
    if not options["quiet"]:
        _summarise(options["output"], trip)


def _rig(options: dict[str, Any]) -> StereoRig:
    from calibration.rig import Mount, minibee
    from simulation.rigs import bent_minibee

    nominal = minibee()
    width, height = _size(options["size"])
    if width * nominal.image_size[1] != height * nominal.image_size[0]:
        raise InputError(f"--size {options['size']}: not 4:3: give 320x240 or 640x480")
    assert nominal.mount is not None
    mount = Mount(
        height=options["height"],
        pitch=math.radians(options["pitch"]),
        roll=math.radians(options["roll"]),
        x=nominal.mount.x,
        y=nominal.mount.y,
    )
    return bent_minibee(width / nominal.image_size[0]).with_mount(mount)


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdecimal() and 16 <= int(part) <= 4096 for part in parts):
        raise InputError(f"--size {text}: expected WIDTHxHEIGHT in pixels: give 320x240 or 640x480")
    return int(parts[0]), int(parts[1])


def _write(
    folder: Path, scene: Scene, rig: StereoRig, trip: Drive, options: dict[str, Any]
) -> None:
    from dataclasses import asdict

    from pipeline.recordings.asl_writer import AslWriter, ImageFormat
    from simulation.renderer import StereoRenderer
    from simulation.wheels import MINIBEE_ENCODERS

    encoders = {**asdict(MINIBEE_ENCODERS), "reversed": list(MINIBEE_ENCODERS.reversed)}
    renderer = StereoRenderer(scene, rig, options["seed"])
    image_format = ImageFormat(options["ending"])
    with AslWriter(folder, rig, options["rate"], encoders, image_format) as recording:
        for stamp, (left, right) in zip(
            trip.tick_stamps.tolist(), trip.ticks.tolist(), strict=True
        ):
            recording.add_ticks(stamp, left, right)
        truth = trip.truth
        with progress_bar("rendering", "pairs", options["quiet"]) as progress:
            for frame, stamp in enumerate(trip.stamps.tolist()):
                pair = renderer.render(trip.poses[frame], frame)
                recording.add_pair(stamp, pair.left, pair.right)
                recording.add_truth(stamp, truth[frame], trip.velocities[frame])
                if options["depth"]:
                    recording.add_depth(stamp, pair.depth)
                progress(frame + 1, len(trip.stamps))


def _write_truth(folder: Path, scene: Scene, rig: StereoRig, trip: Drive, command: str) -> None:
    from pipeline.map_files import write_map_server
    from simulation.floorplan import floor_plan, seen_plan

    folder.mkdir()
    write_map_server(folder, floor_plan(scene, trip.poses[0]), "floorplan")
    write_map_server(folder, seen_plan(scene, rig, trip.poses), "seen")
    (folder / "command.txt").write_text(command + "\n", encoding="utf-8")


def _command_line(context: click.Context) -> str:
    """The command that makes the same recording again."""
    words = ["beemap", "simulate", "office"]
    for option in context.command.params:
        source = context.get_parameter_source(option.name or "")
        if option.name in ("force", "quiet") or source is click.core.ParameterSource.DEFAULT:
            continue
        value = context.params[option.name or ""]
        words += [option.opts[0]] if value is True else [option.opts[0], str(value)]
    return shlex.join(words)


def _summarise(folder: Path, trip: Drive) -> None:
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    seconds = (trip.stamps[-1] - trip.stamps[0]) / 1e9
    click.echo(
        f"{folder}: {len(trip.stamps)} pairs, {trip.distance:.1f} m in {seconds:.0f} s, "
        f"{size / 1e6:.1f} MB"
    )
