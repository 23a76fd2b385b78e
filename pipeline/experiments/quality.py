"""Fig. 8: quality against alpha, the size of the false blocks, and against their number."""

from __future__ import annotations

from pipeline.experiments import style
from pipeline.experiments.batch import Batch, run_batch
from pipeline.experiments.measure import measure
from pipeline.experiments.options import Options
from pipeline.experiments.presets import ALPHA, METHOD_NAMES, METHODS, OURS, PAPER, Preset
from pipeline.experiments.report import HEADER, markdown_table, summary_row, write_table
from pipeline.experiments.spec import RunSpec
from pipeline.experiments.summary import grouped

SEEDS = 24
ALPHAS = (0.0, 0.5, 1.0, ALPHA, 2.5, 3.25, 4.0)
BLOCKS = (0, 1, 2, 3, 4)
FALSE_DEPTHS = ("nearest", "replace")
PARTICLES = 100
PANELS = (
    ("ate", "path error (ATE) [m]"),
    ("lost", "runs lost (ATE > 1 m)"),
    ("E", "E, common ideal"),
    ("E_cut", "E, both maps cut"),
    ("E_own", "E, own perfect-sensor map"),
)


def plan(options: Options) -> list[RunSpec]:
    """Both sweeps; they share the point alpha = 5/3, one block."""
    errors = [(alpha, 1) for alpha in ALPHAS] + [(ALPHA, blocks) for blocks in BLOCKS]
    return [
        options.spec(
            preset,
            seed,
            *method,
            f"mapping.particles={PARTICLES}",
            alpha=alpha,
            blocks=blocks,
            false_depth=false_depth,
        )
        for seed in options.seed_range()
        for alpha, blocks in dict.fromkeys(errors)
        for false_depth in FALSE_DEPTHS
        for preset in (PAPER, OURS)
        for method in METHODS
    ]


def run(options: Options) -> Batch:
    """Do the runs, draw `quality-<preset>-<alpha|blocks>.png`, write `table.md`."""
    batch = run_batch(plan(options), options.folder, measure, options.workers, options.quiet)
    groups = grouped(
        batch.runs,
        lambda spec: (spec.preset, spec.false_depth, spec.method, spec.alpha, spec.blocks),
    )
    parts = []
    for preset in (PAPER, OURS):
        _draw(groups, preset, "alpha", options)
        _draw(groups, preset, "blocks", options)
        for false_depth in FALSE_DEPTHS:
            rows = [
                summary_row(f"{METHOD_NAMES[key[2]]}, alpha {key[3]:.2f}, blocks {key[4]}", runs)
                for key, runs in sorted(groups.items(), key=lambda item: item[0][2:])
                if key[:2] == (preset.name, false_depth)
            ]
            title = f"## Settings: {preset.name}, false depth: {false_depth}"
            parts.append(f"{title}\n\n" + markdown_table(HEADER, rows))
    write_table(
        options.folder, "Quality against the stereo's errors", "\n\n".join(parts), batch.failures
    )
    return batch


def _draw(groups: dict, preset: Preset, against: str, options: Options) -> None:
    """One row of panels for each reading of the false depth."""
    drawn, axes = style.figure(2, len(PANELS), (17.0, 6.8), sharey="col")
    for row, false_depth in zip(axes, FALSE_DEPTHS, strict=True):
        for panel, (name, title) in zip(row, PANELS, strict=True):
            for method in METHOD_NAMES:
                start = (preset.name, false_depth, method)
                if against == "alpha":
                    points = {x: groups.get((*start, x, 1)) for x in ALPHAS}
                else:
                    points = {x: groups.get((*start, ALPHA, x)) for x in BLOCKS}
                points = {x: runs for x, runs in points.items() if runs}
                if not points:
                    continue
                if name == "lost":
                    style.loss_curve(panel, method, list(points), list(points.values()))
                else:
                    style.curve(panel, method, list(points), list(points.values()), name)
            panel.set_title(f"{title}, {false_depth}")
            if against == "alpha":
                panel.axvline(ALPHA, color=style.GREY, linewidth=1.0, linestyle=":")
    for panel in axes[1]:
        panel.set_xlabel("alpha (eq (11): 5/3)" if against == "alpha" else "false blocks a frame")
    measured = [i for i, (name, _) in enumerate(PANELS) if name != "lost"]
    style.finish(drawn, axes[:, measured].flat, axes[0, 0])
    drawn.suptitle(
        f"Quality against the {'size' if against == 'alpha' else 'number'} of false blocks "
        f"({preset.name} settings, {options.place}): median and quartiles"
    )
    style.save(drawn, options.folder / f"quality-{preset.name}-{against}.png")
