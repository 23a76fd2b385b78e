"""The numbers of a calibration as people read them: millimetres, degrees, a few digits."""

from __future__ import annotations

import math

from calibration.calibrate import CalibrationResult, remarks
from calibration.field_of_view import field_of_view

PAIR_COLUMNS = ("pair", "rows px", "left px", "right px", "remark")


def pair_rows(result: CalibrationResult) -> list[list[str]]:
    """A row of `PAIR_COLUMNS` for every pair given."""
    rows = []
    for view in result.views:
        numbers = ["-", "-", "-"]
        if view.number is not None:
            left, right = result.solution.view_rms[view.number]
            errors = (result.heldout.view_rms[view.number], left, right)
            numbers = ["-" if math.isnan(error) else f"{error:.3f}" for error in errors]
        said = "; ".join(remarks(result, view))
        rows.append([view.name, *numbers, said])
    return rows


def facts(result: CalibrationResult) -> list[tuple[str, str]]:
    """What was found out, line by line: a name and its value."""
    solution, judged, rig = result.solution, result.judgement, result.rig
    lines = [
        ("pairs used", f"{result.pairs_used} of {len(result.views)}"),
        ("held-out rows", f"{result.heldout.row_rms:.3f} px RMS"),
        (
            "stereo RMS",
            f"{solution.rms:.3f} px over all {solution.corners} corners, {solution.rms_kept:.3f} "
            f"over those kept ({solution.rejected} rejected)",
        ),
        ("lens", _lens(result)),
        ("baseline", _baseline(result)),
        (
            "squares",
            f"reconstructed to {judged.squares.ratio:.2%} of {result.board.square * 1e3:g} mm, "
            f"each within {judged.squares.scatter:.1%}",
        ),
    ]
    for name, camera in (("left", rig.left), ("right", rig.right)):
        across, down = (_degrees(angle) for angle in field_of_view(camera, rig.image_size))
        doubt = solution.sigma[f"{name}.fx"]
        lines.append(
            (
                f"{name} camera",
                f"focal length {camera.fx:.1f} x {camera.fy:.1f} px (± {doubt:.1f}), "
                f"field of view {across} x {down} deg",
            )
        )
    left, right = judged.coverage
    stood = judged.attitudes.distances
    lines += [
        ("covered", f"{left.share:.0%} of the left image, {right.share:.0%} of the right"),
        ("boards", f"{stood.min():.2g} to {stood.max():.2g} m away; nearer edge: {_tilts(result)}"),
        ("depth error", ", ".join(f"{s} at {z}" for z, s in depth_rows(result))),
        (
            "usable range",
            f"{judged.depth.usable_range:.1f} m, where depth is off by "
            f"{judged.depth.tolerance * 100:.0f} cm",
        ),
    ]
    return lines


def depth_rows(result: CalibrationResult) -> list[tuple[str, str]]:
    """(distance, standard deviation of depth) as people read them."""
    depth = result.judgement.depth
    return [(f"{z:g} m", _length(s)) for z, s in zip(depth.distances, depth.total, strict=True)]


def _degrees(angle: float | None) -> str:
    return "?" if angle is None else f"{math.degrees(angle):.1f}"


def _length(metres: float) -> str:
    if math.isnan(metres):
        return "-"
    if metres < 0.1:
        return f"{metres * 1e3:.2g} mm"
    return f"{metres * 1e2:.0f} cm" if metres < 0.995 else f"{metres:.1f} m"


def _lens(result: CalibrationResult) -> str:
    others = []
    for trial in result.trials:
        if not trial.chosen:
            rows = "no fit" if trial.row_rms is None else f"{trial.row_rms:.3f} px"
            remark = f" ({trial.remark.partition(':')[0]})" if trial.row_rms is not None else ""
            others.append(f"{trial.lens} {rows}{remark}")
    if not others:
        return result.solution.lens
    return f"{result.solution.lens}; held-out rows with others: {', '.join(others)}"


def _baseline(result: CalibrationResult) -> str:
    ruler, rig = result.judgement.ruler, result.rig
    sigma = {axis: result.solution.sigma[f"translation.{axis}"] for axis in "xyz"}
    text = f"{rig.baseline * 1e3:.2f} mm (± {sigma['x'] * 1e3:.2f})"
    if ruler is None:
        return f"{text}; check it with a ruler: --baseline"
    agrees = "agrees with" if ruler.agrees else "disagrees with"
    return f"{text}, {agrees} the ruler's {ruler.ruler * 1e3:.1f} mm ({ruler.excess:+.1%})"


def _tilts(result: CalibrationResult) -> str:
    tilted = result.judgement.attitudes.tilted
    return ", ".join(f"{side} {count}x" for side, count in tilted.items())
