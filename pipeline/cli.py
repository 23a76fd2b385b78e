"""The command line. Heavy libraries are imported inside the commands that need them."""

from __future__ import annotations

import sys

import click

from pipeline.commands.lazy import LazyGroup
from pipeline.errors import for_user, one_line
from pipeline.signals import interrupting, lasting_output

# name -> (module:function in pipeline.commands, what it does).
COMMANDS = {
    "map": ("map:map_command", "Map a recording or a scan log: map and path out."),
    "batch": ("batch:batch_command", "Map many recordings, on all cores or a cluster."),
    "live": ("live:live_command", "Map while the robot drives."),
    "replay": ("replay:replay_command", "Watch a recording being mapped, in the browser."),
    "doctor": ("doctor:doctor_command", "Look whether everything is ready for a live run."),
    "record": ("record:record_command", "Record cameras and encoders."),
    "info": ("info:info_command", "Say what a recording or a scan log holds."),
    "view": ("view:view_command", "Show a run on one time line, in rerun's viewer."),
    "export": ("export:export_command", "Write a run as a bag for Foxglove and RViz."),
    "import": ("import_bag:import_command", "Turn a ROS bag into a recording."),
    "calibrate": ("calibrate:calibrate", "Calibrate a new camera pair."),
    "odometry": ("odometry:odometry", "Read, calibrate and check wheel encoders."),
    "rig": ("rig:rig", "Show, check and convert a rig file."),
    "stereo": ("stereo:stereo", "See what stereo makes of images; measure its sensor model."),
    "simulate": ("simulate:simulate", "Make recordings and scan logs with known truth."),
    "evaluate": ("evaluate:evaluate", "Compare a path or a map with the truth."),
    "experiment": ("experiment:experiment", "Run the paper's experiments, with many seeds."),
    "settings": ("settings:settings_command", "List all settings: default, unit, meaning."),
}


@click.group(
    cls=LazyGroup, table=COMMANDS, context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(package_name="beemap", message="beemap %(version)s")
def cli() -> None:
    """A 2D map and a path from a small stereo camera and two wheel encoders.

    \b
    beemap simulate office -o REC       a rendered recording to try things on
    beemap info REC                     what a recording holds
    beemap map REC -o RUN               map it: RUN/map.png, map.yaml, trajectory.tum, ...
    beemap evaluate path RUN/trajectory.tum RUN/truth.tum
    """


def main() -> None:
    """Entry point of `beemap`: user errors are one line on stderr and exit code 2."""
    with lasting_output():
        code = _run()
    sys.exit(code or 0)


def _run() -> int | None:
    try:
        with interrupting():
            code = cli.main(prog_name="beemap", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        code = error.exit_code
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        remedy = f" (see '{context.command_path} --help')" if context else ""
        click.echo(f"beemap: {one_line(error.format_message()).rstrip('.')}{remedy}", err=True)
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("beemap: interrupted", err=True)
        code = 130
    except Exception as error:
        message = for_user(error)
        if message is None:
            raise
        click.echo(f"beemap: {message}", err=True)
        code = 2
    return code


if __name__ == "__main__":
    main()
