"""What of a bag goes into a recording, and with which rig: read before anything is written."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from calibration.exchange.formats import read_rig
from calibration.rig import RigError, StereoRig, rig_from_dict, rig_to_dict
from odometry.encoders import EncoderParameters, encoder_parameters, encoder_section
from pipeline.errors import InputError
from pipeline.ros.bags import BagReader, Topic
from pipeline.ros.calibration import rig_of
from pipeline.ros.frames import Frames
from pipeline.ros.images import DamagedImageError, ImageFiles
from pipeline.ros.topics import Chosen, listed
from pipeline.ros.types import CAMERA_INFO
from pipeline.ros.wheels import (
    COUNTER_BITS,
    TICKS_PER_REVOLUTION,
    WheelJoints,
    find_wheels,
)
from stereo.encoded import decode_image

MOST_TRANSFORMS = 500  # messages of a topic that are looked at for the mount


@dataclass(frozen=True)
class Asked:
    """What the user said beside the topics: lengths in metres, base: the robot's frame in tf."""

    rig: Path | None = None
    rectified: bool = False
    base: str | None = None
    wheels: str | None = None
    wheel_radius: float | None = None
    track: float | None = None
    ticks_per_revolution: float | None = None


@dataclass(frozen=True)
class Plan:
    """What will be written; notes: what the user must hear of it."""

    chosen: Chosen
    rig: StereoRig
    joints: WheelJoints | None
    parameters: EncoderParameters | None
    notes: list[str] = field(default_factory=list)

    @property
    def topics(self) -> dict[str, str]:
        """name -> what its messages become."""
        topics = {self.chosen.left.name: "cam0", self.chosen.right.name: "cam1"}
        if self.chosen.odometry is not None:
            topics[self.chosen.odometry.name] = "odometry"
        if self.chosen.joints is not None and self.joints is not None:
            topics[self.chosen.joints.name] = "wheels"
        return topics


def plan(bag: BagReader, name: str, chosen: Chosen, asked: Asked) -> Plan:
    """Calibration, mount and wheels, read before anything is written.

    Raises:
        InputError: there is no calibration, or no number that the wheels need.
    """
    notes: list[str] = []
    rig = _rig(bag, name, chosen, asked, notes)
    first = bag.first(chosen.left.name)
    _check_size(chosen.left, first, rig)
    rig = _mounted(bag, rig, chosen, first, asked, notes)
    joints, parameters = _wheels(bag, rig, chosen, asked, notes)
    if parameters is not None:
        rig = replace(rig, sections={**rig.sections, "encoders": encoder_section(parameters)})
    if parameters is None and chosen.odometry is None:
        notes.append("no odometry and no wheels: map finds the motion from the images")
    return Plan(chosen, rig, joints, parameters, notes)


def _rig(bag: BagReader, name: str, chosen: Chosen, asked: Asked, notes: list[str]) -> StereoRig:
    rectified = asked.rectified or chosen.rectified
    if asked.rig is not None:
        try:
            found = read_rig(asked.rig)
        except RigError as error:
            raise InputError(str(error)) from None
        notes += found.notes
        if rectified and not found.rig.rectified:
            notes.append(
                f"{chosen.left.name} is called rectified and {asked.rig} is made for raw images: "
                "name the raw images with --left and --right, or set 'rectified: true' in the rig"
            )
        return found.rig
    infos = (chosen.left_info, chosen.right_info)
    messages = [info and bag.first(info.name) for info in infos]
    for info, message, camera in zip(infos, messages, chosen.cameras, strict=True):
        if info is None or message is None:
            there = {t.name: t for t in bag.topics.values() if t.type == CAMERA_INFO}
            raise InputError(
                f"{name}: no CameraInfo for {camera.name}: give --rig rig.yaml, or name it with "
                f"--left-info and --right-info (there are: {listed(there)})"
            )
    left, right = infos
    assert left is not None
    assert right is not None
    if rectified:
        notes.append(f"{chosen.left.name}: taken as rectified already")
    rig, assumed = rig_of((messages[0], messages[1]), (left.name, right.name), rectified)
    notes += assumed
    return rig


def _check_size(topic: Topic, message: Any, rig: StereoRig) -> None:
    """Refuse images that the calibration is not made for, before any work."""
    try:
        _, data = ImageFiles().file(topic.name, topic.type, message)
    except (DamagedImageError, AttributeError):  # counted in its turn; there is none
        return
    image = decode_image(data)
    if isinstance(image, np.ndarray) and image.shape[1::-1] != rig.image_size:
        (height, width), (w, h) = image.shape[:2], rig.image_size
        raise InputError(
            f"{topic.name}: images of {width}x{height}, the calibration is made for {w}x{h}: give "
            "the rig of these images with --rig"
        )


def _mounted(
    bag: BagReader, rig: StereoRig, chosen: Chosen, first: Any, asked: Asked, notes: list[str]
) -> StereoRig:
    """The rig with the mount that tf tells, where the rig itself tells none; first: left image."""
    if rig.mount is not None:
        return rig
    frames = Frames()
    for topic in sorted(chosen.transforms, key=lambda topic: "static" not in topic.name):
        # Before there was /tf_static, what stands still was told on /tf again and again.
        for message in islice(bag.messages([topic.name]), MOST_TRANSFORMS):
            frames.take(message.content)
    camera = first.header.frame_id if first is not None else ""
    found = frames.mount(camera, asked.base)
    unknown = "its mount is taken as level, 0.3 m up (beemap calibrate mount finds it)"
    if found is None:
        if asked.base is not None:
            raise InputError(
                f"--base {asked.base}: not above the camera's frame '{camera}' in tf "
                f"(above it: {', '.join(frames.above(camera)[1:]) or 'none'})"
            )
        notes.append(f"no tf leads from the robot to the camera's '{camera}': {unknown}")
        return rig
    mount, base = found
    try:  # the checks that a rig file goes through
        rig = rig_from_dict(rig_to_dict(rig.with_mount(mount)), f"tf {base} -> {camera}")
    except RigError as error:
        notes.append(f"{error}: {unknown}")
        return rig
    floor = "" if base == "base_footprint" else f", {base} taken as on the floor"
    notes.append(f"mount from tf {base} -> {camera}: {mount.height:.3f} m up{floor}")
    return rig


def _wheels(
    bag: BagReader, rig: StereoRig, chosen: Chosen, asked: Asked, notes: list[str]
) -> tuple[WheelJoints | None, EncoderParameters | None]:
    if chosen.joints is None:
        return None, None
    topic = chosen.joints.name
    states = (message.content for message in bag.messages([topic]))
    joints = find_wheels(states, topic, asked.wheels)
    if joints is None:
        notes.append(f"{topic}: no joint is called as a left and a right wheel: give --wheels")
        return None, None
    section: dict[str, Any] = {
        "ticks_per_revolution": TICKS_PER_REVOLUTION,
        "counter_bits": COUNTER_BITS,
        **rig.sections.get("encoders", {}),
    }
    if asked.wheel_radius is not None:
        section |= {"left_radius": asked.wheel_radius, "right_radius": asked.wheel_radius}
    if asked.track is not None:
        section["track"] = asked.track
    if asked.ticks_per_revolution is not None:
        section["ticks_per_revolution"] = asked.ticks_per_revolution
    missing = [key for key in ("left_radius", "right_radius", "track") if key not in section]
    if missing:
        told = (
            f"{topic} tells the angles of {joints.left} and {joints.right}, not their size: give "
            "--wheel-radius and --track in metres"
        )
        if chosen.odometry is None:
            raise InputError(told)
        notes.append(f"{told}; {chosen.odometry.name} is taken without them")
        return None, None
    return joints, encoder_parameters(section, f"wheels of {topic}")
