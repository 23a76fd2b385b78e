"""Was the filter healthy, did the local maps match, was there enough to see?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mapping.particle_filter import FilterHealth
from pipeline.health.finding import Finding, Grade

# A step in which fewer than this share of the particles carry the weight has lost most of them;
# one after a loop closed is the filter at work, many are a filter that is starved.
STARVED = 0.05
OFTEN = 0.25
# A step that matches less than half of the obstacles in view disagrees with its own map. Of 16
# simulated runs by both methods, those within 0.2 m of the truth had at most 1.6 % of such steps,
# those more than 0.3 m off 3.8 % and more. Of 24 runs of the office with something spoilt, those
# within 0.1 m had at most one, but for very dark images; where more than 15 % of the steps matched
# less than 40 %, the path was half a metre off and more, or a wrong rig had blurred the map.
HALF, TORN = 0.5, 0.4
SELDOM, OFTEN_TORN = 0.02, 0.15
# With fewer steps judged than this share, or with one or two, nearly all of the path is unchecked.
FEW_JUDGED, MIN_JUDGED = 0.1, 3
UNCHECKED = (
    "the path is odometry's own: let the robot look at places again, or lower mapping.min_overlap"
)
# Shares of the columns that answered: good, and next to nothing.
ANSWERED_WELL = 0.6
HARDLY_ANSWERED = 0.15


@dataclass(frozen=True)
class FilterFigures:
    """What the steps of a filter amount to.

    n_eff: median and least share of the particles; starved: share of steps with too few; matched:
    median share of the obstacles in view, None where no step was judged; poor, torn: judged steps
    that matched less than half, and far less; answered: share of columns or beams.
    """

    steps: int
    particles: int
    n_eff: tuple[float, float]
    starved: float
    resampled: int
    judged: int
    matched: float | None
    poor: int
    torn: int
    answered: float

    @staticmethod
    def of(steps: Sequence[FilterHealth], particles: int) -> FilterFigures:
        """Of at least one step."""
        shares = np.array([step.n_eff for step in steps]) / particles
        matched = np.array([step.matched for step in steps if step.judged])
        observations = [step.observations for step in steps]
        return FilterFigures(
            steps=len(steps),
            particles=particles,
            n_eff=(float(np.median(shares)), float(shares.min())),
            starved=float(np.mean(shares < STARVED)),
            resampled=sum(step.resampled for step in steps),
            judged=len(matched),
            matched=float(np.median(matched)) if len(matched) else None,
            poor=int(np.count_nonzero(matched < HALF)),
            torn=int(np.count_nonzero(matched < TORN)),
            answered=float(np.average([step.answered for step in steps], weights=observations)),
        )


def filter_findings(figures: FilterFigures, sight: str) -> list[Finding]:
    """The three of them; sight: "columns" of a camera or "beams" of a laser."""
    return [particles_finding(figures), matching_finding(figures), answers_finding(figures, sight)]


def particles_finding(figures: FilterFigures) -> Finding:
    """Did enough particles carry the weight, and how often were they resampled."""
    median, least = figures.n_eff
    text = (
        f"N_eff {median:.0%} of {figures.particles} particles (least {least:.0%}), "
        f"resampled in {figures.resampled} of {figures.steps} steps"
    )
    if figures.starved <= OFTEN:
        return Finding(text, praise="healthy")
    return Finding(
        text,
        "too few particles agree with what is seen: give more (mapping.particles), or more doubt "
        "of odometry (odometry.along, odometry.heading)",
        grade=Grade.DOUBTFUL,
        short=f"in {figures.starved:.0%} of the steps hardly a particle agreed with what was seen",
        symptom=True,
        command=f"{{map}} --set mapping.particles={2 * figures.particles}",
    )


def matching_finding(figures: FilterFigures) -> Finding:
    """How much of what the map holds in view was seen again."""
    judged = f"{figures.judged} of {figures.steps} steps saw enough of the map to be judged"
    if figures.matched is None:
        return Finding(
            judged,
            UNCHECKED,
            grade=Grade.DOUBTFUL,
            short="no place was seen twice, so that nothing checks the path",
        )
    text = f"{judged}; they matched {figures.matched:.0%} of its obstacles in view"
    few = figures.judged < max(MIN_JUDGED, FEW_JUDGED * figures.steps)
    if figures.matched >= HALF and figures.poor <= max(1, SELDOM * figures.judged):
        matched = f"what was seen again matched the map by {figures.matched:.0%}"
        return Finding(
            text,
            UNCHECKED if few else "",
            praise="good",
            grade=Grade.DOUBTFUL if few else Grade.GOOD,
            short=f"{matched}, but that was little" if few else matched,
        )
    much = figures.torn > max(1, OFTEN_TORN * figures.judged)
    return Finding(
        f"{text}, {figures.poor} of them less than half",
        "look for double walls where the map disagrees with itself; more particles, another --seed "
        "or a better odometry may close the loop",
        grade=Grade.BROKEN if much else Grade.DOUBTFUL,
        short=f"{figures.poor} of {figures.judged} steps saw less than half of what the map holds "
        "there",
        symptom=True,
        command=f"{{map}} --seed 2 --set mapping.particles={2 * figures.particles}",
    )


def answers_finding(figures: FilterFigures, sight: str) -> Finding:
    """Share of columns or beams without an answer."""
    text = f"{1.0 - figures.answered:.0%} of the {sight} had no answer"
    answered = f"{figures.answered:.0%} of the {sight} answered"
    if figures.answered >= ANSWERED_WELL:
        return Finding(text, short=answered)
    grade = Grade.DOUBTFUL if figures.answered >= HARDLY_ANSWERED else Grade.BROKEN
    if sight == "columns":
        return Finding(
            text,
            "more light or texture, a cleaner lens, or a new calibration would help",
            grade=grade,
            short=f"only {answered}",
            command="beemap rig check {rig} {recording}",
        )
    return Finding(
        text,
        "where maximum readings mean open space, set laser.maximum=free",
        short=f"only {answered}",
        command="{map} --set laser.maximum=free",
    )
