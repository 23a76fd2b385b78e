"""Options of the commands that spoil ranges as a stereo camera would."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pipeline.errors import InputError

LOG_ENDINGS = (".log", ".clf", ".carmen")


def stereo_error_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --alpha, --blocks and --false-depth."""
    for option in reversed(
        (
            click.option(
                "--alpha",
                default=5.0 / 3.0,
                show_default="5/3",
                type=click.FloatRange(min=0),
                help="Size of the false blocks, eq (12) of the paper; 5/3 is its eq (11).",
            ),
            click.option(
                "--blocks",
                default=1,
                show_default=True,
                type=click.IntRange(0, 100),
                help="False blocks in every scan; 0: none.",
            ),
            click.option(
                "--false-depth",
                default="nearest",
                show_default=True,
                type=click.Choice(["nearest", "replace"]),
                help="In a block the nearer of true and false depth stands, or the false one.",
            ),
        )
    ):
        command = option(command)
    return command


def check_log_name(path: Path) -> None:
    """Refuse a name that would not be taken for a scan log, or for that of another file."""
    if path.suffix.lower() not in LOG_ENDINGS:
        raise InputError(
            f"{path}: a log's name ends in {', '.join(LOG_ENDINGS)}: give {path.name}.log"
        )
