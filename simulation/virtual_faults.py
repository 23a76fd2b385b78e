"""Faults of the virtual rig: what breaks, when, how long: `unplug@12s`, `stall-left@5s:2s`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from simulation.errors import SimulationError

# kind -> (usual length [s], what happens)
ENCODER_FAULTS = {
    "unplug": (3.0, "the encoders' cable is pulled and put back"),
    "move": (3.0, "the same, and the port comes back under another name"),
    "garbage": (0.5, "noise among the encoders' bytes, torn lines"),
    "restart": (1.0, "the encoders' board restarts: counters begin at 0"),
    "wrap": (0.0, "the left counter wraps at this time"),
    "mute": (2.0, "the encoders say nothing"),
}
CAMERA_FAULTS = {
    "stall": (1.5, "no images"),
    "drop": (0.5, "images are lost"),
    "corrupt": (0.5, "images are cut short or scrambled"),
    "lost": (2.0, "the connection breaks and is refused"),
    "skew": (0.0, "the right image comes late by this much, for 5 s"),
}
FAULTS = {**ENCODER_FAULTS, **CAMERA_FAULTS}
SIDES = ("left", "right")
SKEW_FOR, USUAL_SKEW = 5.0, 0.030  # s

_FAULT = re.compile(r"([a-z]+)(?:-(left|right))?@([0-9]+\.?[0-9]*)s?(?::([0-9]+\.?[0-9]*)(ms|s)?)?")


@dataclass(frozen=True)
class Fault:
    """kind: of `FAULTS`; begin, length: seconds of the drive; side: of a camera, None: both;
    late: of a skew [s]."""

    kind: str
    begin: float
    length: float
    side: str | None = None
    late: float = 0.0

    def during(self, seconds: float) -> bool:
        """Whether it holds at that time of the drive."""
        return self.begin <= seconds < self.begin + self.length

    def strikes(self, side: str) -> bool:
        """Whether it is about that camera."""
        return self.kind in CAMERA_FAULTS and self.side in (None, side)


def parse_fault(text: str) -> Fault:
    """The fault in `KIND[-left|-right]@TIMEs[:LENGTH[ms|s]]`.

    Raises:
        SimulationError: it is none; names the known ones.
    """
    match = _FAULT.fullmatch(text.strip())
    if match is None or match[1] not in FAULTS:
        raise SimulationError(
            f"--fault {text}: write KIND@TIME[:LENGTH], as unplug@12s or stall-left@5s:2s; kinds: "
            + ", ".join(FAULTS)
        )
    kind, side, begin, length, unit = match.groups()
    if side is not None and kind not in CAMERA_FAULTS:
        raise SimulationError(f"--fault {text}: {kind} is of the encoders: leave -{side} out")
    value = None if length is None else float(length) / (1000.0 if unit == "ms" else 1.0)
    if kind == "skew":
        return Fault(kind, float(begin), SKEW_FOR, "right", USUAL_SKEW if value is None else value)
    usual = FAULTS[kind][0]
    return Fault(kind, float(begin), usual if value is None else value, side)


def active(faults: tuple[Fault, ...], kind: str, seconds: float, side: str | None = None) -> bool:
    """Whether a fault of that kind holds at that time of the drive."""
    return any(
        fault.kind == kind and fault.during(seconds) and (side is None or fault.strikes(side))
        for fault in faults
    )
