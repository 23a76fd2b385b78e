"""`beemap simulate paper`: the paper's simulated experiment as a scan log, with its truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.commands.stereo_error_options import check_log_name, stereo_error_options
from pipeline.errors import InputError
from pipeline.new_files import check_free, new_files

if TYPE_CHECKING:
    from simulation.paper import PaperRun, PaperSettings
    from simulation.route import Route
    from simulation.world import World


@click.command(short_help="The paper's Sec. IV as a log of ranges and odometry, without images.")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="The log, as paper.log; paper.tum, .pgm, .yaml, .seen.pgm and .seen.yaml go beside it.",
)
@click.option(
    "--seed", default=1, show_default=True, type=click.IntRange(min=0), help="Of all the errors."
)
@stereo_error_options
@click.option(
    "--world",
    default="flat",
    show_default=True,
    metavar="NAME|FILE",
    help="flat, hall, corridors, a world file, or a floor plan as map_server YAML.",
)
@click.option(
    "--route",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Waypoints (YAML), or a path (TUM, CSV), in place of the world's own route.",
)
@click.option(
    "--positions",
    type=click.IntRange(min=1),
    metavar="N",
    help="Observations, one every 200 mm. By default the paper's 785, or fewer on a short route.",
)
@click.option("--perfect", is_flag=True, help="Exact ranges and odometry: no error of any kind.")
@click.option("--force", is_flag=True, help="Replace existing files.")
@click.option("--quiet", is_flag=True, help="No summary.")
def paper(**options: Any) -> None:
    """Drive through a floor plan as in the paper's Sec. IV and log what the camera sees.

    Writes a CARMEN log of ranges and odometry, and beside it the true path, the floor plan and
    what perfect sensors would see of it. Takes a second.

    Example: beemap simulate paper -o paper.log --seed 1
    """
    from simulation.paper import simulate

    log = options["output"]
    check_log_name(log)
    targets = [log, *(log.with_name(log.stem + end) for end in _BESIDE)]
    check_free(targets, options["force"])
    world, route = _place(options["world"], options["route"])
    settings = _settings(options, world, route)
    run = simulate(world, route, settings, options["seed"], options["perfect"])
    with new_files(targets, options["force"]) as folder:
        _write(folder, log, world, settings, run, options)
    if not options["quiet"]:
        _summarise(log, world, route, settings, run)


_BESIDE = (".tum", ".pgm", ".yaml", ".seen.pgm", ".seen.yaml")


def _place(name: str, route_file: Path | None) -> tuple[World, Route]:
    from simulation.world import load_route, load_world

    world = load_world(name)
    route = world.route if route_file is None else load_route(route_file)
    if route is None:
        raise InputError(f"{name}: holds no route: give --route FILE")
    return world, route


def _settings(options: dict[str, Any], world: World, route: Route) -> PaperSettings:
    from simulation.paper import PaperSettings, positions_on

    positions = options["positions"]
    if positions is None:
        positions = min(PaperSettings.positions, positions_on(route, PaperSettings.spacing))
    return PaperSettings(
        alpha=options["alpha"],
        blocks=options["blocks"],
        false_depth=options["false_depth"],
        positions=positions,
    )


def _write(
    folder: Path,
    log: Path,
    world: World,
    settings: PaperSettings,
    run: PaperRun,
    options: dict[str, Any],
) -> None:
    import numpy as np

    from pipeline.map_files import write_map_server
    from pipeline.recordings.carmen_writer import write_carmen
    from pipeline.trajectory import Trajectory, write_tum
    from simulation.paper import floor_plan, seen_plan

    about = [_made_by(options, settings), "observations of a stereo camera, Sec. IV of the paper"]
    suggested = _suggested(settings, options["perfect"])
    write_carmen(folder / log.name, run.scans, run.odometry, about, suggested)
    stamps = np.array([scan.stamp for scan in run.scans])
    write_tum(folder / f"{log.stem}.tum", Trajectory(stamps, run.truth))
    write_map_server(folder, floor_plan(world, run.poses[0]), log.stem)
    write_map_server(folder, seen_plan(world, run.poses, settings), f"{log.stem}.seen")


def _suggested(settings: PaperSettings, perfect: bool) -> dict[str, dict[str, Any]]:
    """What a mapper should know of this log: the doubts of odometry as random walks, so that one
    step of `spacing` has the doubt it was made with; and the laser's."""
    x, y, theta = (0.0 if perfect else sd for sd in settings.odometry_noise)
    walk = math.sqrt(settings.spacing)
    return {
        "odometry": {
            "along": x / walk,
            "across": y / walk,
            "heading": math.degrees(theta) / walk,
            "turn": 0.0,
        },
        "laser": {
            "noise": 0.0 if perfect else settings.depth_noise,
            "floor": 0.0,
            "maximum": "free",
            "max_range": settings.max_range,
        },
        # Every position is an observation; errors are independent from beam to beam, so that the
        # scans are trusted more, and hits taken as points.
        "mapping": {
            "spacing": 0.5 * settings.spacing,
            "correlated": 1.0,
            "window": 10,
            "match_weight": 20.0,
            "spread": False,
        },
    }


def _made_by(options: dict[str, Any], settings: PaperSettings) -> str:
    """The command that makes the same log again, wherever it is written to."""
    import shlex

    words = ["beemap", "simulate", "paper", "--seed", options["seed"], "--world", options["world"]]
    if options["route"] is not None:
        words += ["--route", options["route"]]
    words += ["--positions", settings.positions]
    if options["perfect"]:
        words += ["--perfect"]
    else:
        words += ["--alpha", settings.alpha, "--blocks", settings.blocks]
        words += ["--false-depth", settings.false_depth]
    return shlex.join(map(str, words))


def _summarise(
    log: Path, world: World, route: Route, settings: PaperSettings, run: PaperRun
) -> None:
    import numpy as np

    from pipeline.evaluate_path import evaluate_path
    from pipeline.trajectory import Trajectory

    n = len(run.scans)
    click.echo(
        f"{log}: {n} positions, {settings.spacing * (n - 1):.1f} m through {world.name}"
        + (f" (its route of {route.distance:.1f} m ends there)" if n < 785 else "")
    )
    if n > 1:
        stamps = np.array([scan.stamp for scan in run.scans])
        score = evaluate_path(Trajectory(stamps, run.odometry), Trajectory(stamps, run.truth))
        click.echo(f"dead reckoning alone: ATE {score.ate_rmse:.3f} m")
