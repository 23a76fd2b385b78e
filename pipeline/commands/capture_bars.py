"""The line on the screen while pairs of a board are taken."""

from __future__ import annotations

import sys

import click

from pipeline.board_capture import BoardCapture, Look
from pipeline.pair_taking import CaptureWatcher
from stereo.camera import CapturedPair

BAR = 8  # characters


class CaptureBars(CaptureWatcher):
    """Bars of what is there, what to do now, what became of the pair; on standard error."""

    def looked(self, pair: CapturedPair, look: Look, capture: BoardCapture) -> None:
        """Write it over the line before on a terminal; else a line for each kept pair."""
        bars = " ".join(
            f"{name} {'#' * round(BAR * share):.<{BAR}}" for name, share in capture.bars().items()
        )
        blur = f", blur {look.blur:.1f} px" if look.blur is not None else ""
        wanted = capture.wanted()
        now = f"now: {wanted[0]}" if wanted else "enough"
        line = f"{bars} | {look.why}{blur} | {now}"
        if sys.stderr.isatty():
            click.echo(f"\r\x1b[K{line}" + ("\n" if look.kept else ""), err=True, nl=False)
        elif look.kept:
            click.echo(line, err=True)
