"""Which rig a recording is read with; and what describes a rig file on the command line."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calibration.device_rig import load_device_rig
from calibration.exchange.formats import KINDS, read_rig
from calibration.rig import Mount, RigError, StereoRig, load_rig
from pipeline.errors import InputError
from pipeline.recordings.base import BROKEN_RIG, Recording

# What a new calibration of the cameras does not touch in the rig file that it replaces.
KEPT_SECTIONS = ("encoders", "devices")
NO_MOUNT = (
    "the rig has no mount: the camera is taken as level, 0.3 m above the floor, at the robot's "
    "origin; 'beemap calibrate mount' finds it, or write height, pitch, roll under 'mount:' in "
    "the rig file"
)


def choose_rig(recording: Recording, path: Path | None) -> tuple[StereoRig, list[str]]:
    """The rig file given, of any known format, else the recording's own; and notes that the user
    must hear.

    Raises:
        InputError: there is neither; RigError: the file is wrong.
    """
    notes = []
    if path is not None:
        found = read_rig(path)
        rig, notes = found.rig, found.notes
        if found.kind != "beemap":
            notes.append(f"{path}: read as {KINDS[found.kind]}")
        if recording.rig is not None:
            notes.append(f"{path} is used instead of the recording's {recording.rig_source}")
    elif recording.rig is not None:
        rig = recording.rig
    else:
        broken = "; ".join(recording.skipped.get(BROKEN_RIG, []))
        raise InputError(
            (broken or f"{recording.path}: holds no calibration")
            + ": give --rig rig.yaml ('beemap calibrate cameras' makes one)"
        )
    if rig.mount is None:
        notes.append(NO_MOUNT)
        rig = rig.with_mount(Mount())
    return rig, notes


@dataclass(frozen=True)
class Replaced:
    """What a rig file that will be replaced holds beside its cameras' calibration."""

    mount: Mount | None
    sections: dict[str, Any]


def with_kept(rig: StereoRig, replaced: Replaced | None) -> tuple[StereoRig, list[str]]:
    """The rig with what only the rig that it replaces knows; and the names of that."""
    if replaced is None:
        return rig, []
    kept = [
        name for name in KEPT_SECTIONS if name in replaced.sections and name not in rig.sections
    ]
    sections = {**{name: replaced.sections[name] for name in kept}, **rig.sections}
    if rig.mount is None and replaced.mount is not None:
        kept.insert(0, "mount")
    return replace(rig, mount=rig.mount or replaced.mount, sections=sections), kept


def rig_to_replace(output: Path) -> Replaced:
    """What must not be lost of a rig file that will be replaced, calibrated or not.

    Raises:
        InputError: it cannot be read.
    """
    try:
        rig = load_rig(output)
        return Replaced(rig.mount, rig.sections)
    except RigError as error:
        try:
            found = load_device_rig(output)
        except RigError:
            raise InputError(f"{error}: mend or delete it, its mount would be lost") from None
    sections = {"devices": found.devices, "encoders": found.encoders}
    return Replaced(None, {name: part for name, part in sections.items() if part is not None})


def size_option(text: str | None, option: str = "--size") -> tuple[int, int] | None:
    """(width, height) px in `640x480`.

    Raises:
        InputError: it is something else.
    """
    if text is None:
        return None
    match = re.fullmatch(r"([1-9][0-9]{0,5})[xX]([1-9][0-9]{0,5})", text.strip())
    if match is None:
        raise InputError(f"{option} {text}: expected WIDTHxHEIGHT in pixels, as in 640x480")
    return int(match[1]), int(match[2])


def length_option(text: str | None, option: str) -> float | None:
    """Metres in a length with its unit, as `25mm`.

    Raises:
        CalibrationError: it is something else.
    """
    from calibration.board import parse_length

    return None if text is None else parse_length(text, option)
