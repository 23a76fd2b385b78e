"""Signals and terminals that close: a run ends with its results, or does not notice."""

from __future__ import annotations

import errno
import io
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

# Ctrl-C, `kill`, and the terminal that closes.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# What a write to a reader who has gone, or to a terminal that is closed, fails with.
GONE = (errno.EPIPE, errno.EIO)


@contextmanager
def until_interrupted() -> Iterator[threading.Event]:
    """An event that the first signal to end sets; a second Ctrl-C or SIGTERM breaks the run.

    A terminal that closes sends SIGHUP, often twice: it never breaks anything. Where SIGHUP is
    ignored (`nohup`) it stays so.
    """
    stop = threading.Event()

    def on_signal(signum: int, frame: Any) -> None:
        if stop.is_set() and signum != signal.SIGHUP:
            raise KeyboardInterrupt
        stop.set()

    with handled(on_signal):
        yield stop


@contextmanager
def interrupting() -> Iterator[None]:
    """SIGTERM and SIGHUP end a command as Ctrl-C does: its temporary folders are removed."""

    def on_signal(signum: int, frame: Any) -> None:
        if signum == signal.SIGHUP:  # a second one must not break off the removing
            signal.signal(signum, signal.SIG_IGN)
        raise KeyboardInterrupt

    with handled(on_signal, (signal.SIGTERM, signal.SIGHUP)):
        yield


@contextmanager
def handled(on_signal: Any, numbers: Sequence[int] = ENDING) -> Iterator[None]:
    """Signals to end go to `on_signal`; only the main thread may choose that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in numbers}
    for number, handler in before.items():
        if number == signal.SIGINT or handler is not signal.SIG_IGN:
            signal.signal(number, on_signal)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def lasting_output() -> Iterator[None]:
    """Standard output and error to which a run may write when nobody reads them any more."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_lasting(stream) for stream in before)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = before


def _lasting(stream: Any) -> Any:
    try:
        stream.flush()
        raw = _Lasting(stream.fileno(), "w", closefd=False)
    except (OSError, ValueError, AttributeError):
        return stream  # no file behind it
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=True,
    )


class _Lasting(io.FileIO):
    """A file whose reader may go."""

    def write(self, data: Any) -> int | None:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in GONE:
                raise
            return len(memoryview(data).cast("B"))
