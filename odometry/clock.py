"""SenderClock: a micro-controller's microseconds on the host's clock."""

from __future__ import annotations

WRAP_US = 1 << 32

# How fast the offset may grow again: more than two quartz crystals drift apart.
DRIFT = 2e-4


class SenderClock:
    """Maps the sender's clock to the host's by the least delay seen.

    A line arrives late or in time, never early, so the least of arrival - sent is the offset
    between the clocks (and the least delay, which cannot be told from it). It may creep up by
    `DRIFT`, or a slow sender would seem ever later. A sender that restarts, or whose
    time is garbled, is brought back to the time of arrival at once.
    """

    def __init__(self) -> None:
        self._last_us: int | None = None
        self._sender_ns = 0
        self._offset = 0

    def host_time(self, t_us: int, arrival: int) -> int:
        """Host time [ns] of a line sent at `t_us` (wrapping at 2^32) that arrived at `arrival`.

        Never later than `arrival`.
        """
        if self._last_us is None:
            self._offset = arrival
            elapsed = 0
        else:
            elapsed = (t_us - self._last_us) % WRAP_US * 1000
        self._last_us = t_us
        self._sender_ns += elapsed
        self._offset = min(self._offset + int(elapsed * DRIFT), arrival - self._sender_ns)
        return self._sender_ns + self._offset
