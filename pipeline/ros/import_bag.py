"""A bag becomes a recording: images as they are, calibration, mount, odometry, wheels.

Everything is streamed: a message is written before the next one is read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.exchange.formats import read_rig
from calibration.rig import RigError, StereoRig, rig_from_dict, rig_to_dict
from odometry.encoders import EncoderParameters, encoder_parameters, encoder_section
from pipeline.errors import InputError
from pipeline.recordings.asl import LAST_STAMP
from pipeline.recordings.asl_writer import AslWriter
from pipeline.ros.bags import BagReader, Message
from pipeline.ros.calibration import rig_of
from pipeline.ros.frames import Frames, yaw_of
from pipeline.ros.images import DamagedImageError, ImageFiles
from pipeline.ros.topics import Chosen, listed
from pipeline.ros.types import CAMERA_INFO, stamp_of
from pipeline.ros.wheels import (
    COUNTER_BITS,
    TICKS_PER_REVOLUTION,
    WheelJoints,
    find_wheels,
    ticks_of,
)


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
    rig = _mounted(bag, rig, chosen, asked, notes)
    joints, parameters = _wheels(bag, rig, chosen, asked, notes)
    if parameters is not None:
        rig = replace(rig, sections={**rig.sections, "encoders": encoder_section(parameters)})
    if parameters is None and chosen.odometry is None:
        notes.append("no odometry and no wheels: map finds the motion from the images")
    return Plan(chosen, rig, joints, parameters, notes)


def write(
    bag: BagReader,
    made: Plan,
    folder: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Counter[str]:
    """Stream the messages of the plan into the recording `folder`, which exists; how many of what.

    Raises:
        InputError: an encoding of images that is not known.
    """
    encoders = None if made.parameters is None else encoder_section(made.parameters)
    topics = made.topics
    total = sum(bag.topics[topic].count for topic in topics)
    with AslWriter(folder, made.rig, None, encoders, keep_rig=True) as writer:
        sink = _Sink(bag, made, writer)
        for number, message in enumerate(bag.messages(topics), start=1):
            sink.take(topics[message.topic], message)
            progress(number, total)
    if sink.images.bits is not None:
        made.notes.append(f"16-bit images: the lower {sink.images.bits} bits are scaled to 8")
    return sink.counts


class _Sink:
    """Writes messages; what is of no use is counted among what the bag skipped."""

    def __init__(self, bag: BagReader, made: Plan, writer: AslWriter) -> None:
        self.counts: Counter[str] = Counter()
        self.images = ImageFiles()
        self._bag, self._made, self._writer = bag, made, writer
        self._seen: dict[str, set[int]] = {}

    def take(self, kind: str, message: Message) -> None:
        """One message of that kind."""
        stamp = stamp_of(message.content.header)
        if stamp == 0:  # the driver does not know the time: when it was received
            stamp = message.time
            self.counts["without a stamp"] += 1
        seen = self._seen.setdefault(kind, set())
        if not 0 < stamp <= LAST_STAMP:
            self._skip("stamp that is no time", message)
        elif stamp in seen:
            self._skip("message that repeats a stamp", message)
        elif self._written(kind, stamp, message):
            seen.add(stamp)
            self.counts[kind] += 1

    def _written(self, kind: str, stamp: int, message: Message) -> bool:
        if kind in ("cam0", "cam1"):
            topic = self._bag.topics[message.topic]
            try:
                file = self.images.file(message.topic, topic.type, message.content)
            except DamagedImageError:
                self._skip("damaged image", message)
                return False
            self._writer.add_image(kind, stamp, *file)
        elif kind == "odometry":
            pose = message.content.pose.pose
            place = np.array([pose.position.x, pose.position.y, yaw_of(pose.orientation)])
            if not np.isfinite(place).all():
                self._skip("odometry that is no number", message)
                return False
            self._writer.add_odometry(stamp, place)
        else:
            joints, parameters = self._made.joints, self._made.parameters
            assert joints is not None
            assert parameters is not None
            ticks = ticks_of(message.content, joints, parameters)
            if ticks is None:  # of other joints: several programs tell theirs on one topic
                self.counts["joint states without the wheels"] += 1
                return False
            self._writer.add_ticks(stamp, *ticks)
        return True

    def _skip(self, reason: str, message: Message) -> None:
        self._bag.skip(reason, f"{message.topic} at {message.time}")


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


def _mounted(
    bag: BagReader, rig: StereoRig, chosen: Chosen, asked: Asked, notes: list[str]
) -> StereoRig:
    """The rig with the mount that tf tells, where the rig itself tells none."""
    if rig.mount is not None:
        return rig
    frames = Frames()
    static = [t.name for t in chosen.transforms if "static" in t.name]
    for message in bag.messages(static):
        frames.take(message.content)
    first = bag.first(chosen.left.name)
    camera = first.header.frame_id if first is not None else ""
    found = frames.mount(camera, asked.base)
    unknown = "its mount is taken as level, 0.3 m up (beemap calibrate mount finds it)"
    if found is None:
        if asked.base is not None:
            raise InputError(
                f"--base {asked.base}: not above the camera's frame '{camera}' in tf_static "
                f"(above it: {', '.join(frames.above(camera)[1:]) or 'none'})"
            )
        notes.append(f"no tf_static leads from the robot to the camera's '{camera}': {unknown}")
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
