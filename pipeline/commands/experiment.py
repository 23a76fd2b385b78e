"""`beemap experiment`: the paper's experiments, with many seeds, as tables and figures."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pipeline.errors import InputError

# name -> what it shows. The module of that name in pipeline.experiments is loaded when it runs.
SIMULATED = {
    "localmaps": "A false obstacle appears in a local map and is erased (Fig. 3).",
    "particles": "Time and quality against the number of particles (Figs 6, 7).",
    "quality": "Quality against the size and the number of false blocks (Fig. 8).",
    "maps": "The maps of both methods beside the ideal ones (Fig. 9).",
    "readings": "Sensitivity to each reading of the paper.",
    "table": "What the mapper must show, each with the previous method beside it.",
    "cost": "Time and memory against N, area and length; two threads against one.",
}
OFFICE = "A recording mapped from its images by both methods (Fig. 11)."
# Of these the time counts: runs beside each other would disturb it.
TIMED = ("particles", "cost")
# Of these there is but one run.
SINGLE = ("localmaps",)


@click.group()
def experiment() -> None:
    """Run the paper's experiments: rows.csv, table.md and figures in a folder.

    Every run is a simulated drive, mapped and held against the truth. A folder that was begun is
    gone on with: finished runs are not done again while settings, world and source are the same.
    """


def _shared(command: Callable[..., None]) -> Callable[..., None]:
    """The options of every experiment."""
    for option in reversed(
        [
            click.option(
                "-o",
                "--output",
                required=True,
                type=click.Path(path_type=Path),
                metavar="DIR",
                help="Folder of the results; one that was begun is gone on with.",
            ),
            click.option(
                "--seeds",
                type=click.IntRange(min=1),
                metavar="N",
                help="Runs of each kind. By default as many as the experiment needs.",
            ),
            click.option("--first-seed", default=1, show_default=True, type=click.IntRange(min=0)),
            click.option(
                "--set",
                "settings",
                multiple=True,
                metavar="STAGE.KEY=VALUE",
                help="A setting for all runs; wins over the experiment's own.",
            ),
            click.option("--force", is_flag=True, help="Start over."),
            click.option("--quiet", is_flag=True, help="No progress, no summary."),
        ]
    ):
        command = option(command)
    return command


def _workers(usual: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The options that say who does the runs; usual: how many at once."""
    jobs = click.option(
        "--jobs",
        type=click.IntRange(min=1),
        metavar="J",
        help=f"Runs at once. By default {usual}; with --scheduler as many as it has workers.",
    )
    scheduler = click.option(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="Run on the workers of this Dask scheduler (extra 'cluster').",
    )
    return lambda command: jobs(scheduler(command))


def _simulated(name: str, meaning: str) -> click.Command:
    timed = name in TIMED

    @click.command(name, help=meaning, short_help=meaning)
    @_shared
    @click.option("--world", default="flat", show_default=True, metavar="NAME|FILE")
    @click.option("--route", type=click.Path(), metavar="FILE", help="By default the world's own.")
    def command(**chosen: Any) -> None:
        others = [s for s in chosen["settings"] if not s.strip().startswith("mapping.")]
        if others:
            raise InputError(f"--set {others[0]}: only mapping.* decides a simulated run")
        _run(name, usual=1 if timed else None, **chosen)

    if name not in SINGLE:
        _workers("1: the time counts" if timed else "as many as there are cores")(command)
    return command


for _name, _meaning in SIMULATED.items():
    experiment.add_command(_simulated(_name, _meaning))


@experiment.command(short_help=OFFICE)
@click.argument("recording", type=click.Path(path_type=Path))
@_shared
@_workers("1")
def office(recording: Path, **chosen: Any) -> None:
    """RECORDING, as data/office, mapped from its images by both methods (Fig. 11)."""
    if not recording.is_dir():
        raise InputError(f"{recording}: no such folder: give a recording, as data/office")
    _run("office", recording, usual=1, world=str(recording), route=None, **chosen)


def _run(
    name: str,
    *arguments: Any,
    output: Path,
    seeds: int | None,
    force: bool,
    quiet: bool,
    usual: int | None,
    jobs: int | None = None,
    scheduler: str | None = None,
    **chosen: Any,
) -> None:
    """Run an experiment; exit code 1 when some of its runs failed, 130 after Ctrl-C.

    usual: runs at once on this machine, unless the user chooses.
    """
    from pipeline.experiments.batch import InterruptedBatchError
    from pipeline.experiments.options import Options
    from pipeline.output_lock import locked
    from pipeline.tasks.folder import open_folder
    from pipeline.tasks.runner import Workers

    module = importlib.import_module(f"pipeline.experiments.{name}")
    workers = Workers(jobs or (None if scheduler else usual), scheduler)
    options = Options(output, seeds=seeds or module.SEEDS, workers=workers, quiet=quiet, **chosen)
    try:
        with locked(output):
            open_folder(output, "experiment", name, force)
            batch = module.run(options, *arguments)
    except InterruptedBatchError as interrupted:
        click.echo(
            f"beemap: interrupted: {interrupted.done} of {interrupted.total} runs are in {output}; "
            "the same command goes on",
            err=True,
        )
        raise SystemExit(130) from None
    for failure in batch.failures:
        click.echo(f"beemap: failed: {failure}", err=True)
    if not quiet:
        for note in batch.notes:
            click.echo(f"note: {note}", err=True)
        names = ", ".join(sorted(file.name for file in output.glob("*.png")))
        click.echo(f"results: {output}{os.sep} (table.md, {names})")
    if batch.failures:
        raise SystemExit(1)
