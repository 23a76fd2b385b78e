"""What visual odometry and the wheels beside it went through, in words for the user."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pipeline.fused_motion import FusedMotion, Slip
from pipeline.health.finding import Finding, Grade
from pipeline.seeing import AnyMotion
from pipeline.visual_motion import BRIDGED, GUESSED, Loss, VisualMotion

MOST_TOLD = 3
# Wheels slip a little on every floor [m, rad].
WORTH_TELLING = (0.02, math.radians(2.0))
# An offset of all disparities worth a word [px], and in standard deviations.
WRONG_OFFSET, SIGNIFICANT = 0.5, 5.0


def told(motion: AnyMotion, begin: int) -> list[Finding]:
    """Findings on lost tracking and slipping wheels; times count from the stamp `begin` [ns]."""
    if isinstance(motion, VisualMotion):
        return [*_losses(motion.all_losses(), begin), *_offset(motion)]
    if isinstance(motion, FusedMotion):
        losses = _losses(motion.visual.all_losses(), begin)
        return [*losses, *_slips(motion.slips, begin), *_offset(motion.visual)]
    return []


def _offset(motion: VisualMotion) -> list[Finding]:
    """Whether the motion shows that the ranges are wrong."""
    value, variance = motion.offset
    if abs(value) < max(WRONG_OFFSET, SIGNIFICANT * math.sqrt(variance)):
        return []
    large = "large" if value > 0 else "small"
    return [
        Finding(
            f"the images' motion shows that all disparities are {abs(value):.1f} px too {large}: "
            "ranges are wrong by that",
            "calibrate the cameras again",
            grade=Grade.DOUBTFUL,
            short=f"all disparities are {abs(value):.1f} px too {large}",
        )
    ]


def _losses(losses: Sequence[Loss], begin: int) -> list[Finding]:
    if not losses:
        return []
    times = [f"{_seconds(loss.first, loss.last, begin)}, {loss.end}" for loss in losses]
    line = f"visual odometry lost its way {_times(len(losses))} ({_some(times)})"
    if any(loss.end == GUESSED for loss in losses):
        guessed = sum(loss.end == GUESSED for loss in losses)
        return [
            Finding(
                f"{line}: how the robot moved where it is guessed is not known",
                "more light, a shorter exposure, slower turns, or wheels (--motion fused) would "
                "help",
                grade=Grade.DOUBTFUL,
                short=f"how the robot moved had to be guessed {_times(guessed)}",
            )
        ]
    if any(loss.end == BRIDGED for loss in losses):
        return [Finding(f"{line}: the wheels answered alone there")]
    return [Finding(line)]


def _slips(slips: Sequence[Slip], begin: int) -> list[Finding]:
    large = [slip for slip in slips if _worth_telling(slip)]
    if not large:
        return []
    times = [
        f"{_seconds(slip.first, slip.last, begin)}, {math.hypot(*slip.error[:2]):.2f} m and "
        f"{abs(math.degrees(slip.error[2])):.0f} deg"
        for slip in large
    ]
    text = f"wheels slipped {_times(len(large))} ({_some(times)})"
    return [Finding(f"{text}: the images' motion was taken there")]


def _worth_telling(slip: Slip) -> bool:
    return math.hypot(*slip.error[:2]) > WORTH_TELLING[0] or abs(slip.error[2]) > WORTH_TELLING[1]


def _seconds(first: int, last: int, begin: int) -> str:
    return f"{(first - begin) / 1e9:.1f} to {(last - begin) / 1e9:.1f} s"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _some(items: Sequence[str]) -> str:
    more = f"; and {len(items) - MOST_TOLD} more" if len(items) > MOST_TOLD else ""
    return "; ".join(items[:MOST_TOLD]) + more
