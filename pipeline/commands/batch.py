"""`beemap batch`: many recordings by one command, on all cores or on a cluster."""

from __future__ import annotations

import os
from pathlib import Path

import click


@click.command("batch")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDINGS...")
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), metavar="DIR",
    help="folder of the results; one that was begun is gone on with",
)  # fmt: skip
@click.option(
    "--jobs", type=click.IntRange(min=1), metavar="N",
    help="recordings at once; default: all cores, or all workers of the scheduler",
)  # fmt: skip
@click.option(
    "--scheduler", metavar="tcp://HOST:PORT",
    help="map on the workers of this Dask scheduler (extra 'cluster')",
)  # fmt: skip
@click.option(
    "--threads", type=click.IntRange(min=1), metavar="N",
    help="of each recording; default: its share of the cores, or those of the worker",
)  # fmt: skip
@click.option(
    "--rig", type=click.Path(path_type=Path), help="rig.yaml for all; wins over the recordings' own"
)
@click.option("--motion", help="as of 'beemap map'; default: fused, else visual")
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="one setting")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option(
    "--fps", type=click.FloatRange(min=0, min_open=True), help="of plain image folders and videos"
)
@click.option("--force", is_flag=True, help="start over")
@click.option("--quiet", is_flag=True, help="no progress, no summary")
def batch_command(
    recordings: tuple[str, ...],
    output: Path,
    jobs: int | None,
    scheduler: str | None,
    threads: int | None,
    rig: Path | None,
    motion: str | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    seed: int,
    fps: float | None,
    force: bool,
    quiet: bool,
) -> None:
    """Map many RECORDINGS: recordings and scan logs, folders of them, or patterns.

    Every recording gets a result folder in DIR as from 'beemap map'; DIR/index.html shows them
    all, DIR/table.md and table.csv hold the numbers. A folder that was begun is gone on with: a
    result is used again while its recording, settings, seed and beemap are the same. A recording
    that fails does not stop the others; the exit code is 1 then.
    """
    from pipeline.batch.inputs import find_recordings, named
    from pipeline.batch.page import summary, write_overview
    from pipeline.batch.run import Wanted, failures, run_batch
    from pipeline.motion import absolute_choice
    from pipeline.output_lock import locked
    from pipeline.settings import load_settings
    from pipeline.tasks.folder import open_folder
    from pipeline.tasks.runner import Workers

    workers = Workers(jobs, scheduler)
    load_settings(settings_file, overrides)
    wanted = Wanted(
        _checked_rig(rig),
        absolute_choice(motion) if motion else None,
        fps,
        seed,
        settings_file.resolve() if settings_file else None,
        overrides,
    )
    paths, notes = find_recordings(recordings, output)
    with locked(output):
        open_folder(output, "batch", "recordings", force)
        inputs = named(paths, output)
        outcome = run_batch(inputs, wanted, output.resolve(), workers, threads, quiet)
        write_overview(output, outcome.rows)
    failed = failures(outcome.rows)
    for row in failed:
        click.echo(f"beemap: failed: {row.name}: {row.why}", err=True)
    if not quiet:
        if outcome.reused:
            notes.append(f"{outcome.reused} results were there already")
        for note in notes:
            click.echo(f"note: {note}", err=True)
        click.echo(f"{len(inputs)} recordings: {summary(outcome.rows)}")
        click.echo(f"results: {output}{os.sep} (open index.html; table.md, table.csv)")
    if outcome.interrupted:
        click.echo("beemap: interrupted: the same command goes on", err=True)
        raise SystemExit(130)
    if failed:
        raise SystemExit(1)


def _checked_rig(file: Path | None) -> Path | None:
    """A rig that cannot be read is told of once, not by every recording."""
    if file is None:
        return None
    from calibration.exchange.formats import read_rig

    read_rig(file)
    return file.resolve()
