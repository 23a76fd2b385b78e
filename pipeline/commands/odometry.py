"""`beemap odometry`: wheel encoders read, calibrated and checked."""

from __future__ import annotations

import click

from pipeline.commands.lazy import LazyGroup

COMMANDS = {
    "read": ("odometry_read:read", "Read the encoders of a rig, or replay a raw log of them."),
    "calibrate": (
        "odometry_calibrate:calibrate_wheels",
        "Radii, track, camera place and time offset from a driven recording.",
    ),
    "straight": ("odometry_checks:straight", "Wheel radii from a straight run along a tape."),
    "umbmark": ("odometry_checks:umbmark", "Radii and track from squares driven both ways round."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def odometry() -> None:
    """Read, calibrate and check wheel encoders.

    \b
    beemap odometry read rig.yaml                      do the encoders answer?
    beemap odometry straight --length 3 --rig rig.yaml --ticks 0 0 12740 12725
    beemap odometry calibrate REC --rig rig.yaml -o rig.yaml --force
    """
