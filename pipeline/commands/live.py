"""`beemap live`: map while the robot drives."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click
import msgspec

from pipeline.commands.web_options import check_web, watched, web_options


@click.command("live")
@click.argument("rig_file", metavar="RIG", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, help="Result folder."
)
@click.option(
    "--record",
    "recording",
    type=click.Path(path_type=Path),
    metavar="REC",
    help="Folder of the recording.  [default: recording in the result folder]",
)
@click.option(
    "--motion",
    type=click.Choice(["encoders", "visual", "fused"]),
    help="From the wheels, the images, or both.  [default: fused; visual without encoders]",
)
@click.option(
    "--continue",
    "known_map",
    type=click.Path(path_type=Path),
    metavar="MAP",
    help="Begin in a map made before: a result folder, map.npz or map.yaml.",
)
@click.option("--pose", metavar="X,Y,DEG", help="Where in it; else it is searched.")
@web_options
@click.option("--poses", metavar="FILE|-", help="Pose after every pair, new maps: JSON lines.")
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings.")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="One setting.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option("--threads", type=click.IntRange(min=1), help="Default: all cores.")
@click.option(
    "--duration", type=click.FloatRange(min=0, min_open=True), help="Seconds; else until Ctrl-C."
)
@click.option("--force", is_flag=True, help="Replace an existing result folder.")
@click.option("--quiet", is_flag=True, help="No status line, no summary.")
def live_command(
    rig_file: Path,
    output: Path,
    recording: Path | None,
    motion: str | None,
    known_map: Path | None,
    pose: str | None,
    web: bool,
    host: str | None,
    port: int | None,
    poses: str | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    seed: int,
    threads: int | None,
    duration: float | None,
    force: bool,
    quiet: bool,
) -> None:
    """Map with the devices that RIG names, until Ctrl-C; everything is recorded, too.

    Map and path are saved whenever the map has grown (map.yaml, map.npz, trajectory.tum, each
    replaced whole) and at the end, with all that `beemap map` writes. It speaks to nobody but the
    devices of the rig; with --web it listens on this machine alone, unless --host says otherwise.

    \b
    beemap simulate rig --preset office             (in another terminal)
    beemap live virtual-rig/rig.yaml -o run --web
    """
    from pipeline.checkpoint import Checkpoint
    from pipeline.commands.libraries import use_threads
    from pipeline.commands.live_screen import Screen
    from pipeline.commands.record import check_new
    from pipeline.fitting import fitted_live
    from pipeline.folders import check_target
    from pipeline.live.devices import load_live_rig
    from pipeline.live.events import EventLines
    from pipeline.live.live_run import LiveOptions, abandon_output, begin_output, live_run
    from pipeline.map_request import MapRequest, parse_begin
    from pipeline.output_lock import locked
    from pipeline.places import read_places
    from pipeline.settings import check, given_settings, sets_cell
    from pipeline.signals import until_interrupted
    from pipeline.watcher import NOBODY

    check_web(web, host, port)
    rig = load_live_rig(rig_file)
    rig.source.calibrated()
    if motion is None:
        motion = "visual" if rig.parameters is None else "fused"
    elif motion != "visual":
        rig.wheels()
    given = given_settings(settings_file, overrides)
    begin = parse_begin(known_map, pose)
    known_grid = None if begin is None else begin.known()
    settings, chosen = fitted_live(
        check(given, "settings"),
        not sets_cell(given),
        rig.source.calibrated(),
        rig.parameters,
        known_grid,
    )
    check_target(output, force)
    if recording is not None:
        check_new(recording)
    use_threads(threads or os.cpu_count() or 1)
    place = recording or _free(output / "recording")
    facts = {"input": str(rig_file), "format": "live", "motion": motion, "seed": seed}
    facts["recording"] = str(place)
    lines = EventLines(poses) if poses else None
    screen = Screen(quiet)
    if rig.parameters is None:
        screen.tell(f"{rig_file}: names no encoders: motion is found from the images")
    for setting, reason in chosen.items():
        screen.tell(f"{setting}: {reason}")
    name = output.resolve().name
    # What mapping the recording offline would be asked for: `map --resume` goes on so.
    asked = MapRequest(str(place), motion=motion, seed=seed, begin=begin)
    asked = asked.complete(settings, chosen)
    facts["request"] = asked.told()

    def opened() -> Checkpoint:
        begin_output(output, facts)
        return Checkpoint.start(output / "checkpoint", msgspec.to_builtins(asked))

    try:
        with (
            locked(output),
            locked(place),
            until_interrupted() as stop,
            watched(web, host, port, name, output, stop) as page,
        ):
            screen.page = page
            options = LiveOptions(settings, seed, duration, stop, opened, facts, known_grid)
            options.places = read_places(Path(begin.map)) if begin else []
            options.motion, options.watcher = motion, page or NOBODY
            sinks = {"on_pose": lines, "on_map": lines} if lines else {}
            try:
                summary = live_run(
                    rig, output, place, options, **sinks, tell=screen.tell, on_status=screen.status
                )
            except Exception:
                abandon_output(output)
                raise
            (output / "checkpoint").unlink(missing_ok=True)
    finally:
        screen.end()
        if lines is not None:
            lines.close()
    if not quiet:
        _tell(output, place, summary)


def _free(place: Path) -> Path:
    """That folder, or one beside it: a recording is never replaced."""
    number = 1
    free = place
    while free.exists() and (not free.is_dir() or any(free.iterdir())):
        number += 1
        free = place.with_name(f"{place.name}-{number}")
    return free


def _tell(output: Path, place: Path, summary: dict[str, Any]) -> None:
    from pipeline.commands.record import summarise

    poses, maps = summary["pair_to_pose_s"], summary["map_to_file_s"]
    counts = summary["counts"]
    click.echo(
        f"{counts.get('pairs used', 0)} pairs mapped, {summary['pairs_skipped']} skipped, "
        f"{counts.get('observations', 0)} observations, {summary['local_maps']} local maps, "
        f"{summary['path_m']:.1f} m of path, "
        f"mapped: {summary['free_m2']:.1f} m2 free, {summary['occupied_m2']:.1f} m2 occupied",
        err=True,
    )
    if poses and maps:
        click.echo(
            f"95 % of the poses within {1000 * poses['p95']:.0f} ms of the image, of the maps "
            f"saved within {1000 * maps['p95']:.0f} ms",
            err=True,
        )
    summarise(summary)
    for line in summary["health"]:
        click.echo(f"health: {line}", err=True)
    click.echo(f"verdict: {summary['verdict']['word']}: {summary['verdict']['why']}", err=True)
    click.echo(f"results: {output}{os.sep}; recording: {place}", err=True)
