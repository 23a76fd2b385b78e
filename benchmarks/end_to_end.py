"""Time and memory of `beemap map data/office` as a whole process, beside bare OpenCV.

The baseline is what no stereo mapper can do without: the images decoded, rectified (the rows
used only) and matched by SGBM with the same settings, for as many pairs as the run looks at, in
two threads, without starting a process, mapping, or writing results.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

import cv2
import numpy as np

from benchmarks.report import OFFICE, map_recording
from pipeline.experiments.report import machine, markdown_table
from pipeline.recordings import open_recording
from pipeline.recordings.base import PairFiles, Recording
from stereo.ranger import StereoRanger

ROUNDS = 5
THREADS = 2

T = TypeVar("T")


@dataclass(frozen=True)
class Cost:
    """Seconds by the clock, and of processor time over all threads and child processes."""

    wall: float
    cpu: float


def measure(work: Callable[[], T]) -> tuple[Cost, T]:
    """What the work cost, and what it returned."""
    before = os.times()
    result = work()
    after = os.times()
    # user, system, user and system of the children; then the clock
    return Cost(after[4] - before[4], sum(after[:4]) - sum(before[:4])), result


def main() -> str:
    """Measure; the section as Markdown."""
    recording = open_recording(OFFICE)
    load = os.getloadavg()[0]
    whole, bare, runs = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "run"

        def map_once() -> dict[str, Any]:
            return map_recording(OFFICE, output, "--threads", str(THREADS))

        count = map_once()["counts"]["observations"]  # numba compiles and caches
        for _ in range(ROUNDS):
            cost, run = measure(map_once)
            whole.append(cost)
            runs.append(run)
            bare.append(measure(lambda: bare_opencv(recording, count))[0])
    return _section(whole, bare, runs, load)


def bare_opencv(recording: Recording, count: int) -> None:
    """Decode, remap and match `count` pairs spread over the recording."""
    assert recording.rig is not None
    ranger = StereoRanger(recording.rig)
    cv2.setNumThreads(1)  # pairs run beside each other, as in beemap

    def work(files: PairFiles) -> None:
        left, right = (
            cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in (files.left, files.right)
        )
        assert left is not None
        assert right is not None
        ranger.match(*ranger.rectify(left, right))

    chosen = np.linspace(0, len(recording.pairs) - 1, count).astype(int)
    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(work, [recording.pairs[index] for index in chosen]))


def _section(
    whole: Sequence[Cost], bare: Sequence[Cost], runs: Sequence[dict[str, Any]], load: float
) -> str:
    pairs, looked_at = (runs[0]["counts"][key] for key in ("pairs used", "observations"))
    rows = [
        _row("`beemap map`, whole process", whole, pairs),
        _row("bare OpenCV", bare, pairs),
    ]
    wall_ratio = median(cost.wall for cost in whole) / median(cost.wall for cost in bare)
    cpu_ratio = median(cost.cpu for cost in whole) / median(cost.cpu for cost in bare)
    stages = [
        [stage, f"{median(run['seconds'][stage] for run in runs):.2f}"]
        for stage in runs[0]["seconds"]
    ]
    memory = median(run["peak_memory_mb"] for run in runs)
    return "\n\n".join(
        [
            "## End to end: `python -m benchmarks.end_to_end`",
            f"{machine()}. {pairs} pairs of 320x240 from `{OFFICE}`, of which {looked_at} are due "
            f"as observations; default settings, {THREADS} threads, numba's cache warm. Median "
            f"(least to most) of {ROUNDS} runs; the machine's load before them was {load:.1f}.",
            markdown_table(
                ["", "wall [s]", "wall [ms a pair]", "CPU [s]", "CPU [ms a pair]"], rows
            ),
            f"The whole job takes **{wall_ratio:.2f} times** the wall time and {cpu_ratio:.2f} "
            "times the processor time of the bare OpenCV work (images decoded, rectified and "
            "matched in two threads, nothing else), and "
            f"**{memory:.0f} MB** of memory at its peak.",
            markdown_table(["stage", "seconds"], stages),
            "Reading and stereo are sums over the threads; total is the time up to the writing "
            "of the results.",
        ]
    )


def _row(name: str, costs: Sequence[Cost], pairs: int) -> list[str]:
    cells = [name]
    for seconds in ([cost.wall for cost in costs], [cost.cpu for cost in costs]):
        middle = median(seconds)
        cells += [
            f"{middle:.2f} ({min(seconds):.2f} to {max(seconds):.2f})",
            f"{1000 * middle / pairs:.2f}",
        ]
    return cells


if __name__ == "__main__":
    print(main())
