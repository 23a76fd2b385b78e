r"""ODrive ASCII: `f <axis>\n` is answered by `<position turns> <speed turns/s>\n`.

A request with `*<xor>` gets an answer with one. Axis 0 is taken as the left wheel. Positions are
single-precision turns of the motor: resolution is lost after some ten thousand of them.
"""

from __future__ import annotations

import re

from odometry.protocols.base import Banner, LineProtocol, Sample
from odometry.protocols.stream import checksum_holds, checksum_of, counts_of

_ANSWER = re.compile(rb"(\S+)[ \t]+(\S+)")


class ODriveProtocol(LineProtocol):
    """Polled, one request an axis.

    Args:
        counts_per_turn: counts of the rig's encoders in one turn of each motor.
        axes: of the left and the right wheel; checked: with checksums both ways.
        counter_bits: after which the counts wrap.
    """

    baud = 115200

    def __init__(
        self,
        counts_per_turn: tuple[float, float],
        axes: tuple[int, int] = (0, 1),
        checked: bool = False,
        counter_bits: int = 32,
    ) -> None:
        super().__init__()
        self._scale = counts_per_turn
        self._checked = checked
        self._bits = counter_bits
        self._requests = tuple(self._request(axis) for axis in axes)
        self._asked = 0
        self._left: int | None = None

    def _request(self, axis: int) -> bytes:
        body = b"f %d" % axis
        return body + (b"*%d\n" % checksum_of(body) if self._checked else b"\n")

    @property
    def requests(self) -> tuple[bytes, ...]:
        """Feedback of the left axis, then of the right one."""
        return self._requests

    def restart(self) -> None:
        """Forget a begun line and a lone left position."""
        super().restart()
        self._left = None

    def expect(self, request: bytes) -> None:
        """The next line answers this request."""
        self._asked = self._requests.index(request) if request in self._requests else 0
        self.waiting = True

    def line(self, line: bytes) -> Sample | Banner | None:
        """One line without its end."""
        body, star, checksum = line.partition(b"*")
        if (star or self._checked) and not checksum_holds(body, checksum):
            self.counts["checksum"] += 1
            return None
        match = _ANSWER.fullmatch(body.strip())
        scale = self._scale[self._asked]
        count = None if match is None else counts_of(match[1], scale, self._bits)
        if match is None or count is None or counts_of(match[2], 1.0, self._bits) is None:
            return self.useless(line)
        if not self.waiting:
            self.counts["unasked"] += 1
            return None
        self.waiting = False
        if self._asked == 0:
            self._left = count
            return None
        left, self._left = self._left, None
        return None if left is None else Sample(left, count)
