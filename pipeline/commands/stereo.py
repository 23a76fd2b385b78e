"""`beemap stereo`: look at what stereo makes of images, and measure how far it can be trusted."""

from __future__ import annotations

import click

from pipeline.commands.lazy import LazyGroup

COMMANDS = {
    "show": ("stereo_show:show", "Draw a pair, its disparity and its scan, as picture or video."),
    "model": (
        "stereo_model:model",
        "Measure the sensor model against the truth, for the settings.",
    ),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def stereo() -> None:
    """See what stereo makes of a recording, and measure how far it can be trusted."""
