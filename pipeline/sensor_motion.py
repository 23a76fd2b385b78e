"""How a camera or a laser moved, in its own frame and by what it saw alone.

This is what the wheels are calibrated against. Pairs tell by visual odometry; scans by matching
each to those before it, where the wheels only say where to look.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from calibration.rig import Mount, StereoRig
from mapping.ego_motion import EgoMotion
from mapping.gate import gate_of
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from odometry.settings import OdometrySettings
from odometry.walk import step_covariances
from pipeline.recordings.base import Recording
from pipeline.seeing import LoadedPair, moved
from pipeline.visual_motion import VisualMotion
from stereo.scan import RangeScan
from stereo.visual_settings import VisualSettings

# The wheels may be off by this much more than any wheels are.
LOOSE = OdometrySettings(along=0.15, across=0.15, heading=10.0, turn=10.0)

Progress = Callable[[int, int], None]
# Of consecutive steps; None where one could not be told.
SensorMotions = list[Motion | None]


def visual_motions(recording: Recording, rig: StereoRig, progress: Progress) -> SensorMotions:
    """Motion of the camera's foot on the floor from pair to pair, by visual odometry.

    Height, pitch and roll of the rig's mount must be right; its yaw, x and y are not used.
    """
    mount = replace(rig.mount or Mount(), yaw=0.0, x=0.0, y=0.0)
    camera = VisualMotion(rig.with_mount(mount), VisualSettings(), seed=0, hold=False)
    motions: SensorMotions = []
    pairs = moved(recording.pairs, camera, os.cpu_count() or 1)
    for done, (pair, motion) in enumerate(pairs, start=1):
        progress(done, len(recording.pairs))
        if isinstance(pair, LoadedPair) and pair.damage:
            recording.skip("damaged or unfit image", [pair.damage])
        motions.append(motion)
    return motions[1:]


def scan_motions(
    scans: Iterable[RangeScan],
    motions: Iterable[Motion],
    place: np.ndarray,
    settings: MappingSettings,
) -> SensorMotions:
    """Motion of the scanner from one due scan to the next.

    motions: of the robot by the wheels, to each scan from the one before; place: (3,) of the
    scanner on the robot, roughly.
    """
    ego = EgoMotion(settings.cell, float(np.radians(settings.correlated)))
    gate = gate_of(settings)
    found: SensorMotions = []
    since: Motion | None = None
    for scan, motion in zip(scans, motions, strict=True):
        since = motion if since is None else since.then(motion)
        if not gate.step(motion.increment):
            continue
        guess = compose(inverse(place), compose(since.increment, place))
        loose = Motion(guess, step_covariances(guess[None], LOOSE)[0], since.first, since.last)
        found.append(ego.refine(replace(scan, origin=(0.0, 0.0, 0.0)), loose))
        since = None
    return found[1:]
