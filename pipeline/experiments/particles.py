"""Figs 6 and 7: time and dissimilarity against the number of particles, both methods."""

from __future__ import annotations

from pipeline.experiments import style
from pipeline.experiments.batch import Batch, run_batch
from pipeline.experiments.measure import measure
from pipeline.experiments.options import Options
from pipeline.experiments.presets import METHOD_NAMES, METHODS, OURS, PAPER, Preset
from pipeline.experiments.report import HEADER, markdown_table, summary_row, write_table
from pipeline.experiments.spec import RunSpec
from pipeline.experiments.summary import grouped

SEEDS = 12
NUMBERS = (10, 30, 100, 300, 1000)
PANELS = (
    ("cpu_s", "CPU time of mapping [s]"),
    ("ate", "path error (ATE) [m]"),
    ("lost", "runs lost (ATE > 1 m), 95 % interval"),
    ("E", "E, common ideal"),
    ("E_cut", "E, both maps cut"),
    ("E_own", "E, own perfect-sensor map"),
)


def plan(options: Options) -> list[RunSpec]:
    """Seeds outside: a run that is stopped early has some of everything."""
    return [
        options.spec(preset, seed, *method, f"mapping.particles={N}", varied=f"N={N}")
        for seed in options.seed_range()
        for preset in (PAPER, OURS)
        for N in NUMBERS
        for method in METHODS
    ]


def run(options: Options) -> Batch:
    """Do the runs, draw `particles-<preset>.png`, write `table.md`."""
    batch = run_batch(plan(options), options.folder, measure, options.workers, options.quiet)
    parts = []
    for preset in (PAPER, OURS):
        groups = grouped(
            (r for r in batch.runs if r.spec.preset == preset.name),
            lambda spec: (spec.method, spec.mapping.particles),
        )
        _draw(groups, preset, options)
        rows = [
            summary_row(f"{METHOD_NAMES[method]}, N = {N}", runs)
            for (method, N), runs in sorted(groups.items())
        ]
        parts.append(f"## Settings: {preset.name}\n\n" + markdown_table(HEADER, rows))
    write_table(options.folder, "Time and quality against N", "\n\n".join(parts), batch.failures)
    return batch


def _draw(groups: dict, preset: Preset, options: Options) -> None:
    drawn, axes = style.figure(2, 3, (12.5, 7.2))
    for panel, (name, title) in zip(axes.flat, PANELS, strict=True):
        style.logarithmic(panel, "x")
        for method in METHOD_NAMES:
            x = sorted(N for of, N in groups if of == method)
            runs = [groups[method, N] for N in x]
            if not x:
                continue
            if name == "lost":
                style.loss_curve(panel, method, x, runs)
            else:
                style.curve(panel, method, x, runs, name)
        panel.set_title(title)
        panel.set_xlabel("particles N")
    style.logarithmic(axes[0, 0], "y")
    rising = [axes[0, 1], *axes[1]]
    style.finish(drawn, rising, axes[0, 0])
    drawn.suptitle(
        f"Number of particles ({preset.name} settings, {options.place}): "
        "median and quartiles of the runs"
    )
    style.save(drawn, options.folder / f"particles-{preset.name}.png")
