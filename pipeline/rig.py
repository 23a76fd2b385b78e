"""Which rig a recording is read with."""

from __future__ import annotations

from pathlib import Path

from calibration.rig import Mount, StereoRig, load_rig
from pipeline.errors import InputError
from pipeline.recordings.base import Recording

NO_MOUNT = (
    "the rig has no mount: the camera is taken as level, 0.3 m above the floor, at the robot's "
    "origin; measure it and write height, pitch, roll under 'mount:' in the rig file that "
    "'beemap calibrate cameras' makes"
)


def choose_rig(recording: Recording, path: Path | None) -> tuple[StereoRig, list[str]]:
    """The rig file given, else the recording's own; and notes that the user must hear.

    Raises:
        InputError: there is neither; RigError: the file is wrong.
    """
    notes = []
    if path is not None:
        rig = load_rig(path)
        if recording.rig is not None:
            notes.append(f"{path} is used instead of the recording's {recording.rig_source}")
    elif recording.rig is not None:
        rig = recording.rig
    else:
        raise InputError(
            f"{recording.path}: holds no calibration: give --rig rig.yaml "
            "('beemap calibrate cameras' makes one)"
        )
    if rig.mount is None:
        notes.append(NO_MOUNT)
        rig = rig.with_mount(Mount())
    return rig, notes
