"""Columns on a real picture: ranges from the motorcycle against those of its true disparity.

Middlebury's cameras of 2014 have different centres: Z = f B / (d + doffs), and a rectified rig
here has none. Both images are therefore widened by the whole part of doffs, the left one on its
left side, the right one on its right side: every disparity grows by it and nothing is lost. The
rest, 0.086 px, is added where the measured range becomes a depth, so that both depths are metric.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from benchmarks.stereo_pictures import Picture, motorcycle, opencv_matcher, real_data
from pipeline.experiments.report import markdown_table
from stereo.disparity import SUBPIXEL
from stereo.pair import StereoPair

DOFFS = 31.086
SHIFT = int(DOFFS)
# The nearest surface of a column is that of its 8th-largest true disparity: so many pixels show it.
SHOWN_BY = 8
HEADER = ("columns by", "answered", "off > 5 %", "off > 10 %", "median error", "68 %", "95 %")


@dataclass(frozen=True)
class Columns:
    """Depth (W,) m of the nearest surface in each column and its sigma (W,) m; NaN: no answer."""

    depth: np.ndarray
    sigma: np.ndarray


def widened(picture: Picture) -> Picture:
    """The picture with every disparity larger by SHIFT."""

    def pad(image: np.ndarray, left: int, right: int) -> np.ndarray:
        return cv2.copyMakeBorder(image, 0, 0, left, right, cv2.BORDER_REPLICATE)

    unknown = np.full((len(picture.truth), SHIFT), np.nan)
    assert picture.centre is not None
    return replace(
        picture,
        left=pad(picture.left, SHIFT, 0),
        right=pad(picture.right, 0, SHIFT),
        truth=np.hstack([unknown, picture.truth + SHIFT]),
        centre=(picture.centre[0] + SHIFT, picture.centre[1]),
    )


def nearest(disparity: np.ndarray, rank: int) -> np.ndarray:
    """The rank-th largest disparity (W,) of each column of (H, W) px; NaN where fewer are known."""
    ordered = np.sort(np.where(disparity > 0, disparity, -np.inf), axis=0)[-rank]
    return np.where(ordered > 0, ordered, np.nan)


def metric(picture: Picture, disparity: np.ndarray) -> np.ndarray:
    """Depth [m] of a disparity of the widened pair [px]."""
    return picture.f * picture.baseline / (disparity + DOFFS - SHIFT)


def true_depth(picture: Picture) -> np.ndarray:
    """Depth (W,) m of the nearest surface; NaN for columns that the right image does not hold."""
    return metric(picture, nearest(np.where(picture.inside, picture.truth, 0.0), SHOWN_BY))


def by_stage(picture: Picture, **settings: object) -> Columns:
    """The stereo stage's scan as depths, one a column of the image."""
    scan = picture.ranger(**settings)(StereoPair(0, picture.left, picture.right))
    cosine = np.cos(scan.bearing)
    depth = np.where(np.isfinite(scan.range), scan.range * cosine, np.nan)
    depth = metric(picture, picture.f * picture.baseline / depth)
    return Columns(depth[::-1], (scan.sigma * cosine)[::-1])


def by_rank(picture: Picture) -> Columns:
    """OpenCV's 3WAY as it is, and the 8th-largest disparity of each column."""
    matcher = opencv_matcher("3WAY", picture.disparities)
    disparity = matcher.compute(picture.left, picture.right).astype(float) / SUBPIXEL
    depth = metric(picture, nearest(disparity, SHOWN_BY))
    return Columns(depth, np.full(depth.shape, np.nan))


def main() -> str:
    """Measure; the section as Markdown."""
    title = "## Columns on a real picture: `python -m benchmarks.stereo_columns`"
    folder = real_data()
    if folder is None:
        return f"{title}\n\nBEEMAP_REAL_DATA is not set: the motorcycle was not measured."
    picture = widened(motorcycle(folder))
    truth = true_depth(picture)
    rows = [
        _row("OpenCV 3WAY, 8th-largest disparity", by_rank(picture), truth),
        _row("beemap, plain nearest (stereo.support=1)", by_stage(picture, support=1), truth),
        _row("**beemap**", by_stage(picture), truth),
    ]
    return "\n\n".join(
        [
            title,
            markdown_table(HEADER, rows),
            f"{np.sum(~np.isnan(truth))} of {picture.truth.shape[1] - SHIFT} columns count: their "
            "nearest surface's match lies inside the right image. That surface is the depth of "
            f"the {SHOWN_BY}th-largest true disparity, Z = f B / (d + doffs), all rows, no height "
            "band. off: share of the answered columns. 68 %, 95 %: share of the answered columns "
            "within 1 and 1.96 of their own sigma. Asked for: at least 92 % answered, at most "
            "1.5 % off by more than 5 %.",
        ]
    )


def _row(name: str, found: Columns, truth: np.ndarray) -> list[str]:
    counted = ~np.isnan(truth)
    answered = counted & ~np.isnan(found.depth)
    off = np.abs(found.depth - truth)[answered]
    share = off / truth[answered]
    sigma = found.sigma[answered]
    honest = [
        "-" if np.isnan(sigma).all() else f"{100 * np.mean(off < width * sigma):.0f} %"
        for width in (1.0, 1.96)
    ]
    return [
        name,
        f"{100 * answered.sum() / counted.sum():.1f} %",
        f"{100 * np.mean(share > 0.05):.1f} %",
        f"{100 * np.mean(share > 0.10):.1f} %",
        f"{100 * np.median(share):.2f} %",
        *honest,
    ]


if __name__ == "__main__":
    print(main())
