"""Fig. 11: a recording mapped from its images by both methods, side by side.

Each map is made by `beemap map` as a process of its own: its folder tells all about it, and the
same command makes it again.
"""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.evaluate_path import align, evaluate_path, match
from pipeline.experiments import style
from pipeline.experiments.batch import Batch
from pipeline.experiments.options import Options
from pipeline.experiments.presets import HIERARCHICAL, METHOD_NAMES, PREVIOUS
from pipeline.experiments.report import markdown_table, number_of, write_table
from pipeline.experiments.scores import best_score, frames
from pipeline.experiments.spec import source_digest
from pipeline.map_files import read_map
from pipeline.progress import progress_bar
from pipeline.trajectory import read_tum

SEEDS = 1
# The source that decides what `beemap map` makes of a recording.
DECIDING = ("calibration/*.py", "stereo/*.py", "odometry/*.py", "mapping/*.py", "pipeline/*.py")
# One supporting pixel is enough: the paper's plain nearest depth of a column.
NEAREST = ("stereo.support=1",)
HEADER = ("map", "seed", "ATE [m]", "dead reckoning [m]", "E", "E cut", "F1", "mapping [s]")


@dataclass(frozen=True)
class Variant:
    """One way to map the recording."""

    folder: str
    name: str
    settings: tuple[str, ...]


VARIANTS = (
    Variant("hierarchical", METHOD_NAMES["hierarchical"], HIERARCHICAL),
    Variant("per-scan", METHOD_NAMES["per-scan"], PREVIOUS),
    Variant(
        "hierarchical-nearest",
        f"{METHOD_NAMES['hierarchical']}, plain nearest depth",
        (*HIERARCHICAL, *NEAREST),
    ),
    Variant(
        "per-scan-nearest",
        f"{METHOD_NAMES['per-scan']}, plain nearest depth",
        (*PREVIOUS, *NEAREST),
    ),
)


def run(options: Options, recording: Path) -> Batch:
    """Map, draw `office-<seed>.png`, write `table.md`."""
    batch = Batch()
    tasks = [(variant, seed) for seed in options.seed_range() for variant in VARIANTS]
    with progress_bar("maps", "maps", options.quiet) as progress:
        for done, (variant, seed) in enumerate(tasks):
            progress(done, len(tasks))
            failure = _map(options, recording, variant, seed)
            if failure:
                batch.failures.append(f"{variant.name}, seed {seed}: {failure}")
        progress(len(tasks), len(tasks))
    lines = []
    for seed in options.seed_range():
        places = {v: _place(options, recording, v, seed) for v in VARIANTS}
        found = {variant: folder for variant, folder in places.items() if _is_whole(folder)}
        scores = {variant: _scores(folder, recording) for variant, folder in found.items()}
        lines += [[variant.name, str(seed), *numbers] for variant, numbers in scores.items()]
        title = f"{recording.name}, mapped from its images, seed {seed}; blue: the path"
        _draw(found, scores, title, options.folder / f"office-{seed}.png")
    text = (
        "Made by `beemap map`, each with the settings in its folder's settings.yaml; E and F1 "
        "against `truth/seen.yaml` of the recording where it has one; mapping: seconds of both "
        "stages together, without the stereo.\n\n" + markdown_table(HEADER, lines)
    )
    title = f"{recording.name} by both methods"
    write_table(options.folder, title, text, batch.failures, legend=False)
    return batch


def _place(options: Options, recording: Path, variant: Variant, seed: int) -> Path:
    """Its folder; the name tells all that decides the map, so that no other passes for it."""
    decides = [str(recording.resolve()), *variant.settings, *options.settings]
    digest = hashlib.sha256("\n".join([*decides, source_digest(DECIDING)]).encode()).hexdigest()
    return options.folder / f"{variant.folder}-{seed}-{digest[:8]}"


def _map(options: Options, recording: Path, variant: Variant, seed: int) -> str:
    """Make the map unless it is there; why it failed, if it did."""
    folder = _place(options, recording, variant, seed)
    if _is_whole(folder):
        return ""
    settings = (*variant.settings, *options.settings)
    command = [sys.executable, "-m", "pipeline.cli", "map", str(recording), "-o", str(folder)]
    command += ["--seed", str(seed), "--force", "--quiet"]
    command += [part for value in settings for part in ("--set", value)]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        _, said = process.communicate()
    except KeyboardInterrupt:
        # It was told as well, and ends with what it has: no whole map.
        process.wait()
        raise
    if process.returncode == 0:
        return ""
    return (said.strip().splitlines() or [f"ended with code {process.returncode}"])[-1]


def _is_whole(folder: Path) -> bool:
    """Whether a map is there that was not interrupted."""
    try:
        summary = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return False
    return not summary["partial"]


def _scores(folder: Path, recording: Path) -> list[str]:
    """The numbers of `HEADER` after the seed; a dash where the recording holds no truth."""
    ate = reckoned = E = E_cut = f1 = math.nan
    alignment = np.zeros(3)
    if (folder / "truth.tum").is_file():
        path, truth = read_tum(folder / "trajectory.tum"), read_tum(folder / "truth.tum")
        ate = evaluate_path(path, truth).ate_rmse
        reckoned = evaluate_path(read_tum(folder / "odometry.tum"), truth).ate_rmse
        index, true = match(path, truth)
        alignment = align(path.poses[index], true)
    ideal = recording / "truth" / "seen.yaml"
    if ideal.is_file():
        score = best_score(frames(read_map(folder), alignment), read_map(ideal))
        E, E_cut, f1 = score.E, score.E_cut, score.f1
    seconds = json.loads((folder / "run.json").read_text(encoding="utf-8"))["seconds"]["mapping"]
    numbers = ((ate, 3), (reckoned, 3), (E, 0), (E_cut, 0), (f1, 3), (seconds, 1))
    return [number_of(value, digits) for value, digits in numbers]


def _draw(
    found: dict[Variant, Path], scores: dict[Variant, list[str]], title: str, file: Path
) -> None:
    rows = len(VARIANTS) // 2
    drawn, axes = style.figure(rows, 2, (13.0, 4.5 * rows), sharex=True, sharey=True)
    for panel, variant in zip(axes.flat, VARIANTS, strict=True):
        if variant in found:
            ate, _, E, *_ = scores[variant]
            folder = found[variant]
            style.show_map(panel, read_map(folder), f"{variant.name}: ATE {ate} m, E {E}")
            x, y = read_tum(folder / "trajectory.tum").poses[:, :2].T
            panel.plot(x, y, color=style.COLOURS["hierarchical"], linewidth=0.7, alpha=0.6)
    drawn.suptitle(title)
    style.save(drawn, file)
