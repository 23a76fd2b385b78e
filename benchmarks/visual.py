"""Visual odometry: drift, map and cost, alone and with the wheels.

Drift is KITTI's (Geiger et al. 2012): over all stretches of some lengths the end's error, in the
frame of the stretch's first pose, by its length; here 10 to 50 m, as the street has 60 m.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from benchmarks.report import IDEAL, OFFICE, map_recording
from odometry.motion import compose, inverse
from pipeline.evaluate_map import evaluate_map_files
from pipeline.evaluate_path import evaluate_path_files, match
from pipeline.experiments.report import machine, markdown_table
from pipeline.motion import motion_of
from pipeline.recordings import open_recording
from pipeline.settings import Settings
from pipeline.trajectory import distance_travelled, read_tum
from pipeline.visual_motion import VisualMotion

LENGTHS = (10.0, 20.0, 30.0, 40.0, 50.0)  # m
STREET = Path("recordings/kitti-street")
RENDERED = ("--size", "640x480", "--rate", "10", "--duration", "40", "--quiet")
MOTIONS = ("encoders", "visual", "fused")
HEAD = [
    "motion",
    "drift [%]",
    "heading [deg/m]",
    "path before and after matching: ATE [m]",
    "map F1",
]


def main() -> str:
    """Measure; the section as Markdown."""
    data = os.environ.get("BEEMAP_REAL_DATA")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rendered = folder / "office"
        command = [sys.executable, "-m", "pipeline.cli", "simulate", "office", "-o", str(rendered)]
        subprocess.run([*command, *RENDERED], check=True)
        parts = [
            "## Visual odometry: `python -m benchmarks.visual`",
            f"{machine()}. Drift is that of the motion alone, before any matching to a map: over "
            "all stretches of 10, 20, ... 50 m the error at the end by their length.",
            f"`{OFFICE}`, 320x240, 2 pairs a second, up to 13.5 deg between two:",
            _table(OFFICE, IDEAL, (), folder, MOTIONS),
            f"The same office by `beemap simulate office {' '.join(RENDERED[:-1])}`:",
            _table(rendered, None, (), folder, MOTIONS),
        ]
        costs = [OFFICE, rendered]
        if data:
            street = Path(data) / STREET
            parts += [
                f"`{STREET}`, 1226x370, 10 pairs a second, 1.2 m a pair:",
                _table(street, None, ("--set", "mapping.cell=0.2"), folder, ("visual",)),
            ]
            costs.append(street)
        else:
            parts.append("BEEMAP_REAL_DATA is not set: the street was not measured.")
        parts += [
            "Processor time of a pair in one thread, decoding left out: rectified whole, made "
            "smaller, followed.",
            markdown_table(
                ["recording", "pairs", "CPU [ms a pair]", "points that agree", "key frames"],
                [_cost(path) for path in costs],
            ),
        ]
    return "\n\n".join(parts)


def drift(estimate: Path, reference: Path) -> tuple[float, float]:
    """Mean error over the stretches of `LENGTHS`: share of the length, and rad/m."""
    path = read_tum(estimate)
    index, true = match(path, read_tum(reference))
    found = path.poses[index]
    travelled = distance_travelled(true)
    errors = []
    for length in LENGTHS:
        end = np.searchsorted(travelled, travelled + length)
        begin = np.flatnonzero(end < len(true))
        stretches = [compose(inverse(p[begin]), p[end[begin]]) for p in (true, found)]
        error = compose(inverse(stretches[0]), stretches[1])
        errors.append(np.column_stack([np.hypot(*error[:, :2].T), np.abs(error[:, 2])]) / length)
    share, turn = np.concatenate(errors).mean(axis=0)
    return float(share), float(turn)


def _table(
    recording: Path,
    ideal: Path | None,
    options: tuple[str, ...],
    folder: Path,
    motions: tuple[str, ...],
) -> str:
    rows = []
    for motion in motions:
        run = folder / motion
        map_recording(recording, run, "--motion", motion, *options)
        truth = run / "truth.tum"
        share, turn = drift(run / "odometry.tum", truth)
        ates = [
            evaluate_path_files(run / name, truth).ate_rmse
            for name in ("odometry.tum", "trajectory.tum")
        ]
        f1 = "" if ideal is None else f"{evaluate_map_files(run, ideal).f1:.3f}"
        rows.append(
            [
                f"`{motion}`",
                f"{100 * share:.2f}",
                f"{np.degrees(turn):.4f}",
                f"{ates[0]:.3f}, {ates[1]:.3f}",
                f1,
            ]
        )
    return markdown_table(HEAD, rows)


def _cost(path: Path) -> list[str]:
    recording = open_recording(path)
    assert recording.rig is not None
    cv2.setNumThreads(1)
    motion = motion_of("visual", recording, recording.rig, Settings(), seed=1)
    assert isinstance(motion, VisualMotion)
    spent = []
    for files in recording.pairs:
        pair = files.load()
        begin = time.process_time()
        motion.step(files.stamp, motion.prepare(pair))
        spent.append(time.process_time() - begin)
    report = motion.report()
    return [
        path.name,
        str(len(spent)),
        # Without the first ones, which load the kernels.
        f"{1000 * float(np.mean(spent[5:])):.1f}",
        f"{report['visual_inliers_median']:.0f}",
        f"{report['visual_key_frames']}",
    ]


if __name__ == "__main__":
    print(main())
