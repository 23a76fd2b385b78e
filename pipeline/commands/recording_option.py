"""`--recording`: where the input of a finished run is, for commands that make the run again."""

from __future__ import annotations

from pathlib import Path

import click

recording_option = click.option(
    "--recording",
    type=click.Path(path_type=Path),
    metavar="REC",
    help="Where the run's input is now.  [default: where it was]",
)
