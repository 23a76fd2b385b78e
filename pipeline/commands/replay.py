"""`beemap replay`: a recording mapped at the pace at which it was made, on a page."""

from __future__ import annotations

import os
import threading
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from pipeline.commands.web_options import check_web, watched, web_options
from pipeline.errors import InputError

if TYPE_CHECKING:
    from pipeline.job import Job
    from pipeline.settings import Settings
    from pipeline.web.run_state import RunState


@click.command("replay")
@click.argument("source", metavar="RUN_OR_RECORDING", type=click.Path(path_type=Path))
@web_options
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    type=click.FloatRange(0.01, 1000),
    help="Times as fast as it was recorded.",
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Keep the results here.")
@click.option("--rig", type=click.Path(path_type=Path), help="As of map.")
@click.option("--motion", help="As of map.")
@click.option("--fps", type=click.FloatRange(min=0, min_open=True), help="As of map.")
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings.")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="One setting.")
@click.option("--seed", type=click.IntRange(min=0), help="[default: 1]")
@click.option("--threads", type=click.IntRange(min=1), help="Default: all cores.")
@click.option("--force", is_flag=True, help="Replace an existing result folder.")
def replay_command(
    source: Path,
    web: bool,
    host: str | None,
    port: int | None,
    speed: float,
    output: Path | None,
    rig: Path | None,
    motion: str | None,
    fps: float | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    seed: int | None,
    threads: int | None,
    force: bool,
) -> None:
    """Watch a recording being mapped, on the page of a live run.

    It is mapped anew, at the pace at which it was recorded; of a result folder, the recording it
    was made from, as it was mapped then. Every pair is mapped: where that takes longer than
    recording did, the replay is slower. Ctrl-C, or Stop on the page, ends it.

    \b
    beemap replay data/office --web --speed 4
    """
    from pipeline.commands.libraries import use_threads
    from pipeline.folders import check_output
    from pipeline.live.live_run import abandon_output, begin_output
    from pipeline.map_request import MapRequest
    from pipeline.output_lock import locked
    from pipeline.signals import until_interrupted

    if not web:
        raise InputError("replay: shows a run on a page: give --web")
    check_web(web, host, port)
    threads = threads or os.cpu_count() or 1
    use_threads(threads)
    if (source / "run.json").is_file():
        given = {"--rig": rig, "--motion": motion, "--fps": fps, "--seed": seed}
        given |= {"--settings": settings_file, "--set": overrides or None}
        job, settings, facts = _of_run(source, given, threads)
    else:
        request = MapRequest(
            str(source), str(rig) if rig else None, motion, fps, 1 if seed is None else seed
        )
        job, settings = request.prepare(settings_file, overrides, threads)
        asked = request.complete(settings).told()
        facts = {"input": request.input, "seed": request.seed, "request": asked}
    for note in job.notes:
        click.echo(f"note: {note}", err=True)
    if output is not None:
        check_output(Path(facts["input"]), output, force)
    name = source.resolve().name
    with (
        nullcontext() if output is None else locked(output),
        until_interrupted() as stop,
        watched(True, host, port, name, output, stop) as state,
    ):
        assert state is not None
        if output is not None:
            begin_output(output, facts)
        try:
            _replay(job, settings, facts, state, speed, output, stop)
        except Exception:
            if output is not None:
                abandon_output(output)
            raise
        if not stop.is_set():
            click.echo("the replay is over; Ctrl-C, or Stop on the page, ends it", err=True)
            stop.wait()


def _of_run(
    folder: Path, given: dict[str, Any], threads: int
) -> tuple[Job, Settings, dict[str, Any]]:
    """The run that made a result folder, its settings, and what run.json says of what it was
    asked for."""
    from pipeline.run_folder import open_run

    for option, value in given.items():
        if value is not None:
            raise InputError(f"{option}: a run is made again as it was: give the recording instead")
    run = open_run(folder)
    job = run.job(None, threads)
    for note in run.notes:
        click.echo(f"note: {note}", err=True)
    if job is None:
        raise InputError(f"{folder}: cannot be made again: give the recording instead")
    facts = {name: run.facts[name] for name in ("input", "seed", "request") if name in run.facts}
    # Where it lies now: it must not be replaced.
    facts["input"] = str(job.opened.path)
    return job, run.settings, facts


def _replay(
    job: Job,
    settings: Settings,
    facts: dict[str, Any],
    state: RunState,
    speed: float,
    output: Path | None,
    stop: threading.Event,
) -> None:
    """Map, show, and keep the results where they are wanted."""
    from pipeline.checkpoint import NOTHING
    from pipeline.live.live_run import save_results
    from pipeline.live.map_saver import MapSaver
    from pipeline.map_request import MapRequest
    from pipeline.replay import Paced, count

    saver = None if output is None else MapSaver(output, state.saved)
    paced = Paced(state, speed, count(job), stop, saver)
    try:
        run = job.run(lambda done, total: None, stop.is_set, NOTHING, paced)
    finally:
        if saver is not None:
            saver.close()
    if output is not None:
        facts |= {**job.facts(), "notes": job.notes}
        asked = msgspec.convert(facts.get("request", {"input": ""}), MapRequest)
        request = msgspec.structs.replace(asked, input=facts["input"])
        origin = request.origin(output, job.opened)
        save_results(output, run, settings, facts, job.truth, origin)
        click.echo(f"results: {output}{os.sep}", err=True)
    state.ended(run)
