"""Accuracy on the rendered office, and on a real street where BEEMAP_REAL_DATA is set."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from benchmarks.report import IDEAL, OFFICE, map_recording
from pipeline.evaluate_map import MapScore, evaluate_map_files
from pipeline.evaluate_path import evaluate_path_files
from pipeline.experiments.report import markdown_table

OFFICE_SEEDS = range(1, 6)
STREET_SEEDS = range(1, 11)

STREET_SETTINGS = (
    "mapping.cell=0.2",
    "odometry.noise=[0.02, 0.5]",
    "odometry.bias=0.5",
)


def main() -> str:
    """Measure; the section as Markdown."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "run"
        parts = ["## Accuracy: `python -m benchmarks.accuracy`", *_office(output)]
        data = os.environ.get("BEEMAP_REAL_DATA")
        if data:
            parts += _street(Path(data) / "recordings" / "kitti-street", output)
        else:
            parts.append("BEEMAP_REAL_DATA is not set: the street was not measured.")
    return "\n\n".join(parts)


def _office(output: Path) -> list[str]:
    rows = []
    for seed in OFFICE_SEEDS:
        map_recording(OFFICE, output, "--seed", str(seed))
        rows.append([f"fused, seed {seed}", *_path_errors(output), *_map_errors(output)])
    for motion in ("visual", "encoders"):
        map_recording(OFFICE, output, "--motion", motion)
        rows.append([motion, *_path_errors(output), *_map_errors(output)])
    map_recording(OFFICE, output, "--motion", "poses")
    rows.append(["exact poses", *_path_errors(output), *_map_errors(output)])
    header = ["motion", "ATE [m]", "dead reckoning [m]", "F1", "precision", "recall", "E"]
    return [
        f"### The office (`{OFFICE}`)",
        markdown_table(header, rows),
        "ATE: RMSE after SE(2) alignment, asked for: at most 0.12 m and half of dead reckoning's "
        f"in each seed. The map is held against `{IDEAL}`, the floor plan's cells that a true "
        "beam hits; F1 of its obstacle cells within one cell, asked for: at least 0.55. "
        "With exact poses only the stereo decides: the ceiling of any localisation.",
    ]


def _street(recording: Path, output: Path) -> list[str]:
    settings = [part for setting in STREET_SETTINGS for part in ("--set", setting)]
    rows, better = [], 0
    for seed in STREET_SEEDS:
        map_recording(recording, output, "--motion", "poses", "--seed", str(seed), *settings)
        found, reckoned = _ates(output)
        better += found < reckoned
        rows.append([str(seed), f"{found:.2f}", f"{reckoned:.2f}", f"{found / reckoned:.2f}"])
    return [
        "### A real street (KITTI odometry, 51 pairs, 60 m)",
        markdown_table(["seed", "ATE [m]", "dead reckoning [m]", "ratio"], rows),
        f"Better than dead reckoning in **{better} of {len(rows)}** seeds, asked for: all. Motion "
        "is the true poses with noise of 2 % and 0.5 deg a frame and a bias of 0.5 deg a frame; "
        f"settings `{'`, `'.join(STREET_SETTINGS)}`.",
    ]


def _path_errors(run: Path) -> list[str]:
    return [f"{ate:.3f}" for ate in _ates(run)]


def _ates(run: Path) -> tuple[float, float]:
    """ATE RMSE [m] of the mapped path and of dead reckoning."""
    found, reckoned = (
        evaluate_path_files(run / name, run / "truth.tum").ate_rmse
        for name in ("trajectory.tum", "odometry.tum")
    )
    return found, reckoned


def _map_errors(run: Path) -> list[str]:
    score: MapScore = evaluate_map_files(run, IDEAL)
    rates = (score.f1, score.precision, score.recall)
    return [*(f"{rate:.3f}" for rate in rates), f"{score.E:.1f}"]


if __name__ == "__main__":
    print(main())
