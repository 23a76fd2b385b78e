r"""The streamed encoder line: `[t_us,]left,right[*checksum]\n`.

t_us is the micro-controller's clock in microseconds; left and right are its counters. The
checksum is the decimal XOR of all bytes before the `*` (the rule of GCode). `#` begins a
remark of the firmware, which is passed over like a blank line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import reduce
from operator import xor

MAX_LINE = 128

_LINE = re.compile(rb"\s*(?:(\d{1,18})\s*,)?\s*([-+]?\d{1,10})\s*,\s*([-+]?\d{1,10})\s*")


@dataclass(frozen=True)
class EncoderLine:
    """One reading: raw counters, and the sender's clock [us] where it sends one."""

    left: int
    right: int
    t_us: int | None = None


def parse_line(line: bytes) -> EncoderLine | None:
    """The reading in one line without its newline; None for garbage, whatever the bytes."""
    body, star, checksum = line.partition(b"*")
    if star and not _checksum_holds(body, checksum.strip()):
        return None
    match = _LINE.fullmatch(body)
    if match is None:
        return None
    t_us, left, right = match.groups()
    return EncoderLine(int(left), int(right), None if t_us is None else int(t_us))


def _checksum_holds(body: bytes, checksum: bytes) -> bool:
    return re.fullmatch(rb"\d{1,3}", checksum) is not None and int(checksum) == reduce(xor, body, 0)


class LineSplitter:
    """Cuts a stream of bytes into lines, however it arrives in chunks.

    Keeps at most `MAX_LINE` bytes between chunks. A longer line is dropped and counted in
    `overlong`; blank lines and remarks are left out.
    """

    def __init__(self) -> None:
        self.overlong = 0
        self._rest = b""
        self._dropping = False

    def feed(self, chunk: bytes) -> list[bytes]:
        """The lines that this chunk completes, without their ends."""
        *complete, rest = (self._rest + chunk).split(b"\n")
        lines = []
        for line in complete:
            if self._dropping or len(line) > MAX_LINE:
                self.overlong += 1
                self._dropping = False
            elif line.strip() and not line.lstrip().startswith(b"#"):
                lines.append(line)
        if self._dropping or len(rest) > MAX_LINE:
            self._dropping, rest = True, b""
        self._rest = rest
        return lines
