"""ScanLog: a log of laser scans with odometry; it enters a run after the stereo stage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import msgspec
import numpy as np

from odometry.encoders import EncoderParameters
from odometry.tick_log import TickLog
from pipeline.recordings.laser import Beams, LaserSettings, maximum_reading, range_scan
from stereo.scan import RangeScan

# Endings of scan logs, and of packed ones.
ENDINGS = (".log", ".clf", ".carmen", ".gz", ".bz2", ".xz")

# What may be odd about a log that is read whole all the same; counted by these names.
BACKWARDS = "times stepping backwards"
REPEATED = "times repeated"
CHANGES = "changes of the beam count"
NO_NUMBER = "beams without a number"
ODDITIES = (BACKWARDS, REPEATED, CHANGES, NO_NUMBER)


# What suits the laser scanners and the odometry of logs that say nothing of themselves: beams are
# independent from one degree to the next; odometry is poor in rotation, and the scanner is seldom
# mounted quite straight, which looks like slip to the side. A local map spans 2 m, as in the paper.
# Found on the Intel and ACES logs.
USUAL: dict[str, dict[str, Any]] = {
    "odometry": {"along": 0.03, "across": 0.1, "heading": 12.0, "turn": 12.0},
    "mapping": {
        "max_range": 20.0,
        "spacing": 0.5,
        "spacing_angle": 20.0,
        "correlated": 1.0,
        "window": 4,
        "match_weight": 10.0,
    },
}


@dataclass
class ScanLog:
    """A scan log as read, in file order.

    stamps: (n,) int64 ns, not always increasing; odometry: (n, 3) the robot's dead reckoning at
    each scan (x m, y m, theta rad); readings: n arrays [m] as they stand, with their `beams`;
    origins: (n, 3) of the scanner on the robot. counts: scans, messages by type, and `ODDITIES`;
    skipped: what was passed over, by reason; suggested: stage -> key -> value, what the
    log says of itself; ticks, encoders: of logs that hold raw counters instead of odometry.
    """

    path: Path
    kind: str
    stamps: np.ndarray
    odometry: np.ndarray
    readings: list[np.ndarray]
    beams: list[Beams]
    origins: np.ndarray
    counts: Counter[str] = field(default_factory=Counter)
    skipped: dict[str, list[str]] = field(default_factory=dict)
    suggested: dict[str, dict[str, Any]] = field(default_factory=dict)
    ticks: TickLog | None = None
    encoders: EncoderParameters | None = None

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def truth_file(self) -> Path | None:
        """The true path beside the log, as `paper.tum` beside `paper.log` or `paper.log.gz`."""
        stem = self.path
        while stem.suffix.lower() in ENDINGS:
            stem = stem.with_suffix("")
        truth = stem.with_name(f"{stem.name}.tum")
        return truth if truth.is_file() else None

    @property
    def fitting(self) -> dict[str, dict[str, Any]]:
        """stage -> key -> value: what is usual, and what the log says of itself."""
        stages = {**USUAL, **self.suggested}
        return {name: {**USUAL.get(name, {}), **self.suggested.get(name, {})} for name in stages}

    @property
    def scans(self) -> Scans:
        """The scans by the defaults and by what the log says of its laser."""
        return self.taken(msgspec.convert(self.suggested.get("laser", {}), LaserSettings))

    def taken(self, settings: LaserSettings, usable: float | None = None) -> Scans:
        """The scans by these settings, used up to `usable` [m] (None: as far as they reach)."""
        return Scans(self, settings, usable)

    @cached_property
    def maximum_found(self) -> float:
        """Maximum reading of the scans that do not state one [m]."""
        unstated = zip(self.readings, self.beams, strict=True)
        return maximum_reading([r for r, beams in unstated if beams.maximum is None])


class Scans(Sequence[RangeScan]):
    """The scans of a log, each made when it is asked for."""

    def __init__(self, log: ScanLog, settings: LaserSettings, usable: float | None):
        self._log = log
        self._settings = settings
        self._usable = usable

    def __len__(self) -> int:
        return len(self._log)

    @overload
    def __getitem__(self, index: int) -> RangeScan: ...
    @overload
    def __getitem__(self, index: slice) -> list[RangeScan]: ...
    def __getitem__(self, index: int | slice) -> RangeScan | list[RangeScan]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        log = self._log
        beams = log.beams[index]
        x, y, yaw = log.origins[index].tolist()
        return range_scan(
            int(log.stamps[index]),
            (x, y, yaw),
            beams,
            log.readings[index],
            self._limit(beams),
            self._settings,
            self._usable,
        )

    def _limit(self, beams: Beams) -> float:
        if self._settings.max_range is not None:
            return self._settings.max_range
        return beams.maximum if beams.maximum is not None else self._log.maximum_found
