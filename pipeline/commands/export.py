"""`beemap export`: a run becomes a bag for Foxglove, RViz and whatever reads bags."""

from __future__ import annotations

import os
from pathlib import Path

import click

from pipeline.commands.recording_option import recording_option


@click.command("export")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="OUT.mcap",
    help="One .mcap, a ROS 1 .bag, or (no ending) a ROS 2 bag's folder.",
)
@recording_option
@click.option("--no-images", is_flag=True, help="Leave the images out: a tenth of the size.")
@click.option("--threads", type=click.IntRange(min=1), help="Default: all cores.")
@click.option("--force", is_flag=True, help="Replace a bag that is there.")
@click.option("--quiet", is_flag=True, help="No progress, no summary.")
def export_command(
    run: Path,
    output: Path,
    recording: Path | None,
    no_images: bool,
    threads: int | None,
    force: bool,
    quiet: bool,
) -> None:
    """Write RUN, a result folder, as a bag.

    /map and /path (latched), /odom, /tf and /tf_static (map, odom, base_link, cameras) and, of the
    recording that the run was made of, /scan, images and their CameraInfo; on its own stamps.
    """
    from pipeline.extras import need

    need("ros", "export")
    from pipeline.commands.libraries import use_threads
    from pipeline.progress import progress_bar
    from pipeline.ros.bag_writer import check_bag, new_bag
    from pipeline.ros.export_run import export
    from pipeline.run_folder import open_run

    check_bag(output, force)
    threads = threads or os.cpu_count() or 1
    use_threads(threads)
    opened = open_run(run)
    job = opened.job(recording, threads)
    if not quiet:
        for note in (*opened.notes, *(job.notes if job else ())):
            click.echo(f"note: {note}", err=True)
    with progress_bar("exporting", "poses", quiet) as progress, new_bag(output, force) as writer:
        counts, skipped = export(opened, job, writer, not no_images, progress)
    if quiet:
        return
    from pipeline.recordings.base import counted
    from pipeline.ros.topics import short

    click.echo(", ".join(f"{n} {short(kind)}" for kind, n in counts.items()))
    for reason, names in skipped.items():
        click.echo(f"skipped: {reason}: {counted(names)}")
    click.echo(f"bag: {output}")
