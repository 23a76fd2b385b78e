"""What every protocol is: bytes in, samples out, and what to send when it is polled. No I/O."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import Counter
from typing import NamedTuple

MAX_LINE = 128

# What a board prints when it starts: words, not a number or two and not line noise.
_WORDS = re.compile(rb"[\x09\x20-\x7e]*[A-Za-z]{2}[\x09\x20-\x7e]*")


class Sample(NamedTuple):
    """One reading: raw counters, and the sender's clock where it sends one [us]."""

    left: int
    right: int
    t_us: int | None = None


class Banner(NamedTuple):
    """Words that were no answer: the board may have restarted."""

    text: str


class EncoderProtocol(ABC):
    """A state machine that turns bytes, however they are cut into chunks, into samples.

    It neither reads nor waits, holds a bounded number of bytes and raises nothing, whatever the
    bytes: garbage is counted in `counts` by name (`garbled`, `checksum`, ...).

    A protocol that is polled gives the `requests` of one cycle; each is announced by `expect`
    when it is sent, and answered when `feed` has turned `waiting` false. The last answer of a
    cycle completes the sample. A protocol that streams has no requests.
    """

    baud: int  # usual one
    startup_s = 0.0  # a board that restarts when its port is opened must not be asked before

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.waiting = False

    @property
    def requests(self) -> tuple[bytes, ...]:
        """What to send in one cycle, each after the answer to the one before."""
        return ()

    @abstractmethod
    def restart(self) -> None:
        """Forget all halves: the port was opened, or an answer did not come."""

    def expect(self, request: bytes) -> None:
        """A request has been sent."""
        del request
        self.waiting = True

    @abstractmethod
    def feed(self, data: bytes) -> list[Sample | Banner]:
        """What these bytes complete, in order."""


class LineSplitter:
    """Cuts a stream of bytes into lines, however it arrives in chunks.

    Keeps at most `MAX_LINE` bytes between chunks. A longer line is dropped and counted in
    `overlong`; blank lines are left out.
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
            elif line := line.strip():
                lines.append(line)
        if self._dropping or len(rest) > MAX_LINE:
            self._dropping, rest = True, b""
        self._rest = rest
        return lines

    def clear(self) -> None:
        """Forget a line that has begun."""
        self._rest, self._dropping = b"", False


class LineProtocol(EncoderProtocol):
    """A protocol made of lines: blank ones are nothing, words a banner, the rest is judged."""

    def __init__(self) -> None:
        super().__init__()
        self._splitter = LineSplitter()

    def restart(self) -> None:
        """Forget a line that has begun."""
        self._splitter.clear()
        self.waiting = False

    def feed(self, data: bytes) -> list[Sample | Banner]:
        """The samples and banners in the lines that these bytes complete."""
        items: list[Sample | Banner] = []
        before = self._splitter.overlong
        for line in self._splitter.feed(data):
            item = self.line(line)
            if item is not None:
                items.append(item)
        self.counts["garbled"] += self._splitter.overlong - before
        return items

    @abstractmethod
    def line(self, line: bytes) -> Sample | Banner | None:
        """What one line says, without blanks about it; what is of no use is counted."""

    def useless(self, line: bytes) -> Banner | None:
        """A line that is no answer: words are a banner, all else is garbled."""
        if _WORDS.fullmatch(line):
            return Banner(line.decode("ascii"))
        self.counts["garbled"] += 1
        return None
