"""What the tests of batches share: short recordings, and how their results are compared."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

# Few particles are enough to run every line of the filter.
QUICK = ("--set", "mapping.particles=5")
# Files that tell of time and place, too.
TELLING = {"run.json", "report.html"}


def cut(recording: Path, target: Path, first: int, pairs: int) -> Path:
    """A recording of so many pairs of another one, with its ticks and truth."""
    for camera in ("cam0", "cam1"):
        source, place = recording / "mav0" / camera, target / "mav0" / camera
        (place / "data").mkdir(parents=True)
        shutil.copy(source / "sensor.yaml", place)
        head, *lines = (source / "data.csv").read_text().splitlines()
        lines = lines[first : first + pairs]
        (place / "data.csv").write_text("\n".join([head, *lines]) + "\n")
        for line in lines:
            name = line.partition(",")[2]
            shutil.copy(source / "data" / name, place / "data" / name)
    for name in ("odom0", "state_groundtruth_estimate0"):
        shutil.copytree(recording / "mav0" / name, target / "mav0" / name)
    return target


def results(folder: Path) -> dict[str, bytes]:
    """What must be the same for the same input, settings and seed."""
    return {f.name: f.read_bytes() for f in folder.iterdir() if f.name not in TELLING}


def batch_command(*arguments: object) -> list[str]:
    """`beemap batch` as a process of its own."""
    words = [*map(str, arguments), *QUICK]
    return [sys.executable, "-m", "pipeline.cli", "batch", *words]
