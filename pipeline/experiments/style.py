"""How the figures look: one colour a method, light grid, no frame; the same bytes every time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from cycler import cycler
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import (
    LogLocator,
    NullFormatter,
    PercentFormatter,
    StrMethodFormatter,
)

from mapping.grid import OccupancyGrid
from pipeline.experiments.batch import Run
from pipeline.experiments.presets import METHOD_NAMES
from pipeline.experiments.summary import lost, of
from pipeline.new_files import new_files

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Of the colour-blind safe palette of Okabe and Ito.
COLOURS = {"hierarchical": "#0072B2", "per-scan": "#D55E00"}
MARKERS = {"hierarchical": "o", "per-scan": "s"}
INK, GREY, UNKNOWN = "#2b2b33", "#8a8a94", "#dadee2"
# Free is white, obstacles are dark; what is rather free must look lighter than what is undecided.
OCCUPANCY = LinearSegmentedColormap.from_list(
    "occupancy",
    [(0.0, "#ffffff"), (0.2, "#fbfbfb"), (0.5, "#e9e4da"), (0.7, "#6f6a66"), (1.0, "#1c2430")],
).with_extremes(bad=UNKNOWN)

STYLE: Any = {
    "axes.prop_cycle": cycler(
        color=["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#2b2b33"]
    ),
    "figure.dpi": 110,
    "savefig.dpi": 110,
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e6e6ea",
    "grid.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "lines.markersize": 5.5,
}
plt.rcParams.update(STYLE)


def figure(
    rows: int, columns: int, size: tuple[float, float], **options: Any
) -> tuple[Figure, Any]:
    """A figure of `size` inches and its axes (rows, columns)."""
    return plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained", **options)


def save(drawn: Figure, file: Path) -> None:
    """Write a PNG whole or not at all."""
    with new_files([file], force=True) as partial:
        drawn.savefig(partial / file.name, metadata={"Software": None})
    plt.close(drawn)


def curve(
    axes: Axes,
    method: str,
    x: Sequence[float],
    groups: Sequence[Sequence[Run]],
    name: str,
    **look: Any,
) -> None:
    """Median of a result over the runs of each group against x, its quartiles as a band."""
    spreads = [of(runs, name) for runs in groups]
    look = {"color": COLOURS[method], "marker": MARKERS[method], **look}
    axes.plot(x, [s.median for s in spreads], label=METHOD_NAMES[method], **look)
    axes.fill_between(
        x,
        [s.lower for s in spreads],
        [s.upper for s in spreads],
        color=look["color"],
        alpha=0.15,
        linewidth=0.0,
    )


def logarithmic(axes: Axes, which: Literal["x", "y"]) -> None:
    """A logarithmic axis with plain numbers at 1, 3, 10, 30, ..."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def finish(drawn: Figure, rising_from_zero: Iterable[Axes], legend_of: Axes) -> None:
    """Let panels begin at 0, once all is plotted, and put one legend below them all."""
    for panel in rising_from_zero:
        panel.set_ylim(bottom=0.0)
    handles, names = legend_of.get_legend_handles_labels()
    drawn.legend(handles, names, loc="outside lower center", ncols=max(len(names), 1))


def show_map(
    axes: Axes,
    grid: OccupancyGrid,
    title: str,
    box: tuple[float, float, float, float] | None = None,
) -> None:
    """A map with equal axes in metres; box: left, right, bottom, top of what is shown."""
    height, width = grid.probability.shape
    left, bottom = grid.origin
    extent = (left, left + width * grid.cell, bottom, bottom + height * grid.cell)
    masked = np.ma.masked_invalid(grid.probability)
    axes.set_facecolor(UNKNOWN)
    axes.imshow(
        masked,
        OCCUPANCY,
        vmin=0.0,
        vmax=1.0,
        origin="lower",
        extent=extent,
        interpolation="nearest",
    )
    axes.set_title(title)
    axes.grid(False)
    axes.set_aspect("equal")
    if box is not None:
        axes.set_xlim(box[0], box[1])
        axes.set_ylim(box[2], box[3])
    axes.tick_params(length=2, labelsize=8)
    for spine in axes.spines.values():
        spine.set_visible(False)


def loss_curve(
    axes: Axes, method: str, x: Sequence[float], groups: Sequence[Sequence[Run]]
) -> None:
    """Share of lost runs of each group against x, with its 95 % interval."""
    share, low, high = np.array(
        [(number / len(runs), a, b) for runs in groups for number, a, b in [lost(runs)]]
    ).T
    # The intervals of the two methods stand beside each other.
    aside = 1.0 if method == "per-scan" else -1.0
    at = np.asarray(x, float)
    beside = at * 1.04**aside if axes.get_xscale() == "log" else at + 0.012 * aside * np.ptp(at)
    axes.errorbar(
        beside,
        share,
        yerr=np.maximum([share - low, high - share], 0.0),
        color=COLOURS[method],
        marker=MARKERS[method],
        capsize=3,
        elinewidth=1.0,
        label=METHOD_NAMES[method],
    )
    axes.set_ylim(-0.02, 1.0)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
