r"""The streamed encoder line: `[t_us,]left,right[*checksum]\n`, or as `fields` say.

t_us is the micro-controller's clock in microseconds; left and right are its counters. The
checksum is the decimal XOR of all bytes before the `*` (the rule of GCode). Commas, semicolons,
tabs and blanks part the fields. `#` begins a remark of the firmware. docs/encoders.md holds a
sketch that sends such lines.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import reduce
from operator import xor

from odometry.protocols.base import Banner, LineProtocol, Sample

FIELDS = ("time_us", "time_ms", "left", "right", "skip")
# Wheel paths and turns are rounded to whole counts of the rig; more of them are nonsense.
MOST_COUNTS = 2.0**62

_PLAIN = re.compile(rb"(?:(\d{1,18})[,;\s]\s*)?([-+]?\d{1,10})\s*[,;\s]\s*([-+]?\d{1,10})\s*")
_PARTS = re.compile(rb"\s*[,;\s]\s*")
_WHOLE = re.compile(rb"[-+]?\d{1,18}")
_REAL = re.compile(rb"[-+]?(?:\d{1,18}\.?\d{0,18}|\.\d{1,18})(?:[eE][-+]?\d{1,2})?")


class StreamProtocol(LineProtocol):
    """Lines that come by themselves.

    Args:
        fields: the names of all fields in order, of `FIELDS`; None: `left,right`, with the time
            [us] before them where there are three.
        counts_per_unit: what one unit of left and right is in counts; None: they are counts.
        checked: refuse lines without a checksum.
        counter_bits: after which counts made from units wrap.
    """

    baud = 115200

    def __init__(
        self,
        fields: Sequence[str] | None = None,
        counts_per_unit: tuple[float, float] | None = None,
        checked: bool = False,
        counter_bits: int = 32,
    ) -> None:
        super().__init__()
        self._fields = None if fields is None else tuple(fields)
        self._scale = counts_per_unit
        self._checked = checked
        self._bits = counter_bits

    def line(self, line: bytes) -> Sample | Banner | None:
        """One line without its end."""
        body, star, checksum = line.partition(b"*")
        if line.startswith(b"#"):
            return Banner(line.decode("ascii", "replace"))
        if (star or self._checked) and not checksum_holds(body, checksum):
            self.counts["checksum"] += 1
            return None
        plain = self._fields is None and self._scale is None
        sample = self._plain(body) if plain else self._mapped(body)
        return self.useless(line) if sample is None else sample

    def _plain(self, body: bytes) -> Sample | None:
        match = _PLAIN.fullmatch(body)
        if match is None:
            return None
        t_us, left, right = match.groups()
        return Sample(int(left), int(right), None if t_us is None else int(t_us))

    def _mapped(self, body: bytes) -> Sample | None:
        parts = _PARTS.split(body.strip())
        names = self._fields or ("time_us", "left", "right")[-min(len(parts), 3) :]
        if len(parts) != len(names) or len(parts) < 2:
            return None
        told = dict(zip(names, parts, strict=True))
        time = told.get("time_us", told.get("time_ms"))
        if time is not None and not (_WHOLE.fullmatch(time) and int(time) >= 0):
            return None
        factor = 1000 if "time_ms" in told else 1
        counts = [self._count(told[name], side) for side, name in enumerate(("left", "right"))]
        if counts[0] is None or counts[1] is None:
            return None
        return Sample(counts[0], counts[1], None if time is None else factor * int(time))

    def _count(self, text: bytes, side: int) -> int | None:
        if self._scale is None:
            return int(text) if _WHOLE.fullmatch(text) else None
        return counts_of(text, self._scale[side], self._bits)


def counts_of(text: bytes, counts_per_unit: float, counter_bits: int) -> int | None:
    """A real number, in units of `counts_per_unit` counts, as a wrapping counter would show it;
    None: it is no number."""
    if not _REAL.fullmatch(text):
        return None
    value = float(text) * counts_per_unit
    return round(value) % (1 << counter_bits) if abs(value) < MOST_COUNTS else None


def checksum_of(body: bytes) -> int:
    """XOR of all bytes."""
    return reduce(xor, body, 0)


def checksum_holds(body: bytes, checksum: bytes) -> bool:
    """Whether the decimal after the `*` is the XOR of the bytes before it."""
    checksum = checksum.strip()
    return len(checksum) <= 3 and checksum.isdigit() and int(checksum) == checksum_of(body)
