r"""ros_arduino_bridge: `e\r` is answered by `<left> <right>\r\n`, decimal signed 32-bit counters.

Commands end with a carriage return only. What it does not know it answers by `Invalid Command`.
Most boards restart when their port is opened and must not be spoken to for a second or two.
"""

from __future__ import annotations

import re

from odometry.protocols.base import Banner, LineProtocol, Sample

_ANSWER = re.compile(rb"([-+]?\d{1,10})[ \t]+([-+]?\d{1,10})")


class ArduinoBridgeProtocol(LineProtocol):
    """Polled; see the module."""

    baud = 57600
    startup_s = 2.0

    @property
    def requests(self) -> tuple[bytes, ...]:
        """Both counters at once."""
        return (b"e\r",)

    def line(self, line: bytes) -> Sample | Banner | None:
        """One line of the firmware without its end."""
        if line in (b"OK", b"Invalid Command"):
            self.counts["refused"] += line != b"OK"
            self.waiting = False
            return None
        match = _ANSWER.fullmatch(line)
        if match is None:
            return self.useless(line)
        self.waiting = False
        return Sample(int(match[1]), int(match[2]))
