"""`beemap view`: a run on one time line."""

from __future__ import annotations

import math
import os
import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.commands.recording_option import recording_option

if TYPE_CHECKING:
    import rerun as rr

    from pipeline.job import Job
    from pipeline.run_folder import RunFolder


@click.command("view")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option(
    "--save",
    type=click.Path(path_type=Path),
    metavar="FILE.rrd",
    help="Write it into a file instead, for rerun's viewer on another machine.",
)
@recording_option
@click.option("--no-browser", is_flag=True, help="Print the address only.")
@click.option("--threads", type=click.IntRange(min=1), help="Default: all cores.")
@click.option("--force", is_flag=True, help="Replace a file that is there.")
@click.option("--quiet", is_flag=True, help="No progress, no notes.")
def view_command(
    run: Path,
    save: Path | None,
    recording: Path | None,
    no_browser: bool,
    threads: int | None,
    force: bool,
    quiet: bool,
) -> None:
    """Show RUN, a result folder, as it came about: images, disparity, scans, local maps,
    particles, map and path on one time line, in rerun's viewer.

    The run is made again from its recording, with its own settings and seed; without the
    recording what the folder holds is shown. The viewer listens on 127.0.0.1 only.
    """
    from pipeline.extras import need

    need("view", "view")
    from pipeline.commands.libraries import use_threads
    from pipeline.new_files import check_free
    from pipeline.run_folder import open_run
    from pipeline.signals import until_interrupted

    if save is not None:
        check_free([save], force)
    threads = threads or os.cpu_count() or 1
    use_threads(threads)
    opened = open_run(run)
    job = opened.job(recording, threads)
    if not quiet:
        for note in opened.notes:
            click.echo(f"note: {note}", err=True)
    with until_interrupted() as stop:
        if save is not None:
            _save(opened, job, save, stop, force, quiet)
        else:
            _serve(opened, job, stop, no_browser, quiet)


def _save(
    run: RunFolder, job: Job | None, save: Path, stop: threading.Event, force: bool, quiet: bool
) -> None:
    from pipeline.new_files import new_files
    from pipeline.view.replay import layout, new_recording

    with new_files([save], force) as partial:
        with new_recording(run) as stream:
            stream.save(partial / save.name, default_blueprint=layout(run))
            _show(stream, run, job, stop, quiet)
        if stop.is_set():
            raise click.Abort
    if not quiet:
        click.echo(f"saved: {save} ('rerun {save}' shows it, and so does rerun's viewer elsewhere)")


def _serve(
    run: RunFolder, job: Job | None, stop: threading.Event, no_browser: bool, quiet: bool
) -> None:
    import webbrowser

    from pipeline.view.replay import layout, new_recording
    from pipeline.view.server import viewer

    with ExitStack() as stack:
        served = stack.enter_context(viewer())
        stream = stack.enter_context(new_recording(run))
        stream.connect_grpc(served.sink, default_blueprint=layout(run))
        click.echo(f"{served.page}  (Ctrl-C ends it)")
        if not no_browser and _has_screen():
            webbrowser.open(served.page)
        _show(stream, run, job, stop, quiet)
        stream.flush()
        stop.wait()


def _show(
    stream: rr.RecordingStream,
    run: RunFolder,
    job: Job | None,
    stop: threading.Event,
    quiet: bool,
) -> None:
    from pipeline.progress import progress_bar
    from pipeline.view.replay import SAME, Shown

    shown = Shown(stream, run)
    if job is None:
        shown.folder()
        return
    with progress_bar("showing", job.unit, quiet) as progress:
        apart = shown.again(job, progress, stop.is_set)
    if apart > SAME and not stop.is_set() and not quiet:
        other = "it is of other pairs than"
        if math.isfinite(apart):
            other = f"the path is up to {apart:.3f} m from"
        click.echo(f"note: made again, {other} the one in {run.path}", err=True)


def _has_screen() -> bool:
    """Without one a browser for terminals might be found, which can show nothing of it."""
    told = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in told)
