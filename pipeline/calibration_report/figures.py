"""The figures of a calibration report. Each draws one answer; `page.py` puts them together.

Drawn in few colours on a transparent ground, so that the page can swap ink and grey for dark
mode: `INK` and `FAINT` are used for nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from calibration.attitudes import TILTED
from calibration.verdict import LIMITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from calibration.calibrate import CalibrationResult
    from calibration.coverage import Coverage

INK, FAINT = "#2b2b34", "#c9c9d2"
# Of the colour-blind safe palette of Okabe and Ito.
LEFT, RIGHT, ROWS, ALARM = "#0072b2", "#e69f00", "#009e73", "#d55e00"
BOARDS = LinearSegmentedColormap.from_list("boards", ["#cfe3f1", "#0072b2", "#00304d"])
STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlecolor": INK,
    "figure.facecolor": "none",
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "svg.fonttype": "none",  # the page's own font, and text that can be searched
    "svg.hashsalt": "beemap",  # the same bytes every time
}
ARROW = 0.08  # length of the longest arrow over the image's width
MOST_PAIRS = 40  # in the figure
WIDTH = 5.0  # inches: text stays readable when a phone shrinks the figure


def coverage_figure(result: CalibrationResult) -> Figure:
    """How many boards covered each part of both images, and where their corners were."""
    figure, axes = _panels(1, 2, 2.3)
    views = [result.solution.views[index] for index in result.solution.used_views]
    corners = ([v.left.corners for v in views], [v.right.corners for v in views])
    covers = result.judgement.coverage
    most = max(1, *(int(cover.boards.max()) for cover in covers))
    for panel, name, cover, seen in zip(
        axes[0], ("left image", "right image"), covers, corners, strict=True
    ):
        _show_coverage(panel, cover, np.concatenate(seen), result.rig.image_size, most)
        panel.set_title(f"{name}: {cover.share:.0%} covered")
    bar = figure.colorbar(axes[0, 0].images[0], ax=axes[0].tolist(), shrink=0.8, aspect=12)
    bar.set_label("boards")
    bar.outline.set_edgecolor(FAINT)
    return figure


def residual_figure(result: CalibrationResult) -> Figure:
    """Mean reprojection residual of each part of both images: what the lens model leaves over."""
    figure, axes = _panels(1, 2, 2.3)
    solution = result.solution
    size = solution.rig.image_size
    fields = []
    for side in (0, 1):
        kept = [k[side] for k in solution.kept]
        at = [(v.left, v.right)[side].corners for v in solution.views]
        off = [r[side] for r in solution.residuals]
        fields.append(_binned(_chosen(at, kept), _chosen(off, kept), size))
    longest = max(float(np.hypot(*means.T).max(initial=1e-6)) for _, means in fields)
    magnified = ARROW * size[0] / longest
    for panel, name, (places, means) in zip(
        axes[0], ("left image", "right image"), fields, strict=True
    ):
        # Image rows run downwards; quiver's angles="xy" follows the axes.
        arrows = means * magnified
        panel.quiver(
            *places.T, *arrows.T, angles="xy", scale_units="xy", scale=1, color=LEFT, width=0.006
        )
        panel.set_title(name)
        panel.grid(False)
        _image_frame(panel, size)
    figure.supxlabel(f"longest arrow {longest:.2f} px, drawn {magnified:.0f} times as long", size=8)
    return figure


def pairs_figure(result: CalibrationResult) -> Figure:
    """Held-out row error and reprojection error of the pairs, of very many the worst."""
    rows = result.heldout.view_rms
    worst = np.sort(np.argsort(-rows, kind="stable")[:MOST_PAIRS])
    by_number = {view.number: view.name for view in result.views}
    names = [by_number[number] for number in worst.tolist()]
    rows, errors = rows[worst], result.solution.view_rms[worst]
    at = np.arange(len(names))
    figure, axes = _panels(1, 1, 1.1 + 0.24 * len(names))
    panel = axes[0, 0]
    for offset, values, colour, label in (
        (-0.27, rows, ROWS, "rows, held out"),
        (0.0, errors[:, 0], LEFT, "corners, left"),
        (0.27, errors[:, 1], RIGHT, "corners, right"),
    ):
        panel.barh(at + offset, values, height=0.25, color=colour, label=label)
    _verdict_lines(panel, float(max(np.nanmax(rows), errors.max())))
    panel.set_yticks(at, names)
    panel.set_ylim(len(names) - 0.4, -0.6)
    panel.set_xlabel("RMS [px]")
    panel.grid(False, axis="y")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def depth_figure(result: CalibrationResult) -> Figure:
    """Standard deviation of depth against depth: matching, the calibration's doubt, both."""
    figure, axes = _panels(1, 1, 2.7)
    panel, depth = axes[0, 0], result.judgement.depth
    for values, colour, style, label in (
        (depth.total, INK, "-", "together"),
        (depth.from_matching, LEFT, "--", f"matching ({depth.disparity_sigma:g} px)"),
        (depth.from_calibration, ALARM, ":", "calibration"),
    ):
        panel.plot(depth.distances, values, color=colour, linestyle=style, marker="o", label=label)
    panel.axhline(depth.tolerance, color=FAINT, linewidth=1.0)
    panel.annotate(
        f"usable to {depth.usable_range:.1f} m",
        (depth.usable_range, depth.tolerance),
        xytext=(0, -22),
        textcoords="offset points",
    )
    panel.plot([depth.usable_range], [depth.tolerance], marker="D", color=ROWS)
    panel.set(xscale="log", yscale="log", xlabel="depth [m]", ylabel="standard deviation [m]")
    panel.set_xticks(depth.distances, [f"{z:g}" for z in depth.distances])
    panel.set_xticks([], minor=True)
    panel.yaxis.set_major_formatter("{x:g}")
    panel.legend(loc="upper left")
    return figure


def attitudes_figure(result: CalibrationResult) -> Figure:
    """Tilts and distances of the boards."""
    figure, axes = _panels(1, 1, 2.7)
    panel, stood = axes[0, 0], result.judgement.attitudes
    about_x, about_y = np.degrees(stood.tilts).T
    panel.axhspan(*np.degrees([-TILTED, TILTED]), color=FAINT, alpha=0.35, linewidth=0)
    panel.axvspan(*np.degrees([-TILTED, TILTED]), color=FAINT, alpha=0.35, linewidth=0)
    dots = panel.scatter(about_y, about_x, c=stood.distances, cmap=BOARDS, s=40, edgecolor=FAINT)
    reach = max(30.0, 1.15 * float(np.abs(np.degrees(stood.tilts)).max()))
    panel.set(xlim=(-reach, reach), ylim=(-reach, reach))
    panel.set(xlabel="left edge nearer  |  right edge nearer [deg]")
    panel.set(ylabel="lower  |  upper edge nearer [deg]")
    bar = figure.colorbar(dots, ax=panel)
    bar.set_label("distance [m]")
    bar.outline.set_edgecolor(FAINT)
    return figure


def _panels(rows: int, columns: int, height: float) -> tuple[Figure, Any]:
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _chosen(values: list[np.ndarray], kept: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([v[k] for v, k in zip(values, kept, strict=True)])


def _image_frame(panel: Axes, size: tuple[int, int]) -> None:
    width, height = size
    panel.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    panel.set_xticks([])
    panel.set_yticks([])
    for spine in panel.spines.values():
        spine.set_visible(True)


def _show_coverage(
    panel: Axes, cover: Coverage, corners: np.ndarray, size: tuple[int, int], most: int
) -> None:
    width, height = size
    boards = np.ma.masked_equal(cover.boards, 0)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    panel.imshow(boards, cmap=BOARDS, vmin=1, vmax=max(most, 2), extent=extent)
    panel.plot(*corners.T, ".", color="white", markersize=1.2, markeredgewidth=0)
    panel.grid(False)
    _image_frame(panel, size)


def _verdict_lines(panel: Axes, longest: float) -> None:
    """The limits of the verdicts that are near the bars."""
    for name, limit in LIMITS:
        if limit <= 1.3 * longest:
            panel.axvline(limit, color=INK, linewidth=0.8, linestyle=(0, (3, 3)))
            panel.annotate(
                name, (limit, 1.0), xycoords=("data", "axes fraction"), xytext=(-2, 1),
                textcoords="offset points", fontsize=7, ha="right", va="bottom",
            )  # fmt: skip


def _binned(
    at: np.ndarray, values: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean place (k, 2) and mean value (k, 2) over the occupied cells of a grid over the image."""
    columns, rows = 14, 10
    column, row = ((at + 0.5) * (columns, rows) / size).astype(int).T
    cell = np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1)
    count = np.bincount(cell, minlength=rows * columns)
    occupied = count > 0

    def mean(of: np.ndarray) -> np.ndarray:
        sums = [np.bincount(cell, of[:, axis], rows * columns)[occupied] for axis in (0, 1)]
        return np.stack(sums, axis=1) / count[occupied, None]

    return mean(at), mean(values)
