"""VirtualEncoders: an encoder board behind a pseudo-terminal, as a USB serial device would be."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
import tty
from pathlib import Path

import numpy as np

from simulation.virtual_boards import Board
from simulation.virtual_drive import Timeline
from simulation.virtual_faults import Fault, active

NAMES = ("ttyENC0", "ttyENC1")
MOST_RATE = 1000.0  # lines a second
LATE = 0.02  # s: lines that could not be sent in time are not made up for


class VirtualEncoders:
    """Serves the counters of a drive at `folder`/ttyENC0, a link to a pseudo-terminal.

    rate: lines a second of the drive, of a board that streams. Unplugged, the terminal is gone
    like a device; the port's name is taken away with it.
    """

    def __init__(
        self,
        folder: Path,
        timeline: Timeline,
        board: Board,
        faults: tuple[Fault, ...] = (),
        rate: float = 50.0,
    ) -> None:
        self.folder = folder
        self.bits = board.counter_bits or timeline.drive.encoders.counter_bits
        self._timeline = timeline
        self._board = board
        self._faults = faults
        self._rate = min(rate * timeline.speed, MOST_RATE)
        self._rng = np.random.default_rng((1, 7))
        self._fds: tuple[int, int] | None = None
        self._name = NAMES[0]
        self._offset = np.zeros(2, np.int64)
        self._restarted: set[float] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="virtual encoders", daemon=True)

    @property
    def pattern(self) -> str:
        """The port's name as a pattern that also fits after a move."""
        return str(self.folder / "ttyENC*")

    def start(self) -> None:
        """Plug it in."""
        for fault in self._faults:
            if fault.kind == "wrap":
                top = 1 << self.bits
                self._offset[:] = top - self._timeline.counts(fault.begin)[0]
        self._plug()
        self._thread.start()

    def stop(self) -> None:
        """Take it away."""
        self._stop.set()
        self._thread.join()
        self._unplug()

    def _plug(self) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._fds = (master, slave)
        link = self.folder / self._name
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        self._send(self._board.banner)

    def _unplug(self) -> None:
        fds, self._fds = self._fds, None
        (self.folder / self._name).unlink(missing_ok=True)
        for fd in fds or ():
            os.close(fd)

    def _run(self) -> None:
        next_line = time.monotonic()
        while not self._stop.is_set():
            seconds = self._timeline.seconds()
            self._replug(seconds)
            if self._fds is None:
                self._stop.wait(0.005)
                continue
            wait = max(0.0, next_line - time.monotonic()) if self._board.streams else 0.05
            ready, _, _ = select.select([self._fds[0]], [], [], min(wait, 0.05))
            if ready:
                self._reply()
            now = time.monotonic()
            if self._board.streams and now >= next_line:
                self._stream(now)
                next_line = max(next_line + 1.0 / self._rate, now - LATE)

    def _replug(self, seconds: float) -> None:
        out = any(active(self._faults, kind, seconds) for kind in ("unplug", "move"))
        if out and self._fds is not None:
            self._unplug()
        elif not out and self._fds is None:
            moved = [f for f in self._faults if f.kind == "move" and seconds >= f.begin]
            self._name = NAMES[len(moved) % 2]
            self._plug()

    def _counts(self, seconds: float) -> np.ndarray:
        """(2,) as the board's counters show them."""
        for fault in self._faults:
            end = fault.begin + fault.length
            if fault.kind == "restart" and seconds >= end and end not in self._restarted:
                self._restarted.add(end)
                self._offset = -self._timeline.counts(end)
                self._send(self._board.banner)
        return (self._timeline.counts(seconds) + self._offset) % (1 << self.bits)

    def _silent(self, seconds: float) -> bool:
        return any(active(self._faults, kind, seconds) for kind in ("restart", "mute"))

    def _stream(self, now: float) -> None:
        seconds = self._timeline.seconds()
        if not self._silent(seconds):
            line = self._board.line(int(now * 1e6), self._counts(seconds))
            self._send(self._noisy(line, seconds))

    def _reply(self) -> None:
        assert self._fds is not None
        data = b""
        with contextlib.suppress(OSError):
            data = os.read(self._fds[0], 4096)
        seconds = self._timeline.seconds()
        if data and not self._silent(seconds):
            self._send(self._noisy(self._board.answers(data, self._counts(seconds)), seconds))

    def _noisy(self, data: bytes, seconds: float) -> bytes:
        """Now and then torn, or with noise in it, while there is garbage on the line."""
        if not active(self._faults, "garbage", seconds) or self._rng.random() < 0.5:
            return data
        noise = self._rng.integers(0, 256, self._rng.integers(1, 40)).astype(np.uint8).tobytes()
        cut = int(self._rng.integers(0, len(data) + 1))
        return data[:cut] + noise

    def _send(self, data: bytes) -> None:
        """Bytes that nobody reads are lost, as on a real line."""
        if self._fds is not None and data:
            with contextlib.suppress(OSError):
                os.write(self._fds[0], data)
