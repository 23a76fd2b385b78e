"""WorstPairs: the few pairs of a run that a person should look at, gathered while it goes on.

What is kept is bounded, however long the run is: of every kind of defect the first and the latest
pair, the pairs that gave the fewest ranges, and those about which the map was matched worst. They
are known by their stamps; the images are read again when somebody wants to see them. No two of
the pairs seen come from one stretch of `STRETCH` observations: neighbours show the same.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mapping.particle_filter import FilterHealth
from stereo.scan import RangeScan

STRETCH = 10
FEWEST = 3  # with the fewest ranges
UNLIKE = 3  # with the worst match
MOST_DEFECTS = 6  # kinds of defects, two pairs of each

FEW_RANGES = "fewest ranges"
UNLIKE_MAP = "worst match"


@dataclass(frozen=True)
class Suspect:
    """A pair or scan worth a look.

    index: the number of its pose in the path; stamp: ns; kind: of defect, or FEW_RANGES or
    UNLIKE_MAP; why: in words, of a defect; share: of columns that answered, or of obstacles
    matched; scan: what was seen, where anything was.
    """

    index: int
    stamp: int
    name: str
    kind: str
    why: str = ""
    share: float = 0.0
    scan: RangeScan | None = None


class WorstPairs:
    """Is shown every pair that was looked at."""

    def __init__(self) -> None:
        self._defects: dict[str, list[Suspect]] = {}
        # Heaps with the best of the worst on top: (-share, -index, suspect).
        self._few: list[tuple[float, int, Suspect]] = []
        self._unlike: list[tuple[float, int, Suspect]] = []
        self._stretch: list[Suspect] = []
        self._worst_step: tuple[float, Suspect] | None = None
        self._open = 0  # of the stretch, the first pair of the step that goes on

    def skipped(self, index: int, stamp: int, name: str, kind: str, why: str) -> None:
        """A pair that was no use: the kind of defect, and why in words."""
        kept = self._defects.get(kind)
        if kept is None:
            if len(self._defects) == MOST_DEFECTS:
                return
            kept = self._defects[kind] = []
        del kept[1:]
        kept.append(Suspect(index, stamp, name, kind, why))

    def observed(
        self, index: int, name: str, scan: RangeScan, closed: Sequence[FilterHealth]
    ) -> None:
        """A pair that was seen, and the steps of the filter that it closed."""
        seen = Suspect(index, scan.stamp, name, FEW_RANGES, share=scan.answered, scan=scan)
        self._stretch.append(seen)
        for step in closed:
            middle = self._stretch[(self._open + len(self._stretch) - 1) // 2]
            self._open = len(self._stretch)
            if step.judged and (self._worst_step is None or step.matched < self._worst_step[0]):
                found = replace(middle, kind=UNLIKE_MAP, share=step.matched)
                self._worst_step = step.matched, found
        if closed and len(self._stretch) >= STRETCH:
            self._end_stretch()

    def chosen(self) -> list[Suspect]:
        """The defects by kind, the pairs with the fewest ranges, those with the worst match; the
        worst first."""
        few, unlike = list(self._few), list(self._unlike)
        if self._stretch:
            _push(few, min(self._stretch, key=lambda seen: seen.share), FEWEST)
        if self._worst_step is not None:
            _push(unlike, self._worst_step[1], UNLIKE)
        defects = [suspect for kept in self._defects.values() for suspect in kept]
        return [*defects, *_ordered(few), *_ordered(unlike)]

    def _end_stretch(self) -> None:
        _push(self._few, min(self._stretch, key=lambda seen: seen.share), FEWEST)
        if self._worst_step is not None:
            _push(self._unlike, self._worst_step[1], UNLIKE)
        self._stretch, self._worst_step, self._open = [], None, 0


def _push(heap: list[tuple[float, int, Suspect]], suspect: Suspect, most: int) -> None:
    heapq.heappush(heap, (-suspect.share, -suspect.index, suspect))
    if len(heap) > most:
        heapq.heappop(heap)


def _ordered(heap: list[tuple[float, int, Suspect]]) -> list[Suspect]:
    return [suspect for _, _, suspect in sorted(heap, key=lambda item: (-item[0], -item[1]))]
