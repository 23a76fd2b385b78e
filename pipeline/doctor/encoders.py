"""The encoders: does the port open, the protocol answer, do the counters rise?"""

from __future__ import annotations

import numpy as np

from pipeline.doctor.check import FAIL, PASS, WARN, Check, failed
from pipeline.doctor.watch import Watched
from pipeline.live.devices import LiveRig

# Of the readings that may be damaged.
DAMAGED = 0.01
SLOW = 10.0  # readings a second
MOVED = 0.03  # m of a wheel that tell a direction


def encoder_checks(rig: LiveRig, seen: Watched) -> list[Check]:
    """Port, protocol, direction."""
    if rig.device is None:
        return [
            Check(
                "encoders",
                WARN,
                "the rig names none",
                "add devices.encoders, or map with motion from the images",
            )
        ]
    if seen.encoder_error is not None:
        return [failed("encoders", seen.encoder_error)]
    return [_rate(rig, seen), _direction(rig, seen)]


def _rate(rig: LiveRig, seen: Watched) -> Check:
    assert rig.device is not None
    count = len(seen.readings)
    rate = count / max(seen.seconds, 1e-3)
    wrong = {name: n for name, n in seen.encoders.items() if name != "readings"}
    told = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in wrong.items())
    found = f"{rate:.0f} readings a second by '{rig.device.protocol}'"
    found += f" ({told})" if told else ""
    if rate < SLOW:
        return Check("encoders", WARN, found, "let the firmware send 20 or more a second")
    if sum(wrong.values()) > DAMAGED * count:
        return Check("encoders", WARN, found, "check baud rate, cable and its shield")
    return Check("encoders", PASS, found)


def _direction(rig: LiveRig, seen: Watched) -> Check:
    """Which counter fell while the robot was pushed forward."""
    assert rig.parameters is not None
    name = "direction"
    if len(seen.readings) < 2:
        return Check(name, WARN, "no readings to tell")
    first, last = seen.readings[0], seen.readings[-1]
    counts = np.array([last.left_total - first.left_total, last.right_total - first.right_total])
    left, right = counts * rig.parameters.metres_per_tick
    found = f"left wheel {left:+.2f} m, right wheel {right:+.2f} m"
    if max(abs(left), abs(right)) < MOVED:
        return Check(name, WARN, "the wheels stood still", "push the robot forward meanwhile")
    if min(left, right) > 0:
        return Check(name, PASS, found)
    fell = [bool(value < 0) for value in (left, right)]
    flags = [f != r for f, r in zip(rig.parameters.reversed, fell, strict=True)]
    words = " and ".join(side for side, f in zip(("left", "right"), fell, strict=True) if f)
    if not any(fell):
        still = "left" if left == 0 else "right"
        return Check(name, WARN, found, f"the {still} counter stands: check its cable")
    return Check(
        name,
        FAIL,
        f"{found}: the {words} counter fell",
        f"if it was pushed forward, set encoders.reversed: {str(flags).lower()}",
    )
