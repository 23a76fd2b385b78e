"""What a board behind a serial line sends: answers, streamed lines, and a pty to send them on."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from odometry.encoders import EncoderParameters
from odometry.protocols.stream import checksum_of

WHEELS = EncoderParameters(2000, 0.075, 0.075, 0.3, 16)
FINE = EncoderParameters(2000, 0.075, 0.075, 0.3, 32)


def checked(body: bytes) -> bytes:
    """A body with its checksum."""
    return body + b"*%d" % checksum_of(body)


def sketch_line(t_us: int, left: int, right: int) -> bytes:
    """What docs/arduino/encoders.ino prints: `%lu,%ld,%ld*%u\\r\\n` with 32-bit numbers."""
    signed = [(n + (1 << 31)) % (1 << 32) - (1 << 31) for n in (left, right)]
    return checked(b"%d,%d,%d" % (t_us % (1 << 32), *signed)) + b"\r\n"


class Board:
    """A pty whose far end answers as `answer(bytes)` says; `unplug` takes it away."""

    def __init__(self, link: str, answer: Callable[[bytes], bytes] | None = None) -> None:
        import pty

        self.master, slave = pty.openpty()
        tty.setraw(slave)
        os.symlink(os.ttyname(slave), link)
        self._slave, self._link, self._answer = slave, link, answer
        self._thread = threading.Thread(target=self._run, daemon=True)
        if answer is not None:
            self._thread.start()

    def send(self, data: bytes) -> None:
        """Let bytes arrive at the host."""
        os.write(self.master, data)

    def unplug(self) -> None:
        """The device is gone, its name too."""
        os.unlink(self._link)
        os.close(self._slave)
        os.close(self.master)

    def _run(self) -> None:
        assert self._answer is not None
        while True:
            try:
                data = os.read(self.master, 1000)
                os.write(self.master, self._answer(data))
            except OSError:
                return


@contextmanager
def board(link: str, answer: Callable[[bytes], bytes] | None = None) -> Iterator[Board]:
    """A board that is unplugged at the end, if it has not been."""
    made = Board(link, answer)
    try:
        yield made
    finally:
        if os.path.islink(link):
            made.unplug()
