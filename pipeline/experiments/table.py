"""The simulated figures that beemap is held against, each with the previous method beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.experiments import style
from pipeline.experiments.batch import Batch, Run, run_batch
from pipeline.experiments.consistency import BAND, band, share_inside
from pipeline.experiments.measure import LOST, measure
from pipeline.experiments.options import Options
from pipeline.experiments.presets import HIERARCHICAL, OURS, PAPER, PREVIOUS, Preset
from pipeline.experiments.report import (
    HEADER,
    markdown_table,
    number_of,
    percent,
    summary_row,
    write_table,
)
from pipeline.experiments.spec import RunSpec
from pipeline.experiments.summary import grouped, lost, of

SEEDS = 200
FACTOR = 3.0  # by which the band of NEES is widened
# The previous method with all that helps it: each particle drawn about its best match.
MATCHED_PREVIOUS = ("mapping.method=per-scan", "mapping.proposal=matched")
MATCHED_PREVIOUS_NAME = "previous method, matched proposal"
VARIANTS = {
    "hierarchical": HIERARCHICAL,
    "previous method": PREVIOUS,
    MATCHED_PREVIOUS_NAME: MATCHED_PREVIOUS,
}
# It takes several times as long.
MOST_SEEDS = {MATCHED_PREVIOUS_NAME: 3}
SHOWN = (0.02, 5.0)  # path errors in the figure [m]


@dataclass(frozen=True)
class Case:
    """One line of what must be shown: `target` in words, `seeds` it asks for."""

    name: str
    preset: Preset
    settings: tuple[str, ...]
    seeds: int
    target: str
    simulated: dict[str, Any] = field(default_factory=dict)
    variants: tuple[str, ...] = ("hierarchical", "previous method")


ALL = tuple(VARIANTS)
REPLACE = {"false_depth": "replace"}
CASES = [
    Case(
        "paper's settings, raw ego-motion, N = 100, nearest",
        PAPER,
        ("mapping.particles=100",),
        200,
        "hierarchical: median ATE <= .16 m, upper bound of the loss rate <= 3 %; at least 4 times "
        "less CPU time than the previous method",
    ),
    Case(
        "matched ego-motion, N = 30, nearest",
        OURS,
        ("mapping.particles=30",),
        48,
        "hierarchical: mean ATE <= .08 m, worst <= .15 m",
    ),
    Case(
        "matched ego-motion, N = 30, replace",
        OURS,
        ("mapping.particles=30",),
        48,
        "hierarchical: mean ATE <= .09 m, worst <= .18 m",
        REPLACE,
    ),
    Case(
        "matched ego-motion, N = 100, nearest",
        OURS,
        ("mapping.particles=100",),
        48,
        "hierarchical: mean ATE <= .07 m, worst <= .10 m",
        variants=ALL,
    ),
    Case(
        "matched ego-motion, N = 100, replace",
        OURS,
        ("mapping.particles=100",),
        48,
        "hierarchical: mean ATE <= .08 m, worst <= .12 m",
        REPLACE,
        ALL,
    ),
    Case(
        "4 false blocks, matched ego-motion, N = 100, replace",
        OURS,
        ("mapping.particles=100",),
        24,
        "hierarchical: worst ATE <= .3 m",
        {**REPLACE, "blocks": 4},
        ALL,
    ),
]


def plan(options: Options) -> list[RunSpec]:
    """Every case with every variant of the method."""
    return [
        options.spec(
            case.preset,
            seed,
            *case.settings,
            *VARIANTS[variant],
            varied=f"{case.name}: {variant}",
            **case.simulated,
        )
        for seed in options.seed_range()
        for case in CASES
        for variant in case.variants
        if seed in options.seed_range(min(case.seeds, MOST_SEEDS.get(variant, case.seeds)))
    ]


def run(options: Options) -> Batch:
    """Do the runs, draw `consistency.png` and `path-error.png`, write `table.md`."""
    batch = run_batch(plan(options), options.folder, measure, options.workers, options.quiet)
    groups = grouped(batch.runs, lambda spec: spec.varied)
    parts = []
    for case in CASES:
        found = {v: groups[name] for v in case.variants if (name := f"{case.name}: {v}") in groups}
        if found:
            rows = [summary_row(variant, runs) for variant, runs in found.items()]
            facts = _facts(found)
            parts.append(
                f"## {case.name[0].upper()}{case.name[1:]}\n\nTo reach: {case.target}.\n\n"
                f"{markdown_table(HEADER, rows)}\n\n{facts}"
            )
    parts.append("## Consistency\n\n" + _consistency(groups, options))
    _draw_errors(groups, options)
    write_table(options.folder, "What it must show", "\n\n".join(parts), batch.failures)
    return batch


def _facts(found: dict[str, list[Run]]) -> str:
    """Dead reckoning, the bound of the loss rate, and how the times compare."""
    runs = next(iter(found.values()))
    facts = [f"Dead reckoning: median {of(runs, 'dead_reckoning').median:.2f} m."]
    if "hierarchical" in found:
        _, _, upper = lost(found["hierarchical"])
        facts.append(f"Hierarchical, loss rate: at most {100 * upper:.1f} % (95 %).")
        mine = of(found["hierarchical"], "cpu_s").median
        facts += [
            f"CPU time of the {variant}: {of(others, 'cpu_s').median / mine:.1f} times as much."
            for variant, others in found.items()
            if variant != "hierarchical"
        ]
    return " ".join(facts)


def _consistency(groups: dict[str, list[Run]], options: Options) -> str:
    """Table of NEES, and its course along the run as a figure."""
    header = (
        "case",
        "runs",
        "median NEES",
        f"single runs in the {100 * BAND:.0f} % band",
        f"within a factor {FACTOR:g}",
        f"mean of the runs in its {100 * BAND:.0f} % band",
        f"within a factor {FACTOR:g}",
    )
    rows = []
    drawn, axes = style.figure(1, 1, (9.5, 6.4))
    panel = axes[0, 0]
    for case in CASES:
        runs = groups.get(f"{case.name}: hierarchical", [])
        if not runs:
            continue
        series = _together([run.result.nees_series for run in runs])
        mean = series.mean(axis=0)
        rows.append(
            [
                case.name,
                str(len(runs)),
                number_of(float(np.median(series)), 1),
                *(percent(share_inside(series, band(1, factor))) for factor in (1.0, FACTOR)),
                *(percent(share_inside(mean, band(len(runs), factor))) for factor in (1.0, FACTOR)),
            ]
        )
        panel.plot(np.arange(1, len(mean) + 1), np.median(series, axis=0), label=case.name)
    low, high = band(1)
    panel.axhspan(low, high, color=style.GREY, alpha=0.25, linewidth=0)
    panel.axhspan(low / FACTOR, high * FACTOR, color=style.GREY, alpha=0.12, linewidth=0)
    panel.set_yscale("log")
    panel.set_xlabel("local maps closed")
    panel.set_ylabel("NEES, median over the runs")
    panel.set_title(
        "Is the filter as sure as it may be? Above the band: over-confident\n"
        f"(dark: 95 % band of chi-square(3); light: widened {FACTOR:g} times)"
    )
    drawn.legend(loc="outside lower center", ncols=2, fontsize=9)
    style.save(drawn, options.folder / "consistency.png")
    text = (
        "NEES of the hierarchical filter's poses to the truth at every local map that closes along "
        "the run, in the frame of the first pose, from the particles' weighted mean and covariance "
        "after resampling. A single run's NEES is chi-square with 3 degrees of freedom when the "
        "spread is right (95 % of the time between 0.216 and 9.35); the mean over the runs at one "
        "closing has a narrower band. Where all particles share one ancestor's direction NEES is "
        "infinite and counts as outside."
    )
    return f"{text}\n\n{markdown_table(header, rows)}\n\n![NEES along the run](consistency.png)"


def _together(series: Sequence[np.ndarray]) -> np.ndarray:
    """(runs, closings) as far as every run goes."""
    shortest = min(len(values) for values in series)
    return np.array([values[:shortest] for values in series])


def _draw_errors(groups: dict[str, list[Run]], options: Options) -> None:
    """Distribution of the path error: the share of runs that stay below it."""
    drawn, axes = style.figure(2, 3, (14.0, 8.0), sharey=True, sharex=True)
    for panel, case in zip(axes.flat, CASES, strict=True):
        for variant in case.variants:
            runs = groups.get(f"{case.name}: {variant}", [])
            errors = np.sort([run.result.ate for run in runs])
            panel.step(
                np.concatenate([[SHOWN[0]], errors, [SHOWN[1]]]),
                np.concatenate([np.arange(len(errors) + 1), [len(errors)]]) / max(len(errors), 1),
                where="post",
                color=style.COLOURS["hierarchical" if variant == "hierarchical" else "per-scan"],
                linestyle="--" if variant == MATCHED_PREVIOUS_NAME else "-",
                label=variant,
            )
        panel.axvline(LOST, color=style.GREY, linewidth=1.0, linestyle=":")
        panel.set_title(case.name, fontsize=10)
    style.logarithmic(axes[0, 0], "x")
    axes[0, 0].set_xlim(*SHOWN)
    for row in axes:
        row[0].set_ylabel("share of the runs")
    for panel in axes[1]:
        panel.set_xlabel("path error (ATE) [m]")
    handles, names = axes[1, 2].get_legend_handles_labels()
    drawn.legend(handles, names, loc="outside lower center", ncols=3)
    drawn.suptitle(f"Share of the runs below a path error ({options.place}); dotted: lost")
    style.save(drawn, options.folder / "path-error.png")
