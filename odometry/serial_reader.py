"""SerialEncoderReader: wheel ticks from a serial port, read in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import serial

from odometry.clock import SenderClock
from odometry.encoders import shortest_difference, within_counter
from odometry.errors import OdometryError
from odometry.protocol import EncoderLine, LineSplitter, parse_line

try:
    from termios import error as TerminalError  # noqa: N812
except ImportError:  # no termios on Windows, where pyserial raises OSErrors only
    TerminalError = OSError

# serial.SerialException is an OSError.
DEVICE_ERRORS = (OSError, TerminalError)

READ_TIMEOUT_S = 0.1


@dataclass(frozen=True)
class SerialTicks:
    """One reading. stamp: host's monotonic clock [ns], strictly increasing.

    left, right: counters as read; left_total, right_total: the same made continuous.
    """

    stamp: int
    left: int
    right: int
    left_total: int
    right_total: int


class SerialEncoderReader:
    """Reads lines of ticks from a serial port until it is disconnected or the device is lost.

    Readings are stamped with the time their chunk of bytes arrived or, where the line carries
    the sender's clock, with that clock brought to the host's (`SenderClock`). Lines that
    `parse` refuses, and counts beyond `counter_bits`, are counted in `garbled`. A lost device
    ends the thread and shows in `error`; what arrived before stays readable.

        with SerialEncoderReader("/dev/ttyUSB0", counter_bits=16) as reader:
            while reader.wait(1.0):
                for reading in reader.ticks():
                    ...

    Args:
        parse: what a line means; None for garbage. Another line protocol is another parser.
    """

    def __init__(
        self,
        port: str,
        baud: int = 115200,
        counter_bits: int = 32,
        parse: Callable[[bytes], EncoderLine | None] = parse_line,
    ) -> None:
        self.port = port
        self.baud = baud
        self._bits = counter_bits
        self._parse = parse
        self._splitter = LineSplitter()
        self._clock = SenderClock()
        self._unparsed = 0
        self._last: SerialTicks | None = None
        self._arrived: list[SerialTicks] = []
        self._error: str | None = None
        self._news = threading.Condition()
        self._stop = threading.Event()
        self._serial: serial.Serial | None = None
        self._thread: threading.Thread | None = None

    def connect(self) -> None:
        """Open the port and start reading.

        Raises:
            OdometryError: the port cannot be opened.
        """
        try:
            self._serial = serial.Serial(self.port, self.baud, timeout=READ_TIMEOUT_S)
        except (*DEVICE_ERRORS, ValueError) as error:
            raise OdometryError(
                f"{self.port}: cannot be opened at {self.baud} baud ({error}): check the cable, "
                "the port's name and your right to use it (group dialout)"
            ) from None
        self._stop.clear()
        self._thread = threading.Thread(
            target=self._read, args=(self._serial,), name=f"encoders {self.port}", daemon=True
        )
        self._thread.start()

    def disconnect(self) -> None:
        """Stop reading and close the port; returns within about a read's timeout."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    def __enter__(self) -> SerialEncoderReader:
        self.connect()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.disconnect()

    @property
    def error(self) -> str | None:
        """Why reading ended by itself; None while all is well."""
        return self._error

    @property
    def garbled(self) -> int:
        """Lines so far that held no usable reading."""
        return self._unparsed + self._splitter.overlong

    def ticks(self) -> list[SerialTicks]:
        """The readings that arrived since the last call, oldest first; never waits."""
        with self._news:
            arrived, self._arrived = self._arrived, []
        return arrived

    def wait(self, timeout: float) -> bool:
        """Wait until readings are there; False after `timeout` seconds or a lost device."""
        with self._news:
            self._news.wait_for(lambda: self._arrived or self._error, timeout)
            return bool(self._arrived)

    def _read(self, port: serial.Serial) -> None:
        try:
            while not self._stop.is_set():
                # Wait for the first byte, then take all that is there.
                chunk = port.read(1)
                chunk += port.read(port.in_waiting)
                self._take(chunk, time.monotonic_ns())
        except DEVICE_ERRORS as error:
            with self._news:
                self._error = (
                    f"{self.port}: the encoders' device was lost ({error}): "
                    "check the cable and start again"
                )
                self._news.notify_all()

    def _take(self, chunk: bytes, arrival: int) -> None:
        readings = []
        for line in self._splitter.feed(chunk):
            parsed = self._parse(line)
            if parsed is None or not self._in_range(parsed):
                self._unparsed += 1
            else:
                readings.append(self._reading(parsed, arrival))
        if readings:
            with self._news:
                self._arrived += readings
                self._news.notify_all()

    def _in_range(self, line: EncoderLine) -> bool:
        return bool(within_counter([line.left, line.right], self._bits).all())

    def _reading(self, line: EncoderLine, arrival: int) -> SerialTicks:
        stamp = arrival if line.t_us is None else self._clock.host_time(line.t_us, arrival)
        last = self._last
        if last is None:
            totals = (line.left, line.right)
        else:
            # Lines that came in one chunk, and clocks, must not stop time or turn it back.
            stamp = max(stamp, last.stamp + 1)
            totals = (
                last.left_total + shortest_difference(line.left - last.left, self._bits),
                last.right_total + shortest_difference(line.right - last.right, self._bits),
            )
        self._last = SerialTicks(stamp, line.left, line.right, *totals)
        return self._last
