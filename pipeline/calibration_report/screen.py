"""A calibration on the screen: the pairs, the facts, then the verdict and what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from calibration.calibrate import CalibrationResult
from calibration.imagepairs import PairList
from calibration.verdict import MEANING
from pipeline.calibration_report.next_steps import next_steps
from pipeline.calibration_report.tables import PAIR_COLUMNS, facts, pair_rows

COLOURS = {"excellent": "green", "good": "green", "usable": "yellow", "redo": "red"}


def print_result(
    result: CalibrationResult, found: PairList, output: Path, kept: Sequence[str]
) -> None:
    """Print what was found out.

    Args:
        output: the rig file that was written; kept: what it keeps of the file it replaced.
    """
    console = Console(highlight=False, soft_wrap=True)
    for row in _aligned([list(PAIR_COLUMNS), *pair_rows(result)]):
        console.print(escape(row))
    if found.matched_by == "order":
        console.print("images matched by sorted order: their names share no numbers")
    if found.passed_over:
        told = f"{len(found.pairs)} of {len(found.pairs) + found.passed_over} pairs looked at"
        console.print(f"{told}, evenly spread: neighbours in a recording show the same view")
    for path in found.unmatched:
        console.print(f"no partner: {escape(str(path))}")
    console.print()
    for name, value in facts(result):
        console.print(f"{name:<15}{escape(value)}")
    if kept:
        console.print(f"{'kept':<15}{', '.join(kept)} of the replaced file")
    console.print(f"{'written':<15}{escape(str(output))}")
    word = result.judgement.verdict
    rows = f"held-out rows {result.heldout.row_rms:.3f} px RMS"
    console.print(f"\nverdict: [bold {COLOURS[word]}]{word}[/], {rows}: {MEANING[word]}")
    first, *others = next_steps(result, output)
    console.print(f"next: {escape(first)}")
    for hint in others:
        console.print(f"also: {escape(hint)}")


def _aligned(rows: list[list[str]]) -> list[str]:
    """The rows of a table as lines; unlike rich's tables, whatever the width of the screen."""
    widths = [max(len(cell) for cell in column) + 2 for column in zip(*rows, strict=True)]
    return [
        "".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
