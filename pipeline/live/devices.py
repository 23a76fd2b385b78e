"""LiveRig: what a rig file says of the devices, all of it checked before any is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calibration.device_rig import DeviceRig, load_device_rig
from odometry.devices import ENCODER_FIELDS, EncoderDevice, encoder_device
from odometry.encoders import EncoderParameters, encoder_parameters
from pipeline.errors import InputError
from stereo.camera_settings import CAMERA_KEYS, CameraSettings, camera_settings


@dataclass(frozen=True, eq=False)
class LiveRig:
    """device and parameters: of the encoders; None where the rig has none."""

    source: DeviceRig
    cameras: CameraSettings
    device: EncoderDevice | None
    parameters: EncoderParameters | None

    def wheels(self) -> tuple[EncoderDevice, EncoderParameters]:
        """The encoders. Raises InputError where the rig has none."""
        if self.device is None or self.parameters is None:
            raise InputError(
                f"{self.source.source}: devices names no encoders: add encoders: /dev/ttyUSB0 and "
                "protocol, and the section encoders"
            )
        return self.device, self.parameters


def load_live_rig(path: Path) -> LiveRig:
    """Read and check a rig file with devices.

    Raises:
        RigError, InputError, StereoError, OdometryError: naming the file and the field.
    """
    source = load_device_rig(path)
    known = {*CAMERA_KEYS, *ENCODER_FIELDS}
    for key in source.devices:
        if key not in known:
            raise InputError(
                f"{path}: unknown field 'devices.{key}' (known: {', '.join(sorted(known))})"
            )
    cameras = camera_settings(source.devices, str(path))
    device = parameters = None
    if source.devices.get("encoders") is not None:
        device = encoder_device(source.devices, str(path))
        if source.encoders is None:
            raise InputError(
                f"{path}: the section 'encoders' is missing: ticks_per_revolution, left_radius, "
                "right_radius, track, counter_bits"
            )
        parameters = encoder_parameters(source.encoders, f"{path}: encoders")
    return LiveRig(source, cameras, device, parameters)
