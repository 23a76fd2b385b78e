"""The sensor model from data: "we examine many images" (paper Sec. II-C).

Many pairs are ranged and compared with the truth: how often a cell is rightly and wrongly called
occupied, how noisy a right range is, and how many false blocks a frame has, how wide and how far.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from calibration.rig import StereoRig
from pipeline.errors import InputError
from pipeline.frontend import Observation, ahead, observe
from pipeline.image_check import check_images
from pipeline.intervals import Estimate, of_values, ratio, share
from pipeline.recordings.base import RecordedPair, Recording
from pipeline.run import USABLE_CELLS
from pipeline.settings import Settings
from pipeline.stereo_cells import (
    FALSE_HIT,
    HIT,
    TOLD,
    TOLD_FREE,
    count_cells,
    range_bins,
)
from pipeline.stereo_truth import Truth
from pipeline.whole_images import spread
from stereo.error_statistics import (
    Blocks,
    Compared,
    at_edge,
    classify,
    disparity_errors,
    find_blocks,
    half_width,
    in_sigmas,
    relative_errors,
)
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan

TWO_SIGMA = 1.959964
STAMPS = "do the stamps of both agree?"

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class RangeBin:
    """P(O|E) and P(O|notE) of the cells between two ranges [m]."""

    low: float
    high: float
    hit: Estimate
    false_hit: Estimate


@dataclass(frozen=True)
class StereoModel:
    """What was measured, each with its 95 % interval.

    hit, false_hit: P(O|E), P(O|notE). Shares: `unanswered` and `false_free` of the columns whose
    truth is known, `false` of the answered ones, `at_edge` of the false ones. noise: of right
    ranges, relative; disparity_noise, disparity_bias px; within_1, within_2: share of answered
    columns with an obstacle that are off by less than 1 and 1.96 of their own sigma. blocks: a
    frame; block_width and its sd in degrees, block_depth and its sd in metres.
    """

    frames: int
    columns: int
    hit: Estimate
    false_hit: Estimate
    bins: list[RangeBin]
    unanswered: Estimate
    false: Estimate
    at_edge: Estimate
    false_free: Estimate
    noise: Estimate
    disparity_noise: Estimate
    disparity_bias: Estimate
    within_1: Estimate
    within_2: Estimate
    blocks: Estimate
    block_width: Estimate
    block_width_sd: Estimate
    block_depth: Estimate
    block_depth_sd: Estimate


@dataclass(frozen=True)
class Examined:
    """The frames that were compared: their columns, and the counts (n, 4, k) of their cells."""

    compared: Compared
    cells: np.ndarray
    counts: Counter[str] = field(default_factory=Counter)
    skipped: dict[str, list[str]] = field(default_factory=dict)


def examine(
    recording: Recording,
    rig: StereoRig,
    settings: Settings,
    truth: Truth,
    pairs: int,
    threads: int,
    progress: Progress,
) -> Examined:
    """Range at most `pairs` pairs, spread evenly, and hold them against the truth.

    Raises:
        InputError: images and rig do not fit, or no pair has both a scan and a truth.
        StereoError: the rig makes no stereo.
    """
    usable = USABLE_CELLS * settings.mapping.cell
    ranger = StereoRanger(rig, settings.stereo, settings.mapping.max_range, usable_sigma=usable)
    check_images(recording, rig, ranger)
    files = spread(recording.pairs, pairs)
    cell = settings.mapping.cell
    seen: list[tuple[RangeScan, np.ndarray]] = []
    cells: list[np.ndarray] = []
    counts: Counter[str] = Counter()
    skipped: dict[str, list[str]] = {}

    def work(pair: RecordedPair) -> Observation:
        return observe(pair, ranger, key_frame=False)

    for done, (_, found) in enumerate(ahead(files, work, threads), start=1):
        progress(done, len(files))
        if found.scan is None:
            skipped.setdefault(found.kind, []).append(found.damage)
            continue
        true = truth(found.scan)
        if true is None:
            counts["pairs without truth"] += 1
            continue
        cells.append(count_cells(found.scan, true, cell, settings.mapping.spread, len(seen)))
        seen.append((found.scan, true))
    if not seen:
        raise InputError(
            f"{recording.path}: none of {len(files)} pairs has both a scan and a true one: "
            + next((f"{kind}: {names[0]}" for kind, names in skipped.items()), STAMPS)
        )
    return Examined(_compared(seen, ranger, cell), np.array(cells), counts, skipped)


def _compared(
    seen: list[tuple[RangeScan, np.ndarray]], ranger: StereoRanger, cell: float
) -> Compared:
    return Compared(
        bearing=seen[0][0].bearing,
        measured=np.array([scan.range for scan, _ in seen]),
        sigma=np.array([scan.sigma for scan, _ in seen]),
        truth=np.array([truth for _, truth in seen]),
        max_range=seen[0][0].max_range,
        depth_factor=ranger.camera.depth_factor,
        cell=cell,
    )


def model_of(examined: Examined) -> StereoModel:
    """The statistics of what was examined."""
    compared, cells = examined.compared, examined.cells
    classes = classify(compared)
    frames = len(compared.truth)
    known, unanswered, false = (
        np.sum(mask, axis=1) for mask in (classes.known, classes.unanswered, classes.false)
    )
    disparities, sigmas = disparity_errors(compared, classes), in_sigmas(compared)
    total = cells.sum(axis=2)
    return StereoModel(
        frames=frames,
        columns=int(known.sum()),
        hit=share(total[:, HIT], total[:, TOLD]),
        false_hit=share(total[:, FALSE_HIT], total[:, TOLD_FREE]),
        bins=_bins(cells, range_bins(compared.max_range)),
        unanswered=share(unanswered, known),
        false=share(false, known - unanswered),
        at_edge=share(at_edge(compared, classes).sum(axis=1), false),
        false_free=share(classes.false_free.sum(axis=1), known),
        noise=of_values(relative_errors(compared, classes), half_width),
        disparity_noise=of_values(disparities, half_width),
        disparity_bias=of_values(disparities, _median),
        within_1=_within(sigmas, 1.0),
        within_2=_within(sigmas, TWO_SIGMA),
        **_blocks(find_blocks(compared, classes), frames),
    )


def _bins(cells: np.ndarray, edges: np.ndarray) -> list[RangeBin]:
    return [
        RangeBin(
            float(edges[k]),
            float(edges[k + 1]),
            share(cells[:, HIT, k], cells[:, TOLD, k]),
            share(cells[:, FALSE_HIT, k], cells[:, TOLD_FREE, k]),
        )
        for k in range(len(edges) - 1)
    ]


def _within(sigmas: list[np.ndarray], limit: float) -> Estimate:
    inside = np.array([np.sum(values < limit) for values in sigmas])
    return share(inside, np.array([len(values) for values in sigmas]))


def _blocks(blocks: Blocks, frames: int) -> dict[str, Estimate]:
    widths, depths = (
        [values[blocks.frame == frame] for frame in range(frames)]
        for values in (np.degrees(blocks.width), blocks.range)
    )
    return {
        "blocks": ratio(np.bincount(blocks.frame, minlength=frames), np.ones(frames)),
        "block_width": of_values(widths, _mean),
        "block_width_sd": of_values(widths, _sd),
        "block_depth": of_values(depths, _mean),
        "block_depth_sd": of_values(depths, _sd),
    }


def _median(values: np.ndarray) -> float:
    return float(np.median(values))


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values))


def _sd(values: np.ndarray) -> float:
    return float(np.std(values))
