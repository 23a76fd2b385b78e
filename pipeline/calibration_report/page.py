"""report.html: one file that holds the whole report, and its figures as PNG files beside it."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib

from calibration.calibrate import CalibrationResult
from calibration.verdict import LIMITS, MEANING
from pipeline.calibration_report import figures
from pipeline.calibration_report.files import PAGE, report_files
from pipeline.calibration_report.rectified import pairs_to_show, rectified_picture
from pipeline.calibration_report.tables import PAIR_COLUMNS, facts, pair_rows
from pipeline.new_files import new_files
from pipeline.pages.render import jpeg_uri, render

PNG_DPI = 150

# name -> how it is drawn, its title, and what to see in it.
DRAWN = {
    "coverage": (
        figures.coverage_figure,
        "Where the boards stood",
        "A lens is known only where boards were: blank parts, above all in the corners, are "
        "guesses. Dots are the corners found.",
    ),
    "residuals": (
        figures.residual_figure,
        "What the lens model leaves over",
        "Mean distance of the corners found from where the rig puts them, much magnified. Arrows "
        "in all directions are noise; arrows that swirl or run outwards together are a lens that "
        "the model does not describe, or a board that is not flat.",
    ),
    "pairs": (
        figures.pairs_figure,
        "Pair by pair",
        "Row errors are held out: from a rig that was solved without that pair. A bar far longer "
        "than the others is a pair to drop.",
    ),
    "attitudes": (
        figures.attitudes_figure,
        "How the boards were tilted",
        "Good sets have dots on all sides, outside the grey bands, and at different distances.",
    ),
    "depth": (
        figures.depth_figure,
        "What it means for depth",
        "Matching errs anew in every frame; the calibration's doubt is the same error for good.",
    ),
}


def write_report(
    result: CalibrationResult, unmatched: Sequence[Path], rig_file: Path, folder: Path
) -> Path:
    """Write the page and the PNGs into a folder; all of them or none. Returns the page.

    Files of an earlier report there are replaced: `check_free` is the caller's.

    Raises:
        InputError: they cannot be written.
    """
    with (
        new_files(report_files(folder), force=True) as partial,
        matplotlib.rc_context(figures.STYLE),
    ):
        drawn = [_figure(name, result, partial) for name in DRAWN]
        picture = rectified_picture(result)
        _encode_to(picture, partial / "rectified.png")
        page = _page(result, unmatched, rig_file, drawn, jpeg_uri(picture))
        (partial / PAGE).write_text(page, encoding="utf-8")
    return folder / PAGE


def _page(
    result: CalibrationResult,
    unmatched: Sequence[Path],
    rig_file: Path,
    drawn: list[dict[str, str]],
    rectified: str,
) -> str:
    verdict = result.judgement.verdict
    shown = ", ".join(view.name for view in pairs_to_show(result))
    return render(
        "pipeline.calibration_report",
        "report.html.j2",
        verdict=verdict,
        meaning=MEANING[verdict],
        heldout=f"{result.heldout.row_rms:.3f}",
        limits=LIMITS,
        advice=result.advice,
        facts=facts(result),
        figures=drawn,
        rectified=rectified,
        shown=shown,
        columns=PAIR_COLUMNS,
        pairs=list(zip(pair_rows(result), [result.used(v) for v in result.views], strict=True)),
        unmatched=[str(path) for path in unmatched],
        rig_file=rig_file.name,
        sigma=list(result.solution.sigma.items()),
        values=_values(result),
        date=result.rig.sections["calibration"]["date"],
        board=f"{result.board.name}, {result.board.square * 1e3:g} mm",
        size="{} x {}".format(*result.rig.image_size),
    )


def _figure(name: str, result: CalibrationResult, folder: Path) -> dict[str, str]:
    """Draw a figure into a PNG file, and as SVG for the page."""
    draw, title, meaning = DRAWN[name]
    figure, text = draw(result), io.StringIO()
    file = folder / f"{name}.png"
    figure.savefig(file, dpi=PNG_DPI, facecolor="white", metadata={"Software": None})
    # The layout found for the one holds for the other.
    figure.set_layout_engine("none")
    figure.savefig(text, format="svg", metadata={"Date": None})
    svg = _for_page(text.getvalue(), name)
    return {"name": name, "title": title, "meaning": meaning, "svg": svg}


def _for_page(svg: str, name: str) -> str:
    """The SVG element alone, scalable, in the page's ink; names in it made its own."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'<svg ([^>]*?)height="[^"]*" ([^>]*?)width="[^"]*"', r"<svg \1\2", svg, count=1)
    svg = re.sub(r"<svg ([^>]*?)width=\"[^\"]*\" height=\"[^\"]*\"", r"<svg \1", svg, count=1)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.S)
    for colour, variable in ((figures.INK, "var(--ink)"), (figures.FAINT, "var(--faint)")):
        svg = svg.replace(colour, variable)
    svg = re.sub(r'id="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', svg)
    return re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", svg)


def _values(result: CalibrationResult) -> dict[str, float]:
    """The rig's parameters under the names that the solution gives them; no rotation, which is
    told by its matrix."""
    from calibration.lens import LENSES

    lens, rig = LENSES[result.solution.lens], result.rig
    values = {
        f"{side}.{name}": float(value)
        for side, camera in (("left", rig.left), ("right", rig.right))
        for name, value in zip(lens.names, lens.intrinsics(camera), strict=True)
    }
    values.update({f"translation.{axis}": float(v) for axis, v in zip("xyz", rig.T, strict=True)})
    return values


def _encode_to(picture, file: Path) -> None:
    _, data = cv2.imencode(".png", picture)
    file.write_bytes(data.tobytes())
