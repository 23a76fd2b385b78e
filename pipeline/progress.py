"""The progress bar of long work: done, rate, time left; on stderr."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(
    title: str, unit: str, quiet: bool = False
) -> Iterator[Callable[[float, int], None]]:
    """Yield progress(done, total); what is half done counts half."""
    if quiet:
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), refresh_per_second=4) as bar:
        task = bar.add_task(title, total=None, rate="")

        def progress(done: float, total: int) -> None:
            speed = bar.tasks[task].speed
            bar.update(task, completed=done, total=total, rate=_rate(speed, unit))

        yield progress


def _rate(speed: float | None, unit: str) -> str:
    if not speed:
        return ""
    return f"{speed:.0f} {unit}/s" if speed >= 1.0 else f"{60.0 * speed:.1f} {unit}/min"
