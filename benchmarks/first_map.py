"""What a first map is like: `beemap map` with nothing set, on windows, rooms and real recordings.

python -m benchmarks.first_map [office|rooms|cheap|real ...]
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.rendered import PRESETS, cache, rendered
from benchmarks.report import OFFICE, map_recording
from benchmarks.stereo_end_to_end import LOST, OPTIONS, driven_anew, map_f1
from pipeline.evaluate_path import align, evaluate_path_files, match
from pipeline.experiments.report import machine, markdown_table
from pipeline.trajectory import Trajectory, read_tum

WINDOW, EVERY = 180, 20  # pairs: 90 s at 2 Hz
WINDOW_SEEDS = range(1, 4)
ROOMS = ("office", "clutter", "corridor", "glass")
WHEEL_SEEDS = range(1, 11)
CHEAP = (
    *("--camera", "cheap", "--fault", "shutter=0.03", "--fault", "readout=0.02"),
    *("--fault", "skew=0.008", "--mount-error", "1"),
)
PATHS = ("trajectory", "online", "odometry")
JOBS = os.cpu_count() or 1
HEADER = (
    *("recordings", "runs", "ATE mean [m]", "worst", "lost", "odometry mean [m]"),
    *("served / odometry, worst", "finished / odometry, worst", "F1"),
)

# Fills a folder (first argument) with the recording to map; returns `beemap map`'s input.
Prepare = Callable[[Path], Path]


class Outcome(NamedTuple):
    """ATE [m] of the finished path, of the poses served, of the odometry fed; F1 of the map."""

    finished: float
    served: float
    odometry: float
    f1: float


def main(parts: Sequence[str] = ()) -> str:
    """Measure; the section as Markdown."""
    rows = []
    for part, measure in (("office", _windows), ("rooms", _rooms), ("cheap", _cheap)):
        if not parts or part in parts:
            rows += measure()
    text = [
        "## A first map, nothing set: `python -m benchmarks.first_map`",
        f"{machine()}. Path errors after SE(2) alignment; lost: worse than {LOST:g} m. Served: "
        "online.tum, odometry: odometry.tum, the motion that the filter is fed.",
        markdown_table(HEADER, rows),
        f"Windows: {WINDOW} pairs (90 s) of `{OFFICE}`, every {EVERY} pairs, seeds 1 to 3. Rooms: "
        "640x480, 60 m, the wheels' errors drawn anew (20 mm, 0.7 deg per 0.2 m, right wheel 0.2 % "
        "too large), ten seeds. Cheap: uneven exposure, noise, JPEG, shutter open for 30 ms, "
        "rows read within 20 ms, right camera 8 ms late, mount stated 1 deg wrong.",
    ]
    if not parts or "real" in parts:
        text += _real()
    return "\n\n".join(text)


def _windows() -> list[list[str]]:
    lines = (OFFICE / "mav0" / "cam0" / "data.csv").read_text("ascii").splitlines()
    pairs = sum(not line.startswith("#") for line in lines)
    cuts = [
        (partial(cut, OFFICE, first, first + WINDOW), seed)
        for first in range(0, pairs - WINDOW + 1, EVERY)
        for seed in WINDOW_SEEDS
    ]
    return [_row("windows of data/office", _map_all(cuts, None))]


def _rooms(options: tuple[str, ...] = (), kind: str = "clean") -> list[list[str]]:
    folder = cache()
    if folder is None:
        return []
    rows = []
    for room in ROOMS:
        filmed = rendered(folder, room, (*OPTIONS, *options)).path
        drives = [(partial(_driven, filmed, PRESETS[room], seed), seed) for seed in WHEEL_SEEDS]
        rows.append(_row(f"{room}, {kind}", _map_all(drives, filmed / "truth" / "seen.yaml")))
    return rows


def _cheap() -> list[list[str]]:
    return _rooms(CHEAP, "cheap")


def _map_all(inputs: Iterable[tuple[Prepare, int]], ideal: Path | None) -> list[Outcome]:
    """Each input mapped with a seed, some at once, one thread each."""

    def one(given: tuple[Prepare, int]) -> Outcome:
        prepare, seed = given
        with tempfile.TemporaryDirectory() as temporary:
            recording, run = Path(temporary) / "recording", Path(temporary) / "run"
            map_recording(prepare(recording), run, "--seed", str(seed), "--threads", "1")
            finished, served, odometry = (
                evaluate_path_files(run / f"{name}.tum", run / "truth.tum").ate_rmse
                for name in PATHS
            )
            f1 = np.nan if ideal is None else map_f1(run, ideal)
            return Outcome(finished, served, odometry, f1)

    with ThreadPoolExecutor(JOBS) as pool:
        return list(pool.map(one, inputs))


def _driven(filmed: Path, scene: str, seed: int, target: Path) -> Path:
    return driven_anew(filmed, target, scene, seed)


def _row(name: str, outcomes: list[Outcome]) -> list[str]:
    finished, served, odometry, f1 = np.array(outcomes).T
    return [
        name,
        str(len(outcomes)),
        f"{finished.mean():.3f}",
        f"{finished.max():.3f}",
        str(np.count_nonzero(finished > LOST)),
        f"{odometry.mean():.3f}",
        f"{(served / odometry).max():.2f}",
        f"{(finished / odometry).max():.2f}",
        "" if np.isnan(f1).any() else f"{f1.mean():.3f}",
    ]


def cut(source: Path, first: int, last: int, target: Path) -> Path:
    """Link pairs first to last of an EuRoC recording, with the ticks and truth of their time."""
    margin = 200_000_000  # ns
    stamps: list[int] = []
    for sensor in sorted((source / "mav0").iterdir()):
        there = target / "mav0" / sensor.name
        there.mkdir(parents=True)
        lines = (sensor / "data.csv").read_text("ascii").splitlines()
        rows = [line for line in lines if not line.startswith("#")]
        if (sensor / "data").is_dir():
            (there / "data").symlink_to((sensor / "data").resolve())
            rows = rows[first:last]
            stamps += [int(row.split(",")[0]) for row in rows]
        else:
            low, high = min(stamps) - margin, max(stamps) + margin
            rows = [row for row in rows if low <= int(row.split(",")[0]) <= high]
        (there / "data.csv").write_text("\n".join([lines[0], *rows]) + "\n", "ascii")
        if (sensor / "sensor.yaml").exists():
            shutil.copy(sensor / "sensor.yaml", there)
    return target


def _real() -> list[str]:
    data = os.environ.get("BEEMAP_REAL_DATA")
    if not data:
        return ["BEEMAP_REAL_DATA is not set: the real recordings were not measured."]
    recordings = Path(data) / "recordings"
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        run = Path(temporary) / "run"
        street = recordings / "kitti-street"
        facts = map_recording(street, run)
        errors = [evaluate_path_files(run / f"{n}.tum", run / "truth.tum") for n in PATHS]
        chosen = "; ".join(facts["request"]["chosen"].values())
        rows.append(["kitti-street", *(f"{e.ate_rmse:.3f}" for e in errors), chosen])
        rover = recordings / "rover-sandbox"
        map_recording(rover, run, "--rig", str(rover / "rig.yaml"), "--fps", "1")
        true = _rover_truth(rover / "gt.csv")
        scaled = [_similar(read_tum(run / f"{n}.tum"), true) for n in PATHS]
        rows.append(["rover-sandbox, after a similarity", *(f"{e:.3f}" for e in scaled), ""])
    header = ("real recording", "ATE [m]", "served", "odometry", "cells")
    return [markdown_table(header, rows)]


def _rover_truth(file: Path) -> Trajectory:
    """Of the frames' times: frame i was taken about i + 0.95 s after the table's zero."""
    seconds, x, y = np.loadtxt(file, delimiter=",", skiprows=1).T
    stamps = np.round((seconds - 0.95) * 1e9).astype(np.int64)
    return Trajectory(stamps, np.column_stack([x, y, np.zeros_like(x)]))


def _similar(found: Trajectory, true: Trajectory) -> float:
    """ATE [m] after the similarity that fits best (Umeyama 1991): the rig's scale is not known."""
    first = Trajectory(found.stamps - found.stamps[0], found.poses)
    index, known = match(first, true)
    poses = first.poses[index]
    a, b = (p[:, :2] - p[:, :2].mean(axis=0) for p in (poses, known))
    angle = align(poses, known)[2]
    c, s = np.cos(angle), np.sin(angle)
    turned = a @ np.array([[c, s], [-s, c]])
    scale = np.sum(turned * b) / np.sum(a**2)
    return float(np.sqrt(np.mean(np.sum((scale * turned - b) ** 2, axis=1))))


if __name__ == "__main__":
    print(main(sys.argv[1:]))
