"""report.html: the map, the verdict, and all that a run measured of itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapping.grid import OccupancyGrid
from pipeline.health.run_health import RunHealth
from pipeline.pages.render import render
from pipeline.recordings.base import RecordedPair
from pipeline.run import MapRun
from pipeline.run_report import tables
from pipeline.run_report.curves import Curve, along_the_run, both_paths
from pipeline.run_report.map_view import map_view
from pipeline.run_report.next_steps import next_steps
from pipeline.run_report.origin import Origin
from pipeline.run_report.thumbnails import thumbnails
from pipeline.settings import Settings
from pipeline.trajectory import distance_travelled
from pipeline.worst_pairs import FEW_RANGES, UNLIKE_MAP, Suspect

PAGE = "report.html"


def write_report(
    folder: Path,
    run: MapRun,
    settings: Settings,
    grid: OccupancyGrid,
    path: np.ndarray,
    health: RunHealth,
    summary: dict[str, Any],
    origin: Origin,
) -> str:
    """Write the page into `folder`; what could not be shown in it, in words, or "".

    grid, path (n, 3): the map and the path; summary: the content of run.json.
    """
    sight = "columns" if run.unit == "pairs" else "beams"
    driven = distance_travelled(path) if len(path) else np.zeros(1)
    suspects = run.worst.chosen()
    pairs, problem = _pairs(origin, run)

    def place(suspect: Suspect) -> str:
        if suspect.index < 0:
            return suspect.name
        seconds = (suspect.stamp - run.mapper.stamps[0]) / 1e9
        return f"{suspect.name}, after {driven[suspect.index]:.1f} m and {seconds:.1f} s"

    shown = thumbnails(suspects, health.figures, sight, place, pairs)
    groups = [
        (heading, [one for one, s in zip(shown, suspects, strict=True) if kind(s)])
        for heading, kind in (
            ("Of no use", lambda s: s.kind not in (FEW_RANGES, UNLIKE_MAP)),
            (f"Fewest {sight} with an answer", lambda s: s.kind == FEW_RANGES),
            ("Matched the map worst", lambda s: s.kind == UNLIKE_MAP),
        )
    ]
    page = render(
        "pipeline.run_report",
        "report.html.j2",
        name=Path(str(summary.get("input", ""))).name or "a run",
        verdict=health.verdict,
        partial=run.partial,
        unit=run.unit,
        sight=sight,
        window=settings.mapping.window,
        map=map_view(
            grid, path, driven, run.mapper.filter.poses, [s.index for s in suspects], run.places
        ),
        summary=summary,
        next=next_steps(health, origin, run.partial, (folder / "truth.tum").exists()),
        curves=_curves(run, driven, health, sight),
        groups=[(heading, found) for heading, found in groups if found],
        problem=problem,
        show=_show(origin, shown),
        paths=both_paths(np.array(run.mapper.odometry), path) if len(path) else "",
        odometry=tables.odometry_rows(health),
        stages=tables.stage_rows(summary["seconds"], run.used),
        live=tables.live_rows(summary),
        losses=tables.loss_rows(summary),
        settings=tables.changed_settings(settings),
        facts=tables.facts_rows(summary, grid.cell),
        notes=summary.get("notes", []),
    )
    (folder / PAGE).write_text(page, encoding="utf-8")
    return problem


def _pairs(origin: Origin, run: MapRun) -> tuple[Sequence[RecordedPair], str]:
    """The recording's pairs; or why there are none to show."""
    if run.unit != "pairs":
        return (), ""
    try:
        return origin.pairs(), ""
    except Exception as error:  # a recording that has gone must not cost the results
        return (), f"the images of the worst pairs could not be read again: {error}"


def _curves(run: MapRun, driven: np.ndarray, health: RunHealth, sight: str) -> list[Curve]:
    if health.figures is None:
        return []
    steps = run.mapper.filter.health
    # The last local map is closed by the end of the run.
    where = np.full(len(steps), driven[-1])
    where[: len(run.ends)] = driven[run.ends]
    return along_the_run(steps, where, health.figures, sight)


def _show(origin: Origin, shown: Sequence[Any]) -> str:
    """The command that draws what stereo made of the first pair that is shown."""
    frames = [one.frame for one in shown if one.frame is not None]
    if not frames:
        return ""
    command = "beemap stereo show {recording}{rig_option} --frame "
    return origin.fill(f"{command}{frames[0]} -o pair.png")
