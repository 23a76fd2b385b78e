"""What visual odometry and the wheels beside it went through, in words for the user."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pipeline.fused_motion import FusedMotion, Slip
from pipeline.health.finding import Finding, Grade
from pipeline.health.odometry_findings import odometry_findings
from pipeline.health.wheel_findings import wheel_fault_finding
from pipeline.seeing import AnyMotion
from pipeline.visual_motion import BRIDGED, GUESSED, Loss, VisualMotion

MOST_TOLD = 3
# Wheels slip a little on every floor [m, rad].
WORTH_TELLING = (0.02, math.radians(2.0))
# Wheels that are wrong in a larger share of the steps do not slip: something is wrong with them.
MANY = 0.2
MIN_WRONG = 10
# Counts of fused steps, each of which has one.
STEPS = ("fused", "wheels_alone", "wheels_wrong", "images_alone", "images_doubted", "guessed")
WHEELS, IMAGES = "the wheels were used there", "the images were used there"
# An offset of all disparities worth a word [px], and in standard deviations.
WRONG_OFFSET, SIGNIFICANT = 0.5, 5.0


def told(motion: AnyMotion, begin: int) -> list[Finding]:
    """Findings on lost tracking and slipping wheels; times count from the stamp `begin` [ns]."""
    if isinstance(motion, VisualMotion):
        return [*_losses(motion.all_losses(), begin), *_offset(motion)]
    if isinstance(motion, FusedMotion):
        # The last loss may not have ended: no guess, but what the wheels bridged.
        losses = [
            replace(loss, end=BRIDGED) if loss.first == loss.last else loss
            for loss in motion.visual.all_losses()
        ]
        return [
            *_losses(losses, begin, wheels=True),
            *_images_failed(motion.counts),
            *_wheels_failed(motion, begin),
            *_offset(motion.visual),
        ]
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


def _losses(losses: Sequence[Loss], begin: int, wheels: bool = False) -> list[Finding]:
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
    if wheels:
        return [Finding(f"{line}: the wheels answered alone there")]
    return [Finding(line)]


def _images_failed(counts: Mapping[str, int]) -> list[Finding]:
    """Steps of a fused run in which the images could not be used."""
    steps = sum(counts[name] for name in STEPS)
    findings = []
    if alone := counts["wheels_alone"]:
        findings.append(
            Finding(f"the images did not show the motion in {alone} of {steps} steps: {WHEELS}")
        )
    if frozen := counts["images_frozen"]:
        often = frozen > MANY * steps
        text = f"the cameras sent the same images again in {frozen} of {steps} steps"
        findings.append(
            Finding(
                f"{text} while the wheels turned: {WHEELS}",
                "look after the cameras and their cables",
                grade=Grade.DOUBTFUL if often else Grade.GOOD,
                short=text if often else "",
            )
        )
    if doubted := counts["images_doubted"]:
        findings.append(
            Finding(
                f"images disagreed with the wheels in {doubted} of {steps} steps, and few of their "
                f"points agreed on a motion: {WHEELS}"
            )
        )
    return findings


def _wheels_failed(motion: FusedMotion, begin: int) -> list[Finding]:
    """Steps of a fused run in which the wheels could not be used."""
    counts = motion.counts
    steps, wrong = sum(counts[name] for name in STEPS), counts["wheels_wrong"]
    bridged = counts["wheels_alone"] + counts["images_doubted"]
    if (fault := motion.wheel_fault()) is not None and motion.encoders is not None:
        return [wheel_fault_finding(fault, motion.encoders, bridged, steps)]
    findings = []
    if silent := counts["images_alone"]:
        findings.append(
            Finding(
                f"the wheels reported nothing in {silent} of {steps} steps: {IMAGES}",
                "look after the encoders' cable, and compare their clock with the images'",
            )
        )
    if wrong <= MIN_WRONG or wrong <= MANY * (wrong + counts["fused"]):
        return [*findings, *_slips(motion.slips, begin), *_systematic(motion)]
    text = f"wheels disagreed with the images in {wrong} of {steps} steps"
    findings.append(
        Finding(
            f"{text}: {IMAGES}",
            "compare the section encoders of the rig with the robot (ticks_per_revolution, radii, "
            "track, reversed; left and right exchanged), and look after the cable",
            grade=Grade.DOUBTFUL if bridged else Grade.GOOD,
            short=f"{text}, and were all there was in {bridged}" if bridged else "",
            command="beemap odometry calibrate {recording}{rig_option} -o {new_rig} --force",
        )
    )
    return findings


def _systematic(motion: FusedMotion) -> list[Finding]:
    """What the wheels did wrong throughout."""
    return [
        replace(
            finding,
            text=f"{finding.text} (wheels against images; corrected in this run)",
            grade=Grade.GOOD,
            short="",
        )
        for finding in odometry_findings(motion.wheel_errors(), encoders=motion.by_ticks)
    ]


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
