"""The sensor model measured on the rendered presets, beside the paper's."""

from __future__ import annotations

import cv2

from benchmarks.rendered import PRESETS, cache, missing, rendered
from pipeline.experiments.report import markdown_table
from pipeline.intervals import Estimate
from pipeline.settings import Settings
from pipeline.stereo_model import StereoModel, examine, model_of
from pipeline.stereo_truth import truth_of

THREADS = 2
PAIRS = 1000
HEADER = (
    "preset",
    "P(O\\|E) [%]",
    "P(O\\|notE) [%]",
    "depth noise [%]",
    "disparity noise [px]",
    "unanswered [%]",
    "false free [%]",
    "false blocks a frame",
    "width [deg]",
    "range of blocks [m]",
)


def main() -> str:
    """Measure; the section as Markdown."""
    title = "## The sensor model: `python -m benchmarks.stereo_model`"
    folder = cache()
    if folder is None:
        return missing(title)
    cv2.setNumThreads(1)
    rows = [["paper", "54", "10", "2", "-", "-", "-", "1", "eq (11), mean 5 to 10", "4.886, 1.773"]]
    bins = []
    for preset, name in PRESETS.items():
        recording = rendered(folder, preset)
        assert recording.rig is not None
        truth, _ = truth_of(recording, None)
        examined = examine(
            recording, recording.rig, Settings(), truth, PAIRS, THREADS, lambda done, total: None
        )
        model = model_of(examined)
        rows.append([f"{name} ({model.frames} pairs)", *_row(model)])
        bins += [
            [name, f"{b.low:.0f} to {b.high:.0f} m", _percent(b.hit), _percent(b.false_hit)]
            for b in model.bins
        ]
    return "\n\n".join(
        [
            title,
            "As `beemap stereo model` counts, default settings, all columns; 95 % intervals from "
            "drawing whole frames anew. Blocks: mean, standard deviation.",
            markdown_table(HEADER, rows),
            "By range of the cell:",
            markdown_table(["preset", "range", "P(O\\|E) [%]", "P(O\\|notE) [%]"], bins),
        ]
    )


def _row(model: StereoModel) -> list[str]:
    return [
        _percent(model.hit),
        _percent(model.false_hit),
        _percent(model.noise),
        _number(model.disparity_noise, 3),
        _percent(model.unanswered),
        _percent(model.false_free),
        _number(model.blocks, 2),
        f"{model.block_width.value:.2f}, {model.block_width_sd.value:.2f}",
        f"{model.block_depth.value:.2f}, {model.block_depth_sd.value:.2f}",
    ]


def _percent(estimate: Estimate) -> str:
    return _number(Estimate(*(100 * v for v in vars(estimate).values())), 1)


def _number(estimate: Estimate, digits: int) -> str:
    if estimate.value != estimate.value:
        return "-"
    return f"{estimate.value:.{digits}f} ({estimate.low:.{digits}f} to {estimate.high:.{digits}f})"


if __name__ == "__main__":
    print(main())
