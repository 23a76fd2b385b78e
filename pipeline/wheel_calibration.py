"""Wheels, sensor place and time offset of a recording, from wheels and the sensor's own motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from odometry.encoders import EncoderParameters
from odometry.errors import OdometryError
from odometry.motion import Motion
from odometry.settings import OdometrySettings
from odometry.tick_track import TickTrack
from odometry.time_offset import TimeOffset, time_offset
from odometry.wheel_calibration import Stretches, WheelCalibration, calibrate_wheels
from pipeline.mount import PLACE_KNOWN, SIGNIFICANT, YAW_KNOWN
from pipeline.sensor_motion import SensorMotions

# Steps are joined to stretches of this travel or turn [m, rad]: long against the wheels' noise.
STRETCH = (1.0, math.radians(45.0))
PARTS = 32
# Used when known to these shares.
RADIUS_KNOWN = 0.01
TRACK_KNOWN = 0.02
LEAST_OFFSET = 0.002  # s


@dataclass(frozen=True)
class WheelEstimate:
    """parameters: the encoders with all that is known well enough; found: all six numbers;
    offset: of time, and whether it was taken over; place: x, y, yaw of the sensor on the robot,
    None where not known well enough; distance: of all stretches [m].
    """

    parameters: EncoderParameters
    found: WheelCalibration
    offset: TimeOffset | None
    offset_used: bool
    position: tuple[float, float] | None
    yaw: float | None
    stretches: int
    distance: float
    notes: list[str] = field(default_factory=list)


def estimate_wheels(
    track: TickTrack,
    parameters: EncoderParameters,
    sensor_motions: SensorMotions,
    settings: OdometrySettings,
) -> WheelEstimate:
    """What makes wheels and sensor agree.

    track: by these parameters, their time offset included; sensor_motions: of consecutive steps,
    of whatever sensor, in its own frame.

    Raises:
        OdometryError: too little motion, or a wheel that counts backwards.
    """
    steps = [motion for motion in sensor_motions if motion is not None]
    offset = _offset(track, parameters, steps)
    use_offset = (
        offset is not None
        and offset.clear
        and abs(offset.seconds) > max(SIGNIFICANT * offset.sigma, LEAST_OFFSET)
    )
    shift = offset.seconds if offset is not None and use_offset else 0.0
    track = replace(track, stamps=track.stamps + round(shift * 1e9))
    joined = _stretches(sensor_motions)
    stretches = _with_wheels(joined, track)
    found = calibrate_wheels(stretches, parameters.track, settings)
    _check_signs(found)
    new, notes = _taken(parameters, found)
    position, yaw = _place(found)
    return WheelEstimate(
        parameters=replace(new, time_offset=parameters.time_offset + shift),
        found=found,
        offset=offset,
        offset_used=use_offset,
        position=position,
        yaw=yaw,
        stretches=len(stretches.sensor),
        distance=float(np.abs(stretches.wheels.mean(axis=2)).sum()),
        notes=notes,
    )


def _offset(
    track: TickTrack, parameters: EncoderParameters, steps: list[Motion]
) -> TimeOffset | None:
    if not steps:
        return None
    headings = (track.paths[:, 1] - track.paths[:, 0]) / parameters.track
    spans = np.array([(motion.first, motion.last) for motion in steps])
    turns = np.array([motion.increment[2] for motion in steps])
    return time_offset(track.stamps, headings, spans, turns)


def _stretches(motions: SensorMotions) -> list[Motion]:
    """Consecutive steps joined to stretches; one that is missing begins a new stretch."""
    stretches: list[Motion] = []
    since: Motion | None = None
    for motion in motions:
        since = motion if since is None or motion is None else since.then(motion)
        if since is not None and (
            math.hypot(*since.increment[:2]) >= STRETCH[0] or abs(since.increment[2]) >= STRETCH[1]
        ):
            stretches.append(since)
            since = None
    return stretches


def _with_wheels(stretches: list[Motion], track: TickTrack) -> Stretches:
    """The stretches that the wheels were read all through."""
    bad = np.flatnonzero(track.in_gap | track.lost.any(axis=1))
    told = []
    for motion in stretches:
        inside = track.stamps[0] <= motion.first and motion.last <= track.stamps[-1]
        overlap = (track.stamps[bad] < motion.last) & (track.stamps[bad + 1] > motion.first)
        if inside and not overlap.any():
            told.append(motion)
    # Relative to the first reading: stamps of 19 digits are more than a float holds.
    zero = track.stamps[0]
    spans = np.array([(m.first - zero, m.last - zero) for m in told], np.int64).reshape(-1, 2)
    times = spans[:, :1] + (spans[:, 1:] - spans[:, :1]) * np.linspace(0.0, 1.0, PARTS + 1)
    paths = [np.interp(times, track.stamps - zero, track.paths[:, i]) for i in (0, 1)]
    paths = np.stack(paths, axis=-1)
    return Stretches(
        np.diff(paths, axis=1),
        np.array([m.increment for m in told]).reshape(-1, 3),
        np.array([m.covariance for m in told]).reshape(-1, 3, 3),
    )


def _check_signs(found: WheelCalibration) -> None:
    left, right = (found.values[:2] < 0.0).tolist()
    if left or right:
        which = "both wheels count" if left and right else f"the {'left' if left else 'right'} one"
        raise OdometryError(
            f"the wheels turn the wrong way round for what was seen ({which} backwards): change "
            "encoders.reversed, or exchange the two encoders"
        )


def _taken(
    parameters: EncoderParameters, found: WheelCalibration
) -> tuple[EncoderParameters, list[str]]:
    """The parameters with what is known well enough, and what is not."""
    left, right, track = found.values[:3].tolist()
    doubt = found.sigma[:3] / found.values[:3]
    notes = []
    if max(doubt[:2]) <= RADIUS_KNOWN:
        parameters = replace(
            parameters,
            left_radius=parameters.left_radius * left,
            right_radius=parameters.right_radius * right,
        )
    else:
        notes.append(f"the radii stay: they would be known to {max(doubt[:2]):.1%}; drive further")
    if doubt[2] <= TRACK_KNOWN:
        parameters = replace(parameters, track=track)
    else:
        notes.append(f"the track stays: it would be known to {doubt[2]:.1%}; turn more, both ways")
    return parameters, notes


def _place(found: WheelCalibration) -> tuple[tuple[float, float] | None, float | None]:
    """Position and yaw of the sensor, where they are known as `calibrate mount` wants them."""
    x, y, yaw = found.values[3:].tolist()
    known = max(found.sigma[3:5]) <= PLACE_KNOWN
    return (x, y) if known else None, yaw if found.sigma[5] <= YAW_KNOWN else None
