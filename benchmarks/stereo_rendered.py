"""Scans of the rendered presets against the true range vectors."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.rendered import PRESETS, cache, inside_other_image, missing, rendered, truth
from pipeline.experiments.report import markdown_table
from pipeline.frontend import ahead
from pipeline.recordings.base import Pair, Recording
from pipeline.run import USABLE_CELLS
from pipeline.settings import Settings
from simulation.true_scans import TrueScans
from stereo.error_statistics import Compared, classify
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan
from stereo.settings import StereoSettings

THREADS = 2
NEAR = 5.0  # m
TEXTURED = 2.0  # grey levels per pixel, root mean square
WRONG = 0.10
HEADER = (
    "preset",
    "columns by",
    "pairs",
    "textured, near",
    "answered",
    "wrong > 10 %",
    "median error",
    "false free",
    "blank: unknown",
    "blank: wrong",
    "68 %",
    "95 %",
)


@dataclass(frozen=True)
class Scans:
    """Measured and true ranges with the texture (n, b) of every pair; fair: columns that count."""

    compared: Compared
    texture: np.ndarray
    fair: np.ndarray


def measure(recording: Recording, scans: TrueScans, settings: StereoSettings) -> Scans:
    """Range every pair of a rendered recording."""
    assert recording.rig is not None
    cell = Settings().mapping.cell
    ranger = StereoRanger(recording.rig, settings, usable_sigma=USABLE_CELLS * cell)

    def work(files: Pair) -> RangeScan:
        return ranger(files.load())

    found = [scan for _, scan in ahead(recording.pairs, work, THREADS)]
    row = {stamp: n for n, stamp in enumerate(scans.stamp.tolist())}
    order = [row[scan.stamp] for scan in found]
    camera, ranges = ranger.camera, scans.range[order].astype(float)
    compared = Compared(
        bearing=scans.bearing,
        measured=np.array([scan.range for scan in found]),
        sigma=np.array([scan.sigma for scan in found]),
        truth=ranges,
        max_range=ranger.max_range,
        depth_factor=camera.depth_factor,
        cell=cell,
    )
    fair = inside_other_image(ranges, scans.bearing, camera.f, camera.cx, camera.baseline)
    return Scans(compared, scans.texture[order], fair)


def main() -> str:
    """Measure; the section as Markdown."""
    title = "## Scans of rendered rooms: `python -m benchmarks.stereo_rendered`"
    folder = cache()
    if folder is None:
        return missing(title)
    cv2.setNumThreads(1)
    rows = []
    for preset, name in PRESETS.items():
        recording = rendered(folder, preset)
        scans = truth(recording)
        for by, settings in (
            ("**defaults**", StereoSettings()),
            ("plain nearest", StereoSettings(support=1)),
        ):
            rows.append([name, by, *table_row(measure(recording, scans, settings))])
    return "\n\n".join([title, markdown_table(HEADER, rows), LEGEND])


def table_row(scans: Scans) -> list[str]:
    """The numbers of one preset."""
    c, fair = scans.compared, scans.fair & ~np.isnan(scans.compared.truth)
    standing = fair & np.isfinite(c.truth)
    near = standing & (c.truth <= min(NEAR, c.max_range))
    textured = near & (scans.texture >= TEXTURED)
    blank = near & (scans.texture < TEXTURED)
    answered = ~np.isnan(c.measured)
    with np.errstate(invalid="ignore"):
        # "Nothing up to max_range" is wrong by at least what is missing to max_range.
        off = np.abs(np.minimum(c.measured, c.max_range) - c.truth) / c.truth
    classes = classify(c)
    ranged = standing & np.isfinite(c.measured)
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = np.abs(c.measured - c.truth)[ranged] / c.sigma[ranged]
    return [
        str(len(c.truth)),
        _percent(textured, fair, 0),
        _percent(textured & answered, textured, 1),
        f"**{_percent(textured & answered & (off > WRONG), textured & answered, 2)}**",
        f"{100 * np.median(off[textured & np.isfinite(c.measured)]):.2f} %",
        _percent(fair & classes.false_free, fair, 2),
        _percent(blank & ~answered, blank, 0),
        _percent(blank & answered & (off > WRONG), blank & answered, 1),
        f"{100 * np.mean(scaled < 1.0):.0f} %",
        f"{100 * np.mean(scaled < 1.96):.0f} %",
    ]


def _percent(part: np.ndarray, whole: np.ndarray, digits: int) -> str:
    return f"{100 * part.sum() / whole.sum():.{digits}f} %" if whole.any() else "-"


LEGEND = (
    "Columns count whose true nearest surface has its match inside the right image. textured, "
    f"near: share of these with an obstacle within {NEAR:g} m (or the farthest range used, if "
    f"less) whose image has a gradient of at least {TEXTURED:g} grey levels a pixel (RMS). Of "
    "these: answered, and of the answered ones wrong by more than 10 % (free up to the farthest "
    "range counts as that range), median error. false free: columns of any kind said to be free "
    "beyond their true obstacle by more than 10 %, 3 sigma and two cells. blank: the near columns "
    "with less gradient: unknown, and of the answered ones wrong. 68 %, 95 %: share of all ranges "
    "within 1 and 1.96 of their "
    "own sigma. Asked for: office at most 1 % wrong, at least 95 % answered, median at most 1.5 %; "
    "corridor and glass at most 4 % wrong; false free at most 1 %; 60 to 76 % and 90 to 98 %."
)


if __name__ == "__main__":
    print(main())
