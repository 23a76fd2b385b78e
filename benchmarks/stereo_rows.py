"""Matching only the rows that can hold obstacles, against matching the whole image."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np

from benchmarks.rendered import PRESETS, cache, missing, rendered
from pipeline.experiments.report import markdown_table
from pipeline.frontend import ahead
from pipeline.recordings.base import Pair, Recording
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan
from stereo.settings import StereoSettings

THREADS = 2
WHOLE = {"height_min": -50.0, "height_max": 50.0}


def main() -> str:
    """Measure; the section as Markdown."""
    title = "## The row band against the whole image: `python -m benchmarks.stereo_rows`"
    folder = cache()
    if folder is None:
        return missing(title)
    cv2.setNumThreads(1)
    rows = [[name, *_row(rendered(folder, preset))] for preset, name in PRESETS.items()]
    header = ["preset", "rows", "all rows", "ranged by both", "differ > 2 sigma", "by one only"]
    return "\n\n".join(
        [
            title,
            markdown_table(header, rows),
            "The same height band of obstacles; only what is matched differs. ranged by both: "
            "share of all columns; of these differ by more than 2 sigma; by one only: share of all "
            "columns that one of the two answers and the other does not, or calls free. Asked for: "
            "at most 0.5 % differ.",
        ]
    )


def _row(recording: Recording) -> list[str]:
    assert recording.rig is not None
    settings = StereoSettings()
    band = StereoRanger(recording.rig, settings)
    whole = StereoRanger(recording.rig, msgspec.structs.replace(settings, **WHOLE))
    rows = whole.camera.height * whole.camera.rows_joined
    whole.settings = settings  # the rows are chosen: from here on the same band of heights

    def work(files: Pair) -> tuple[RangeScan, RangeScan]:
        pair = files.load()
        return band(pair), whole(pair)

    scans = [found for _, found in ahead(recording.pairs, work, THREADS)]
    (a, sigma), (b, _) = (
        [np.concatenate([getattr(pair[n], name) for pair in scans]) for name in ("range", "sigma")]
        for n in (0, 1)
    )
    both = np.isfinite(a) & np.isfinite(b)
    alike = both | (np.isnan(a) & np.isnan(b)) | (np.isinf(a) & np.isinf(b))
    differ = np.abs(a - b)[both] > 2.0 * sigma[both]
    return [
        str(band.camera.height * band.camera.rows_joined),
        str(rows),
        f"{100 * both.mean():.1f} %",
        f"**{100 * differ.mean():.2f} %**",
        f"{100 * np.mean(~alike):.2f} %",
    ]


if __name__ == "__main__":
    print(main())
