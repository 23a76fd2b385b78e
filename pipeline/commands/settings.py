"""`beemap settings`: every setting with its default, unit and meaning."""

from __future__ import annotations

import click


@click.command("settings")
@click.option("--yaml", "as_file", is_flag=True, help="print a settings file with the defaults")
def settings_command(as_file: bool) -> None:
    """List all settings: default, unit, meaning.

    Change one with --set stage.key=value, or several in a YAML file given with --settings.
    """
    from pipeline.settings import defaults_as_yaml, described

    if as_file:
        click.echo(defaults_as_yaml(), nl=False)
        return
    rows = [
        (name, "auto" if default is None else str(default), unit, meaning)
        for name, default, unit, meaning in described()
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    for name, default, unit, meaning in rows:
        click.echo(f"{name:<{widths[0]}}  {default:>{widths[1]}}  {unit:<{widths[2]}}  {meaning}")
