"""Fig. 9: the maps of both methods for some alphas, beside the ideal ones."""

from __future__ import annotations

import numpy as np

from mapping.grid import OccupancyGrid
from pipeline.experiments import style
from pipeline.experiments.batch import Batch, Run, run_batch
from pipeline.experiments.measure import common_ideal, ideal_of, measure
from pipeline.experiments.options import Options
from pipeline.experiments.presets import ALPHA, METHOD_NAMES, METHODS, OURS, PAPER
from pipeline.experiments.report import HEADER, markdown_table, summary_row, write_table
from pipeline.experiments.spec import RunSpec
from pipeline.experiments.summary import grouped
from pipeline.map_files import read_map

SEEDS = 1
PRESETS = (PAPER, OURS)
ALPHAS = (0.0, ALPHA, 4.0)
FALSE_DEPTHS = ("nearest", "replace")
PARTICLES = 100
MARGIN = 0.5  # shown around the ideal map [m]


def plan(options: Options) -> list[RunSpec]:
    """Every run leaves its map in the folder `maps`."""
    return [
        options.spec(
            preset,
            seed,
            *method,
            f"mapping.particles={PARTICLES}",
            alpha=alpha,
            false_depth=false_depth,
            keep_map=True,
        )
        for seed in options.seed_range()
        for preset in PRESETS
        for false_depth in FALSE_DEPTHS
        for alpha in ALPHAS
        for method in METHODS
    ]


def run(options: Options) -> Batch:
    """Do the runs, draw `maps-<preset>-<false depth>-<seed>.png`, write `table.md`."""
    batch = run_batch(plan(options), options.folder, measure, options.workers, options.quiet)
    pictures = grouped(batch.runs, lambda spec: (spec.preset, spec.false_depth, spec.seed))
    for (preset, false_depth, seed), runs in pictures.items():
        N = runs[0].spec.mapping.particles
        title = f"{preset} settings, N = {N}, {options.place}, {false_depth}, seed {seed}"
        _draw(runs, title, options, f"maps-{preset}-{false_depth}-{seed}.png")
    groups = grouped(
        batch.runs, lambda spec: (spec.preset, spec.false_depth, spec.method, spec.alpha)
    )
    rows = [
        summary_row(f"{preset}, {false_depth}, {METHOD_NAMES[method]}, alpha {alpha:.2f}", runs)
        for (preset, false_depth, method, alpha), runs in groups.items()
    ]
    write_table(options.folder, "Maps", markdown_table(HEADER, rows), batch.failures)
    return batch


def _draw(runs: list[Run], title: str, options: Options, name: str) -> None:
    """A row a method: the common ideal, the method's own, then its maps."""
    drawn, axes = style.figure(2, 2 + len(ALPHAS), (17.5, 7.4), sharex=True, sharey=True)
    for row, method in zip(axes, METHOD_NAMES, strict=True):
        mine = {r.spec.alpha: r for r in runs if r.spec.method == method}
        if not mine:
            continue
        spec = next(iter(mine.values())).spec
        common = common_ideal(spec.world, spec.route, spec.positions)
        box = _box(common)
        style.show_map(row[0], common, "what perfect sensors see", box)
        style.show_map(row[1], ideal_of(spec), f"{METHOD_NAMES[method]}:\nperfect sensors", box)
        for panel, alpha in zip(row[2:], ALPHAS, strict=True):
            if alpha not in mine:
                continue
            result, key = mine[alpha].result, mine[alpha].spec.key
            text = (
                f"alpha {alpha:.2f}: ATE {result.ate:.2f} m,\n"
                f"E {result.E:.0f}, own {result.E_own:.0f}"
            )
            style.show_map(panel, read_map(options.folder / "maps" / f"{key}.npz"), text, box)
    drawn.suptitle(title)
    style.save(drawn, options.folder / name)


def _box(grid: OccupancyGrid) -> tuple[float, float, float, float]:
    known = np.argwhere(~np.isnan(grid.probability))
    (bottom, left), (top, right) = known.min(axis=0), known.max(axis=0) + 1
    x, y = grid.origin
    return (
        x + left * grid.cell - MARGIN,
        x + right * grid.cell + MARGIN,
        y + bottom * grid.cell - MARGIN,
        y + top * grid.cell + MARGIN,
    )
