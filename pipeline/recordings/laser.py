"""From a scanner's readings to a RangeScan; settings of the stage `laser`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from stereo.scan import RangeScan


def _meta(description: str, unit: str, **limits: Any) -> msgspec.Meta:
    return msgspec.Meta(description=description, extra={"unit": unit}, **limits)


Positive = Annotated[float, msgspec.Meta(gt=0)]


class LaserSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the readings of a scan log are taken."""

    field_of_view: Annotated[
        Annotated[float, msgspec.Meta(gt=0, le=360)] | None,
        _meta(
            "beams used: this angle about straight ahead; null: all. FLASER lines do not state "
            "theirs (180): a larger one spreads their beams over it",
            "deg",
        ),
    ] = None
    max_range: Annotated[
        Positive | None,
        _meta(
            "readings from here on are maximum readings; null: as a ROBOTLASER1 line states, for "
            "FLASER lines the log's largest reading if it repeats; 80 at most",
            "m",
        ),
    ] = None
    # A SICK scanner gives the same code for nothing in range, for dazzle and for glass or black
    # cloth close by: what it did not see must not be cleared.
    maximum: Annotated[
        Literal["free", "unknown"],
        _meta("what a maximum reading means: free up to max_range, or unknown", ""),
    ] = "unknown"
    noise: Annotated[
        float, _meta("standard deviation of a range as a share of it", "fraction", ge=0)
    ] = 0.0
    # A SICK LMS 200 states 15 mm of systematic error and 5 mm of noise; the width of a beam on a
    # slanted wall comes on top.
    floor: Annotated[
        float, _meta("standard deviation of a range, joined by that of `noise`", "m", ge=0)
    ] = 0.02


@dataclass(frozen=True)
class Beams:
    """How the beams of a scan lie.

    bearing: (n,) rad, left positive, strictly increasing; maximum: the largest range as the log
    states it [m], or None; assumed: nothing states the bearings (FLASER).
    """

    bearing: np.ndarray
    maximum: float | None
    assumed: bool

    @staticmethod
    def flaser(n: int) -> Beams:
        """Beams of a FLASER line: n over 180 deg, the first at -90 deg.

        As CARMEN's own reader and GMapping have it: a SICK scans 181 beams a degree apart (361
        half a degree); where 180 (360) stand, the last one was left out, so that the step is
        the same and the scan ends at +89 (+89.5) deg.
        """
        steps = n if n % 2 == 0 else max(n - 1, 1)
        return Beams(-0.5 * math.pi + np.arange(n) * (math.pi / steps), None, True)

    def spread(self, field_of_view: float) -> np.ndarray:
        """Bearings (n,) when the same beams span another angle [rad]."""
        return self.bearing * (field_of_view / math.pi)


# CARMEN's own limit: SICK scanners tell of all that they did not see by 81.83 to 81.91 m.
FARTHEST = 80.0
# The same codes when they measure in millimetres.
MILLIMETRE_CODES = (8.18, 8.192)


def maximum_reading(readings: list[np.ndarray]) -> float:
    """The range [m] from which on readings are maximum readings, found in readings (n,) alone.

    The largest one if it occurs more than once; else nothing in the log is a maximum reading and
    the limit lies just above all.
    """
    tops = [float(r[np.isfinite(r)].max(initial=0.0)) for r in readings]
    top = max(tops, default=0.0)
    if sum(int(np.count_nonzero(r == top)) for r in readings if r.size) < 2:
        return min(math.nextafter(top, math.inf), FARTHEST)
    if MILLIMETRE_CODES[0] <= top <= MILLIMETRE_CODES[1]:
        return MILLIMETRE_CODES[0]
    return min(top, FARTHEST)


def range_scan(
    stamp: int,
    origin: tuple[float, float, float],
    beams: Beams,
    readings: np.ndarray,
    limit: float,
    settings: LaserSettings,
    usable: float | None = None,
) -> RangeScan:
    """Readings (n,) [m] as a scan.

    Args:
        limit: readings from here on are maximum readings [m].
        usable: the map's own reach [m]; a reading beyond it means free up to it.

    NaN, zero and negative readings are unknown.
    """
    reach = limit if usable is None else min(limit, usable)
    with np.errstate(invalid="ignore"):
        ranges = np.where(readings > 0.0, readings, np.nan)
        ranges[readings > reach] = np.inf
        ranges[readings >= limit] = np.inf if settings.maximum == "free" else np.nan
    bearing = beams.bearing
    if settings.field_of_view is not None:
        angle = math.radians(settings.field_of_view)
        if beams.assumed and angle > math.pi:
            bearing = beams.spread(angle)
        used = np.abs(bearing) <= 0.5 * angle + 1e-9
        bearing, ranges = bearing[used], ranges[used]
    seen = np.where(np.isfinite(ranges), ranges, np.nan)
    sigma = np.hypot(settings.floor, settings.noise * seen)
    return RangeScan(stamp, origin, bearing, ranges, sigma, reach)
