"""`beemap rig convert`: between rig.yaml and the formats of ROS, Kalibr, EuRoC and OpenCV."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.errors import InputError
from pipeline.new_files import check_free, new_files
from pipeline.rig import length_option, rig_to_replace, size_option, with_kept

KINDS = ("beemap", "ros", "kalibr", "euroc", "opencv")
IN_A_FOLDER = ("ros", "euroc")
# Endings that OpenCV's FileStorage knows.
STORAGE = (".yml", ".yaml", ".xml", ".json")


@click.command()
@click.argument("source", metavar="IN", type=click.Path(path_type=Path))
@click.argument("second", metavar="[IN2]", required=False, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="File to write; for ros and euroc a folder.",
)
@click.option(
    "--to",
    "kind",
    type=click.Choice(KINDS),
    help="Format to write; by default what the name of OUT says (rig.yaml, camchain.yaml, .xml).",
)
@click.option("--size", help="Image size of a file that holds none, as in 640x480.")
@click.option("--unit", help="What T counts in a file that does not say, as in 25mm (a square).")
@click.option("--force", is_flag=True, help="Replace existing files; a rig file keeps its mount.")
def convert(
    source: Path,
    second: Path | None,
    output: Path,
    kind: str | None,
    size: str | None,
    unit: str | None,
    force: bool,
) -> None:
    """Convert a rig. IN is a file, a folder, or the left camera's file with IN2 the right one's.

    \b
    beemap rig convert rig.yaml -o ros --to ros         ros/left.yaml, ros/right.yaml
    beemap rig convert camchain.yaml -o rig.yaml        Kalibr
    beemap rig convert left.yaml right.yaml -o rig.yaml ROS camera_info
    beemap rig convert intrinsics.yml extrinsics.yml -o rig.yaml --size 640x480 --unit 25mm
    """
    from calibration.exchange.formats import KINDS as CALLED
    from calibration.exchange.formats import read_rig, write_rig

    kind = kind or _kind_of(output)
    ending = _ending(output, kind)
    given = [source] if second is None else [source, second]
    found = read_rig(given, size_option(size), length_option(unit, "--unit"))
    replaces = kind == "beemap" and force and output.is_file()
    rig, kept = with_kept(found.rig, rig_to_replace(output) if replaces else None)
    texts, lost = write_rig(rig, kind, ending)
    files = {(output / name if name else output): text for name, text in texts.items()}
    _write(files, given, force)
    for line in [*found.notes, *lost]:
        click.echo(f"warning: {line}", err=True)
    if kept:
        click.echo(f"kept from the replaced file: {', '.join(kept)}")
    click.echo(f"{CALLED[found.kind]} -> {CALLED[kind]}: {', '.join(map(str, files))}")


def _kind_of(output: Path) -> str:
    """What a name alone says of the format."""
    if output.suffix in (".yml", ".xml", ".json"):
        return "opencv"
    if output.suffix == ".yaml" and "camchain" in output.stem:
        return "kalibr"
    if output.suffix == ".yaml" and "rig" in output.stem:
        return "beemap"
    if output.name == "mav0":
        return "euroc"
    raise InputError(
        f"-o {output}: the name does not say which format: give --to with one of {', '.join(KINDS)}"
    )


def _ending(output: Path, kind: str) -> str:
    """The ending of the one file that is written; "" for a folder."""
    if kind in IN_A_FOLDER:
        return ""
    if kind != "opencv":
        return output.suffix
    if output.suffix and output.suffix not in STORAGE:
        raise InputError(f"-o {output}: OpenCV knows the endings {', '.join(STORAGE)}")
    return output.suffix


def _write(files: dict[Path, str], given: list[Path], force: bool) -> None:
    """Every file whole or not at all."""
    inputs = {path.resolve() for path in given}
    for file in files:
        if file.resolve() in inputs:
            raise InputError(f"{file}: is what is converted: choose another name")
    check_free(list(files), force)
    for folder in {file.parent: None for file in files}:
        here = [file for file in files if file.parent == folder]
        with new_files(here, force) as partial:
            for file in here:
                (partial / file.name).write_text(files[file], encoding="utf-8")
