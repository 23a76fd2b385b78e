"""What the wheel encoders are: ticks, wheels, track; and their counters made continuous."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from odometry.errors import OdometryError

# Field: (least, most, meaning). Wider than any robot this is meant for, and narrow enough to
# catch millimetres given for metres.
LIMITS = {
    "ticks_per_revolution": (1.0, 1e7, "counts of one turn of a wheel, gear included"),
    "left_radius": (0.001, 2.0, "m"),
    "right_radius": (0.001, 2.0, "m"),
    "track": (0.01, 5.0, "m between the two wheels' points of contact"),
}
TIME_OFFSET = (-2.0, 2.0, "s, added to the stamps of the counters")
COUNTER_BITS = (12, 32)


@dataclass(frozen=True)
class EncoderParameters:
    """Two wheel encoders of a differential drive; lengths in metres.

    counter_bits: width of the counters as read, after which they wrap.
    reversed: (left, right), true where the counter falls while the robot drives forward.
    time_offset: to be added to the stamps of the counters, that they agree with the images' [s].
    """

    ticks_per_revolution: float
    left_radius: float
    right_radius: float
    track: float
    counter_bits: int
    reversed: tuple[bool, bool] = (False, False)
    time_offset: float = 0.0

    @property
    def metres_per_tick(self) -> np.ndarray:
        """(2,) signed path of the left and right wheel for one count [m]."""
        circumference = 2.0 * math.pi * np.array([self.left_radius, self.right_radius])
        sign = np.where(self.reversed, -1.0, 1.0)
        return sign * circumference / self.ticks_per_revolution


def encoder_parameters(data: Any, source: str) -> EncoderParameters:
    """Check the `encoders` section of a rig, or the content of `odom0/sensor.yaml`.

    Raises:
        OdometryError: a field is missing, unknown or out of range; `source` is named.
    """
    if not isinstance(data, dict):
        raise OdometryError(f"{source}: expected the fields {', '.join(LIMITS)}, counter_bits")
    known = {*LIMITS, "counter_bits", "reversed", "time_offset", "sensor_type", "comment"}
    for key in data:
        if key not in known:
            raise OdometryError(
                f"{source}: unknown field '{key}' (known: {', '.join(sorted(known))})"
            )
    if data.get("sensor_type", "encoders") != "encoders":
        raise OdometryError(
            f"{source}: sensor_type is {data['sensor_type']!r}; wheel ticks need 'encoders'"
        )
    return EncoderParameters(
        **{key: _number(data, key, *limits, source) for key, limits in LIMITS.items()},
        counter_bits=_counter_bits(data, source),
        reversed=_reversed(data, source),
        time_offset=_number({"time_offset": 0.0, **data}, "time_offset", *TIME_OFFSET, source),
    )


def encoder_section(parameters: EncoderParameters) -> dict[str, Any]:
    """The `encoders` section of a rig with these parameters; what is usual is left out."""
    section = {key: getattr(parameters, key) for key in LIMITS}
    section["counter_bits"] = parameters.counter_bits
    if any(parameters.reversed):
        section["reversed"] = list(parameters.reversed)
    if parameters.time_offset:
        section["time_offset"] = parameters.time_offset
    return section


def shortest_difference(difference, counter_bits: int):
    """Difference(s) of two counter readings, as whole numbers, with any wrap taken out.

    Right as long as a wheel turns by less than half the counter's range between the readings.
    """
    half = 1 << (counter_bits - 1)
    return (difference + half) % (2 * half) - half


def unwrap_counts(raw: np.ndarray, counter_bits: int) -> np.ndarray:
    """Counter readings (n,) made continuous: int64 (n,) that begins at raw[0]."""
    steps = shortest_difference(np.diff(raw), counter_bits)
    return np.concatenate([raw[:1], raw[:1] + np.cumsum(steps)])


def within_counter(raw, counter_bits: int):
    """Which reading(s) a counter of that width can show, be it signed or unsigned."""
    return (raw >= -(1 << (counter_bits - 1))) & (raw < 1 << counter_bits)


def _number(data: dict, key: str, least: float, most: float, meaning: str, source: str) -> float:
    if key not in data:
        raise OdometryError(f"{source}: field '{key}' is missing ({meaning})")
    value = data[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise OdometryError(f"{source}: {key}: {value!r} is not a number ({meaning})")
    if not least <= value <= most:
        raise OdometryError(
            f"{source}: {key}: {value} is out of range: give {least:g} to {most:g} ({meaning})"
        )
    return float(value)


def _counter_bits(data: dict, source: str) -> int:
    least, most = COUNTER_BITS
    value = data.get("counter_bits")
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise OdometryError(
            f"{source}: counter_bits: {value!r}; give a whole number from {least} to {most} "
            "(the width after which the counters wrap)"
        )
    return value


def _reversed(data: dict, source: str) -> tuple[bool, bool]:
    value = data.get("reversed", [False, False])
    if (
        not isinstance(value, (list, tuple))
        or len(value) != 2
        or not all(isinstance(v, bool) for v in value)
    ):
        raise OdometryError(
            f"{source}: reversed: {value!r}; give [left, right], each true or false"
        )
    return (value[0], value[1])
