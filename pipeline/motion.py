"""Which motion a recording is mapped with: `--motion`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calibration.rig import StereoRig
from odometry.dead_reckoning import DeadReckoning
from odometry.encoders import EncoderParameters, encoder_parameters
from odometry.errors import OdometryError
from odometry.poses import PoseOdometry
from odometry.settings import OdometrySettings
from odometry.source import EncoderOdometry, MotionSource
from pipeline.errors import InputError
from pipeline.recordings.base import BROKEN_TICKS, Recording
from pipeline.trajectory import read_tum

if TYPE_CHECKING:
    from pipeline.fused_motion import FusedMotion
    from pipeline.seeing import AnyMotion
    from pipeline.settings import Settings
    from pipeline.visual_motion import VisualMotion

LOOKING = ("visual", "fused")
KNOWN = "encoders, odometry, poses, poses:FILE.tum, visual, fused"


def check_choice(choice: str) -> None:
    """Refuse what `--motion` cannot name. Raises InputError."""
    kind, _, file = choice.partition(":")
    plain = ("encoders", "odometry", "poses", *LOOKING)
    if choice not in plain and not (kind == "poses" and file):
        raise InputError(f"--motion {choice}: unknown (known: {KNOWN})")


def absolute_choice(choice: str) -> str:
    """The choice with the path of its file made absolute. Raises InputError when it is none."""
    check_choice(choice)
    kind, _, file = choice.partition(":")
    return f"{kind}:{Path(file).resolve()}" if file else choice


def usual_motion(
    recording: Recording, rig: StereoRig, settings: OdometrySettings
) -> tuple[str, list[str]]:
    """What a recording is mapped with unless the user chooses; and notes for the user.

    The images, and the wheels with them where their record can be used: one that cannot stops no
    run, but is noted.
    """
    wheels, faults = _recorded_wheels(recording, rig, settings)
    if wheels is not None:
        return "fused", faults
    if faults:
        return "visual", [f"{'; '.join(faults)}: motion is found from the images alone"]
    also = "" if recording.poses is None else " (--motion poses takes the recording's own poses)"
    return "visual", [f"no wheel ticks in the recording: its motion is found from the images{also}"]


def motion_of(
    choice: str, recording: Recording, rig: StereoRig, settings: Settings, seed: int
) -> AnyMotion:
    """Any motion that `--motion` names, those that look at the images included.

    Raises:
        InputError: an unknown choice, or one that the recording does not hold.
    """
    if choice not in LOOKING:
        return choose_motion(choice, recording, rig, settings.odometry, seed)
    if choice == "visual":
        return looking(rig, None, settings, seed)
    wheels, faults = _recorded_wheels(recording, rig, settings.odometry)
    if wheels is None:
        raise InputError(
            "; ".join(faults)
            or f"{recording.path}: holds no wheel ticks (odom0/data.csv) to fuse with: give "
            "--motion visual"
        )
    return looking(rig, wheels, settings, seed)


def _recorded_wheels(
    recording: Recording, rig: StereoRig, settings: OdometrySettings
) -> tuple[MotionSource | None, list[str]]:
    """The wheels' motion, by their ticks or else by odometry kept as poses; None: there is none
    that can be used. And what is wrong with those that cannot."""
    faults: list[str] = []
    if recording.ticks is not None or BROKEN_TICKS in recording.skipped:
        try:
            return _encoders(recording, rig, settings), faults
        except (InputError, OdometryError) as error:
            faults.append(str(error))
    if recording.odometry is not None:
        try:
            return choose_motion("odometry", recording, rig, settings, 0), faults
        except OdometryError as error:
            faults.append(str(error))
    return None, faults


def looking(
    rig: StereoRig, wheels: MotionSource | None, settings: Settings, seed: int
) -> VisualMotion | FusedMotion:
    """Motion from the images, alone or with the wheels."""
    from pipeline.fused_motion import FusedMotion
    from pipeline.visual_motion import VisualMotion

    if wheels is None:
        return VisualMotion(rig, settings.visual, seed)
    visual = VisualMotion(rig, settings.visual, seed, hold=False)
    return FusedMotion(visual, wheels, settings.odometry.max_speed)


def choose_motion(
    choice: str, recording: Recording, rig: StereoRig, settings: OdometrySettings, seed: int
) -> MotionSource:
    """The motion source that `--motion` names.

    Raises:
        InputError: an unknown choice, or one that the recording does not hold.
    """
    check_choice(choice)
    kind, _, file = choice.partition(":")
    if kind == "encoders":
        return _encoders(recording, rig, settings)
    if choice == "odometry":
        if recording.odometry is None:
            raise InputError(
                f"{recording.path}: holds no odometry (odometry0/data.csv): leave --motion out"
            )
        return DeadReckoning(recording.odometry.stamps, recording.odometry.poses, settings)
    if kind == "poses" and file:
        poses = read_tum(Path(file))
        return PoseOdometry(poses.stamps, poses.poses, settings, seed)
    if recording.poses is None:
        raise InputError(
            f"{recording.path}: holds no poses: give --motion poses:FILE.tum"
            + (" or --motion encoders" if recording.ticks else "")
        )
    return PoseOdometry(recording.poses.stamps, recording.poses.poses, settings, seed)


def _encoders(recording: Recording, rig: StereoRig, settings: OdometrySettings) -> EncoderOdometry:
    if recording.ticks is None:
        if broken := recording.skipped.get(BROKEN_TICKS):
            raise InputError("; ".join(broken))
        instead = "--motion visual" + (" or poses" if recording.poses is not None else "")
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
