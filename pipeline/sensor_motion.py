"""How a camera or a laser moved, in its own frame and by what it saw alone.

This is what the wheels are calibrated against. Pairs tell by their features; scans by matching
each to those before it, where the wheels only say where to look.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from calibration.rig import Mount, StereoRig
from mapping.ego_motion import EgoMotion
from mapping.gate import ObservationGate
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from odometry.settings import OdometrySettings
from odometry.source import MotionSource
from odometry.walk import step_covariances
from pipeline.mount import floor_matcher, reduced
from pipeline.mount_steps import STEP, looked_at
from pipeline.recordings.base import RecordedPair, Recording
from pipeline.whole_images import whole_rectifier
from stereo.floor_motion import motion_between
from stereo.scan import RangeScan

# The wheels may be off by this much more than any wheels are.
LOOSE = OdometrySettings(along=0.15, across=0.15, heading=10.0, turn=10.0)

Progress = Callable[[int, int], None]
# Of consecutive steps; None where one could not be told.
SensorMotions = list[Motion | None]


def visual_motions(
    recording: Recording, rig: StereoRig, source: MotionSource, progress: Progress
) -> SensorMotions:
    """Motion of the camera's foot on the floor from pair to pair, each about `STEP` on.

    Height, pitch and roll of the rig's mount must be right; its yaw, x and y are not used.
    """
    small, scale = reduced(rig)
    mount = replace(rig.mount or Mount(), yaw=0.0, x=0.0, y=0.0)
    rectify = whole_rectifier(small, mount)
    due = _due(recording, source)
    motions: SensorMotions = []
    before = None
    looked = looked_at(recording, due, rectify, floor_matcher(rectify), scale)
    for done, (pair, features) in enumerate(looked, start=1):
        progress(done, len(due))
        if before is not None:
            motion = None
            if features is not None and before[1] is not None:
                motion = motion_between(before[1], features, rectify.camera)
            motions.append(
                motion and Motion(motion.increment, motion.covariance, before[0].stamp, pair.stamp)
            )
        before = pair, features
    return motions


def _due(recording: Recording, source: MotionSource) -> list[RecordedPair]:
    gate = ObservationGate(*STEP)
    motions = ((pair, source.until(pair.stamp)) for pair in recording.pairs)
    return [pair for pair, motion in motions if motion and gate.step(motion.increment)]


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
    gate = ObservationGate(settings.spacing, float(np.radians(settings.spacing_angle)))
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
