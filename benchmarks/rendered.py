"""Rendered recordings for the benchmarks, made once and kept where BEEMAP_BENCH_CACHE says."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.recordings import open_recording
from pipeline.recordings.base import Recording
from pipeline.stereo_truth import SCANS, rendered_scans
from simulation.true_scans import TrueScans

CACHE = "BEEMAP_BENCH_CACHE"
# command of `beemap simulate`: name in the tables
PRESETS = {
    "office": "office",
    "corridor": "corridor",
    "glass": "glass",
    "clutter": "clutter",
    "paper-rendered": "paper",
}
# One pair in four seconds, so that every one shows something else.
SPARSE = ("--rate", "0.25", "--duration", "240", "--seed", "1")


def cache() -> Path | None:
    """Where rendered recordings are kept; None: nobody said."""
    folder = os.environ.get(CACHE)
    return Path(folder) if folder else None


def missing(title: str) -> str:
    """The section of a benchmark that cannot be measured."""
    return f"{title}\n\n{CACHE} is not set: the rendered recordings were not measured."


def rendered(folder: Path, preset: str, options: Sequence[str] = SPARSE) -> Recording:
    """The recording of a preset with these options; rendered when it is not in the folder yet."""
    name = "_".join([preset, *(option.strip("-") for option in options)])
    target = folder / name.replace("/", "-")
    if not target.is_dir():
        command = [sys.executable, "-m", "pipeline.cli", "simulate", preset, "-o", str(target)]
        subprocess.run([*command, "--quiet", *options], check=True)
    return open_recording(target)


def truth(recording: Recording) -> TrueScans:
    """The true scans of a rendered recording."""
    found = rendered_scans(recording)
    assert found is not None, recording.path / SCANS
    return found


def inside_other_image(
    ranges: np.ndarray, bearing: np.ndarray, f: float, cx: float, baseline: float
) -> np.ndarray:
    """Columns (n, b) whose nearest surface has its match inside the right image.

    ranges: (n, b) m, true; f, cx [px], baseline [m]: of the rectified camera.
    """
    column = cx - f * np.tan(bearing)
    return column - f * baseline / (ranges * np.cos(bearing)) >= 0.0
