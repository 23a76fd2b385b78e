"""`beemap info`: what a recording holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from pipeline.recordings.base import Recording

# A gap is a step between pairs longer than so many median steps.
GAP = 2.5


@click.command("info")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--fps", type=click.FloatRange(min=0, min_open=True), help="of plain image folders")
@click.option("--json", "as_json", is_flag=True, help="print JSON")
def info_command(recording: Path, fps: float | None, as_json: bool) -> None:
    """Say what RECORDING holds: format, counts, rate, gaps, image size, calibration, motion."""
    from pipeline.recordings import open_recording
    from pipeline.recordings.base import counted

    facts = describe(open_recording(recording, fps))
    if as_json:
        click.echo(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        if isinstance(value, dict):
            value = "; ".join(f"{what}: {counted(n)}" for what, n in value.items()) or "none"
        click.echo(f"{name.replace('_', ' '):<14} {value}")


def describe(recording: Recording) -> dict[str, Any]:
    """The facts that `beemap info` prints."""
    import numpy as np

    from pipeline.recordings.base import PAIR_TOLERANCE, image_size, looks_damaged

    stamps = np.array([pair.stamp for pair in recording.pairs], np.int64)
    steps = np.diff(stamps) / 1e9
    duration = float(stamps[-1] - stamps[0]) / 1e9
    median = float(np.median(steps)) if steps.size else 0.0
    gaps = steps[steps > GAP * median] if steps.size else steps
    size = image_size(recording.pairs)
    images = [image for pair in recording.pairs for image in (pair.left, pair.right)]
    damaged = filter(looks_damaged, images)
    recording.skip("image cut short", [str(i.relative_to(recording.path)) for i in damaged])
    facts: dict[str, Any] = {
        "format": recording.kind,
        "pairs": len(recording.pairs),
        "duration": f"{duration:.2f} s",
        "rate": f"{1.0 / median:.2f} pairs/s" if median > 0 else "one pair",
        "gaps": f"{gaps.size}, the longest {gaps.max():.2f} s" if gaps.size else "none",
        "pairing": f"left and right stamps within {PAIR_TOLERANCE / 1e6:.0f} ms",
        "image_size": f"{size[0]}x{size[1]}" if size else "no image can be read",
        "calibration": _calibration(recording),
        "motion": _motion(recording),
        "truth": _truth(recording),
        "skipped": recording.skipped,
    }
    return facts


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
    if recording.poses is not None:
        found.append(f"poses: {len(recording.poses)} from {recording.poses_source}")
    return "; ".join(found) or "none: give --motion poses:FILE.tum"


def _truth(recording: Recording) -> str:
    return recording.poses_source or "none"
