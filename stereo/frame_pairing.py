"""FramePairing: which left frame belongs to which right one, while both are coming in."""

from __future__ import annotations

import threading
from collections import deque

from stereo.camera import CapturedPair, Frame

WAITING = 8  # frames of one camera kept while the other says nothing


class FramePairing:
    """Takes frames of both cameras in any order, gives the pairs in order of time.

    limit: most time between the images of a pair [ns]. one_clock: both cameras stamp by the same
    clock of their own, which no network disturbs. Frames without a partner are counted in
    `lonely`. May be called from several threads.
    """

    def __init__(self, limit: int, one_clock: bool = False) -> None:
        self.limit = limit
        self._one_clock = one_clock
        self.lonely = 0
        self._left: deque[Frame] = deque()
        self._right: deque[Frame] = deque()
        self._lock = threading.Lock()

    def add(self, name: str, frame: Frame) -> list[CapturedPair]:
        """The pairs that the frame of camera `name` (left or right) completes."""
        with self._lock:
            mine = self._left if name == "left" else self._right
            mine.append(frame)
            if len(mine) > WAITING:
                mine.popleft()
                self.lonely += 1
            return self._matched()

    def _matched(self) -> list[CapturedPair]:
        pairs = []
        while self._left and self._right:
            skew = self._skew(self._left[0], self._right[0])
            if abs(skew) <= self.limit:
                pairs.append(CapturedPair(self._left.popleft(), self._right.popleft(), skew))
            else:
                (self._left if skew > 0 else self._right).popleft()
                self.lonely += 1
        return pairs

    def _skew(self, left: Frame, right: Frame) -> int:
        if self._one_clock and left.taken is not None and right.taken is not None:
            return right.taken - left.taken
        return right.stamp - left.stamp
