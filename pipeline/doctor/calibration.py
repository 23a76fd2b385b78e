"""The calibration: is there one, for this image size, and does it still hold?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

from calibration.rig import StereoRig
from pipeline.doctor.check import FAIL, PASS, WARN, Check
from pipeline.doctor.watch import Watched
from pipeline.errors import InputError
from pipeline.live.devices import LiveRig
from pipeline.recordings.base import RecordedPair, Recording
from pipeline.rig_check import check_rig
from stereo.errors import StereoError

PAIRS = 8  # looked at
NAME = "calibration"


def calibration_checks(rig: LiveRig, seen: Watched) -> list[Check]:
    """One check, or none where no image came."""
    found = rig.source.rig
    if found is None:
        remedy = f"'beemap calibrate capture {rig.source.source}' makes one"
        return [Check(NAME, WARN, "none yet", remedy)]
    if not seen.pairs:
        return [Check(NAME, WARN, f"for {_size(found.image_size)}; no image to compare")]
    size = seen.size()
    if size is not None and size != tuple(found.image_size):
        told = f"for {_size(found.image_size)}, the cameras send {_size(size)}"
        return [Check(NAME, FAIL, told, "set devices.size, or calibrate at this size")]
    mount = Check("mount", PASS, "in the rig")
    if found.mount is None:
        mount = Check("mount", WARN, "not in the rig", "'beemap calibrate mount' finds it")
    return [_holds(found, rig.source.source, seen), mount]


def _holds(rig: StereoRig, source: str, seen: Watched) -> Check:
    pairs = cast("Sequence[RecordedPair]", seen.pairs)
    recording = Recording(Path(source), "live", pairs)
    try:
        drift = check_rig(rig, recording, PAIRS, lambda done, total: None)
    except (StereoError, InputError) as error:
        return Check(NAME, WARN, " ".join(str(error).split()), "look at a scene with texture")
    rows = drift.rows.systematic
    found = f"rows agree within {rows:.2f} px (limit {drift.limit:.2f})"
    if drift.drifted:
        return Check(NAME, FAIL, found, "it has drifted: calibrate again")
    return Check(NAME, PASS, found)


def _size(size: Sequence[int]) -> str:
    return f"{size[0]}x{size[1]}"
