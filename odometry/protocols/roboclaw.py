"""RoboClaw packet serial: binary, with a CRC16 over request and answer.

Command 78 asks for both counters: 8 bytes, big-endian, and the CRC. Commands 16 (M1) and 17 (M2)
ask for one each: 4 bytes, a status byte and the CRC; older firmware knows only these.
M1 is taken as the left motor.
"""

from __future__ import annotations

import binascii

from odometry.protocols.base import Banner, EncoderProtocol, Sample

BOTH = 78
SINGLE = (16, 17)
ANSWER_SIZE = {BOTH: 10, 16: 7, 17: 7}


class RoboClawProtocol(EncoderProtocol):
    """Polled; bytes outside an answer are `unasked`, answers with a wrong CRC `checksum`.

    Args:
        address: 0x80 to 0x87; both: ask with command 78, else with 16 and 17.
    """

    baud = 38400

    def __init__(self, address: int = 0x80, both: bool = True) -> None:
        super().__init__()
        self._address = address
        self._commands = (BOTH,) if both else SINGLE
        self._command = 0
        self._answer = b""
        self._left: int | None = None

    @property
    def requests(self) -> tuple[bytes, ...]:
        """Reading needs no CRC from the host."""
        return tuple(bytes((self._address, command)) for command in self._commands)

    def restart(self) -> None:
        """Forget a begun answer and a lone left counter."""
        self._answer, self._left, self.waiting = b"", None, False

    def expect(self, request: bytes) -> None:
        """The next bytes answer this request."""
        self._command = request[1] if len(request) == 2 and request[1] in ANSWER_SIZE else 0
        self._answer, self.waiting = b"", self._command != 0

    def feed(self, data: bytes) -> list[Sample | Banner]:
        """At most one answer, as long as one is awaited."""
        if not self.waiting:
            self.counts["unasked"] += bool(data)
            return []
        size = ANSWER_SIZE[self._command]
        missing = size - len(self._answer)
        self._answer += data[:missing]
        if len(self._answer) < size:
            return []
        self.waiting = False
        self.counts["unasked"] += len(data) > missing
        body, crc = self._answer[:-2], self._answer[-2:]
        if binascii.crc_hqx(bytes((self._address, self._command)) + body, 0) != int.from_bytes(crc):
            self.counts["checksum"] += 1
            self._left = None
            return []
        return self._decoded(body)

    def _decoded(self, body: bytes) -> list[Sample | Banner]:
        first = int.from_bytes(body[:4])
        if self._command == BOTH:
            return [Sample(first, int.from_bytes(body[4:]))]
        if self._command == SINGLE[0]:
            self._left = first
            return []
        left, self._left = self._left, None
        return [] if left is None else [Sample(left, first)]
