"""`beemap info`: what a recording or a scan log holds."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    import numpy as np

    from pipeline.recordings.base import Recording
    from pipeline.recordings.scan_log import ScanLog

# A gap is a step between pairs longer than so many median steps.
GAP = 2.5


@click.command("info")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--fps", type=click.FloatRange(min=0, min_open=True), help="of plain image folders")
@click.option("--json", "as_json", is_flag=True, help="print JSON")
def info_command(recording: Path, fps: float | None, as_json: bool) -> None:
    """Say what RECORDING, a folder of image pairs or a scan log, holds.

    Format, counts, rate, gaps, image size or beams, calibration, motion, truth.
    """
    from pipeline.recordings import open_input
    from pipeline.recordings.base import counted
    from pipeline.recordings.scan_log import ScanLog

    opened = open_input(recording, fps)
    facts = describe_log(opened) if isinstance(opened, ScanLog) else describe(opened)
    if as_json:
        click.echo(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        if isinstance(value, dict):
            parts = (f"{k}: {counted(v) if isinstance(v, list) else v}" for k, v in value.items())
            value = "; ".join(parts) or "none"
        click.echo(f"{name.replace('_', ' '):<14} {value}")


def describe(recording: Recording) -> dict[str, Any]:
    """The facts that `beemap info` prints of a recording."""
    import numpy as np

    from pipeline.recordings.base import PAIR_TOLERANCE, image_size, looks_damaged

    stamps = np.array([pair.stamp for pair in recording.pairs], np.int64)
    size = image_size(recording.pairs)
    images = [image for pair in recording.pairs for image in pair.files]
    damaged = filter(looks_damaged, images)
    recording.skip("image cut short", [str(i.relative_to(recording.path)) for i in damaged])
    facts: dict[str, Any] = {
        "format": recording.kind,
        "pairs": len(recording.pairs),
        **_timing(stamps, "pair"),
        "pairing": f"left and right stamps within {PAIR_TOLERANCE / 1e6:.0f} ms",
        "image_size": f"{size[0]}x{size[1]}" if size else "no image can be read",
        "calibration": _calibration(recording),
        "motion": _motion(recording),
        "truth": _truth(recording),
        "skipped": recording.skipped,
    }
    return facts


def describe_log(log: ScanLog) -> dict[str, Any]:
    """The facts that `beemap info` prints of a scan log."""
    from pipeline.recordings.scan_log import BACKWARDS, REPEATED
    from pipeline.trajectory import distance_travelled

    x, y, yaw = log.origins[0].tolist()
    return {
        "format": log.kind,
        "scans": len(log),
        "messages": {kind: n for kind, n in log.counts.items() if kind.isupper()},
        **_timing(log.stamps, "scan"),
        "times": f"{log.counts[BACKWARDS]} step backwards, {log.counts[REPEATED]} repeat",
        **_laser(log),
        "scanner": f"{x:.3f} m ahead, {y:.3f} m left, turned by {math.degrees(yaw):.1f} deg",
        "motion": f"odometry of {distance_travelled(log.odometry)[-1]:.1f} m",
        "says_of_itself": {
            f"{stage}.{key}": value
            for stage, values in log.suggested.items()
            for key, value in values.items()
        },
        "truth": log.truth_file.name if log.truth_file else "none",
        "skipped": log.skipped,
    }


def _timing(stamps: np.ndarray, unit: str) -> dict[str, str]:
    """Duration, rate and gaps; steps backwards count for none of them."""
    import numpy as np

    steps = np.diff(stamps) / 1e9
    steps = steps[steps > 0]
    median = float(np.median(steps)) if steps.size else 0.0
    gaps = steps[steps > GAP * median]
    return {
        "duration": f"{float(stamps.max() - stamps.min()) / 1e9:.2f} s",
        "rate": f"{1.0 / median:.2f} {unit}s/s" if median > 0 else f"one {unit}",
        "gaps": f"{gaps.size}, the longest {gaps.max():.2f} s" if gaps.size else "none",
    }


def _laser(log: ScanLog) -> dict[str, str]:
    """Beams, the maximum reading, and how often there was no answer."""
    import numpy as np

    from pipeline.recordings.scan_log import CHANGES

    scans = log.scans
    first = scans[0]
    left, right = math.degrees(first.bearing[-1]), math.degrees(first.bearing[0])
    changes = log.counts[CHANGES]
    answered = np.mean([scan.answered for scan in scans])
    stated = log.beams[0].maximum is not None
    return {
        "beams": f"{len(first.bearing)} from {right:.1f} to {left:.1f} deg"
        + (f", {changes} changes of their number" if changes else ""),
        "maximum": f"{first.max_range:g} m, {'as stated' if stated else 'found in the readings'}",
        "no_answer": f"{1.0 - answered:.1%} of the beams",
    }


def _calibration(recording: Recording) -> str:
    rig = recording.rig
    if rig is None:
        return "none: give --rig rig.yaml"
    mount = (
        f"camera {rig.mount.height:.2f} m high" if rig.mount else "mount unknown (taken as level)"
    )
    return (
        f"{recording.rig_source}: f {rig.left.fx:.1f} px, baseline {rig.baseline * 1000:.1f} mm, "
        f"{mount}"
    )


def _motion(recording: Recording) -> str:
    found = []
    if recording.ticks is not None:
        ticks = recording.ticks
        skipped = sum(ticks.skipped.values())
        gaps = ticks.gaps
        found.append(
            f"encoders: {len(ticks)} readings over "
            f"{(ticks.stamps[-1] - ticks.stamps[0]) / 1e9:.1f} s, {skipped} lines skipped, "
            f"{len(gaps)} gaps"
        )
    if recording.odometry is not None:
        found.append(f"odometry: {len(recording.odometry)} poses")
    if recording.poses is not None:
        found.append(f"poses: {len(recording.poses)} from {recording.poses_source}")
    return "; ".join(found) or "none: give --motion poses:FILE.tum"


def _truth(recording: Recording) -> str:
    return recording.poses_source or "none"
