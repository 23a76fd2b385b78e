"""`beemap calibrate`: from a printed board to a rig file with its mount."""

from __future__ import annotations

import click

from pipeline.commands.lazy import LazyGroup

COMMANDS = {
    "board": ("calibrate_board:board", "Draw a board to print, at exact scale."),
    "capture": ("calibrate_capture:capture", "Take pairs of a board by itself, then calibrate."),
    "cameras": ("calibrate_cameras:cameras", "Find lenses and pose from images of a board."),
    "mount": ("calibrate_mount:mount", "Find how the cameras sit on the robot."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def calibrate() -> None:
    """Calibrate a new camera pair: print a board, take pairs of images of it, then mount it."""
