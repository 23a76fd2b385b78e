"""The plots of a report: what was measured along the run, and odometry beside the matched path."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mapping.particle_filter import FilterHealth
from odometry.motion import compose, inverse
from pipeline.health.filter_findings import ANSWERED_WELL, HALF, STARVED, FilterFigures
from pipeline.pages.svg import MOST_POINTS, Plot, thinned, way

ACROSS = "metres driven"
SHARES = (0.0, 0.5, 1.0), ("0", "50 %", "100 %")


@dataclass(frozen=True)
class Curve:
    """A plot with its heading and what to see in it."""

    title: str
    svg: str
    meaning: str


def along_the_run(
    steps: Sequence[FilterHealth], where: np.ndarray, figures: FilterFigures, sight: str
) -> list[Curve]:
    """N_eff, matched share and answers at the metres (n,) at which the n steps ended."""
    return [
        _n_eff(steps, where, figures),
        _matched(steps, where, figures),
        _answered(steps, where, figures, sight),
    ]


def _plot(where: np.ndarray, label: str) -> Plot:
    plot = Plot((0.0, max(float(where[-1]), 1e-3)), (0.0, 1.0), label, ACROSS)
    plot.ticks(*SHARES)
    return plot


def _n_eff(steps: Sequence[FilterHealth], where: np.ndarray, figures: FilterFigures) -> Curve:
    shares = np.array([step.n_eff for step in steps]) / figures.particles
    median, least = figures.n_eff
    plot = _plot(where, f"N_eff along the run: {median:.0%} in the median, {least:.0%} at least")
    plot.limit(STARVED, f"starved: {STARVED:.0%}")
    plot.line(*thinned(where, shares), "blue")
    resampled = where[[step.resampled for step in steps]]
    if len(resampled) <= MOST_POINTS:
        plot.marks(resampled, "orange")
    return Curve(
        "Particles that carry the weight (N_eff)",
        plot.svg,
        "Each particle is a guess at the path with a map of its own. It falls where the guesses "
        "differ in how well they match, mostly where a loop closes, and the better ones are then "
        "copied (orange strokes). Long near the bottom, too few guesses are left.",
    )


def _matched(steps: Sequence[FilterHealth], where: np.ndarray, figures: FilterFigures) -> Curve:
    judged = np.array([step.judged > 0 for step in steps])
    shares = np.array([step.matched for step in steps])
    told = "never" if figures.matched is None else f"{figures.matched:.0%} in the median"
    label = f"Matched share along the run: {told}, {figures.poor} steps below half"
    plot = _plot(where, label)
    plot.limit(HALF, "half")
    x, y = thinned(where[judged], shares[judged])
    if len(x) > 1:
        plot.line(x, y, "faint")
    colours = ["bad" if value < HALF else "ok" for value in y]
    plot.dots(x, y, colours, [f"at {a:.1f} m: {b:.0%}" for a, b in zip(x, y, strict=True)])
    if np.count_nonzero(~judged) <= MOST_POINTS:
        plot.marks(where[~judged], "soft")
    return Curve(
        "How much was seen again (matched share)",
        plot.svg,
        "Of the obstacles that the map holds in view, as many were seen again. Low dots are where "
        "the map disagreed with itself, which smoothing at the end may have mended. Grey strokes "
        "below: too little of the map was in view to judge.",
    )


def _answered(
    steps: Sequence[FilterHealth], where: np.ndarray, figures: FilterFigures, sight: str
) -> Curve:
    shares = np.array([step.answered for step in steps])
    plot = _plot(where, f"{sight} that answered along the run: {figures.answered:.0%} on average")
    plot.limit(ANSWERED_WELL, f"enough: {ANSWERED_WELL:.0%}")
    plot.line(*thinned(where, shares), "blue")
    if sight == "beams":
        return Curve("Beams that answered", plot.svg, "The others came back without a range.")
    return Curve(
        "Columns that answered",
        plot.svg,
        "Columns of the image that gave a range or open space. The others show nothing to match: "
        "blank walls, darkness, glare, or things too near.",
    )


def both_paths(odometry: np.ndarray, path: np.ndarray) -> str:
    """Odometry's path and the matched one, poses (n, 3), from a common start, as SVG."""
    told = compose(compose(path[0], inverse(odometry[0])), odometry)
    both = np.concatenate([told[:, :2], path[:, :2]])
    low, high = both.min(axis=0), both.max(axis=0)
    margin = 0.04 * max(float((high - low).max()), 0.1)
    width, height = (high - low + 2 * margin).tolist()
    drawn = [
        way(np.stack([p[:, 0] - low[0] + margin, high[1] + margin - p[:, 1]], axis=1))
        for p in (told, path)
    ]
    apart = float(np.hypot(*(told[-1] - path[-1])[:2]))
    label = html.escape(f"Odometry's path and the matched one end {apart:.2f} m apart")
    return (
        f'<svg class="paths" viewBox="0 0 {width:.3f} {height:.3f}" role="img" '
        f'aria-label="{label}"><path class="line orange" d="{drawn[0]}"/>'
        f'<path class="line blue" d="{drawn[1]}"/></svg>'
    )
