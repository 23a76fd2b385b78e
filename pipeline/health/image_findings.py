"""What was wrong with the images, what was lost on the way, and the remedies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.frontend import UNREADABLE
from pipeline.health.finding import Finding, Grade
from stereo.pair_check import BLACK, LEFT_COVERED, RIGHT_COVERED, SAME, SATURATED

# Cameras whose images differ more in brightness are not set alike; what they see differs less.
UNEQUAL = 1.5
REMEDIES = {
    BLACK: "take off the lens caps, or give more light or exposure",
    SATURATED: "lower the exposure or the gain, or keep the cameras out of the light",
    LEFT_COVERED: "uncover or clean its lens, check its cable",
    RIGHT_COVERED: "uncover or clean its lens, check its cable",
    SAME: "one camera was recorded twice: give the other one's images",
}
# Shares of the pairs that were lost: the map may have holes, and it is hardly one.
MUCH_LOST = 0.1
MOST_LOST = 0.5


def image_findings(
    skipped: Mapping[str, Sequence[str]], brightness: Sequence[float]
) -> list[Finding]:
    """Defects of the images; nothing where all were in order.

    skipped: names of pairs that were passed over, by reason; brightness: of the left image over
    the right one, for each observation.
    """
    defects = [*REMEDIES, UNREADABLE]
    due = len(brightness) + sum(len(skipped.get(reason, ())) for reason in defects)
    findings = []
    for reason, names in skipped.items():
        if reason in REMEDIES:
            text = f"{reason} in {_pairs(len(names))} (e.g. {names[0]})"
            short = f"{reason} in {len(names)} of {due} pairs"
            findings.append(_graded(text, REMEDIES[reason], short, len(names) / due))
        elif reason == UNREADABLE:
            text = f"{_pairs(len(names))} could not be used, e.g. {names[0]}"
            short = f"{len(names)} of {due} pairs could not be used"
            remedy = "look at these files: they are cut short, or of another kind than the rest"
            findings.append(_graded(text, remedy, short, len(names) / due))
    ratio = float(np.median(brightness)) if len(brightness) else 1.0
    if max(ratio, 1.0 / ratio) > UNEQUAL:
        side, times = ("left", ratio) if ratio > 1.0 else ("right", 1.0 / ratio)
        findings.append(
            Finding(
                f"the {side} images are {times:.1f} times as bright as the others",
                "give both cameras the same exposure and gain",
            )
        )
    return findings


def loss_findings(counts: Mapping[str, int], facts: Mapping[str, Any]) -> list[Finding]:
    """Pairs without motion, pairs that mapping or the disk were too slow for, silent wheels.

    counts: of a run; facts: what the command knows of it, as in run.json.
    """
    findings = []
    used, without = counts.get("pairs used", 0), counts.get("pairs without motion", 0)
    if without:
        findings.append(
            _graded(
                f"{_pairs(without)} came when nothing was known of the robot's motion",
                "compare the clocks of images and wheels, and look after the encoders' cable",
                f"of {without} of {used + without} pairs the motion is not known",
                without / (used + without),
                command="beemap info {recording}",
            )
        )
    odometry = facts.get("odometry", {})
    if gaps := odometry.get("tick_gaps", 0):
        longest = odometry.get("longest_tick_gap_s", 0.0)
        findings.append(
            Finding(
                f"the wheels were silent {_times(gaps)}"
                + (f", up to {longest:.1f} s" if longest else ""),
                "look after the encoders' cable",
                command="beemap doctor {rig}",
            )
        )
    late = facts.get("pairs_skipped", 0) + facts.get("recorded", {}).get("dropped", 0)
    if late:
        findings.append(
            _graded(
                f"{_pairs(late)} came too fast for the processor or the disk",
                "map the recording once more, which waits for every pair; live, take fewer pairs "
                "a second, or less of everything (stereo.rows_joined, mapping.particles)",
                f"{late} of {used + without + late} pairs came too fast",
                late / (used + without + late),
                command="{map}",
            )
        )
    return findings


def _graded(text: str, remedy: str, short: str, share: float, command: str = "") -> Finding:
    grade = Grade.GOOD
    if share > MUCH_LOST:
        grade = Grade.DOUBTFUL if share <= MOST_LOST else Grade.BROKEN
    return Finding(text, remedy, grade=grade, short=short, command=command)


def _pairs(count: int) -> str:
    return "1 pair" if count == 1 else f"{count} pairs"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
