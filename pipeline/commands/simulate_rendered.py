"""`beemap simulate office|corridor|...`: recordings of rendered scenes, the truth beside them."""

from __future__ import annotations

import math
import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.commands.render_options import (
    FAULTS_TOLD,
    camera_faults,
    given,
    render_options,
    stated_rig,
    true_rig,
)
from pipeline.errors import InputError
from pipeline.folders import RENDERED, check_target, new_folder
from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from calibration.rig import StereoRig
    from simulation.drive import Drive
    from simulation.faults import CameraFaults
    from simulation.scene import Scene
    from simulation.true_scans import TrueScans

# command -> (scene that ships with the package, what it is).
PRESETS = {
    "office": ("office", "a furnished office"),
    "corridor": ("corridor", "a ring of corridors with bare walls"),
    "glass": ("glass", "an office with meeting rooms of glass"),
    "clutter": ("clutter", "a workshop full of things and people"),
    "paper-rendered": ("paper", "the paper's 18 x 18 m world, its walls raised"),
}


def rendered(name: str) -> click.Command:
    """The command that records the preset `name`."""
    scene, what = PRESETS[name]

    @click.command(name, epilog=FAULTS_TOLD, short_help=f"Film {what}.")
    @render_options
    @click.pass_context
    def command(context: click.Context, **options: Any) -> None:
        _record(context, scene, options)

    command.help = (
        f"Drive the virtual robot through {what} and record what it sees.\n\n"
        "Writes stereo pairs, wheel ticks, true poses, true range vectors and true maps.\n\n"
        f"Example: beemap simulate {name} -o {scene} --seed 1 --camera cheap"
    )
    return command


def _record(context: click.Context, preset: str, options: dict[str, Any]) -> None:
    from simulation.drive import drive
    from simulation.scene import load_scene
    from simulation.wheels import MINIBEE_ENCODERS, WheelNoise

    check_target(options["output"], options["force"], RENDERED)
    if options["ending"] == "png" and given(context, "quality"):
        raise InputError("--quality: PNG files keep every pixel: leave it out, or --format jpg")
    rig, faults = true_rig(context), camera_faults(options)
    scene = load_scene(options["scene"] or preset)
    noise = WheelNoise(
        along=options["noise_along"] / 1000.0,
        turn=math.radians(options["noise_turn"]),
        right_error=options["wheel_error"] / 100.0,
    )
    duration = math.inf if options["duration"] is None else options["duration"]
    trip = drive(scene.route, MINIBEE_ENCODERS, noise, options["seed"], duration, options["rate"])
    with new_folder(options["output"], options["force"], RENDERED) as folder:
        scans, seconds = _write(folder, scene, rig, faults, trip, options)
        _write_truth(folder / "truth", scene, rig, trip, scans, _command_line(context))
    if not options["quiet"]:
        _summarise(options["output"], trip, seconds)


def _write(
    folder: Path,
    scene: Scene,
    rig: StereoRig,
    faults: CameraFaults,
    trip: Drive,
    options: dict[str, Any],
) -> tuple[TrueScans, float]:
    """Render all pairs and write the recording; the true range vectors, and the seconds spent on
    the pairs."""
    from dataclasses import asdict

    import numpy as np

    from pipeline.recordings.asl_writer import AslWriter, ImageFormat
    from simulation.filming import film
    from simulation.renderer import StereoRenderer
    from simulation.true_ranges import TrueRanger
    from simulation.true_scans import TrueScans
    from simulation.wheels import MINIBEE_ENCODERS

    stated = stated_rig(rig, options)
    renderer = StereoRenderer(scene, rig, options["seed"], faults=faults)
    ranger = TrueRanger(renderer.tracer, rig, stated)
    encoders = {**asdict(MINIBEE_ENCODERS), "reversed": list(MINIBEE_ENCODERS.reversed)}
    image_format = ImageFormat(options["ending"], options["quality"])
    stamps, truth = trip.stamps.tolist(), trip.truth
    ranges, textures = [], []
    with AslWriter(folder, stated, options["rate"], encoders, image_format) as recording:
        for stamp, (left, right) in zip(
            trip.tick_stamps.tolist(), trip.ticks.tolist(), strict=True
        ):
            recording.add_ticks(stamp, left, right)
        begin = time.perf_counter()
        shots = film(renderer, ranger, scene.route, trip, options["depth"])
        with progress_bar("rendering", "pairs", options["quiet"]) as progress:
            for frame, shot in enumerate(shots):
                recording.add_pair(stamps[frame], shot.left, shot.right)
                recording.add_truth(stamps[frame], truth[frame], trip.velocities[frame])
                if shot.depth is not None:
                    recording.add_depth(stamps[frame], shot.depth)
                ranges.append(shot.range)
                textures.append(shot.texture)
                progress(frame + 1, len(stamps))
    seconds = time.perf_counter() - begin
    scans = TrueScans(trip.stamps, ranger.bearing, np.stack(ranges), np.stack(textures))
    return scans, seconds


def _write_truth(
    folder: Path, scene: Scene, rig: StereoRig, trip: Drive, scans: TrueScans, command: str
) -> None:
    from calibration.rig import save_rig
    from pipeline.map_files import write_map_server
    from simulation.floorplan import floor_plan, seen_plan

    folder.mkdir()
    scans.save(folder / "scans.npz")
    write_map_server(folder, floor_plan(scene, trip.poses[0]), "floorplan")
    write_map_server(folder, seen_plan(scene, rig, trip.poses), "seen")
    if "--mount-error" in command:
        save_rig(rig, folder / "rig.yaml")
    (folder / "command.txt").write_text(command + "\n", encoding="utf-8")


def _command_line(context: click.Context) -> str:
    """The command that makes the same recording again."""
    words = ["beemap", "simulate", context.command.name or ""]
    for option in context.command.params:
        name = option.name or ""
        if name in ("force", "quiet") or not given(context, name):
            continue
        value = context.params[name]
        if value is True:
            words += [option.opts[0]]
            continue
        for one in value if isinstance(value, tuple) else (value,):
            words += [option.opts[0], str(one)]
    return shlex.join(words)


def _summarise(folder: Path, trip: Drive, seconds: float) -> None:
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    driven = (trip.stamps[-1] - trip.stamps[0]) / 1e9
    click.echo(
        f"{folder}: {len(trip.stamps)} pairs, {trip.distance:.1f} m in {driven:.0f} s, "
        f"{size / 1e6:.1f} MB, rendered at {len(trip.stamps) / seconds:.1f} pairs/s"
    )
