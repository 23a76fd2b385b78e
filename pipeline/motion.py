"""Which motion a recording is mapped with: `--motion`."""

from __future__ import annotations

from pathlib import Path

from calibration.rig import StereoRig
from odometry.encoders import EncoderParameters, encoder_parameters
from odometry.poses import PoseOdometry
from odometry.settings import OdometrySettings
from odometry.source import EncoderOdometry, MotionSource
from pipeline.errors import InputError
from pipeline.recordings.base import BROKEN_TICKS, Recording
from pipeline.trajectory import read_tum


def choose_motion(
    choice: str, recording: Recording, rig: StereoRig, settings: OdometrySettings, seed: int
) -> MotionSource:
    """The motion source that `--motion` names.

    Raises:
        InputError: an unknown choice, or one that the recording does not hold.
    """
    kind, colon, file = choice.partition(":")
    if kind == "encoders" and not colon:
        return _encoders(recording, rig, settings)
    if kind == "poses" and file:
        poses = read_tum(Path(file))
        return PoseOdometry(poses.stamps, poses.poses, settings, seed)
    if choice == "poses":
        if recording.poses is None:
            raise InputError(
                f"{recording.path}: holds no poses: give --motion poses:FILE.tum"
                + (" or --motion encoders" if recording.ticks else "")
            )
        return PoseOdometry(recording.poses.stamps, recording.poses.poses, settings, seed)
    raise InputError(f"--motion {choice}: unknown (known: encoders, poses, poses:FILE.tum)")


def _encoders(recording: Recording, rig: StereoRig, settings: OdometrySettings) -> EncoderOdometry:
    if recording.ticks is None:
        if broken := recording.skipped.get(BROKEN_TICKS):
            raise InputError("; ".join(broken))
        instead = "--motion poses" if recording.poses is not None else "--motion poses:FILE.tum"
        raise InputError(f"{recording.path}: holds no wheel ticks (odom0/data.csv): give {instead}")
    return EncoderOdometry(recording.ticks, wheels_of(recording, rig), settings)


def wheels_of(recording: Recording, rig: StereoRig) -> EncoderParameters:
    """The wheels as the rig has them, else as the recording does.

    Raises:
        InputError: neither does.
    """
    if "encoders" in rig.sections:
        return encoder_parameters(rig.sections["encoders"], "rig: encoders")
    if recording.encoders is None:
        broken = "; ".join(recording.skipped.get(BROKEN_TICKS, []))
        raise InputError(broken or f"{recording.path}: wheel ticks without odom0/sensor.yaml")
    return recording.encoders
