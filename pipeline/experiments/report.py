"""table.md: what an experiment found, with the command line that made it."""

from __future__ import annotations

import math
import os
import platform
import shlex
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from pipeline.experiments.batch import Run
from pipeline.experiments.summary import lost, of
from pipeline.new_files import new_files

LIBRARIES = (
    ("OpenCV", "opencv-contrib-python-headless"),
    ("numpy", "numpy"),
    ("numba", "numba"),
)
HEADER = (
    "settings",
    "runs",
    "ATE mean [m]",
    "median",
    "worst",
    "lost (95 %)",
    "E",
    "E cut (decided)",
    "E own",
    "F1",
    "CPU [s]",
    "maps [MB]",
)

LEGEND = (
    "ATE: RMSE over all positions after SE(2) alignment, against the true path; lost: ATE > 1 m, "
    "with the 95 % Wilson interval of the rate. Medians over the runs: E: dissimilarity (eq (9)) "
    "to the common ideal, the floor plan where perfect sensors on the true path see it; E cut: "
    "both maps cut at .7 / .2 to 1, 0 and unknown, the share of known cells that are decided in "
    "brackets; E own: to the map that the same mapper makes with perfect sensors and poses; F1: "
    "of obstacle cells within one cell. Unknown cells cost nothing in E: read all columns "
    "together. CPU: of mapping one run, without the simulation; maps: most memory of all "
    "particles' maps."
)


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The first column is text, the others are numbers."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(row) + " |" for row in (header, rule, *rows))


def summary_row(name: str, runs: Sequence[Run]) -> list[str]:
    """One line of the table with `HEADER`."""
    ate, (number, low, high) = of(runs, "ate"), lost(runs)
    return [
        name,
        str(len(runs)),
        number_of(ate.mean, 3),
        number_of(ate.median, 3),
        number_of(ate.worst, 2),
        f"{number} ({100 * low:.1f} to {100 * high:.1f} %)",
        number_of(of(runs, "E").median, 0),
        f"{number_of(of(runs, 'E_cut').median, 0)} ({percent(of(runs, 'decided').median)})",
        number_of(of(runs, "E_own").median, 0),
        number_of(of(runs, "f1").median, 3),
        number_of(of(runs, "cpu_s").median, 2),
        number_of(of(runs, "maps_mb").median, 1),
    ]


def number_of(value: float, digits: int) -> str:
    """A dash where nothing was measured."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def percent(share: float) -> str:
    """A share as whole percent."""
    return "-" if math.isnan(share) else f"{100 * share:.0f} %"


def command_line() -> str:
    """The command as it was given."""
    return shlex.join(["beemap", *sys.argv[1:]])


def machine() -> str:
    """Processor, cores, Python and the libraries that the time depends on, in one line."""
    libraries = ", ".join(f"{label} {version(name)}" for label, name in LIBRARIES)
    return (
        f"{_processor()}, {os.cpu_count()} cores, {platform.system()}; "
        f"Python {platform.python_version()}, {libraries}, beemap {version('beemap')}"
    )


def write_table(
    folder: Path, title: str, text: str, failures: Sequence[str] = (), legend: bool = True
) -> None:
    """`table.md`: the title, how it was made, what failed, then `text`."""
    parts = [f"# {title}", f"`{command_line()}`\n\n{machine()}."]
    if failures:
        parts.append(
            f"**{len(failures)} runs failed** and are missing below: " + "; ".join(failures[:5])
        )
    parts.append(text)
    if legend:
        parts.append(LEGEND)
    with new_files([folder / "table.md"], force=True) as partial:
        (partial / "table.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _processor() -> str:
    """The model as the kernel of Linux names it, else the platform's own name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
