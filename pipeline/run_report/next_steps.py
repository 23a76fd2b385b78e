"""What to do next, in plain words, with a command where one helps."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.health.run_health import RunHealth
from pipeline.run_report.origin import Origin

RESUME = "beemap map --resume {output}"
COMPARE = "beemap evaluate path {output}/trajectory.tum {output}/truth.tum"


@dataclass(frozen=True)
class NextStep:
    """What to do, why, and a command for it, "" where there is none."""

    do: str
    why: str = ""
    command: str = ""


def next_steps(health: RunHealth, origin: Origin, partial: bool, truth: bool) -> list[NextStep]:
    """From what was found, the gravest first, causes before symptoms; truth: the recording holds
    the true path."""
    steps = []
    if partial:
        steps.append(
            NextStep(
                "Go on with the run.",
                "It was interrupted; what was seen so far need not be looked at again.",
                origin.fill(RESUME),
            )
        )
    for finding in sorted(health.findings, key=lambda f: (not f.grade, f.symptom, -f.grade)):
        if finding.remedy:
            steps.append(
                NextStep(
                    f"{finding.remedy[:1].upper()}{finding.remedy[1:]}.",
                    f"{finding.text[:1].upper()}{finding.text[1:]}.",
                    origin.fill(finding.command),
                )
            )
    if not steps:
        steps.append(
            NextStep(
                "Use it: nothing asks to be mended.",
                "map.yaml is for nav2 and map_server, trajectory.tum the path.",
            )
            if health.figures is not None
            else NextStep("Drive further, where there is something to see.")
        )
    if truth:
        steps.append(
            NextStep(
                "Hold the path against the true one.",
                "The recording holds it; no word of this report rests on it.",
                origin.fill(COMPARE),
            )
        )
    return steps
