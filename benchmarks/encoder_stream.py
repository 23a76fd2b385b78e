"""A board with two encoders on a robot that drives about, as bytes with times; and its faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from odometry.encoders import EncoderParameters
from odometry.raw_log import LOST, OPENED, RECEIVED, SENT, LineEvent

MS = 1_000_000
STEP = 20 * MS
TRACK = 0.3

FAULTS = (
    "garbage",
    "torn lines",
    "wrong digits",
    "unplugged",
    "unplugged, restarted",
    "restart",
    "restart with words",
    "wrap",
    "stall",
    "sender's time jumps",
)
# A wrap is nothing to be told.
UNTOLD = {"wrap"}


def drive(steps: int, rng: np.random.Generator) -> np.ndarray:
    """Wheel paths (steps, 2) [m] every 20 ms: speeds that change smoothly, turns, stops."""
    knots = max(steps // 75, 4)
    speed = np.interp(
        np.linspace(0, knots - 1, steps), np.arange(knots), rng.uniform(0.0, 0.7, knots)
    )
    turn = np.interp(
        np.linspace(0, knots - 1, steps), np.arange(knots), rng.normal(0.0, 0.5, knots)
    )
    left, right = speed - 0.5 * TRACK * turn, speed + 0.5 * TRACK * turn
    return np.cumsum(np.stack([left, right], axis=1) * STEP / 1e9, axis=0)


def poses(paths: np.ndarray) -> np.ndarray:
    """True poses (n, 3) along wheel paths (n, 2), arc by arc."""
    left, right = np.diff(paths, axis=0, prepend=paths[:1]).T
    turn, travel = (right - left) / TRACK, 0.5 * (left + right)
    heading = np.cumsum(turn)
    chord = travel * np.sinc(turn / (2.0 * math.pi))
    along = heading - 0.5 * turn
    return np.stack(
        [np.cumsum(chord * np.cos(along)), np.cumsum(chord * np.sin(along)), heading], axis=1
    )


@dataclass
class Board:
    """Counts paths [m], and says so by a protocol, until something goes wrong.

    style: "sketch" (time, checksum), "plain" (left,right) or "poll" (arduino_bridge).
    """

    wheels: EncoderParameters
    style: str
    rng: np.random.Generator
    zero: np.ndarray = field(default_factory=lambda: np.zeros(2))
    clock_us: int = 0  # what its clock shows beyond the host's
    silent_until: int = 0
    absent_until: int | None = None
    words: bytes = b""
    spoil: int = 0  # lines still to be spoilt
    how: str = ""

    def fail(self, fault: str, now: int, path: np.ndarray) -> None:
        """Begin a fault of this kind."""
        pause = int(self.rng.uniform(0.8, 4.0) * 1e9)
        if fault in ("garbage", "torn lines", "wrong digits"):
            self.spoil, self.how = int(self.rng.integers(1, 6)), fault
        elif fault.startswith("unplugged"):
            self.absent_until = now + pause
            if fault.endswith("restarted"):
                self._restart(path, now)
        elif fault.startswith("restart"):
            self.silent_until = now + int(self.rng.uniform(0.2, 2.0) * 1e9)
            self._restart(path, now)
            self.words = b"# ready\r\n" if "words" in fault and self.style != "poll" else b""
        elif fault == "wrap":
            return  # counters of 12 and 16 bits wrap by themselves all the time
        elif fault == "stall":
            self.silent_until = now + pause
        else:
            self.clock_us += int(self.rng.choice([-1, 1]) * self.rng.uniform(1.0, 1e3) * 1e6)

    def _restart(self, path: np.ndarray, now: int) -> None:
        self.zero = path.copy()
        self.clock_us = -now // 1000

    def line(self, now: int, path: np.ndarray) -> bytes:
        """What it sends now."""
        if now < self.silent_until:
            return b""
        bits = self.wheels.counter_bits
        counts = np.floor((path - self.zero) / self.wheels.metres_per_tick).astype(int)
        left, right = (int(c) % (1 << bits) for c in counts)
        words, self.words = self.words, b""
        return words + self._spoilt(self._formatted(now, left, right))

    def _formatted(self, now: int, left: int, right: int) -> bytes:
        if self.style == "poll":
            return b"%d %d\r\n" % (left, right)
        if self.style == "plain":
            return b"%d,%d\n" % (left, right)
        body = b"%d,%d,%d" % ((now // 1000 + self.clock_us) % (1 << 32), left, right)
        checksum = 0
        for byte in body:
            checksum ^= byte
        return body + b"*%d\r\n" % checksum

    def _spoilt(self, line: bytes) -> bytes:
        if self.spoil == 0:
            return line
        self.spoil -= 1
        if self.how == "garbage":
            return self.rng.bytes(int(self.rng.integers(5, 200))) + b"\n" + line
        if self.how == "torn lines":
            cut = int(self.rng.integers(1, max(len(line) - 3, 2)))
            return line[cut:] if self.rng.random() < 0.5 else line[:cut] + b"\n"
        digits = [i for i, byte in enumerate(line.partition(b"*")[0]) if 48 <= byte < 58]
        place = digits[int(self.rng.integers(len(digits)))]
        digit = (line[place] - 48 + int(self.rng.integers(1, 10))) % 10
        return line[:place] + bytes([48 + digit]) + line[place + 1 :]


def events(board: Board, decoder, now: int, path: np.ndarray) -> list[LineEvent]:
    """What happens on the line in the step that begins `now` [ns]."""
    if board.absent_until is not None:
        if decoder._open:
            return [LineEvent(now, LOST, b"the device was lost")]
        if now < board.absent_until:
            return []
        board.absent_until = None
        return [LineEvent(now, OPENED, b"port")]
    delay = int(board.rng.uniform(1.0, 5.0) * MS)
    if board.style != "poll":
        data = board.line(now, path)
        return [LineEvent(now + delay, RECEIVED, data)] if data else []
    request = decoder.due(now)
    if request is None:
        return []
    answer = board.line(now, path)
    sent = LineEvent(now - delay // 2, SENT, request)
    return [sent, LineEvent(now + delay // 2, RECEIVED, answer)] if answer else [sent]
