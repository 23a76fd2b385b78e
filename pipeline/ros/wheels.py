"""Wheel angles of sensor_msgs/JointState as ticks."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from odometry.encoders import EncoderParameters
from pipeline.errors import InputError

# Fine enough that nothing of an angle is lost, where nobody says how fine the encoders are.
TICKS_PER_REVOLUTION = 65536.0
COUNTER_BITS = 32
LOOKED_AT = 50  # messages: several programs may tell joints on one topic


@dataclass(frozen=True)
class WheelJoints:
    """Names of the joints of the left and the right wheel."""

    left: str
    right: str


def find_wheels(messages: Iterable[Any], topic: str, names: str | None) -> WheelJoints | None:
    """The wheels among the first joint states; names: `LEFT,RIGHT` as the user gave them.

    None: nothing looks like two wheels.

    Raises:
        InputError: the joints named are not there, or names are no two.
    """
    told: dict[str, None] = {}
    for number, message in enumerate(messages):
        told.update(dict.fromkeys(message.name))
        if number >= LOOKED_AT:
            break
    if names is None:
        return _guessed(list(told))
    parts = [part.strip() for part in names.split(",")]
    missing = [part for part in parts if part not in told]
    if len(parts) != 2 or missing:
        raise InputError(
            f"--wheels {names}: give the joints of the left and the right wheel in {topic} "
            f"(there are: {', '.join(told) or 'none'})"
        )
    return WheelJoints(*parts)


def _guessed(names: list[str]) -> WheelJoints | None:
    wheels = [name for name in names if "wheel" in name.lower()] or names
    for left in sorted(wheels, key=lambda name: (len(name), name)):
        right = left.replace("left", "right").replace("Left", "Right")
        if right != left and right in names:
            return WheelJoints(left, right)
    return None


def ticks_of(
    message: Any, joints: WheelJoints, parameters: EncoderParameters
) -> tuple[int, int] | None:
    """The counters (left, right) at the angles of a message; None: it does not tell both.

    A wheel whose encoder counts backwards does so here, too: the sign is that of `parameters`.
    """
    names = list(message.name)
    counts = []
    for name, backwards in zip((joints.left, joints.right), parameters.reversed, strict=True):
        at = names.index(name) if name in names else -1
        if not 0 <= at < len(message.position) or not math.isfinite(message.position[at]):
            return None
        turns = float(message.position[at]) / (2.0 * math.pi)
        count = round((-turns if backwards else turns) * parameters.ticks_per_revolution)
        half = 1 << (parameters.counter_bits - 1)
        counts.append((count + half) % (2 * half) - half)
    return counts[0], counts[1]
