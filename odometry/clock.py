"""SenderClock: a micro-controller's microseconds on the host's clock."""

from __future__ import annotations

WRAP_US = 1 << 32

# How fast the offset may grow again: more than two quartz crystals drift apart.
DRIFT = 2e-4
# A clock that goes ahead of the arrivals by more than this has jumped [ns].
JUMP = 500_000_000


class SenderClock:
    """Maps the sender's clock to the host's by the least delay seen.

    A line arrives late or in time, never early, so the least of arrival - sent is the offset
    between the clocks (and the least delay, which cannot be told from it). It may creep up by
    `DRIFT`, or a slow sender would seem ever later. A sender that restarts, or whose
    time is garbled, is brought back to the time of arrival at once, and counted in `jumps`.

    wrap_us: where the sender's clock begins anew.
    """

    def __init__(self, wrap_us: int = WRAP_US) -> None:
        self.jumps = 0
        self._wrap = wrap_us
        self._last_us: int | None = None
        self._last_arrival = 0
        self._sender_ns = 0
        self._offset = 0

    def host_time(self, t_us: int, arrival: int) -> int:
        """Host time [ns] of a line sent at `t_us` (wrapping) that arrived at `arrival`.

        Never later than `arrival`.
        """
        if self._last_us is None:
            self._offset = arrival
            elapsed = 0
        else:
            elapsed = (t_us - self._last_us) % self._wrap * 1000
            if elapsed > arrival - self._last_arrival + JUMP:
                # From here on as if it were new: how long it was away is not known.
                self.jumps += 1
                elapsed = 0
                self._offset = arrival - self._sender_ns
        self._last_us, self._last_arrival = t_us, arrival
        self._sender_ns += elapsed
        self._offset = min(self._offset + int(elapsed * DRIFT), arrival - self._sender_ns)
        return self._sender_ns + self._offset
