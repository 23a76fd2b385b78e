"""`beemap map`: the main job from the command line."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.errors import InputError

if TYPE_CHECKING:
    from pipeline.job import Job
    from pipeline.run import MapRun
    from pipeline.settings import Settings


@click.command("map")
@click.argument("recording", type=click.Path(path_type=Path), metavar="INPUT")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, help="result folder"
)
@click.option(
    "--rig", type=click.Path(path_type=Path), help="rig.yaml; wins over the recording's own"
)
@click.option(
    "--motion",
    help="encoders (the default), poses (the recording's own) or poses:FILE.tum",
)
@click.option(
    "--method",
    type=click.Choice(["hierarchical", "per-scan"]),
    help="what feeds the filter: as --set mapping.method=...",
)
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="one setting")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option("--fps", type=click.FloatRange(min=0, min_open=True), help="of plain image folders")
@click.option("--threads", type=click.IntRange(min=1), help="default: all cores")
@click.option("--force", is_flag=True, help="replace an existing result folder")
@click.option("--quiet", is_flag=True, help="no progress, no summary")
def map_command(
    recording: Path,
    output: Path,
    rig: Path | None,
    motion: str | None,
    method: str | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    seed: int,
    fps: float | None,
    threads: int | None,
    force: bool,
    quiet: bool,
) -> None:
    """Map INPUT, a recording or a scan log: a map and a path come out.

    A recording is an EuRoC/ASL folder, a KITTI odometry folder, or a folder with left/ and
    right/. A scan log is a CARMEN log of laser scans with odometry (.log, .clf, also .gz, .bz2,
    .xz); the true path beside it (LOG's name, .tum) comes along. Ctrl-C ends the run early with
    the results so far.
    """
    from pipeline.folders import check_target, new_folder

    begin = time.perf_counter()
    check_target(output, force)
    if output.exists() and recording.resolve().is_relative_to(output.resolve()):
        raise InputError(f"{output}: holds the recording: choose another folder for the results")
    if method is not None:
        overrides = (*overrides, f"mapping.method={method}")
    threads = threads or os.cpu_count() or 1
    job, settings = _prepare(recording, fps, rig, motion, settings_file, overrides, seed, threads)
    use_threads(threads)
    if not quiet:
        for note in job.notes:
            click.echo(f"note: {note}", err=True)
    open3d = _Open3DLoading()
    with new_folder(output, force) as folder:
        run = _run(job, quiet, open3d)
        open3d.wait()
        facts = {
            "input": str(recording),
            **job.facts(),
            "seed": seed,
            "notes": job.notes,
            "threads": threads,
            "recording": job.skipped,
        }
        run.seconds["total"] = time.perf_counter() - begin
        from pipeline.results import write_results

        start = time.perf_counter()
        summary = write_results(folder, run, settings, job.truth, facts)
    if not quiet:
        _print_summary(output, job, run, summary, time.perf_counter() - start)
    if run.partial:
        click.echo(f"beemap: interrupted: {output} holds the results so far", err=True)
        raise SystemExit(130)


def _prepare(
    path: Path,
    fps: float | None,
    rig: Path | None,
    motion: str | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    seed: int,
    threads: int,
) -> tuple[Job, Settings]:
    """Open the input; the job with its settings."""
    from pipeline.job import log_job, recording_job
    from pipeline.recordings import open_input
    from pipeline.recordings.scan_log import ScanLog
    from pipeline.settings import load_settings

    if path.is_file():
        for option, value in (("--rig", rig), ("--motion", motion), ("--fps", fps)):
            if value is not None:
                raise InputError(
                    f"{path}: is a scan log, which holds its own odometry and needs no {option}: "
                    "leave it out"
                )
    opened = open_input(path, fps)
    if isinstance(opened, ScanLog):
        settings = load_settings(settings_file, overrides, opened.fitting)
        return log_job(opened, settings, seed), settings
    settings = load_settings(settings_file, overrides)
    return recording_job(opened, rig, motion or "encoders", settings, seed, threads), settings


def _run(job: Job, quiet: bool, open3d: _Open3DLoading) -> MapRun:
    """Map with a progress bar; the first Ctrl-C asks the run to end, a second one breaks it."""
    from pipeline.progress import progress_bar

    stop = threading.Event()

    def on_interrupt(signum: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    previous = signal.signal(signal.SIGINT, on_interrupt)
    try:
        with progress_bar("mapping", job.unit, quiet) as show:

            def progress(done: int, total: int) -> None:
                open3d.check()
                show(done, total)

            return job.run(progress, stop.is_set)
    finally:
        signal.signal(signal.SIGINT, previous)


def use_threads(threads: int) -> None:
    """Share the cores out: OpenCV one (frames run beside each other), numba all."""
    # Threads that wait for their next loop must not take the core from those that match images.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    import cv2
    import numba

    cv2.setNumThreads(1)
    # The default layer is not safe beside other threads; on Linux GNU OpenMP is always there.
    if os.name == "posix" and hasattr(os, "sched_getaffinity"):
        numba.config.THREADING_LAYER = "omp"  # pyright: ignore
    most = numba.config.NUMBA_NUM_THREADS  # pyright: ignore
    try:
        numba.set_num_threads(min(threads, most))
    except ValueError as error:
        raise InputError(
            f"numba finds no threads ({error}): on Debian or Ubuntu run 'apt-get install libgomp1'"
        ) from None


class _Open3DLoading:
    """Imports Open3D (0.6 s) in the background, where it is needed only at the end."""

    def __init__(self) -> None:
        self._failure: RuntimeError | None = None
        # No daemon: an interpreter that ends while a library is being loaded crashes.
        self._thread = threading.Thread(target=self._load)
        self._thread.start()

    def _load(self) -> None:
        from mapping.clouds import import_open3d

        try:
            import_open3d()
        except RuntimeError as error:
            self._failure = error

    def check(self) -> None:
        """Raise what went wrong so far: a long run must not end on a missing library."""
        if self._failure is not None:
            raise self._failure

    def wait(self) -> None:
        """Return when Open3D is there."""
        self._thread.join()
        self.check()


def _print_summary(
    output: Path, job: Job, run: MapRun, summary: dict[str, Any], writing: float
) -> None:
    from pipeline.recordings.base import counted

    seconds = summary["seconds"]["total"] + writing
    click.echo(
        f"{run.used} {job.unit}, {run.counts['observations']} observations, "
        f"{summary['local_maps']} local maps, {summary['path_m']:.1f} m of path, "
        f"{summary['known_m2']:.1f} m2 mapped in {seconds:.1f} s "
        f"({1000 * seconds / max(run.used, 1):.1f} ms a {job.unit.removesuffix('s')})"
    )
    for reasons in (job.skipped, run.skipped):
        for reason, names in reasons.items():
            click.echo(f"skipped: {reason}: {counted(names)}")
    for key, value in summary.get("odometry", {}).items():
        if value and key.startswith(("ticks_", "tick_gaps", "longest", "poses_skipped")):
            click.echo(f"odometry: {key.replace('_', ' ')}: {value:g}")
    for line in summary["health"]:
        click.echo(f"health: {line}")
    click.echo(
        f"results: {output}{os.sep} (open map.png; map.yaml for ROS, trajectory.tum for evo)"
    )
