"""Serial ports: found, opened, and what a user must do when they cannot be."""

from __future__ import annotations

import errno
import glob
import os
import stat
from dataclasses import dataclass
from pathlib import Path

import serial
from serial.tools import list_ports

from odometry.devices import EncoderDevice
from odometry.errors import OdometryError

try:
    from termios import error as TerminalError  # noqa: N812
except ImportError:  # no termios on Windows, where pyserial raises OSErrors only
    TerminalError = OSError

# serial.SerialException is an OSError; pyserial raises TypeError where a port was closed meanwhile.
DEVICE_ERRORS = (OSError, TerminalError)

READ_TIMEOUT_S = 0.1
PATTERN = "*?["


@dataclass(frozen=True)
class UsbIdentity:
    """What stays the same when a device comes back under another name."""

    vid: int
    pid: int
    serial_number: str | None


def identity_of(port: str) -> UsbIdentity | None:
    """Of the USB device behind a port; None where there is none."""
    real = os.path.realpath(port)
    for found in list_ports.comports():
        if found.device in (port, real) and found.vid is not None and found.pid is not None:
            return UsbIdentity(found.vid, found.pid, found.serial_number)
    return None


def find_port(named: str, identity: UsbIdentity | None = None) -> str:
    """The port to open: as named, the one that matches the pattern, or the same device again.

    identity: of a device that was lost; it may have come back under another name.

    Raises:
        OdometryError: there is none, or several match.
    """
    if identity is not None:
        again = [
            found.device
            for found in list_ports.comports()
            if UsbIdentity(found.vid or 0, found.pid or 0, found.serial_number) == identity
        ]
        if len(again) == 1:
            return again[0]
    if not any(character in named for character in PATTERN):
        return named
    # Two links to one device are one port.
    matching = list({os.path.realpath(path): path for path in sorted(glob.glob(named))}.values())
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise OdometryError(
            f"{named}: {len(matching)} ports match ({', '.join(sorted(matching))}): name one"
        )
    raise OdometryError(f"{named}: no port matches; {present()}")


def open_port(port: str, device: EncoderDevice) -> serial.Serial:
    """An open port, for nobody else at the same time.

    Raises:
        OdometryError: it cannot be opened, and what to do about it.
    """
    line = serial.Serial()
    line.port, line.baudrate, line.timeout = port, device.usual_baud, READ_TIMEOUT_S
    line.write_timeout = 1.0
    line.exclusive = True if os.name == "posix" else None
    line.dtr = device.dtr  # before it is opened: a board restarts when the line changes
    try:
        line.open()
    except (*DEVICE_ERRORS, ValueError) as error:
        raise OdometryError(_why(port, device, error)) from None
    return line


def present() -> str:
    """The serial ports that are there, in words."""
    ports = sorted(
        f"{found.device}" + (f" ({found.description})" if found.vid is not None else "")
        for found in list_ports.comports()
    )
    return f"serial ports present: {', '.join(ports)}" if ports else "no serial port is present"


def _why(port: str, device: EncoderDevice, error: BaseException) -> str:
    code = getattr(error, "errno", None)
    if not os.path.exists(port) and os.name == "posix":
        return f"{port}: no such port: check the cable; {present()}"
    if code == errno.EACCES or not os.access(port, os.R_OK | os.W_OK):
        return (
            f"{port}: permission denied: 'sudo usermod -aG {_group(port)} $USER', then log in again"
        )
    if code in (errno.EBUSY, errno.EWOULDBLOCK) or "exclusively lock" in str(error):
        return f"{port}: busy: another program has it open (end it, e.g. a serial monitor)"
    if isinstance(error, ValueError):
        return f"{port}: cannot be opened at {device.usual_baud} baud: give another baud ({error})"
    if code == errno.ENOTTY or not stat.S_ISCHR(Path(port).stat().st_mode):
        return f"{port}: is not a serial port; {present()}"
    return f"{port}: cannot be opened ({error}): check the cable and the port's name"


def _group(port: str) -> str:
    """The group that may use a port; dialout where it cannot be told."""
    try:
        return Path(port).group()
    except (OSError, KeyError, NotImplementedError):
        return "dialout"
