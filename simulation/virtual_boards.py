"""Encoder boards as they speak: counts in, bytes of each protocol out. No I/O."""

from __future__ import annotations

import binascii
from abc import ABC, abstractmethod
from functools import reduce
from operator import xor

import numpy as np

BANNER = b"# virtual encoders\r\n"


class Board(ABC):
    """counter_bits: width of its counters; streams: it sends lines by itself."""

    counter_bits: int | None = None  # None: as the rig's
    streams = False
    banner = b""

    def __init__(self) -> None:
        self._rest = b""

    def line(self, t_us: int, counts: np.ndarray) -> bytes:
        """What a streaming board sends now."""
        del t_us, counts
        return b""

    def answers(self, data: bytes, counts: np.ndarray) -> bytes:
        """What it replies to these bytes, with its counters standing at `counts` (2,)."""
        *requests, self._rest = (self._rest + data).split(self.ending)
        self._rest = self._rest[-64:]
        return b"".join(self.answer(request.strip(), counts) for request in requests)

    ending = b"\n"

    @abstractmethod
    def answer(self, request: bytes, counts: np.ndarray) -> bytes:
        """The reply to one whole request."""


class StreamBoard(Board):
    """`t_us,left,right*xor` lines."""

    streams = True
    banner = BANNER

    def line(self, t_us: int, counts: np.ndarray) -> bytes:
        """One line."""
        body = b"%d,%d,%d" % (t_us % (1 << 32), counts[0], counts[1])
        return b"%s*%d\n" % (body, reduce(xor, body))

    def answer(self, request: bytes, counts: np.ndarray) -> bytes:
        """It is not asked."""
        del request, counts
        return b""


class ArduinoBridgeBoard(Board):
    """ros_arduino_bridge's firmware."""

    ending = b"\r"

    def answer(self, request: bytes, counts: np.ndarray) -> bytes:
        """`e`: counters, `b`: baud rate, `r`: OK."""
        fixed = {b"b": b"57600\r\n", b"r": b"OK\r\n"}
        if request == b"e":
            return b"%d %d\r\n" % (counts[0], counts[1])
        return fixed.get(request, b"Invalid Command\r\n")


class RoboClawBoard(Board):
    """RoboClaw packet serial: commands 78, and 16 and 17."""

    counter_bits = 32

    def answers(self, data: bytes, counts: np.ndarray) -> bytes:
        """Requests are two bytes; what is none is passed over."""
        self._rest += data
        out = b""
        while len(self._rest) >= 2:
            request, self._rest = self._rest[:2], self._rest[2:]
            out += self.answer(request, counts)
        return out

    def answer(self, request: bytes, counts: np.ndarray) -> bytes:
        """Big-endian counters with the CRC16 over request and reply."""
        left, right = (int(c) % (1 << 32) for c in counts)
        bodies = {
            78: left.to_bytes(4) + right.to_bytes(4),
            16: left.to_bytes(4) + b"\x00",
            17: right.to_bytes(4) + b"\x00",
        }
        body = bodies.get(request[1])
        if body is None:
            return b""
        return body + binascii.crc_hqx(request + body, 0).to_bytes(2)


class ODriveBoard(Board):
    """ODrive ASCII: `f <axis>` gives turns and turns a second.

    counts_per_turn: of the wheels' encoders.
    """

    counter_bits = 32

    def __init__(self, counts_per_turn: float) -> None:
        super().__init__()
        self._scale = counts_per_turn

    def answer(self, request: bytes, counts: np.ndarray) -> bytes:
        """Feedback of one axis, with a checksum where one came."""
        body, star, _ = request.partition(b"*")
        if body not in (b"f 0", b"f 1"):
            return b""
        turns = float(np.int32(counts[int(body[2:])])) / self._scale
        reply = b"%.6f 0.000000" % turns
        return reply + (b"*%d" % reduce(xor, reply) if star else b"") + b"\r\n"


def make_board(protocol: str, counts_per_turn: float) -> Board:
    """The board that speaks a protocol: stream, arduino_bridge, roboclaw or odrive."""
    if protocol == "odrive":
        return ODriveBoard(counts_per_turn)
    kinds = {"stream": StreamBoard, "arduino_bridge": ArduinoBridgeBoard, "roboclaw": RoboClawBoard}
    return kinds[protocol]()


PROTOCOLS = ("stream", "arduino_bridge", "roboclaw", "odrive")
