"""What `live` and `record` share on the screen: the status line, notes."""

from __future__ import annotations

import sys
import threading
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from pipeline.live.status import Status
    from pipeline.web.run_state import RunState

# Without a terminal the line is printed each so many times.
SELDOM = 10


class Screen:
    """One line that is written over on a terminal; notes above it. All on standard error.

    page: is told the same.
    """

    def __init__(self, quiet: bool) -> None:
        self.page: RunState | None = None
        self._quiet = quiet
        self._terminal = sys.stderr.isatty()
        self._count = 0
        self._lock = threading.Lock()

    def status(self, status: Status) -> None:
        """Show the status line."""
        if self.page is not None:
            self.page.status(status.figures(), status.checks())
        if self._quiet:
            return
        with self._lock:
            self._count += 1
            if self._terminal:
                click.echo(f"\r\x1b[K{status.line()}", err=True, nl=False)
            elif self._count % SELDOM == 1:
                click.echo(status.line(), err=True)

    def tell(self, text: str) -> None:
        """Say what happened."""
        if self.page is not None:
            self.page.tell(text)
        if self._quiet:
            return
        with self._lock:
            click.echo(("\r\x1b[K" if self._terminal else "") + f"note: {text}", err=True)

    def end(self) -> None:
        """Leave the status line."""
        if self._terminal and self._count and not self._quiet:
            click.echo("", err=True)
