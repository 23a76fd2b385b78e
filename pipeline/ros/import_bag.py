"""A bag becomes a recording: images as they are, odometry, wheels, beside the rig of the plan.

Everything is streamed: a message is written before the next one is read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from odometry.encoders import encoder_section
from pipeline.recordings.asl import LAST_STAMP
from pipeline.recordings.asl_writer import AslWriter
from pipeline.ros.bags import BagReader, Message
from pipeline.ros.frames import yaw_of
from pipeline.ros.images import DamagedImageError, ImageFiles
from pipeline.ros.import_plan import Plan
from pipeline.ros.types import stamp_of
from pipeline.ros.wheels import ticks_of


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
