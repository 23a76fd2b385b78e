"""The cameras: do they open, how often and how much together, is the light right?"""

from __future__ import annotations

import numpy as np

from pipeline.doctor.check import FAIL, PASS, WARN, Check, failed
from pipeline.doctor.watch import Watched
from pipeline.live.devices import LiveRig
from stereo.errors import StereoError

SLOW = 0.9  # of the wanted rate
SKEW_MS, BAD_SKEW_MS = 5.0, 20.0
DARK, BRIGHT = 40.0, 215.0  # mean grey
BURNT = 0.10  # share of white pixels
UNLIKE = 0.25  # difference of the mean greys over their mean
LOOKED_AT = 5  # pairs


def camera_checks(rig: LiveRig, seen: Watched) -> list[Check]:
    """Open, rate, skew, light."""
    if seen.camera_error is not None:
        return [failed("cameras", seen.camera_error)]
    if not seen.pairs:
        counts = seen.cameras.counts if seen.cameras else {}
        frames = ", ".join(f"{name} {c['frames']} images" for name, c in counts.items())
        return [Check("cameras", FAIL, f"no pair ({frames})", "are both running, in step?")]
    return [_rate(rig, seen), _skew(seen), _light(seen)]


def _rate(rig: LiveRig, seen: Watched) -> Check:
    assert seen.cameras is not None
    stamps = np.array([pair.stamp for pair in seen.pairs])
    rate = 1e9 / float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    size = seen.size()
    found = f"{size[0]}x{size[1]} at {rate:.1f} pairs a second" if size else f"{rate:.1f} pairs/s"
    dropped = sum(counts["dropped"] for counts in seen.cameras.counts.values())
    backwards = seen.cameras.backwards
    if dropped or backwards or seen.cameras.lonely > 2:
        found += f", {dropped} images lost, {seen.cameras.lonely} without a partner"
        found += f", {backwards} pairs stamped no later than the one before" if backwards else ""
        return Check("cameras", WARN, found, "a bus of its own for each camera, or fewer a second")
    if rate < SLOW * rig.cameras.fps:
        found += f" of {rig.cameras.fps:g} wanted"
        return Check("cameras", WARN, found, "more light (shorter exposure), or a lower fps")
    return Check("cameras", PASS, found)


def _skew(seen: Watched) -> Check:
    assert seen.cameras is not None
    median, most = seen.cameras.skew_ms
    found = f"right {median:+.1f} ms after left, 95 % within {most:.1f} ms"
    remedy = "drive slowly, or take cameras that expose together"
    if most > BAD_SKEW_MS:
        return Check("skew", FAIL, found, remedy)
    return Check("skew", WARN, found, remedy) if most > SKEW_MS else Check("skew", PASS, found)


def _light(seen: Watched) -> Check:
    greys, burnt = [], 0.0
    for pair in seen.pairs[:: max(1, len(seen.pairs) // LOOKED_AT)]:
        try:
            loaded = pair.load()
        except StereoError:
            continue
        greys.append([float(image.mean()) for image in (loaded.left, loaded.right)])
        burnt = max(burnt, *(float((i > 250).mean()) for i in (loaded.left, loaded.right)))
    if not greys:
        return Check("exposure", FAIL, "no image can be decoded", "check the cables")
    left, right = np.mean(greys, axis=0).tolist()
    found = f"mean grey {left:.0f} left, {right:.0f} right, {burnt:.0%} burnt out"
    if min(left, right) < DARK:
        return Check("exposure", WARN, found, "more light, or a longer devices.exposure")
    if max(left, right) > BRIGHT or burnt > BURNT:
        return Check("exposure", WARN, found, "a shorter devices.exposure")
    if abs(left - right) > UNLIKE * 0.5 * (left + right):
        return Check("exposure", WARN, found, "fix the same devices.exposure for both")
    return Check("exposure", PASS, found)
