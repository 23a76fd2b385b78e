"""`beemap simulate degrade`: a laser log as a stereo camera would have seen it."""

from __future__ import annotations

import math
import shlex
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.commands.stereo_error_options import check_log_name, stereo_error_options
from pipeline.errors import InputError
from pipeline.new_files import check_free, new_files
from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from pipeline.recordings.laser import LaserSettings
    from pipeline.recordings.scan_log import ScanLog
    from simulation.stereo_errors import StereoErrors


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="The log to write, as stereo.log.",
)
@click.option(
    "--seed", default=1, show_default=True, type=click.IntRange(min=0), help="Of all the errors."
)
@click.option(
    "--fov",
    default=66.0,
    show_default=True,
    metavar="DEG",
    type=click.FloatRange(1, 360),
    help="Field of view about straight ahead.",
)
@click.option(
    "--max-range",
    default=8.0,
    show_default=True,
    metavar="M",
    type=click.FloatRange(0.5, 100),
    help="End of the depth range.",
)
@click.option(
    "--depth-noise",
    default=0.02,
    show_default=True,
    type=click.FloatRange(0, 0.3),
    help="Standard deviation of a depth as a share of it.",
)
@stereo_error_options
@click.option("--force", is_flag=True, help="Replace an existing log.")
@click.option("--quiet", is_flag=True, help="No progress bar and no summary.")
def degrade(**options: Any) -> None:
    """Make of a laser log (CARMEN) what a stereo camera would have seen.

    Every scan keeps its own beams, those within the field of view, its time and its odometry;
    its ranges get the depth noise and the false blocks of the paper's error model. Beams whose
    range the laser did not tell stay unknown. A true path beside the log (.tum) is copied.

    Example: beemap simulate degrade intel.clf.bz2 -o stereo.log --seed 1
    """
    from pipeline.recordings.carmen import read_carmen
    from simulation.stereo_errors import StereoErrors

    source, output = options["log"], options["output"]
    check_log_name(output)
    check_free([output], options["force"])
    log = read_carmen(source)
    if output.exists() and output.samefile(source):
        raise InputError(f"{output}: is the log itself: choose another name for the result")
    errors = StereoErrors(**{name: options[name] for name in StereoErrors.__dataclass_fields__})
    targets = [output, *([output.with_suffix(".tum")] if log.truth_file else [])]
    with new_files(targets, options["force"]) as folder:
        kept = _write(folder / output.name, log, errors, options)
        if log.truth_file is not None:
            shutil.copyfile(log.truth_file, folder / targets[1].name)
    if not options["quiet"]:
        left_out = len(log) - kept
        click.echo(
            f"{output}: {kept} of {len(log)} scans"
            + (f" ({left_out} have no beam in {options['fov']:g} deg)" if left_out else "")
        )


def _write(path: Path, log: ScanLog, errors: StereoErrors, options: dict[str, Any]) -> int:
    """Write the degraded log; how many scans have a beam in the field of view."""
    from pipeline.recordings.carmen_writer import write_carmen

    laser = _laser(log, options["fov"])
    scans, kept = [], []
    with progress_bar("degrading", "scans", options["quiet"]) as progress:
        for i, scan in enumerate(log.taken(laser)):
            if scan.bearing.size:
                scans.append(errors.seen(scan, options["seed"], i))
                kept.append(i)
            progress(i + 1, len(log))
    if not scans:
        raise InputError(
            f"{log.path}: no beam lies within --fov {options['fov']:g} deg about straight ahead"
        )
    doubt = {
        "noise": math.hypot(laser.noise, errors.depth_noise),
        "floor": laser.floor,
        "maximum": "free",
    }
    # So short a sight needs a camera's spacing; errors stay independent from beam to beam.
    stereo = {
        "spacing": 0.17,
        "spacing_angle": 10.0,
        "correlated": 1.0,
        "window": 10,
        "match_weight": 20.0,
        "spread": False,
    }
    about = {**log.suggested, "laser": doubt, "mapping": stereo}
    write_carmen(path, scans, log.odometry[kept], [_made_by(log, options)], about)
    return len(scans)


def _laser(log: ScanLog, fov: float) -> LaserSettings:
    """How the log wants its scans taken, within the field of view [deg]."""
    import msgspec

    from pipeline.recordings.laser import LaserSettings

    own = msgspec.convert(log.suggested.get("laser", {}), LaserSettings)
    narrow = fov if own.field_of_view is None else min(fov, own.field_of_view)
    return msgspec.structs.replace(own, field_of_view=narrow)


def _made_by(log: ScanLog, options: dict[str, Any]) -> str:
    """The command that makes the same log again, wherever both logs lie."""
    words = ["beemap", "simulate", "degrade", log.path.name]
    for name in ("seed", "fov", "max_range", "depth_noise", "alpha", "blocks", "false_depth"):
        words += [f"--{name.replace('_', '-')}", str(options[name])]
    return shlex.join(words)
