"""Real robots' logs against hand-made relations, and the Intel log as a stereo camera sees it."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev

from pipeline.evaluate_relations import evaluate_relation_files
from pipeline.experiments.report import machine, markdown_table

SEEDS = (1, 2, 3)
STEREO_SEEDS = (1, 2, 3, 4, 5)
# Asked for: mean error of the translation [m] and processor time [s]; beside it GMapping's own
# (C++, 30 particles, same logs, same metric) on this kind of machine.
ASKED = {"intel": (0.049, 33.0, "0.0489 m, 99 s"), "aces": (0.056, 16.0, "0.0557 m, 49 s")}
METHODS = {
    "per-scan, matched proposal": ("--method", "per-scan", "--set", "mapping.proposal=matched"),
    "hierarchical": ("--method", "hierarchical"),
}
PARTICLES = ("--set", "mapping.particles=30", "--threads", "1")


@dataclass(frozen=True)
class Outcome:
    """Mean errors of all relations [m, deg], the share scored, and processor time [s]."""

    translation: float
    rotation: float
    scored: float
    cpu: float


def main() -> str:
    """Measure; the section as Markdown."""
    data = os.environ.get("BEEMAP_REAL_DATA")
    title = "## Real logs: `python -m benchmarks.logs`"
    if not data:
        return f"{title}\n\nBEEMAP_REAL_DATA is not set: the logs were not measured."
    with tempfile.TemporaryDirectory() as folder:
        parts = [title, f"{machine()}.", *_real(Path(data) / "laser", Path(folder))]
        parts += _as_stereo(Path(data) / "laser" / "intel", Path(folder))
    return "\n\n".join(parts)


def _real(laser: Path, folder: Path) -> list[str]:
    rows = []
    for name, (error, seconds, gmapping) in ASKED.items():
        for method, options in METHODS.items():
            runs = [
                _mapped(
                    laser / name / f"{name}.clf.bz2",
                    laser / name / f"{name}.relations",
                    folder / "run",
                    seed,
                    *options,
                    *PARTICLES,
                )
                for seed in SEEDS
            ]
            rows.append(
                [
                    f"{name}, {method}",
                    " ".join(f"{run.translation:.4f}" for run in runs),
                    f"**{mean(run.translation for run in runs):.4f}**",
                    f"{mean(run.rotation for run in runs):.2f}",
                    f"{min(run.scored for run in runs):.0%}",
                    f"{mean(run.cpu for run in runs):.1f}",
                    f"{error} m, {seconds:g} s",
                    gmapping,
                ]
            )
    header = ["log, method", "seeds 1 to 3 [m]", "mean [m]", "rotation [deg]", "scored"]
    header += ["CPU [s]", "asked", "GMapping"]
    return [
        markdown_table(header, rows),
        "30 particles, one thread; the metric of Kuemmerle et al. (2009) over all relations. CPU "
        "is the whole process, reading and start-up included. The command of a run: "
        "`beemap map intel.clf.bz2 -o RUN --method per-scan --set mapping.proposal=matched "
        "--set mapping.particles=30 --threads 1 --seed 1`, then `beemap evaluate relations "
        "RUN/trajectory.tum intel.relations`. What is usual for a laser (`USUAL` in "
        "`pipeline/recordings/scan_log.py`) was found on these two logs.",
    ]


def _as_stereo(intel: Path, folder: Path) -> list[str]:
    rows = []
    for method, options in METHODS.items():
        runs = []
        for seed in STEREO_SEEDS:
            log = folder / f"stereo-{seed}.log"
            if not log.exists():
                _beemap("simulate", "degrade", intel / "intel.clf.bz2", "-o", log, "--seed", seed)
            relations = intel / "intel.relations"
            runs.append(_mapped(log, relations, folder / "run", seed, *options, *PARTICLES))
        errors = [run.translation for run in runs]
        rows.append(
            [
                method,
                " ".join(f"{error:.3f}" for error in errors),
                f"{mean(errors):.3f} ± {stdev(errors):.3f}",
                str(sum(error < 1.0 for error in errors)),
                f"{mean(run.cpu for run in runs):.1f}",
            ]
        )
    return [
        "### The Intel log as a stereo camera would see it",
        markdown_table(["method", "seeds 1 to 5 [m]", "mean [m]", "kept (< 1 m)", "CPU [s]"], rows),
        "`beemap simulate degrade intel.clf.bz2 -o LOG --seed N`: 66 deg, 8 m, depth noise 2 %, "
        "one false block a frame, the laser's own beams a degree apart; 30 particles. Raw "
        "odometry: 7.37 m.",
    ]


def _mapped(log: Path, relations: Path, run: Path, seed: int, *options: str) -> Outcome:
    before = os.times()
    _beemap("map", log, "-o", run, "--force", "--quiet", "--seed", seed, *options)
    after = os.times()
    score = evaluate_relation_files(run / "trajectory.tum", relations)
    return Outcome(
        score.translation,
        math.degrees(score.rotation),
        score.scored / score.relations,
        # user and system of the children
        after[2] + after[3] - before[2] - before[3],
    )


def _beemap(*words: object) -> None:
    command = [sys.executable, "-m", "pipeline.cli", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    print(main())
