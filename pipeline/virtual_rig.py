"""A recording as the drive of a virtual rig, and the rig file that leads to it."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.rig import StereoRig, save_rig
from pipeline.encoder_sheet import encoder_sheet
from pipeline.errors import InputError
from pipeline.recordings.base import PairFiles, Recording
from simulation.virtual_drive import RecordedDrive
from simulation.virtual_rig import VirtualRig

JPEG_QUALITY = 95  # of images that are none


def recorded_drive(recording: Recording) -> tuple[RecordedDrive, StereoRig]:
    """What a virtual rig plays, and its calibration.

    Raises:
        InputError: the recording has no pairs of image files, no ticks or no calibration.
    """
    pairs = [pair for pair in recording.pairs if isinstance(pair, PairFiles)]
    if not pairs or recording.rig is None:
        raise InputError(f"{recording.path}: a virtual rig needs image files and a calibration")
    if recording.ticks is None or recording.encoders is None:
        raise InputError(f"{recording.path}: a virtual rig needs wheel ticks (odom0)")
    ticks = recording.ticks
    drive = RecordedDrive(
        np.array([pair.stamp for pair in pairs], np.int64),
        lambda number: (_jpeg(pairs[number].left), _jpeg(pairs[number].right)),
        ticks.stamps,
        np.stack([ticks.left, ticks.right], axis=1),
        recording.encoders,
    )
    return drive, recording.rig


def write_rig_file(file: Path, rig: StereoRig, virtual: VirtualRig, calibrated: bool) -> None:
    """The file to give to `beemap live`."""
    encoders = replace(virtual.drive.encoders, counter_bits=virtual.encoders.bits)
    devices = {**virtual.devices, "size": list(rig.image_size)}
    sections = {"encoders": encoder_sheet(encoders), "devices": devices}
    if calibrated:
        save_rig(replace(rig, sections=sections), file)
        return
    from calibration.yamlfile import dump_yaml

    partial = file.with_name(file.name + ".part")
    partial.write_text(dump_yaml({"beemap_rig": 1, **sections}), encoding="utf-8")
    os.replace(partial, file)


def _jpeg(file: Path) -> bytes:
    data = file.read_bytes()
    if file.suffix.lower() in (".jpg", ".jpeg"):
        return data
    import cv2

    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR)
    if image is None:
        return b""
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
