"""Finding: one thing that a run measured of itself, what it means for the map, what to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Grade(IntEnum):
    """What a finding says of the map."""

    GOOD = 0
    DOUBTFUL = 1
    BROKEN = 2


@dataclass(frozen=True)
class Finding:
    """One thing measured.

    text: what, with its numbers; remedy: what to do about it, "" where nothing need be done, and
    then `praise` may say that all is well; grade: what it says of the map; short: as much of it as
    stands in a verdict, "" where it has no say there; symptom: something else is likely to be the
    cause, which is to be mended first; command: a command line that helps, with
    names in braces for what belongs to the run (`Origin.fill`).
    """

    text: str
    remedy: str = ""
    praise: str = ""
    grade: Grade = Grade.GOOD
    short: str = ""
    symptom: bool = False
    command: str = ""

    @property
    def line(self) -> str:
        """Text and remedy, as a run prints them."""
        end = self.remedy or self.praise
        return f"{self.text}: {end}" if end else self.text
