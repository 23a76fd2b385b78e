"""Which serial device the encoders are, as the section `devices` of a rig names it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from odometry.encoders import EncoderParameters
from odometry.errors import OdometryError
from odometry.protocols.arduino_bridge import ArduinoBridgeProtocol
from odometry.protocols.base import EncoderProtocol
from odometry.protocols.odrive import ODriveProtocol
from odometry.protocols.roboclaw import RoboClawProtocol
from odometry.protocols.stream import FIELDS, StreamProtocol

ProtocolName = Literal["stream", "arduino_bridge", "roboclaw", "odrive"]
Positive = Annotated[float, Meta(gt=0.0)]

USUAL_BAUD = {
    "stream": StreamProtocol.baud,
    "arduino_bridge": ArduinoBridgeProtocol.baud,
    "roboclaw": RoboClawProtocol.baud,
    "odrive": ODriveProtocol.baud,
}


class EncoderDevice(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The encoders' part of `devices` in rig.yaml; all but `encoders` may be left out.

    encoders: the port, as /dev/ttyUSB0, or a pattern that one port matches, as
    /dev/serial/by-id/usb-Arduino*.
    baud: None: what is usual for the protocol. rate: polls a second. dtr: False for boards that
    must not restart when the port is opened (those with USB of their own then stay silent).
    fields, units, checked: of `stream` (see its module); checked is for `odrive`, too.
    counts_per_unit: counts of `ticks_per_revolution` in one unit that the device sends: a metre
    where units are metres, a turn of an ODrive's motor. None: as if wheel and encoder were one.
    address, command: of `roboclaw`; axes: left and right, of `odrive`.
    """

    encoders: Annotated[str, Meta(min_length=1)]
    protocol: ProtocolName = "stream"
    baud: Annotated[int, Meta(ge=300, le=12_000_000)] | None = None
    rate: Annotated[float, Meta(gt=0.0, le=500.0)] = 50.0
    dtr: bool = True
    fields: tuple[str, ...] | None = None
    units: Literal["ticks", "metres"] = "ticks"
    checked: bool = False
    counts_per_unit: Positive | None = None
    address: Annotated[int, Meta(ge=0x80, le=0x87)] = 0x80
    command: Literal[78, 16] = 78
    axes: tuple[Annotated[int, Meta(ge=0, le=9)], Annotated[int, Meta(ge=0, le=9)]] = (0, 1)

    @property
    def usual_baud(self) -> int:
        """The baud rate to open the port with."""
        return self.baud if self.baud is not None else USUAL_BAUD[self.protocol]


# Names in `devices` that are the encoders'; all others belong to the cameras.
ENCODER_FIELDS = frozenset(EncoderDevice.__struct_fields__)


def encoder_device(devices: Any, source: str) -> EncoderDevice:
    """The encoders of the section `devices` of a rig; fields that are not theirs are passed over.

    Raises:
        OdometryError: no encoders are named, or a field is wrong; `source` is named.
    """
    if not isinstance(devices, dict) or devices.get("encoders") is None:
        raise OdometryError(
            f"{source}: devices.encoders: missing: name the port, as in "
            "devices: {encoders: /dev/ttyUSB0, protocol: stream, baud: 115200}"
        )
    ours = {key: value for key, value in devices.items() if key in ENCODER_FIELDS}
    try:
        device = msgspec.convert(ours, EncoderDevice)
    except msgspec.ValidationError as error:
        reason, _, where = str(error).partition(" - at `$")
        raise OdometryError(f"{source}: devices{where.rstrip('`')}: {reason}") from None
    _check_fields(device, source)
    if device.axes[0] == device.axes[1]:
        raise OdometryError(f"{source}: devices.axes: {list(device.axes)}: two axes are needed")
    return device


def make_protocol(device: EncoderDevice, parameters: EncoderParameters) -> EncoderProtocol:
    """The state machine that speaks with this device."""
    if device.protocol == "arduino_bridge":
        return ArduinoBridgeProtocol()
    if device.protocol == "roboclaw":
        return RoboClawProtocol(device.address, both=device.command == 78)
    if device.protocol == "odrive":
        turns = device.counts_per_unit or parameters.ticks_per_revolution
        return ODriveProtocol((turns, turns), device.axes, device.checked, parameters.counter_bits)
    return StreamProtocol(
        device.fields, _metres(device, parameters), device.checked, parameters.counter_bits
    )


def _metres(device: EncoderDevice, parameters: EncoderParameters) -> tuple[float, float] | None:
    if device.units == "ticks":
        return None
    if device.counts_per_unit is not None:
        return device.counts_per_unit, device.counts_per_unit
    left, right = (1.0 / np.abs(parameters.metres_per_tick)).tolist()
    return left, right


def _check_fields(device: EncoderDevice, source: str) -> None:
    if device.fields is None:
        return
    wrong = [name for name in device.fields if name not in FIELDS]
    times = sum(name.startswith("time") for name in device.fields)
    once = device.fields.count("left") == device.fields.count("right") == 1
    if wrong or not once or times > 1:
        raise OdometryError(
            f"{source}: devices.fields: {list(device.fields)}: name every field of the line in "
            f"order, of {', '.join(FIELDS)}; left and right once, at most one time"
        )
