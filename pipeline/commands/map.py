"""`beemap map`: the main job from the command line."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from pipeline.commands.libraries import use_threads
from pipeline.errors import InputError

if TYPE_CHECKING:
    from pipeline.checkpoint import Checkpoint, Observations
    from pipeline.job import Job
    from pipeline.map_request import MapRequest
    from pipeline.run import MapRun
    from pipeline.settings import Settings


@click.command("map")
@click.argument("recording", type=click.Path(path_type=Path), metavar="INPUT", required=False)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="result folder")
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="go on with a run of map or live into OUT that was cut off; as it was asked for then",
)
@click.option(
    "--continue",
    "known_map",
    type=click.Path(path_type=Path),
    metavar="MAP",
    help="begin in a map made before: a result folder, map.npz or map.yaml",
)
@click.option("--pose", metavar="X,Y,DEG", help="where in it; else it is searched")
@click.option(
    "--rig", type=click.Path(path_type=Path), help="rig.yaml; wins over the recording's own"
)
@click.option(
    "--motion",
    help="fused (images and wheels), visual (images), encoders, odometry (kept as poses), poses "
    "(the recording's own truth) or poses:FILE.tum; default: fused, else visual",
)
@click.option(
    "--method",
    type=click.Choice(["hierarchical", "per-scan"]),
    help="what feeds the filter: as --set mapping.method=...",
)
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="one setting")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option(
    "--fps", type=click.FloatRange(min=0, min_open=True), help="of plain image folders and videos"
)
@click.option("--ticks", type=click.Path(path_type=Path), help="table of wheel ticks (CSV)")
@click.option(
    "--ticks-columns", default="time,left,right", show_default=True, help="names or 1,2,3"
)
@click.option(
    "--ticks-unit",
    type=click.Choice(["s", "ms", "us", "ns"]),
    help="of its time  [default: as the column's name says, else s]",
)
@click.option(
    "--ticks-offset", default=0.0, help="seconds to add to its time: the images' clock counts"
)
@click.option(
    "--right-late",
    default=0,
    metavar="FRAMES",
    help="pair left image n with right image n + FRAMES: the right camera was so many frames late",
)
@click.option(
    "--unchecked",
    is_flag=True,
    help="map even if a first look shows that images, rig and mount do not fit each other; "
    "nothing is corrected",
)
@click.option("--threads", type=click.IntRange(min=1), help="default: all cores")
@click.option("--force", is_flag=True, help="replace an existing result folder")
@click.option("--quiet", is_flag=True, help="no progress, no summary")
def map_command(
    recording: Path | None,
    output: Path | None,
    resume: Path | None,
    known_map: Path | None,
    pose: str | None,
    rig: Path | None,
    motion: str | None,
    method: str | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    seed: int,
    fps: float | None,
    ticks: Path | None,
    ticks_columns: str,
    ticks_unit: str | None,
    ticks_offset: float,
    right_late: int,
    unchecked: bool,
    threads: int | None,
    force: bool,
    quiet: bool,
) -> None:
    """Map INPUT, a recording or a scan log: a map and a path come out.

    A recording is an EuRoC/ASL folder, a KITTI odometry folder, a folder with left/ and right/, a
    folder with a left and a right video, or one side-by-side video. A scan log is a CARMEN log of
    laser scans with odometry (.log, .clf, also .gz, .bz2, .xz); the true path beside it (LOG's
    name, .tum) comes along. Ctrl-C ends the run early with the results so far; --resume goes on.
    """
    from pipeline.checkpoint import Checkpoint
    from pipeline.folders import check_output
    from pipeline.map_request import MapRequest, Ticks, checkpoint_of, parse_begin, resumed
    from pipeline.output_lock import locked

    threads = threads or os.cpu_count() or 1
    if resume is not None:
        if recording is not None or output is not None:
            raise InputError("--resume OUT: knows its input and its output: give neither again")
        with locked(resume):
            checkpoint, request = resumed(resume)
            with checkpoint:
                job, settings = request.prepare(None, (), threads)
                _map(request, job, settings, checkpoint, resume, threads, True, quiet)
        return
    if recording is None:
        raise click.UsageError("Missing argument 'INPUT'")
    if output is None:
        raise click.UsageError("Missing option '-o'")
    check_output(recording, output, force)
    if method is not None:
        overrides = (*overrides, f"mapping.method={method}")
    table = Ticks(str(ticks), ticks_columns, ticks_unit, ticks_offset) if ticks else None
    begin = parse_begin(known_map, pose)
    rig_name = str(rig) if rig else None
    request = MapRequest(
        str(recording), rig_name, motion, fps, seed, table, begin, right_late, unchecked
    )
    with locked(output):
        job, settings = request.prepare(settings_file, overrides, threads)
        asked = request.complete(settings, job.chosen)
        with Checkpoint.start(checkpoint_of(output), msgspec.to_builtins(asked)) as checkpoint:
            _map(request, job, settings, checkpoint, output, threads, force, quiet)


def _map(
    request: MapRequest,
    job: Job,
    settings: Settings,
    checkpoint: Checkpoint,
    output: Path,
    threads: int,
    force: bool,
    quiet: bool,
) -> None:
    """Run the job, with what the checkpoint knows of it already; write, tell."""
    from pipeline.folders import new_folder
    from pipeline.places import read_places
    from pipeline.signals import until_interrupted

    begin = time.perf_counter()
    use_threads(threads)
    if not quiet:
        for note in job.notes:
            click.echo(f"note: {note}", err=True)
        for setting, reason in job.chosen.items():
            click.echo(f"{setting}: {reason}", err=True)
        if known := len(checkpoint):
            click.echo(f"goes on after {known} observations", err=True)
    # What is read of the earlier result and of the map to begin in, before either changes.
    places = read_places(output)
    if request.begin is not None:
        places += read_places(Path(request.begin.map))
    # Signals end the mapping, not the writing: what is found out is written down whole.
    with until_interrupted() as stop, new_folder(output, force) as folder:
        run = _run(job, quiet, checkpoint, stop)
        run.earlier_places = places
        facts = request.facts(job, settings, threads)
        run.seconds["total"] = time.perf_counter() - begin
        from pipeline.results import write_results

        start = time.perf_counter()
        summary = write_results(
            folder, run, settings, job.truth, facts, request.origin(output, job.opened)
        )
    if not quiet:
        _print_summary(output, job, run, summary, time.perf_counter() - start)
    if run.partial:
        click.echo(
            f"beemap: interrupted: {output} holds the results so far; "
            f"'beemap map --resume {output}' goes on",
            err=True,
        )
        raise SystemExit(130)
    checkpoint.discard()


def _run(job: Job, quiet: bool, known: Observations, stop: threading.Event) -> MapRun:
    """Map with a progress bar until `stop` is set."""
    from pipeline.progress import progress_bar

    with progress_bar("mapping", job.unit, quiet) as progress:
        return job.run(progress, stop.is_set, known)


def _print_summary(
    output: Path, job: Job, run: MapRun, summary: dict[str, Any], writing: float
) -> None:
    from pipeline.recordings.base import counted

    seconds = summary["seconds"]["total"] + writing
    click.echo(
        f"{run.used} {job.unit}, {run.counts['observations']} observations, "
        f"{summary['local_maps']} local maps, {summary['path_m']:.1f} m of path, "
        f"mapped: {summary['free_m2']:.1f} m2 free, {summary['occupied_m2']:.1f} m2 occupied, "
        f"in {seconds:.1f} s "
        f"({1000 * seconds / max(run.used, 1):.1f} ms a {job.unit.removesuffix('s')})"
    )
    for reasons in (job.skipped, run.skipped):
        for reason, names in reasons.items():
            click.echo(f"skipped: {reason}: {counted(names)}")
    for key, value in summary.get("odometry", {}).items():
        if value and key.startswith(("ticks_", "tick_gaps", "longest", "poses_")):
            click.echo(f"odometry: {key.replace('_', ' ')}: {value:g}")
    for line in summary["health"]:
        click.echo(f"health: {line}")
    click.echo(f"verdict: {summary['verdict']['word']}: {summary['verdict']['why']}")
    click.echo(
        f"results: {output}{os.sep} (open report.html; map.yaml for ROS, trajectory.tum for evo)"
    )
