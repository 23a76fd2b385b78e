"""RunHealth: all that a run measured of itself, put together, and the verdict on its map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mapping.odometry_witness import OdometryErrors
from pipeline.health.filter_findings import FilterFigures, filter_findings
from pipeline.health.finding import Finding, Grade
from pipeline.health.image_findings import image_findings, loss_findings
from pipeline.health.odometry_findings import odometry_findings, parting_findings
from pipeline.health.parting import Parting, parting

if TYPE_CHECKING:
    from pipeline.run import MapRun

NOTHING = "nothing was mapped"
WORDS = {Grade.GOOD: "good", Grade.DOUBTFUL: "doubtful", Grade.BROKEN: "broken"}


@dataclass(frozen=True)
class Verdict:
    """Is the map good, doubtful or broken (`word`), and why."""

    word: str
    why: str

    @staticmethod
    def of(findings: Sequence[Finding], partial: bool, praise: str = "") -> Verdict:
        """The worst of the findings decides, and all that make the map worse than good are
        reasons; a good map is good because of all of them, and of what `praise` says."""
        grade = max(finding.grade for finding in findings)
        ordered = sorted(findings, key=lambda finding: -finding.grade)
        least = Grade.GOOD if grade == Grade.GOOD else Grade.DOUBTFUL
        reasons = [f.short for f in ordered if f.short and f.grade >= least]
        if praise and grade == Grade.GOOD:
            reasons.append(praise)
        if partial:
            reasons.append("interrupted: this is the first part of the recording")
        return Verdict(WORDS[grade], "; ".join(reasons))


@dataclass(frozen=True)
class RunHealth:
    """figures: None where nothing was mapped; errors, parting: of odometry, None where the run was
    too short to tell."""

    figures: FilterFigures | None
    errors: OdometryErrors | None
    parting: Parting | None
    findings: list[Finding]
    verdict: Verdict

    @staticmethod
    def of(run: MapRun, path: np.ndarray, facts: Mapping[str, Any]) -> RunHealth:
        """Of a finished run with its path (n, 3); facts: what the command knows of it, as in
        run.json."""
        mapper, motion = run.mapper, facts.get("motion")
        steps = mapper.filter.health
        images = [
            *image_findings(run.skipped, run.brightness),
            *loss_findings(run.counts, facts),
        ]
        if not steps:
            nothing = Finding(
                f"{NOTHING}: the robot saw nothing, or the run was too short",
                grade=Grade.BROKEN,
                short=NOTHING,
            )
            findings = [nothing, *run.told, *images]
            return RunHealth(None, None, None, findings, Verdict.of(findings, run.partial))
        figures = FilterFigures.of(steps, mapper.settings.particles)
        errors = run.witness.errors()
        apart = parting(np.array(mapper.odometry), path)
        findings = [
            *filter_findings(figures, "columns" if run.unit == "pairs" else "beams"),
            *parting_findings(apart),
            *odometry_findings(errors, motion == "encoders", motion in ("visual", "fused")),
            *run.told,
            *images,
        ]
        praise = "no pair was lost" if run.unit == "pairs" and not images else ""
        verdict = Verdict.of(findings, run.partial, praise)
        return RunHealth(figures, errors, apart, findings, verdict)

    @property
    def lines(self) -> list[str]:
        """What a run prints of itself."""
        return [finding.line for finding in self.findings]
