"""A rig file as live runs read it: the devices, and the calibration where there is one yet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.rig import (
    CALIBRATED,
    FIELDS,
    SECTIONS,
    RigError,
    StereoRig,
    check_keys,
    check_version,
    rig_from_dict,
)
from calibration.yamlfile import YamlFileError, parse_yaml, read_text


@dataclass(frozen=True, eq=False)
class DeviceRig:
    """source: the file's name; text: the file as it is; devices, encoders: its sections, not
    checked here; rig: None before the cameras are calibrated."""

    source: str
    text: str
    devices: dict[str, Any]
    encoders: dict[str, Any] | None
    rig: StereoRig | None

    def calibrated(self) -> StereoRig:
        """The rig. Raises RigError with the remedy where there is none yet."""
        if self.rig is None:
            raise not_calibrated(self.source)
        return self.rig


def load_device_rig(path: str | Path) -> DeviceRig:
    """Read a rig file that names its devices, calibrated or not.

    Raises:
        RigError: no rig file, no devices, or a wrong field; the message names it.
    """
    try:
        text = read_text(Path(path))
        data = parse_yaml(text, str(path))
    except YamlFileError as error:
        raise RigError(str(error)) from None
    return device_rig_from_dict(data, str(path), text)


def device_rig_from_dict(data: Any, source: str, text: str) -> DeviceRig:
    """The same from the file's parsed content."""
    check_version(data, source)
    check_keys(data, FIELDS + SECTIONS, source)
    devices, encoders = data.get("devices"), data.get("encoders")
    if not isinstance(devices, dict) or not devices:
        raise RigError(
            f"{source}: names no devices: add the line 'devices: {{left: /dev/video0, right: "
            "/dev/video2, encoders: /dev/ttyUSB0, protocol: stream, baud: 115200}'"
        )
    if encoders is not None and not isinstance(encoders, dict):
        raise RigError(f"{source}: encoders: {encoders!r} is not a section of named values")
    calibrated = any(key in data for key in CALIBRATED)
    rig = rig_from_dict(data, source) if calibrated else None
    return DeviceRig(source, text, devices, encoders, rig)


def not_calibrated(source: str) -> RigError:
    """The error of what needs a calibration."""
    return RigError(
        f"{source}: the cameras are not calibrated yet: run 'beemap calibrate capture {source} "
        "-o shots --board ... --square ...'"
    )
