"""Encoders read live, in a thread of their own, through unplugging and restarts.

    device = encoder_device(rig.sections["devices"], "rig.yaml")
    with open_encoders(device, parameters, settings, raw_log=Path("serial.log")) as encoders:
        encoders.wait_ready(5.0)                     # OdometryError: why nothing comes
        while running:
            if encoders.wait_until(image_stamp, timeout_s=0.2):
                for reading in encoders.readings():  # TickReading, new ones, oldest first
                    ...
            log(encoders.events())                   # messages in words, new ones
    encoders.report()                                # counts of all that happened

Several consumers take a tap each: `tap = encoders.tap()` has `readings()` and `wait_until()` of
its own. `replay_encoders` offers the same from a raw log.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from pathlib import Path

import serial

from odometry.counters import Limits, TickReading
from odometry.decoder import EncoderDecoder
from odometry.devices import EncoderDevice, make_protocol
from odometry.encoders import EncoderParameters
from odometry.errors import OdometryError
from odometry.ports import (
    DEVICE_ERRORS,
    UsbIdentity,
    find_port,
    identity_of,
    open_port,
)
from odometry.raw_log import LOST, OPENED, RECEIVED, SENT, LineEvent, RawLog, read_raw_log
from odometry.settings import OdometrySettings

# A streamed chunk is let grow for a while, the longer one where chunks follow one another within
# BUSY_NS, so that many short lines cost few wake-ups [s].
GATHER_S = (0.002, 0.012)
BUSY_NS = 18_000_000
BACK_OFF_S = (0.2, 5.0)  # first and longest wait before a lost device is tried again
MOST_UNREAD = 200_000  # readings that a tap keeps for a consumer who does not come


class Tap:
    """The readings for one consumer; at most `MOST_UNREAD` of them wait, the oldest go first."""

    def __init__(self, news: threading.Condition) -> None:
        self._news = news
        self._waiting: deque[TickReading] = deque(maxlen=MOST_UNREAD)
        self._latest: int | None = None
        self._ended = False

    def readings(self) -> list[TickReading]:
        """Those that arrived since the last call, oldest first; never waits."""
        with self._news:
            new = list(self._waiting)
            self._waiting.clear()
        return new

    def wait_until(self, stamp: int, timeout_s: float) -> bool:
        """Wait until a reading at or after `stamp` [ns] has arrived; False: it did not in time."""
        with self._news:
            self._news.wait_for(lambda: self._reached(stamp) or self._ended, timeout_s)
            return self._reached(stamp)

    def _reached(self, stamp: int) -> bool:
        return self._latest is not None and self._latest >= stamp

    def _put(self, readings: list[TickReading]) -> None:
        self._waiting.extend(readings)
        self._latest = readings[-1].stamp

    def _end(self) -> None:
        self._ended = True


class Encoders:
    """What live and replayed encoders share: taps, events, report."""

    def __init__(self, decoder: EncoderDecoder) -> None:
        self._decoder = decoder
        self._news = threading.Condition()
        self._own = Tap(self._news)
        self._taps = [self._own]
        self._read = 0

    def tap(self) -> Tap:
        """A consumer of its own for the readings from now on."""
        with self._news:
            self._taps.append(Tap(self._news))
            return self._taps[-1]

    def taps(self, count: int) -> list[Tap]:
        """So many taps that begin with the same reading."""
        with self._news:
            new = [Tap(self._news) for _ in range(count)]
            self._taps += new
            return new

    def readings(self) -> list[TickReading]:
        """As `Tap.readings`."""
        return self._own.readings()

    def wait_until(self, stamp: int, timeout_s: float) -> bool:
        """As `Tap.wait_until`."""
        return self._own.wait_until(stamp, timeout_s)

    def events(self) -> list[str]:
        """Messages in words since the last call, for the log and the user."""
        with self._news:
            return self._decoder.events()

    def report(self) -> dict[str, int]:
        """Readings so far and how often what went wrong; what never happened is left out."""
        with self._news:
            return {"readings": self._read, **self._decoder.report()}

    def _take(self, event: LineEvent) -> None:
        with self._news:
            if readings := self._decoder.take(event):
                self._read += len(readings)
                for tap in self._taps:
                    tap._put(readings)
                self._news.notify_all()

    def _say(self, message: str) -> None:
        with self._news:
            self._decoder.say(f"encoders: {message}")

    def _finish(self) -> None:
        with self._news:
            for tap in self._taps:
                tap._end()
            self._news.notify_all()


class LiveEncoders(Encoders):
    """Encoders on a serial port; made by `open_encoders`, ended by `close`."""

    def __init__(
        self, device: EncoderDevice, decoder: EncoderDecoder, port: str, log: RawLog | None
    ) -> None:
        super().__init__(decoder)
        self._device = device
        self._log = log
        self._port = port
        self._identity: UsbIdentity | None = identity_of(port)
        self._line: serial.Serial | None = open_port(port, device)
        self._chunk = 0  # when the last one came
        self._stop = threading.Event()
        self._event(OPENED, port.encode())
        self._thread = threading.Thread(target=self._run, name=f"encoders {port}", daemon=True)
        self._thread.start()

    @property
    def connected(self) -> bool:
        """Whether the port is open."""
        return self._line is not None

    def wait_ready(self, timeout_s: float) -> None:
        """Wait for the first reading.

        Raises:
            OdometryError: none came in time: why, and what to do.
        """
        if self.wait_until(0, timeout_s):
            return
        with self._news:
            advice = self._decoder.advice()
        baud, protocol = self._device.usual_baud, self._device.protocol
        if advice is None:
            advice = "no answer: check power and cable"
        raise OdometryError(
            f"{self._port}: no reading within {timeout_s:g} s at {baud} baud by protocol "
            f"'{protocol}': {advice}: give protocol and baud of the firmware in the rig's devices"
        )

    def close(self) -> None:
        """Stop reading and close the port; returns within about a read's timeout."""
        self._stop.set()
        self._thread.join()
        if self._line is not None:
            self._line.close()
            self._line = None
        if self._log is not None:
            self._log.close()
        self._finish()

    def __enter__(self) -> LiveEncoders:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            line = self._line
            try:
                if line is None:
                    self._reopen()
                else:
                    self._exchange(line)
            except DEVICE_ERRORS as error:
                self._line = None
                if line is not None:
                    _close(line)
                words = f"{self._port}: the device was lost ({error}): trying to reopen it"
                self._event(LOST, words.encode("utf-8", "replace"))

    def _exchange(self, line: serial.Serial) -> None:
        now = time.monotonic_ns()
        request = self._decoder.due(now)
        if request is not None:
            self._event(SENT, request)
            line.write(request)
        polled = bool(self._decoder.protocol.requests)
        if polled and not self._decoder.protocol.waiting:
            self._stop.wait(self._decoder.wait_s(time.monotonic_ns()))
            return
        data = line.read(1)
        if not data:
            return
        if not polled:
            time.sleep(GATHER_S[time.monotonic_ns() - self._chunk < BUSY_NS])
        stamp = self._chunk = time.monotonic_ns()
        if waiting := line.in_waiting:
            data += line.read(waiting)
        self._event(RECEIVED, data, stamp)

    def _reopen(self) -> None:
        """Try again and again, ever more seldom, until the device is back or reading ends."""
        wait, longest = BACK_OFF_S
        while not self._stop.wait(wait):
            try:
                self._port = find_port(self._device.encoders, self._identity)
                line = open_port(self._port, self._device)
            except OdometryError:
                wait = min(2.0 * wait, longest)
                continue
            self._event(OPENED, self._port.encode())
            self._line = line
            return

    def _event(self, kind: str, data: bytes, stamp: int | None = None) -> None:
        event = LineEvent(time.monotonic_ns() if stamp is None else stamp, kind, data)
        if self._log is not None:
            self._log.add(event)
            if self._log.error is not None:
                self._say(self._log.error)
                self._log.close()
                self._log = None
        self._take(event)


def open_encoders(
    device: EncoderDevice,
    parameters: EncoderParameters,
    settings: OdometrySettings,
    raw_log: Path | None = None,
) -> LiveEncoders:
    """Open the encoders' port and start reading.

    Raises:
        OdometryError: the port cannot be opened (absent, busy, not permitted), or `raw_log`
            is there already.
    """
    port = find_port(device.encoders)
    log = None if raw_log is None else RawLog(raw_log)
    try:
        return LiveEncoders(device, _decoder(device, parameters, settings), port, log)
    except BaseException:
        if log is not None:
            log.close()
            Path(raw_log or "").unlink(missing_ok=True)
        raise


def replay_encoders(
    path: Path, device: EncoderDevice, parameters: EncoderParameters, settings: OdometrySettings
) -> Encoders:
    """The encoders of a run that was logged: all its readings, events and counts at once.

    Raises:
        OdometryError: the log cannot be read.
    """
    encoders = Encoders(_decoder(device, parameters, settings))
    encoders._own._waiting = deque()  # all of them, however many
    for event in read_raw_log(path):
        if event is None:
            encoders._decoder.counts["damaged_log_lines"] += 1
        else:
            encoders._take(event)
    encoders._finish()
    return encoders


def _decoder(
    device: EncoderDevice, parameters: EncoderParameters, settings: OdometrySettings
) -> EncoderDecoder:
    limits = Limits(parameters, settings.max_speed)
    return EncoderDecoder(make_protocol(device, parameters), limits, device.rate)


def _close(line: serial.Serial) -> None:
    try:
        line.close()
    except DEVICE_ERRORS:
        return  # it is gone anyway
