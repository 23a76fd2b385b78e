"""`beemap import`: a ROS bag becomes a recording."""

from __future__ import annotations

import json
import os
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections import Counter

    from pipeline.ros.bags import BagReader
    from pipeline.ros.import_plan import Plan
    from pipeline.ros.topics import Chosen, Named

METRES = click.FloatRange(min=0, min_open=True)


@click.command("import")
@click.argument("bags", nargs=-1, required=True, metavar="BAG...", type=click.Path(path_type=Path))
@click.option("-o", "--output", metavar="REC", type=click.Path(path_type=Path))
@click.option("--list", "list_only", is_flag=True, help="Show the topics and how they are taken.")
@click.option("--left", metavar="TOPIC", help="Images of the left camera.  [default: guessed]")
@click.option("--right", metavar="TOPIC", help="Images of the right camera.")
@click.option("--left-info", metavar="TOPIC", help="Its CameraInfo.  [default: beside the images]")
@click.option("--right-info", metavar="TOPIC", help="CameraInfo of the right camera.")
@click.option("--rectified", is_flag=True, help="The images are rectified, whatever their name.")
@click.option("--odom", metavar="TOPIC", help="Odometry of the wheels.")
@click.option("--joints", metavar="TOPIC", help="JointState that tells the angles of the wheels.")
@click.option("--wheels", metavar="LEFT,RIGHT", help="Joints of the wheels.  [default: guessed]")
@click.option("--wheel-radius", type=METRES, metavar="M", help="Metres; --joints needs it.")
@click.option("--track", type=METRES, metavar="M", help="Metres between the wheels; as above.")
@click.option(
    "--ticks-per-revolution",
    type=click.FloatRange(min=1),
    metavar="N",
    help="How fine the wheels' angles are.  [default: 65536]",
)
@click.option(
    "--base", metavar="FRAME", help="The robot's frame in tf.  [default: base_footprint, base_link]"
)
@click.option("--rig", type=click.Path(path_type=Path), help="Wins over the CameraInfo.")
@click.option("--force", is_flag=True, help="Replace a recording that is there.")
@click.option("--quiet", is_flag=True, help="No progress, no summary.")
def import_command(
    bags: tuple[Path, ...],
    output: Path | None,
    list_only: bool,
    left: str | None,
    right: str | None,
    left_info: str | None,
    right_info: str | None,
    odom: str | None,
    joints: str | None,
    rig: Path | None,
    force: bool,
    quiet: bool,
    **asked: Any,
) -> None:
    """Turn BAG into a recording that every other command takes.

    BAG is a ROS 1 .bag, a ROS 2 .mcap or .db3, or the folder of a ROS 2 bag; several are the parts
    of one drive. Compressed images stay what they are, byte for byte. No ROS is needed.

    \b
    beemap import drive.bag --list
    beemap import drive.bag -o rec
    beemap map rec -o run
    """
    from pipeline.extras import need

    need("ros", "import")
    from pipeline.folders import IMPORTED, check_target
    from pipeline.ros.bags import BagReader
    from pipeline.ros.import_plan import Asked, plan
    from pipeline.ros.topics import Named, choose

    if output is None and not list_only:
        raise click.UsageError("Missing option '-o'")
    if output is not None:
        check_target(output, force, IMPORTED)
    name = ", ".join(map(str, bags))
    named = Named(left, right, left_info, right_info, odom, joints)
    with BagReader(bags) as bag:
        if list_only:
            _list(bag, named, name)
            return
        assert output is not None
        chosen = choose(bag.topics, named, name)
        made = plan(bag, name, chosen, Asked(rig=rig, **asked))
        _import(bag, name, made, output, force, quiet)


def _list(bag: BagReader, named: Named, name: str) -> None:
    """All topics, with what they would be taken as."""
    from pipeline.errors import InputError
    from pipeline.ros.topics import choose, short

    taken: dict[str, str] = {}
    problem = ""
    try:
        taken = _taken(choose(bag.topics, named, name))
    except InputError as error:
        problem = str(error).partition(" (there are:")[0]
    for topic in sorted(bag.topics.values(), key=lambda topic: topic.name):
        what = f"  taken as {taken[topic.name]}" if topic.name in taken else ""
        click.echo(f"{topic.count:>8}  {short(topic.type):<28} {topic.name}{what}")
    for note in (*bag.notes, problem):
        if note:
            click.echo(f"note: {note}", err=True)


def _taken(chosen: Chosen) -> dict[str, str]:
    rectified = ", rectified" if chosen.rectified else ""
    words = {
        chosen.left: f"left camera{rectified}",
        chosen.right: f"right camera{rectified}",
        chosen.left_info: "calibration of the left camera",
        chosen.right_info: "calibration of the right camera",
        chosen.odometry: "odometry",
        chosen.joints: "wheels",
    }
    words |= {t: "mount of the camera" for t in chosen.transforms if "static" in t.name}
    return {topic.name: word for topic, word in words.items() if topic is not None}


def _import(bag: BagReader, name: str, made: Plan, output: Path, force: bool, quiet: bool) -> None:
    from pipeline.errors import InputError
    from pipeline.folders import IMPORTED, new_folder
    from pipeline.progress import progress_bar
    from pipeline.recordings import open_recording
    from pipeline.ros.import_bag import write

    if not quiet:
        for note in (*bag.notes, *made.notes):
            click.echo(f"note: {note}", err=True)
    known = len(made.notes)
    with new_folder(output, force, IMPORTED) as folder:
        with progress_bar("importing", "messages", quiet) as progress:
            counts = write(bag, made, folder, progress)
        # Opened as `map` will open it: what it cannot pair is told now.
        try:
            recording = open_recording(folder)
        except InputError as error:
            raise InputError(str(error).replace(str(folder), str(output))) from None
        facts = {"beemap": version("beemap"), "imported": name, "topics": made.topics}
        text = json.dumps(facts, indent=2) + "\n"
        (folder / "meta.json").write_text(text, encoding="utf-8")
    if not quiet:
        for note in made.notes[known:]:
            click.echo(f"note: {note}", err=True)
        _summarise(counts, len(recording.pairs), {**bag.skipped, **recording.skipped})
        click.echo(f"recording: {output}{os.sep} (beemap map {output} -o run)")


def _summarise(counts: Counter[str], pairs: int, skipped: dict[str, list[str]]) -> None:
    from pipeline.recordings.base import counted

    told = [f"{pairs} pairs of {counts['cam0']} left and {counts['cam1']} right images"]
    told += [
        f"{counts[kind]} {words}"
        for kind, words in (("odometry", "poses of odometry"), ("wheels", "readings of the wheels"))
        if counts[kind]
    ]
    click.echo(", ".join(told))
    if counts["without a stamp"]:
        click.echo(f"{counts['without a stamp']} messages without a stamp: when received is taken")
    for reason, names in skipped.items():
        click.echo(f"skipped: {reason}: {counted(names)}")
