"""Fig. 3: a false obstacle appears in a local map and is erased by the observations after it."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace

import numpy as np

from mapping.local_map import draw
from mapping.sensor_model import CLAMP, SensorModel, probability
from odometry.motion import compose, inverse
from pipeline.errors import InputError
from pipeline.experiments import style
from pipeline.experiments.batch import Batch
from pipeline.experiments.measure import as_points, paper_settings
from pipeline.experiments.options import Options
from pipeline.experiments.presets import HIERARCHICAL, PAPER
from pipeline.experiments.report import write_table
from pipeline.experiments.spec import place
from pipeline.new_files import new_files
from simulation.paper import simulate
from stereo.scan import RangeScan

SEEDS = 1
FALSE_BY = 0.5  # a range that is short by more is a false match [m]
EARLY = 3  # the false match lies in one of the window's first observations
COLUMNS = ("observation", "cells", "log_odds_mean", "probability_mean", "probability_max",
           "occupied", "undecided", "free")  # fmt: skip
PICTURED = 6


@dataclass(frozen=True)
class Window:
    """The observations of one local map: `scans`, their poses (n, 3) in the frame of the first,
    and which beams (n, beams) of each are false."""

    scans: list[RangeScan]
    poses: np.ndarray
    false: np.ndarray


@dataclass(frozen=True)
class Story:
    """What becomes of the cells that observation `shown` of the window falsely calls obstacles.

    maps: log-odds (n, H, W) after each observation; false (H, W): the cells; origin of both [m].
    """

    window: Window
    shown: int
    maps: np.ndarray
    false: np.ndarray
    origin: tuple[float, float]

    @property
    def course(self) -> np.ndarray:
        """Log-odds (n, cells) of the false cells after each observation."""
        return np.nan_to_num(self.maps[:, self.false])


def run(options: Options) -> Batch:
    """Draw `localmaps.png`, write `false_cells.csv` and `table.md`.

    Of the seed's run the window is taken whose false obstacle is the largest that goes away.

    Raises:
        InputError: there is no false match to show.
    """
    spec = options.spec(PAPER, options.first_seed, *HIERARCHICAL)
    model, cell = SensorModel.of(spec.mapping), spec.mapping.cell
    where, settings = place(spec.world, spec.route), paper_settings(spec)
    noisy = simulate(*where, settings, spec.seed)
    true = simulate(*where, settings, spec.seed, perfect=True)
    false = np.array(
        [
            (measured.range < np.minimum(exact.range, exact.max_range) - FALSE_BY)
            for measured, exact in zip(noisy.scans, true.scans, strict=True)
        ]
    )
    scans, size = as_points(noisy.scans), spec.mapping.window
    stories = []
    for start in range(0, len(scans) - size + 1, size):
        some = slice(start, start + size)
        poses = compose(inverse(noisy.odometry[start]), noisy.odometry[some])
        window = Window(scans[some], poses, false[some])
        shown = int(np.argmax(window.false[:EARLY].sum(axis=1)))
        if window.false[shown].any():
            stories.append(_story(window, shown, cell, model))
    best = max(stories, key=lambda story: _erased(story, model), default=None)
    if best is None or not _erased(best, model):
        raise InputError(
            f"{options.world}, seed {options.first_seed}: no false obstacle that is erased: "
            "give another --first-seed, or a world with longer ranges"
        )
    counts = _counts(best, model)
    with (
        new_files([options.folder / "false_cells.csv"], force=True) as partial,
        (partial / "false_cells.csv").open("w", encoding="ascii", newline="") as file,
    ):
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *counts])
    _draw(best, cell, options)
    title = "A false obstacle in a local map"
    write_table(options.folder, title, _text(best, counts), legend=False)
    return Batch()


def _story(window: Window, shown: int, cell: float, model: SensorModel) -> Story:
    """Draw the local map again after each observation, on one common grid."""
    alone = replace(
        window.scans[shown],
        range=np.where(window.false[shown], window.scans[shown].range, np.nan),
    )
    drawn = [
        draw(window.scans[: i + 1], window.poses[: i + 1], cell, model)
        for i in range(len(window.scans))
    ]
    false = draw([alone], window.poses[shown : shown + 1], cell, model)
    whole, _, origin = drawn[-1]
    maps = np.full((len(drawn), *whole.shape), np.nan, np.float32)
    for i, (log_odds, _, corner) in enumerate(drawn):
        _put(maps[i], log_odds, corner, origin, cell)
    marked = np.full(whole.shape, np.nan, np.float32)
    _put(marked, false[0], false[2], origin, cell)
    return Story(window, shown, maps, marked > 0.0, origin)


def _put(
    canvas: np.ndarray,
    values: np.ndarray,
    corner: tuple[float, float],
    origin: tuple[float, float],
    cell: float,
) -> None:
    """Copy a grid with its lower-left `corner` into the canvas that holds it."""
    column, row = np.round((np.array(corner) - origin) / cell).astype(int)
    canvas[row : row + values.shape[0], column : column + values.shape[1]] = values


def _erased(story: Story, model: SensorModel) -> int:
    """How many of the false cells are obstacles at first and end free."""
    first, last = story.course[story.shown], story.course[-1]
    erased = (first > model.local_occupied_above) & (last < model.local_free_below)
    return int(np.count_nonzero(erased))


def _counts(story: Story, model: SensorModel) -> list[list[str]]:
    """A line of `COLUMNS` for every observation."""
    lines = []
    for i, values in enumerate(story.course):
        p = probability(values)
        occupied = np.count_nonzero(values > model.local_occupied_above)
        free = np.count_nonzero(values < model.local_free_below)
        lines.append(
            [
                str(i + 1),
                str(values.size),
                f"{values.mean():.4f}",
                f"{p.mean():.4f}",
                f"{p.max():.4f}",
                str(occupied),
                str(values.size - occupied - free),
                str(free),
            ]
        )
    return lines


def _text(story: Story, counts: list[list[str]]) -> str:
    first, last = counts[story.shown], counts[-1]
    beams = np.count_nonzero(story.window.false[story.shown])
    return (
        f"Observation {story.shown + 1} of {len(counts)} holds {beams} beams that are "
        f"short by more than {FALSE_BY} m: a false obstacle of {first[1]} cells, "
        f"{first[5]} of them above the threshold. After the last observation {last[5]} of these "
        f"cells are still obstacles, {last[6]} undecided, {last[7]} free; their mean probability "
        f"fell from {first[3]} to {last[3]}. Every observation: `false_cells.csv`.\n\n"
        "![Input scans and the growing local map](localmaps.png)"
    )


def _draw(story: Story, cell: float, options: Options) -> None:
    """Scans above, the local map below, and the course of the false cells; ahead is up."""
    n = len(story.maps)
    before = [story.shown - 1] if story.shown else []
    later = np.linspace(story.shown, n - 1, PICTURED - len(before)).round().astype(int)
    after = list(dict.fromkeys([*before, *later.tolist()]))
    drawn = style.plt.figure(figsize=(13.0, 9.0), layout="constrained")
    grid = drawn.add_gridspec(3, PICTURED, height_ratios=[1.0, 1.0, 0.75])
    height, width = story.false.shape
    x0, y0 = story.origin
    extent = (-(y0 + height * cell), -y0, x0, x0 + width * cell)
    for column, i in enumerate(after):
        scan, panel = story.window.scans[i], drawn.add_subplot(grid[0, column])
        _show_scan(panel, scan, story.window.poses[i], story.window.false[i])
        panel.set_title(f"observation {i + 1}")
        below = drawn.add_subplot(grid[1, column])
        shade = np.ma.masked_invalid(probability(story.maps[i]).T[:, ::-1])
        below.imshow(shade, style.OCCUPANCY, vmin=0, vmax=1, origin="lower", extent=extent,
                     interpolation="nearest")  # fmt: skip
        below.contour(
            story.false.T[:, ::-1], [0.5], colors=[style.COLOURS["per-scan"]], linewidths=0.8,
            origin="lower", extent=extent,
        )  # fmt: skip
        for axes in (panel, below):
            axes.set_facecolor(style.UNKNOWN)
            axes.set_aspect("equal")
            axes.set_xlim(extent[0], extent[1])
            axes.set_ylim(extent[2], extent[3])
            axes.set_xticks([])
            axes.set_yticks([])
            axes.grid(visible=False)
        if column == 0:
            panel.set_ylabel("input")
            below.set_ylabel("local map")
    _show_course(drawn.add_subplot(grid[2, :]), story)
    drawn.suptitle(
        f"A false obstacle (outlined) is erased ({options.place}, seed {options.first_seed}); "
        "the robot looks up the page"
    )
    style.save(drawn, options.folder / "localmaps.png")


def _show_scan(panel, scan: RangeScan, pose: np.ndarray, false: np.ndarray) -> None:
    """One scan as a fan of free space with its hits; false ones in colour."""
    reach = np.where(np.isfinite(scan.range), scan.range, scan.max_range)
    angle = pose[2] + scan.bearing
    x, y = pose[0] + reach * np.cos(angle), pose[1] + reach * np.sin(angle)
    panel.fill(np.append(-y, -pose[1]), np.append(x, pose[0]), color="#ffffff", linewidth=0)
    hit = np.isfinite(scan.range)
    for some, colour in ((hit & ~false, style.INK), (hit & false, style.COLOURS["per-scan"])):
        panel.plot(-y[some], x[some], ".", color=colour, markersize=2.5)
    panel.plot([-pose[1]], [pose[0]], "^", color=style.COLOURS["hierarchical"], markersize=5)


def _show_course(panel, story: Story) -> None:
    p = probability(np.clip(story.course, -CLAMP, CLAMP))
    x = np.arange(1, len(p) + 1)
    low, high = np.quantile(p, [0.05, 0.95], axis=1)
    colour = style.COLOURS["per-scan"]
    panel.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    panel.plot(x, p.mean(axis=1), color=colour, marker="o")
    for level, name in ((0.7, "obstacle above"), (0.2, "free below")):
        panel.axhline(level, color=style.GREY, linewidth=1.0, linestyle=":")
        panel.text(len(p) + 0.05, level, f" {name} {level:g}", va="center", fontsize=9)
    panel.set_ylim(0.0, 1.0)
    panel.set_xticks(x)
    panel.set_xlabel("observations in the local map")
    panel.set_ylabel("P(obstacle)")
    panel.set_title("probability of the false cells: mean, and 5 to 95 % of them")
