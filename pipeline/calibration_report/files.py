"""The names of a report's files, known before anything heavy is loaded."""

from __future__ import annotations

from pathlib import Path

PAGE = "report.html"
FIGURES = ("coverage", "residuals", "pairs", "attitudes", "depth", "rectified")


def report_files(folder: Path) -> list[Path]:
    """All files of a report, the page first."""
    return [folder / PAGE, *(folder / f"{name}.png" for name in FIGURES)]
