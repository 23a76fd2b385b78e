"""How the cameras sit on the robot, from a recording: the floor tells height, pitch and roll,
the motion seen against the motion driven tells yaw and place."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from calibration.floor import RectifiedView
from calibration.floor_alignment import FloorFrame
from calibration.hand_eye import LEAST_STEPS, HandEye, solve_hand_eye
from calibration.mount import FloorMount, mount_from_floor
from calibration.rig import Mount, StereoRig
from odometry.settings import OdometrySettings
from pipeline.errors import InputError
from pipeline.frontend import ahead, damage_of
from pipeline.motion import choose_motion
from pipeline.mount_steps import Steps, camera_steps, skip_unfit
from pipeline.recordings.base import DamagedFrameError, RecordedPair, Recording
from pipeline.whole_images import spread, whole_rectifier
from stereo.disparity import SUBPIXEL, DisparityMatcher
from stereo.errors import StereoError
from stereo.rectify import Rectifier
from stereo.settings import StereoSettings

# Wider images are halved, thirded, ...: the floor is found as well, and sooner [px].
WIDEST = 800
# The floor before a low or tilted camera is near: disparities up to this share of the width.
REACH = 0.4
BLOCK = 3  # a small block suits a slanted floor
# Yaw and place are used when known to this [rad, m].
YAW_KNOWN = math.radians(1.0)
PLACE_KNOWN = 0.015
# Wheels that measure this much wrong, and by so many sigma, are worth a word.
SCALE_OFF = 0.01
SIGNIFICANT = 3.0
FROM_FLOOR = ("height", "pitch", "roll")

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class MountEstimate:
    """mount: the new one; sigma: of what was measured, by the name of the mount's field [m, rad];
    what is missing there was kept; notes: what the user must hear."""

    mount: Mount
    sigma: dict[str, float]
    floor: FloorMount
    pairs: int
    hand_eye: HandEye | None
    notes: list[str] = field(default_factory=list)


def estimate_mount(
    recording: Recording, rig: StereoRig, frames: int, progress: Progress
) -> MountEstimate:
    """The mount of the rig's raw left camera on the robot of a recording.

    At most `frames` pairs, spread evenly, are looked at for the floor. Yaw, x and y stay as the
    rig has them (else 0) where the recording does not tell.

    Raises:
        CalibrationError: no floor in view; InputError: too few pairs can be read;
        StereoError: the rig does not fit the images; OdometryError: wrong wheels.
    """
    before = rig.mount or Mount()
    floor, pairs = look_at_floor(recording, rig, frames, progress)
    mount = replace(before, height=floor.height, pitch=floor.pitch, roll=floor.roll)
    sigma: dict[str, float] = dict(zip(FROM_FLOOR, floor.sigma, strict=True))
    hand_eye, notes = _look_at_motion(recording, rig, mount, progress)
    if hand_eye is not None:
        mount, placed, more = _placed(mount, hand_eye)
        sigma.update(placed)
        notes += more
    return MountEstimate(mount, sigma, floor, pairs, hand_eye, notes)


def look_at_floor(
    recording: Recording, rig: StereoRig, frames: int, progress: Progress
) -> tuple[FloorMount, int]:
    """Height, pitch and roll by the floor, and the number of pairs read, of at most `frames`.

    Raises as `estimate_mount`.
    """
    small, scale = reduced(rig)
    # Rectified as if level: the camera's own tilt is what is sought.
    rectify = whole_rectifier(small)
    match = floor_matcher(rectify)

    def frame(files: RecordedPair) -> FloorFrame | ValueError:
        try:
            pair = files.load()
            left, right = rectify(scale(pair.left), scale(pair.right))
            return FloorFrame(left, right, match(left, right).astype(np.float32) / SUBPIXEL)
        except (DamagedFrameError, StereoError) as error:
            return error
        except cv2.error as error:
            return DamagedFrameError(damage_of(files, error))

    files = spread(recording.pairs, frames)
    found: list[FloorFrame] = []
    unfit: ValueError | None = None
    for done, (_, one) in enumerate(ahead(files, frame, os.cpu_count() or 1), start=1):
        progress(done, len(files))
        if isinstance(one, FloorFrame):
            found.append(one)
        else:
            unfit = one
            skip_unfit(recording, one)
    if isinstance(unfit, StereoError) and not found:
        raise unfit
    if not found:
        raise InputError(f"{recording.path}: none of {len(files)} pairs can be read")
    return mount_from_floor(found, level_view(rectify)), len(found)


def _look_at_motion(
    recording: Recording, rig: StereoRig, mount: Mount, progress: Progress
) -> tuple[HandEye | None, list[str]]:
    """Yaw and place from the wheels, or the reason why they tell nothing."""
    if recording.ticks is None:
        return None, ["no wheel ticks in the recording: yaw, x and y stay as they were"]
    source = choose_motion("encoders", recording, rig, OdometrySettings(), 0)
    small, scale = reduced(rig)
    rectify = whole_rectifier(small, replace(mount, yaw=0.0, x=0.0, y=0.0))
    steps: Steps = camera_steps(recording, source, rectify, floor_matcher(rectify), scale, progress)
    if len(steps.wheels) < LEAST_STEPS:
        return None, [
            f"only {len(steps.wheels)} steps in which the robot moved and saw how: yaw, x and y "
            "stay as they were; drive further, past things with texture"
        ]
    place = (mount.x, mount.y, mount.yaw)
    return solve_hand_eye(steps.wheels, steps.camera, steps.covariances, place), []


def _placed(mount: Mount, found: HandEye) -> tuple[Mount, dict[str, float], list[str]]:
    """The mount with what the motion tells well enough; its sigmas; notes on the rest."""
    x, y, yaw = found.sigma.tolist()
    sigma, notes = {}, []
    if yaw <= YAW_KNOWN:
        mount, sigma["yaw"] = replace(mount, yaw=found.yaw), yaw
    else:
        notes.append(f"yaw stays: it would be known to {math.degrees(yaw):.1f} deg; drive further")
    if max(x, y) <= PLACE_KNOWN:
        mount = replace(mount, x=found.x, y=found.y)
        sigma |= {"x": x, "y": y}
    else:
        notes.append(
            f"x and y stay: they would be known to {max(x, y) * 100:.1f} cm only; "
            "turn on the spot both ways while recording"
        )
    off = abs(found.scale - 1.0)
    if off > max(SCALE_OFF, SIGNIFICANT * found.scale_sigma):
        notes.append(
            f"the robot moves {found.scale:.3f} of what its wheels say (+-"
            f"{found.scale_sigma:.3f}): check the wheels' radii or the cameras' baseline"
        )
    return mount, sigma, notes


def level_view(rectify: Rectifier) -> RectifiedView:
    """The geometry of images rectified as if the raw camera were level."""
    camera = rectify.camera
    raw_from_rectified = Mount().rotation.T @ camera.rotation
    return RectifiedView(camera.f, camera.cx, camera.cy, camera.baseline, raw_from_rectified)


def floor_matcher(rectify: Rectifier) -> DisparityMatcher:
    disparities = 16 * math.ceil(REACH * rectify.camera.width / 16)
    return DisparityMatcher(rectify.camera, StereoSettings(disparities=disparities, block=BLOCK))


def reduced(
    rig: StereoRig, widest: int = WIDEST
) -> tuple[StereoRig, Callable[[np.ndarray], np.ndarray]]:
    """The rig for images of at most so many columns, and what makes them of its own images."""
    width, height = rig.image_size
    k = math.ceil(width / widest)
    if k == 1:
        return rig, lambda image: image
    size = (width // k, height // k)
    small = replace(rig.scaled(1.0 / k), image_size=size)

    def scale(image: np.ndarray) -> np.ndarray:
        if image.shape[:2] != (height, width):
            return image  # the rectifier says what is wrong with it
        return cv2.resize(image[: size[1] * k, : size[0] * k], size, interpolation=cv2.INTER_AREA)

    return small, scale
