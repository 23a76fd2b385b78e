"""Time of a pair through the stereo stage beside OpenCV's bare matcher on the same rows.

Both work on the same pair in turn, so that what else the machine does disturbs both alike; the
ratios are of medians. Bare: StereoSGBM's 3WAY on the image rows that the stage uses, rectified
before, with left-right check, uniqueness and speckle filter; where the stage joins rows, also on
the joined ones. The stage: rectify, disparity, columns.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from statistics import median

import cv2
import msgspec
import numpy as np

from benchmarks.report import OFFICE
from calibration.rig import StereoRig
from pipeline.experiments.report import machine, markdown_table
from pipeline.recordings import open_recording
from stereo.pair import StereoPair
from stereo.ranger import StereoRanger
from stereo.settings import StereoSettings

DISPARITIES = 64
ROUNDS = 60
PAIRS_AT_ONCE = 16
ROUNDS_AT_ONCE = 7
HEADER = (
    "",
    "rows",
    "bare 3WAY [ms]",
    "bare, rows joined",
    "stage",
    "ratio",
    "ratio, rows joined",
    "rectify",
    "match",
    "columns",
)
# A row band and the whole image.
BANDS = {"rows that can hold obstacles": (0.10, 1.20), "all rows": (-50.0, 50.0)}


def main() -> str:
    """Measure; the section as Markdown."""
    cv2.setNumThreads(1)
    rig, pair = doubled_office()
    parts = [
        "## Time of a pair: `python -m benchmarks.stereo_time`",
        f"{machine()}. 640x480, {DISPARITIES} disparities; medians of {ROUNDS} rounds.",
    ]
    rows = []
    for name, heights in BANDS.items():
        settings = StereoSettings(
            disparities=DISPARITIES, height_min=heights[0], height_max=heights[1]
        )
        rows.append(_row(name, rig, settings, pair))
    one, two = _in_threads(StereoRanger(rig, StereoSettings(disparities=DISPARITIES)), pair)
    return "\n\n".join(
        [
            *parts,
            markdown_table(HEADER, rows),
            "One core. Asked for: a ratio of at most 1.1.",
            f"{PAIRS_AT_ONCE} pairs take {1e3 * one:.0f} ms in one thread and {1e3 * two:.0f} ms "
            f"in two: **{one / two:.2f} times** as fast. Asked for: 1.7 times.",
        ]
    )


def doubled_office() -> tuple[StereoRig, StereoPair]:
    """A pair of the shipped recording, drawn twice as large: 640x480."""
    recording = open_recording(OFFICE)
    assert recording.rig is not None
    pair = recording.pairs[len(recording.pairs) // 2].load()
    left, right = (
        cv2.resize(image, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC)
        for image in (pair.left, pair.right)
    )
    return recording.rig.scaled(2.0), StereoPair(pair.stamp, left, right)


def _row(name: str, rig: StereoRig, settings: StereoSettings, pair: StereoPair) -> list[str]:
    ranger = StereoRanger(rig, settings)
    apart = StereoRanger(rig, msgspec.structs.replace(settings, rows_joined=1))
    left, right = ranger.rectify(pair.left, pair.right)
    all_rows = apart.rectify(pair.left, pair.right)
    bare = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=DISPARITIES,
        blockSize=settings.block,
        P1=8 * settings.block**2,
        P2=32 * settings.block**2,
        disp12MaxDiff=1,
        uniquenessRatio=settings.uniqueness,
        speckleWindowSize=settings.speckle,
        speckleRange=1,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    work: dict[str, Callable[[], object]] = {
        "bare": lambda: bare.compute(*all_rows),
        "joined": lambda: bare.compute(left, right),
        "stage": lambda: ranger(pair),
        "rectify": lambda: ranger.rectify(pair.left, pair.right),
        "match": lambda: ranger.match(left, right),
    }
    seconds: dict[str, list[float]] = {key: [] for key in work}
    for turn in range(ROUNDS + 1):
        for key, do in work.items():
            taken = _seconds(do)
            if turn:  # the first one compiles and fills caches
                seconds[key].append(taken)
    ms = {key: 1e3 * median(values) for key, values in seconds.items()}
    columns = ms["stage"] - ms["rectify"] - ms["match"]
    return [
        name,
        str(len(all_rows[0])),
        f"{ms['bare']:.1f}",
        f"{ms['joined']:.1f}",
        f"{ms['stage']:.1f}",
        f"**{median(np.divide(seconds['stage'], seconds['bare'])):.2f}**",
        f"{median(np.divide(seconds['stage'], seconds['joined'])):.2f}",
        *(f"{value:.1f}" for value in (ms["rectify"], ms["match"], columns)),
    ]


def _in_threads(ranger: StereoRanger, pair: StereoPair) -> tuple[float, float]:
    """Seconds for PAIRS_AT_ONCE pairs in one thread and in two, in turn; medians."""
    taken: dict[int, list[float]] = {1: [], 2: []}
    pools = {threads: ThreadPoolExecutor(threads) for threads in taken}
    for turn in range(ROUNDS_AT_ONCE + 1):
        for threads, pool in pools.items():
            seconds = _seconds(lambda p=pool: list(p.map(ranger, [pair] * PAIRS_AT_ONCE)))
            if turn:
                taken[threads].append(seconds)
    for pool in pools.values():
        pool.shutdown()
    return median(taken[1]), median(taken[2])


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


if __name__ == "__main__":
    print(main())
