"""A calibration as JSON: what a program reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration.calibrate import CalibrationResult, View, remarks
from calibration.coverage import Coverage


def as_json(result: CalibrationResult, unmatched: Sequence[Path]) -> dict[str, Any]:
    """Everything that was found out, in SI units and pixels; numbers unknown are None."""
    judged, solution = result.judgement, result.solution
    timing, ruler = judged.timing, judged.ruler
    return _plain(
        {
            "verdict": judged.verdict,
            "next_action": result.advice[0],
            "hints": result.advice[1:],
            "stereo_rms_px": solution.rms,
            "stereo_rms_kept_px": solution.rms_kept,
            "heldout_row_rms_px": result.heldout.row_rms,
            "baseline_m": result.rig.baseline,
            "pairs_used": result.pairs_used,
            "pairs_given": len(result.views),
            "corners": solution.corners,
            "corners_rejected": solution.rejected,
            "lens": solution.lens,
            "lens_trials": [
                {
                    "lens": trial.lens,
                    "stereo_rms_px": trial.rms,
                    "heldout_row_rms_px": trial.row_rms,
                    "chosen": trial.chosen,
                    "remark": trial.remark,
                }
                for trial in result.trials
            ],
            "sigma": solution.sigma,
            "depth": [
                {"distance_m": z, "sigma_m": s, "from_matching_m": m, "from_calibration_m": c}
                for z, s, m, c in zip(
                    judged.depth.distances,
                    judged.depth.total,
                    judged.depth.from_matching,
                    judged.depth.from_calibration,
                    strict=True,
                )
            ],
            "usable_range_m": judged.depth.usable_range,
            "coverage": {
                side: _coverage(cover)
                for side, cover in zip(("left", "right"), judged.coverage, strict=True)
            },
            "tilts_deg": np.degrees(judged.attitudes.tilts),
            "distances_m": judged.attitudes.distances,
            "squares": {"ratio": judged.squares.ratio, "scatter": judged.squares.scatter},
            "ruler": ruler
            and {
                "baseline_m": ruler.ruler,
                "excess": ruler.excess,
                "agrees": ruler.agrees,
                "square_m": ruler.square,
            },
            "timing": {
                "unsynchronised": timing.unsynchronised,
                "pairs_moved": timing.moved,
                "usual_offset_px": timing.usual,
                "delay_s": timing.delay,
                "delay_sigma_s": timing.delay_sigma,
            },
            "pairs": [_pair(result, view) for view in result.views],
            "unmatched": [str(path) for path in unmatched],
        }
    )


def _coverage(cover: Coverage) -> dict[str, Any]:
    return {
        "share": cover.share,
        "regions": cover.regions,
        "corners": cover.corners,
        "boards": cover.boards,
    }


def _pair(result: CalibrationResult, view: View) -> dict[str, Any]:
    numbers: dict[str, Any] = dict.fromkeys(
        ("left_rms_px", "right_rms_px", "heldout_row_rms_px", "corners_rejected")
    )
    if view.number is not None:
        left, right = result.solution.view_rms[view.number]
        kept = result.solution.kept[view.number]
        numbers = {
            "left_rms_px": left,
            "right_rms_px": right,
            "heldout_row_rms_px": result.heldout.view_rms[view.number],
            "corners_rejected": sum(int(np.count_nonzero(~k)) for k in kept),
        }
    return {
        "name": view.name,
        "left": str(view.left.path),
        "right": str(view.right.path),
        "used": result.used(view),
        "reason": view.reason,
        "fault": view.fault,
        "remarks": remarks(result, view),
        "renumbered": view.renumbered,
        **numbers,
    }


def _plain(value: Any) -> Any:
    """Plain Python values all the way down; NaN and infinity are None."""
    if isinstance(value, dict):
        return {key: _plain(v) for key, v in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
