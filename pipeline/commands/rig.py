"""`beemap rig`: what to do with the file of a calibrated camera pair."""

from __future__ import annotations

import click

from pipeline.commands.lazy import LazyGroup

COMMANDS = {
    "show": ("rig_show:show", "Print a rig for people: lenses, baseline, what it means for depth."),
    "check": ("rig_check:check", "Tell from ordinary images whether a calibration has drifted."),
    "convert": ("rig_convert:convert", "Convert from and to ROS, Kalibr, EuRoC and OpenCV."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def rig() -> None:
    """Show, check and convert a rig file.

    RIG is a rig.yaml, or a file or folder of ROS camera_info, Kalibr, EuRoC or OpenCV; it is
    recognised by its content.
    """
