"""The figures of a sensor model: cells by range, noise, false blocks, and where in the image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pipeline.experiments.style import GREY, INK, figure
from pipeline.stereo_model import Examined, StereoModel
from simulation.stereo_errors import FALSE_DEPTH_MEAN, FALSE_DEPTH_SD, StereoErrors
from stereo.error_statistics import classify, disparity_errors, find_blocks, relative_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER_HIT, PAPER_FALSE_HIT = 0.54, 0.1
GOOD, BAD, SILENT, TOO_FAR = "#0072B2", "#D55E00", "#8a8a94", "#CC79A7"


def cells_figure(examined: Examined, model: StereoModel) -> Figure:
    """P(O|E) and P(O|notE) by range, beside the paper's constants."""
    drawn, axes = figure(1, 2, (9.0, 3.6))
    panels = (
        ("hit", PAPER_HIT, GOOD, "P(O|E): obstacle cells called occupied"),
        ("false_hit", PAPER_FALSE_HIT, BAD, "P(O|notE): free cells called occupied"),
    )
    for panel, (name, paper, colour, title) in zip(axes[0], panels, strict=True):
        values = [getattr(b, name) for b in model.bins]
        middle = [(b.low + b.high) / 2 for b in model.bins]
        y, low, high = (
            np.array([getattr(v, part) for v in values]) for part in ("value", "low", "high")
        )
        whiskers = np.maximum(np.stack([y - low, high - y]), 0.0)
        panel.errorbar(middle, y, whiskers, fmt="o-", color=colour, capsize=3, label="measured")
        overall = getattr(model, name).value
        panel.axhline(overall, color=colour, ls=":", lw=1.2, label=f"all ranges: {overall:.3f}")
        panel.axhline(paper, color=INK, ls="--", lw=1.0, label=f"paper: {paper:g}")
        panel.set(title=title, xlabel="distance of the cell [m]", ylim=(0, None))
        panel.set_xlim(0, model.bins[-1].high)
        panel.legend(loc="best")
    axes[0, 0].set(ylabel="probability", ylim=(0, 1.05))
    return drawn


def noise_figure(examined: Examined, model: StereoModel, setting: float) -> Figure:
    """Disparity errors of right columns, and how the range error grows.

    setting: stereo.noise in use [px].
    """
    compared = examined.compared
    classes = classify(compared)
    drawn, (panels,) = figure(1, 2, (9.0, 3.6))
    errors = np.concatenate(disparity_errors(compared, classes))
    edges = np.linspace(-1.5, 1.5, 61)
    panels[0].hist(errors, edges, density=True, color=GOOD, alpha=0.55, label="right columns")
    bell = np.exp(-0.5 * (edges / setting) ** 2) / (setting * np.sqrt(2 * np.pi))
    panels[0].plot(edges, bell, color=INK, lw=1.2, label=f"stereo.noise {setting:g} px in use")
    noise, bias = model.disparity_noise.value, model.disparity_bias.value
    panels[0].set(
        title=f"disparity error: sd {noise:.3f} px, median {bias:+.3f} px",
        xlabel="measured less true disparity [px]",
        ylabel="density [1/px]",
        ylim=(0, 1.35 * panels[0].get_ylim()[1]),
    )
    panels[0].legend(loc="upper right")
    off = 100 * np.abs(np.concatenate(relative_errors(compared, classes)))
    chosen = classes.right & np.isfinite(compared.measured) & np.isfinite(compared.truth)
    _error_by_range(panels[1], compared.truth[chosen], off)
    return drawn


def _error_by_range(panel: Axes, truth: np.ndarray, off: np.ndarray) -> None:
    bins = np.arange(0.0, truth.max(initial=1.0) + 0.5, 0.5)
    number = np.digitize(truth, bins)
    used = [n for n in range(1, len(bins) + 1) if np.sum(number == n) >= 20]
    middle = [bins[n - 1] + 0.25 for n in used]
    for quantile, style in ((0.5, "-"), (0.6827, "--"), (0.95, ":")):
        line = [np.quantile(off[number == n], quantile) for n in used]
        panel.plot(middle, line, style, color=GOOD, label=f"{100 * quantile:.0f} % are below")
    panel.axhline(2.0, color=INK, lw=1.0, ls="--", label="paper: sd 2 %")
    panel.set(
        title="error of right ranges",
        xlabel="true range [m]",
        ylabel="|error| [% of the range]",
        xlim=(0, None),
        ylim=(0, None),
    )
    panel.legend(loc="best")


def blocks_figure(examined: Examined, model: StereoModel) -> Figure:
    """How far and how wide the false blocks are, beside the paper's model of them."""
    compared = examined.compared
    blocks = find_blocks(compared, classify(compared))
    drawn, (panels,) = figure(1, 2, (9.0, 3.6))
    reach = max(compared.max_range, 1.0)
    edges = np.linspace(0.0, reach, 25)
    if blocks.range.size:
        panels[0].hist(blocks.range, edges, density=True, color=BAD, alpha=0.55, label="measured")
    z = np.linspace(0.0, reach, 100)
    bell = np.exp(-0.5 * ((z - FALSE_DEPTH_MEAN) / FALSE_DEPTH_SD) ** 2)
    bell /= FALSE_DEPTH_SD * np.sqrt(2 * np.pi)
    panels[0].plot(z, bell, color=INK, lw=1.2, label="paper: N(4.886, 1.773) m")
    panels[0].set(
        title=f"range of false blocks ({model.blocks.value:.2f} a frame)",
        xlabel="range [m]",
        ylabel="density [1/m]",
    )
    panels[0].legend(loc="best")
    width = np.degrees(blocks.width)
    panels[1].plot(blocks.range, width, ".", color=BAD, alpha=0.5, label="measured")
    paper = StereoErrors()
    mean = 3.0 * paper.alpha * (2.0 - z / paper.max_range)
    panels[1].plot(z, mean, color=INK, lw=1.2, label="paper: mean of eq (11)")
    panels[1].set(
        title="width of false blocks",
        xlabel="range [m]",
        ylabel="width [deg]",
        xlim=(0, reach),
        yscale="log",
    )
    panels[1].legend(loc="best")
    return drawn


def columns_figure(examined: Examined, model: StereoModel) -> Figure:
    """In which directions columns are right, false, free by mistake or silent."""
    compared = examined.compared
    classes = classify(compared)
    known = np.maximum(classes.known.sum(axis=0), 1)
    bearing = np.degrees(compared.bearing)
    drawn, ((panel,),) = figure(1, 1, (9.0, 3.4))
    kinds = (
        ("unanswered", classes.unanswered, SILENT),
        ("false", classes.false & ~classes.false_free, BAD),
        ("free by mistake, or too far", classes.false_free, TOO_FAR),
    )
    below = np.zeros(bearing.size)
    for name, mask, colour in kinds:
        share = 100 * mask.sum(axis=0) / known
        panel.fill_between(
            bearing, below, below + share, color=colour, alpha=0.75, lw=0, step="mid", label=name
        )
        below = below + share
    panel.set(
        title=f"columns by direction, {model.frames} frames (the rest is right)",
        xlabel="bearing [deg], left positive: as in the image",
        ylabel="share of the columns with a known truth [%]",
        ylim=(0, max(5.0, float(below.max()) * 1.15)),
        xlim=(bearing[-1], bearing[0]),
    )
    panel.grid(color=GREY, alpha=0.25)
    panel.legend(loc="upper center", ncols=3)
    return drawn
