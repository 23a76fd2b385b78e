"""A pair and what stereo makes of it, for people: rectified images, disparity, scan from above."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from stereo.disparity import SUBPIXEL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stereo.pair import StereoPair
    from stereo.ranger import StereoFrame, StereoRanger
    from stereo.scan import RangeScan

SIZE, DPI = (13.6, 8.4), 100  # inches
LINES = 8  # row lines
# Pixels whose disparity is that of their column's range within this belong to it [px].
BELONGS = 1.5
INK, FAINT = "#2b2b33", "#8a8a94"
HIT, TRUE, FREE, UNKNOWN, LINE = "#D55E00", "#0072B2", "#cfe8d8", "#dadade", "#56d364"
# A range off by more than this share of the truth is wrong.
WRONG = 0.10
TITLE: Any = {"fontsize": 9, "color": INK, "loc": "left", "pad": 3}
DEPTH_TICKS = (0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0)  # m


class StereoPicture:
    """Draws frames of one ranger, one after the other, into pictures of the same size."""

    def __init__(self, ranger: StereoRanger):
        self._ranger = ranger
        self._figure = Figure(SIZE, dpi=DPI)
        self._canvas = FigureCanvasAgg(self._figure)

    def draw(
        self, pair: StereoPair, frame: StereoFrame, truth: np.ndarray | None, title: str
    ) -> np.ndarray:
        """The picture (H, W, 3) uint8 BGR.

        truth: (n,) m as `RangeScan.range`, where it is known; title: where the pair comes from.
        """
        figure = self._figure
        figure.clear()
        camera = self._ranger.camera
        # The images side as wide as three of them, one above the other, need it.
        wide = min(0.24 * SIZE[1] * camera.width / (camera.height * camera.rows_joined) + 1.5, 7.0)
        grid = figure.add_gridspec(
            3,
            2,
            width_ratios=(wide, SIZE[0] - 1.3 - wide),
            left=0.03,
            right=0.985,
            top=0.89,
            bottom=0.07,
            hspace=0.16,
            wspace=0.1,
        )
        left, right, below = (figure.add_subplot(grid[row, 0], anchor="NW") for row in range(3))
        images = self._ranger.rectify(pair.left, pair.right)
        for axes, image, name in ((left, images[0], "left"), (right, images[1], "right")):
            self._image(axes, image, name)
        self._rests_on(left, frame)
        note = "; green: the same rows in both"
        right.set_title(right.get_title(loc="left") + note, **TITLE)
        self._depth(below, frame)
        self._scan(figure.add_subplot(grid[:, 1], anchor="NW"), frame.scan, truth)
        figure.text(0.03, 0.96, title, fontsize=11, color=INK, weight="bold")
        figure.text(0.03, 0.93, in_words(frame.scan, truth), fontsize=9.5, color=INK)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., 2::-1].copy()

    def _image(self, axes: Axes, image: np.ndarray, name: str) -> None:
        joined = self._ranger.camera.rows_joined
        axes.imshow(image, cmap="gray", vmin=0, vmax=255, aspect=joined, interpolation="nearest")
        for row in np.linspace(0, len(image) - 1, LINES + 2)[1:-1]:
            axes.axhline(row, color=LINE, lw=0.6, alpha=0.8)
        axes.set_title(
            f"{name}, rectified" + (f", {joined} rows joined" if joined > 1 else ""), **TITLE
        )
        axes.set(xticks=[], yticks=[])

    def _rests_on(self, axes: Axes, frame: StereoFrame) -> None:
        """Colour the pixels from which the ranges come."""
        marked = belonging(frame, self._ranger)
        shade = np.zeros((*marked.shape, 4))
        shade[marked] = (0.835, 0.369, 0.0, 0.75)
        axes.imshow(shade, aspect=self._ranger.camera.rows_joined, interpolation="nearest")
        axes.set_title(axes.get_title(loc="left") + "; orange: what the ranges rest on", **TITLE)

    def _depth(self, axes: Axes, frame: StereoFrame) -> None:
        camera = self._ranger.camera
        known = frame.disparity > 0
        depth = camera.depth_factor * SUBPIXEL / np.where(known, frame.disparity, 1)
        nearest = camera.depth_factor / self._ranger.match.disparities
        farthest = max(2.0 * self._ranger.max_range, 2.0 * nearest)
        axes.set_facecolor("#404048")
        shown = axes.imshow(
            np.ma.masked_where(~known, depth),
            cmap="turbo_r",
            norm=LogNorm(nearest, farthest, clip=True),
            aspect=camera.rows_joined,
            interpolation="nearest",
        )
        axes.set(xticks=[], yticks=[])
        axes.set_title(f"depth; dark: no match ({100 * np.mean(known):.0f} % matched)", **TITLE)
        ticks = [z for z in DEPTH_TICKS if nearest <= z <= farthest]
        bar = self._figure.colorbar(shown, cax=axes.inset_axes((1.02, 0.0, 0.03, 1.0)), ticks=ticks)
        bar.ax.set_yticklabels([f"{z:g} m" for z in ticks], fontsize=8)
        bar.ax.minorticks_off()

    def _scan(self, axes: Axes, scan: RangeScan, truth: np.ndarray | None) -> None:
        """From above, as the robot sees it: ahead is up, left is left."""
        x, y, yaw = scan.origin
        angle = yaw + scan.bearing
        ray = np.stack([-np.sin(angle), np.cos(angle)], axis=1)  # (right of the page, up)
        eye = np.array([-y, x])
        reach = np.where(np.isfinite(scan.range), scan.range - 2 * scan.sigma, scan.max_range)
        reach = np.maximum(reach, 0.0)
        for mask, colour, name in (
            (np.isnan(scan.range), UNKNOWN, "unknown: no answer"),
            (~np.isnan(scan.range), FREE, "free (up to 2 sigma before a range)"),
        ):
            fans = _fans(eye, ray, reach, mask)
            axes.add_collection(PolyCollection(fans, facecolor=colour, edgecolor="none"))
            axes.plot([], [], "s", color=colour, ms=8, label=name)
        hit = np.isfinite(scan.range)
        at = eye + scan.range[hit, None] * ray[hit]
        doubt = 2 * scan.sigma[hit, None] * ray[hit]
        bars = np.stack([at - doubt, at + doubt], axis=1)
        axes.add_collection(LineCollection(list(bars), colors=HIT, linewidths=0.8, alpha=0.35))
        axes.plot(*at.T, ".", color=HIT, ms=3.5, label="measured, bars: 2 sigma", zorder=4)
        if truth is not None:
            seen = np.where(truth <= 1.5 * scan.max_range, truth, np.nan)
            axes.plot(*(eye + seen[:, None] * ray).T, color=TRUE, lw=1.3, label="true", zorder=3)
        arc = eye + scan.max_range * ray
        axes.plot(*arc.T, color=FAINT, lw=0.8, ls="--")
        axes.plot(*eye, "^", color=INK, ms=8, label="camera")
        axes.plot(0, 0, "+", color=INK, ms=9, label="robot's origin")
        half = max(scan.max_range * math.sin(float(np.max(np.abs(scan.bearing)))), 1.0) * 1.1
        axes.set(
            xlim=(-half, half),
            ylim=(min(-0.3, eye[1] - 0.3), max(1.25 * scan.max_range, 1.0)),
            aspect="equal",
            xlabel="left  -  y of the robot [m]  -  right",
            ylabel="x of the robot, ahead [m]",
        )
        axes.xaxis.set_major_formatter(lambda value, _: f"{-value or 0.0:g}")
        axes.grid(color="#e6e6ea", lw=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.set_title(
            f"scan from above; dashed: farthest range used, {scan.max_range:.1f} m; white: unseen",
            **TITLE,
        )
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9, ncols=2)


def belonging(frame: StereoFrame, ranger: StereoRanger) -> np.ndarray:
    """Pixels (H, W) of the left image whose disparity and bearing are those of a range."""
    camera, settings = ranger.camera, ranger.settings
    d = frame.disparity / SUBPIXEL
    v, u = np.indices(d.shape)
    rays = np.stack([(u - camera.cx) / camera.f, (v - camera.cy) / camera.f_rows, np.ones(d.shape)])
    with np.errstate(divide="ignore"):
        depth = np.where(d > 0, camera.depth_factor / d, np.nan)
    x, y, z = np.tensordot(camera.rotation, rays, axes=1) * depth
    aside = np.tan(np.arctan2(y, x) - camera.yaw)
    column = np.rint(camera.cx - camera.f * aside)
    inside = (column >= 0) & (column < camera.width)
    ranges = frame.scan.range[::-1][np.where(inside, column, 0).astype(int)]
    height = camera.position[2] + z
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = camera.depth_factor * np.hypot(1.0, aside)
        off = np.abs(factor / np.hypot(x, y) - factor / ranges)
        in_band = (height >= settings.height_min) & (height <= settings.height_max)
    return inside & np.isfinite(ranges) & in_band & (off < BELONGS)


def in_words(scan: RangeScan, truth: np.ndarray | None) -> str:
    """What the columns of a scan say, and how right that is."""
    columns = scan.range.size
    hit, free = np.isfinite(scan.range), np.isposinf(scan.range)
    unknown = columns - int(hit.sum()) - int(free.sum())
    text = (
        f"{columns} columns: {hit.sum()} with an obstacle, {free.sum()} free up to "
        f"{scan.max_range:.1f} m, {unknown} unknown"
    )
    if hit.any():
        text += f"; median sigma {100 * np.median(scan.sigma[hit]):.1f} cm"
    if truth is None:
        return text
    both = hit & ~np.isnan(truth)
    if not both.any():
        return text
    # Where nothing stands every range is wrong: a tenth of infinity would forgive it.
    allowed = np.where(np.isfinite(truth[both]), WRONG * truth[both], 0.0)
    wrong = int(np.sum(np.abs(scan.range[both] - truth[both]) > allowed))
    through = int(np.sum(free & (truth < scan.max_range)))
    text += f"; against the truth: {wrong} ranges wrong by more than {100 * WRONG:.0f} %"
    return text + (f", {through} free in spite of an obstacle" if through else "")


def _fans(eye: np.ndarray, ray: np.ndarray, reach: np.ndarray, mask: np.ndarray) -> list:
    """One polygon for every run of neighbouring directions in `mask`, half a column wider on both
    sides, so that runs touch."""
    columns = np.flatnonzero(mask)
    if not columns.size or len(ray) < 2:
        return []
    fans = []
    for run in np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1):
        first, last = run[0], run[-1]
        half = 0.5 * (ray[min(first + 1, len(ray) - 1)] - ray[max(first - 1, 0)]) / 2.0
        begin, end = (ray[first] - half) * reach[first], (ray[last] + half) * reach[last]
        fans.append(eye + np.vstack([np.zeros(2), begin, ray[run] * reach[run, None], end]))
    return fans
