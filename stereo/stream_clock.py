"""StreamClock: a network camera's own stamps on this machine's clock."""

from __future__ import annotations

# How fast the offset may grow again: more than two quartz crystals drift apart.
DRIFT = 2e-4
# A stamp that differs from the arrivals by more than this against the one before: a clock was
# set [ns].
JUMP = 500_000_000


class StreamClock:
    """Maps the camera's clock to this machine's by the least delay seen.

    An image arrives after it was taken, sooner or later as the network goes: the least of arrival
    minus stamp is the offset of the clocks and the least delay. A clock that was set begins anew.
    """

    def __init__(self) -> None:
        self._offset: int | None = None
        self._last = 0

    def host_time(self, taken: int, arrival: int) -> int:
        """When an image was taken that the camera stamped `taken`, both in ns; never after
        `arrival`."""
        offset = arrival - taken
        if self._offset is not None and abs(offset - self._offset) < JUMP:
            crept = self._offset + round(abs(taken - self._last) * DRIFT)
            offset = min(offset, crept)
        self._offset, self._last = offset, taken
        return taken + offset
