"""Fig. 11: a recording mapped from its images by both methods, side by side.

Each map is made as by `beemap map`: its folder tells all about it, and the same command makes it
again.
"""

from __future__ import annotations

import json
import math
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.batch.map_task import MapTask, map_into
from pipeline.evaluate_path import align, evaluate_path, match
from pipeline.experiments import style
from pipeline.experiments.batch import Batch, InterruptedBatchError
from pipeline.experiments.options import Options
from pipeline.experiments.presets import HIERARCHICAL, METHOD_NAMES, PREVIOUS
from pipeline.experiments.report import markdown_table, number_of, write_table
from pipeline.experiments.scores import best_score, frames
from pipeline.map_files import read_map
from pipeline.map_request import MapRequest
from pipeline.progress import progress_bar
from pipeline.tasks.folder import claimed
from pipeline.tasks.runner import task_runner
from pipeline.tasks.task import Failure
from pipeline.trajectory import read_tum

SEEDS = 1
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
    batch, mapped = _map(options, recording)
    lines = []
    for seed in options.seed_range():
        found = {v: mapped[v, seed] for v in VARIANTS if (v, seed) in mapped}
        scores = {variant: _scores(folder, recording) for variant, folder in found.items()}
        lines += [[variant.name, str(seed), *numbers] for variant, numbers in scores.items()]
        title = f"{recording.name}, mapped from its images, seed {seed}; blue: the path"
        _draw(found, scores, title, options.folder / f"office-{seed}.png")
    text = (
        "Made as by `beemap map`, each with the settings in its folder's settings.yaml; E and F1 "
        "against `truth/seen.yaml` of the recording where it has one; mapping: seconds of both "
        "stages together, without the stereo.\n\n" + markdown_table(HEADER, lines)
    )
    title = f"{recording.name} by both methods"
    write_table(options.folder, title, text, batch.failures, legend=False)
    return batch


def _map(options: Options, recording: Path) -> tuple[Batch, dict[tuple[Variant, int], Path]]:
    """Make the maps that are not there; which failed and why, and the folders of the others.

    Raises:
        InterruptedBatchError: Ctrl-C; what was done is kept.
    """
    batch, mapped = Batch(), {}
    wanted = {
        options.folder.resolve() / f"{variant.folder}-{seed}": (variant, seed)
        for seed in options.seed_range()
        for variant in VARIANTS
    }
    try:
        with claimed(options.folder) as claim:
            tasks = [
                MapTask(
                    MapRequest(str(recording.resolve()), seed=seed),
                    folder,
                    claim,
                    overrides=(*variant.settings, *options.settings),
                )
                for folder, (variant, seed) in wanted.items()
            ]
            with (
                task_runner(options.workers, [claim, recording.resolve()]) as run_tasks,
                progress_bar("maps", "maps", options.quiet) as progress,
                closing(run_tasks(tasks, map_into)) as results,
            ):
                progress(0, len(tasks))
                for task, result in results:
                    variant, seed = wanted[task.output]
                    if isinstance(result, Failure):
                        batch.failures.append(f"{variant.name}, seed {seed}: {result.reason}")
                    else:
                        mapped[variant, seed] = task.output
                    progress(len(mapped) + len(batch.failures), len(tasks))
    except KeyboardInterrupt:
        raise InterruptedBatchError(len(mapped), len(wanted)) from None
    return batch, mapped


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
