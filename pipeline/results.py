"""The result folder: written whole or not at all, the same bytes for the same run."""

from __future__ import annotations

import csv
import io
import json
import platform
import resource
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mapping.clouds import map_points, write_ply
from mapping.grid import FREE, OCCUPIED, OccupancyGrid
from pipeline.health.run_health import RunHealth
from pipeline.map_files import write_map_server, write_npz
from pipeline.picture import draw_map
from pipeline.places import run_places, write_places
from pipeline.run import MapRun
from pipeline.run_report.origin import Origin
from pipeline.settings import Settings, as_yaml
from pipeline.trajectory import Trajectory, distance_travelled, write_tum

VERSIONS_OF = (
    "beemap",
    "numpy",
    "scipy",
    "numba",
    "opencv-contrib-python-headless",
    "msgspec",
)


HEALTH_COLUMNS = (
    "stamp_ns",
    "observations",
    "n_eff",
    "resampled",
    "recovered",
    "overlap_cells",
    "matched_share",
    "particles_judged",
    "columns_answered",
    "tiles",
)


def write_results(
    folder: Path,
    run: MapRun,
    settings: Settings,
    truth: Trajectory | None,
    facts: dict[str, Any],
    origin: Origin | None = None,
) -> dict[str, Any]:
    """Write every result file into `folder`; the content of run.json.

    facts: what the command knows of the run (input, seed, rig, motion); origin: where it came
    from, without which the report names no place and shows no images.
    """
    mapper = run.mapper
    grid, path = mapper.grid(), mapper.path()
    write_map_server(folder, grid)
    write_npz(folder / "map.npz", grid)
    stamps = np.array(mapper.stamps, np.int64)
    write_tum(folder / "trajectory.tum", Trajectory(stamps, path))
    write_tum(folder / "online.tum", Trajectory(stamps, np.array(mapper.online).reshape(-1, 3)))
    write_tum(folder / "odometry.tum", Trajectory(stamps, np.array(mapper.odometry).reshape(-1, 3)))
    if truth is not None:
        write_tum(folder / "truth.tum", truth)
    places = run_places(run, path)
    write_places(folder, places)
    _write_picture(folder / "map.png", run, grid, path, places)
    write_ply(folder / "map.ply", map_points(grid))
    if run.key_frames is not None:
        write_ply(folder / "cloud.ply", run.key_frames.merged(path))
        if lost := run.key_frames.lost:
            run.counts["key frames that found no room on the disk"] = lost
    (folder / "health.csv").write_text(_health(run), encoding="ascii")
    (folder / "settings.yaml").write_text(as_yaml(settings), encoding="utf-8")
    health = RunHealth.of(run, path, facts)
    summary = _summary(run, grid, path, facts, health)
    origin = origin or Origin.unknown(folder)
    if untold := _report(folder, run, settings, grid, path, health, summary, origin):
        summary["health"].append(untold)
    (folder / "run.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


def _report(folder: Path, *about: Any) -> str:
    """Write report.html; what is missing in it, or why there is none, in words. A map that is made
    is never lost for it."""
    from pipeline.run_report.report import PAGE, write_report

    try:
        return write_report(folder, *about)
    except Exception as error:
        (folder / PAGE).unlink(missing_ok=True)
        return f"{PAGE} could not be written: {error}"


def _length(path: np.ndarray) -> float:
    return float(distance_travelled(path)[-1]) if len(path) else 0.0


def _write_picture(
    file: Path, run: MapRun, grid: OccupancyGrid, path: np.ndarray, places: list[dict]
) -> None:
    caption = (
        f"{run.used} {run.unit}, {len(run.mapper.filter.health)} local maps, "
        f"{_length(path):.1f} m of path, cells of {grid.cell * 1000:.0f} mm"
        + (", PARTIAL: the run was interrupted" if run.partial else "")
    )
    picture = draw_map(grid, path, run.mapper.filter.poses, caption, places)
    encoded, data = cv2.imencode(".png", picture)
    assert encoded
    file.write_bytes(data.tobytes())


def _health(run: MapRun) -> str:
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(HEALTH_COLUMNS)
    for step in run.mapper.filter.health:
        writer.writerow(
            [
                step.stamp,
                step.observations,
                f"{step.n_eff:.3f}",
                int(step.resampled),
                int(step.recovered),
                step.overlap,
                f"{step.matched:.4f}",
                step.judged,
                f"{step.answered:.4f}",
                step.tiles,
            ]
        )
    return table.getvalue()


def _summary(
    run: MapRun, grid: OccupancyGrid, path: np.ndarray, facts: dict[str, Any], health: RunHealth
) -> dict[str, Any]:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        **facts,
        "partial": run.partial,
        "verdict": {"word": health.verdict.word, "why": health.verdict.why},
        "counts": dict(run.counts),
        "skipped": run.skipped,
        "local_maps": len(run.mapper.filter.health),
        "path_m": round(_length(path), 3),
        "free_m2": round(grid.area(FREE), 2),
        "occupied_m2": round(grid.area(OCCUPIED), 2),
        "seconds": {stage: round(seconds, 3) for stage, seconds in run.seconds.items()},
        # ru_maxrss counts kilobytes on Linux, bytes on macOS.
        "peak_memory_mb": round(peak / (1e6 if sys.platform == "darwin" else 1e3), 1),
        "health": health.lines,
        "to_do": [finding.line for finding in health.findings if finding.remedy],
        "versions": {name: version(name) for name in VERSIONS_OF},
        "python": platform.python_version(),
    }
