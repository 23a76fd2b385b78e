r"""The raw log of a serial line: all that came and went, so that a run can be replayed exactly.

Text, one line an event, only ever appended:

    #beemap serial log 1
    123456789 o /dev/ttyUSB0          the port was opened
    123456790 > e\r                   bytes sent
    123456795 < 1234 -5678\r\n        bytes that arrived
    123459999 x device was lost       the port is gone

The first field is the host's monotonic clock [ns]: just before sending, just after arrival. Bytes
are escaped as in Python. A line without its newline was being written when the power failed and
is not read; a damaged line is passed over and counted.
"""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from odometry.errors import OdometryError

HEADER = b"#beemap serial log 1\n"
OPENED, SENT, RECEIVED, LOST = "o", ">", "<", "x"

_EVENT = re.compile(rb"(\d{1,19}) ([o><x]) ((?:[ -\[\]-~]|\\(?:[\\nrt]|x[0-9a-f]{2}))*)\n")
# Written this often and brought safely to the disk once a second [s].
WRITE_EVERY = 0.1
SYNC_EVERY = 1.0


class LineEvent(NamedTuple):
    """stamp: monotonic [ns]; kind: `OPENED`, `SENT`, `RECEIVED` or `LOST`; data: bytes or words."""

    stamp: int
    kind: str
    data: bytes


class RawLog:
    """Appends events to a new file from a thread of its own: a slow disk delays no reading.

    Raises:
        OdometryError: the file is there already or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.error: str | None = None
        self._path = path
        self._waiting: deque[LineEvent] = deque()
        try:
            self._file = path.open("xb", buffering=0)
        except FileExistsError:
            raise OdometryError(f"{path}: already exists: choose another name") from None
        except OSError as error:
            raise OdometryError(f"{path}: cannot be written ({error.strerror})") from None
        self._file.write(HEADER)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="raw log", daemon=True)
        self._thread.start()

    def add(self, event: LineEvent) -> None:
        """Take an event to be written; never waits."""
        if self.error is None:
            self._waiting.append(event)

    def close(self) -> None:
        """Write and sync what is left."""
        self._stop.set()
        self._thread.join()
        self._file.close()

    def _run(self) -> None:
        synced = time.monotonic()
        stopped = False
        while not stopped:
            stopped = self._stop.wait(WRITE_EVERY)
            try:
                self._write()
                if stopped or time.monotonic() - synced >= SYNC_EVERY:
                    os.fsync(self._file.fileno())
                    synced = time.monotonic()
            except OSError as error:
                self.error = f"{self._path}: cannot be written ({error.strerror}): no longer logged"
                self._waiting.clear()
                return

    def _write(self) -> None:
        lines = []
        with contextlib.suppress(IndexError):
            while True:
                lines.append(_as_line(self._waiting.popleft()))
        data = memoryview(b"".join(lines))
        while data:
            data = data[self._file.write(data) or 0 :]


def _as_line(event: LineEvent) -> bytes:
    text = event.data.decode("latin-1").encode("unicode_escape")
    return b"%d %s %s\n" % (event.stamp, event.kind.encode(), text)


def read_raw_log(path: Path) -> Iterator[LineEvent | None]:
    """The events of a log, None for a damaged line. What was cut off at the end is left out.

    Raises:
        OdometryError: it cannot be read, or is no raw log.
    """
    try:
        with path.open("rb") as file:
            head = file.readline(len(HEADER) + 1)
            if head != HEADER:
                if HEADER.startswith(head):
                    return  # cut off in its first line
                raise OdometryError(
                    f"{path}: not a raw log of encoders (its first line is not "
                    f"'{HEADER.decode().strip()}')"
                )
            while line := file.readline(1 << 20):
                if line.endswith(b"\n"):
                    yield _as_event(line)
    except OSError as error:
        raise OdometryError(f"{path}: cannot be read ({error.strerror})") from None


def _as_event(line: bytes) -> LineEvent | None:
    match = _EVENT.fullmatch(line)
    if match is None or int(match[1]) >= 1 << 63:
        return None
    data = match[3].decode("unicode_escape").encode("latin-1")
    return LineEvent(int(match[1]), match[2].decode(), data)
