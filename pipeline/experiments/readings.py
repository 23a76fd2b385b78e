"""How much each reading of the paper matters: one varied at a time from the paper's settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pipeline.experiments import style
from pipeline.experiments.batch import Batch, Run, run_batch
from pipeline.experiments.measure import measure
from pipeline.experiments.options import Options
from pipeline.experiments.presets import HIERARCHICAL, METHOD_NAMES, METHODS, PAPER
from pipeline.experiments.report import HEADER, markdown_table, summary_row, write_table
from pipeline.experiments.spec import RunSpec
from pipeline.experiments.summary import grouped, of

SEEDS = 24
PANELS = (
    ("ate", "path error (ATE) [m]"),
    ("E", "E, common ideal"),
    ("E_cut", "E, both maps cut"),
    ("E_own", "E, own perfect-sensor map"),
)


@dataclass(frozen=True)
class Reading:
    """One value of one reading; `base`: it is the preset's own."""

    name: str
    value: str
    settings: tuple[str, ...] = ()
    simulated: dict[str, Any] = field(default_factory=dict)
    base: bool = False
    hierarchical_only: bool = False

    def __str__(self) -> str:
        return f"{self.name} = {self.value}"


def _settings(key: str, *values: str, base: str, hierarchical_only: bool = False) -> list[Reading]:
    return [
        Reading(
            key,
            value,
            (f"mapping.{key}={value}",),
            base=value == base,
            hierarchical_only=hierarchical_only,
        )
        for value in values
    ]


READINGS = [
    *_settings("match_tolerance", "0", "1", base="1"),
    *_settings("min_overlap", "0", "20", "50", "100", base="50"),
    *_settings("match_weight", "20", "50", base="50"),
    *_settings("resample_below", "0.25", "0.5", "0.75", base="0.5"),
    *_settings("window", "5", "10", "15", "20", base="10", hierarchical_only=True),
    *_settings("ego_motion", "raw", "matched", base="raw"),
    *_settings("smoothing", "false", "true", base="false"),
    Reading("false_depth", "nearest", base=True),
    Reading("false_depth", "replace", simulated={"false_depth": "replace"}),
    Reading("sigma", "ignored", base=True),
    Reading("sigma", "used", simulated={"sigma": True}),
]


def plan(options: Options) -> list[RunSpec]:
    """What equals the preset is asked for again and again, and run once."""
    return [
        options.spec(
            PAPER, seed, *method, *reading.settings, varied=str(reading), **reading.simulated
        )
        for seed in options.seed_range()
        for reading in READINGS
        for method in METHODS
        if method == HIERARCHICAL or not reading.hierarchical_only
    ]


def run(options: Options) -> Batch:
    """Do the runs, draw `readings.png`, write `table.md`."""
    batch = run_batch(plan(options), options.folder, measure, options.workers, options.quiet)
    groups = grouped(batch.runs, lambda spec: (spec.method, spec.varied))
    _draw(groups, options)
    parts = []
    for method, name in METHOD_NAMES.items():
        rows = [
            summary_row(f"{reading}{' (base)' if reading.base else ''}", groups[method, key])
            for reading in READINGS
            if (method, key := str(reading)) in groups
        ]
        parts.append(f"## {name}\n\n" + markdown_table(HEADER, rows))
    write_table(options.folder, "Sensitivity to the readings", "\n\n".join(parts), batch.failures)
    return batch


def _draw(groups: dict[Any, list[Run]], options: Options) -> None:
    """A line for every value: each run a dot, the median a bar."""
    drawn, axes = style.figure(1, len(PANELS), (15.0, 7.5), sharey=True)
    lines = list(reversed(READINGS))
    for panel, (name, title) in zip(axes[0], PANELS, strict=True):
        for y, reading in enumerate(lines):
            for method, aside in zip(METHOD_NAMES, (0.17, -0.17), strict=True):
                runs = groups.get((method, str(reading)), [])
                values = [getattr(run.result, name) for run in runs]
                colour = style.COLOURS[method]
                panel.plot(
                    values, [y + aside] * len(values), ".", color=colour, alpha=0.35, markersize=6
                )
                panel.plot(
                    [of(runs, name).median],
                    [y + aside],
                    "|",
                    color=colour,
                    markersize=13,
                    markeredgewidth=2.5,
                    label=METHOD_NAMES[method] if y == 0 else None,
                )
            if y and lines[y - 1].name != reading.name:
                panel.axhline(y - 0.5, color=style.GREY, linewidth=0.6)
        panel.set_title(title)
        panel.grid(visible=False, axis="y")
    labels = [f"{reading}{' *' if reading.base else ''}" for reading in lines]
    axes[0, 0].set_yticks(range(len(lines)), labels)
    for panel in axes[0]:
        panel.set_xlim(left=0.0)
        panel.set_ylim(-0.6, len(lines) - 0.4)
    style.finish(drawn, [], axes[0, 0])
    drawn.suptitle(
        f"One reading varied at a time from the paper's settings (* their own; {options.place}): "
        "every run a dot, the median a bar"
    )
    style.save(drawn, options.folder / "readings.png")
