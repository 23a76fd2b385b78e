"""`beemap stereo model`: the sensor model of the mapper, measured."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from pipeline.intervals import Estimate
    from pipeline.settings import Settings
    from pipeline.stereo_model import Examined, StereoModel

# A probability of 0 or 1 would let one observation decide for ever.
LEAST = 0.001
FIGURES = ("cells", "noise", "blocks", "columns")


@click.command()
@click.argument("recording", type=click.Path(path_type=Path), metavar="RECORDING")
@click.option(
    "--run",
    type=click.Path(path_type=Path),
    help="Result folder of 'beemap map': hold the ranges against its map and path.",
)
@click.option("--rig", type=click.Path(path_type=Path), help="Wins over the recording's own.")
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings.")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="One setting.")
@click.option(
    "--pairs",
    default=200,
    show_default=True,
    type=click.IntRange(1),
    help="Pairs to look at, spread evenly.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Also write model.json, settings.yaml and the plots.",
)
@click.option("--threads", type=click.IntRange(min=1), help="Default: all cores.")
@click.option("--force", is_flag=True, help="Replace files that are there.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def model(
    recording: Path,
    run: Path | None,
    rig: Path | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    pairs: int,
    output: Path | None,
    threads: int | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Measure what the mapper believes of stereo: P(O|E), P(O|notE), noise, false blocks.

    The ranges of many pairs are held against the truth: that of a rendered recording, or the map
    and path that --run found in a real one, with the settings of that run; the errors of map and
    path then count as the ranges' own. All numbers come with 95 % intervals from drawing whole
    frames anew. The end of the output can be pasted into a settings file.

    \b
    beemap stereo model REC
    beemap map REC -o RUN; beemap stereo model REC --run RUN -o MODEL
    """
    import cv2

    from pipeline.new_files import check_free
    from pipeline.recordings import open_recording
    from pipeline.rig import choose_rig
    from pipeline.settings import load_settings
    from pipeline.stereo_model import examine, model_of
    from pipeline.stereo_truth import truth_of

    if output is not None:
        check_free(_targets(output), force)
    if run is not None and settings_file is None:
        settings_file = run / "settings.yaml"
    settings = load_settings(settings_file, overrides)
    opened = open_recording(recording)
    chosen, notes = choose_rig(opened, rig)
    truth, source = truth_of(opened, run)
    if not quiet:
        for note in notes:
            click.echo(f"note: {note}", err=True)
    cv2.setNumThreads(1)  # pairs run beside each other
    with progress_bar("ranging", "pairs", quiet or as_json) as progress:
        examined = examine(
            opened, chosen, settings, truth, pairs, threads or os.cpu_count() or 1, progress
        )
    found = model_of(examined)
    facts = _facts(found, examined, recording, source)
    if output is not None:
        _write(output, force, examined, found, facts, settings)
    if as_json:
        click.echo(json.dumps(facts, indent=2))
    elif not quiet:
        _print(found, examined, source, settings, run is not None)
        if output is not None:
            click.echo(f"written: {', '.join(str(target) for target in _targets(output))}")


def _targets(folder: Path) -> list[Path]:
    return [
        folder / name
        for name in ("model.json", "settings.yaml", *(f"{figure}.png" for figure in FIGURES))
    ]


def _facts(found: StereoModel, examined: Examined, recording: Path, source: str) -> dict[str, Any]:
    """JSON has no NaN: what was not observed is null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        if isinstance(value, list):
            return [plain(item) for item in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return plain(
        {
            "recording": str(recording),
            "truth": source,
            **asdict(found),
            "max_range_m": examined.compared.max_range,
            "pairs_without_truth": examined.counts["pairs without truth"],
            "skipped": examined.skipped,
        }
    )


def _write(
    folder: Path,
    force: bool,
    examined: Examined,
    found: StereoModel,
    facts: dict[str, Any],
    settings: Settings,
) -> None:
    from pipeline import stereo_model_figures as figures
    from pipeline.new_files import new_files

    drawn = {
        "cells": figures.cells_figure(examined, found),
        "noise": figures.noise_figure(examined, found, settings.stereo.noise),
        "blocks": figures.blocks_figure(examined, found),
        "columns": figures.columns_figure(examined, found),
    }
    with new_files(_targets(folder), force) as partial:
        text = json.dumps(facts, indent=2) + "\n"
        (partial / "model.json").write_text(text, encoding="utf-8")
        (partial / "settings.yaml").write_text(_snippet(found) + "\n", encoding="utf-8")
        for name, figure in drawn.items():
            figure.savefig(partial / f"{name}.png", metadata={"Software": None})


def _snippet(found: StereoModel) -> str:
    """The lines of a settings file."""
    sections = {
        "mapping": {
            "hit": _probability(found.hit.value),
            "false_hit": _probability(found.false_hit.value),
        },
        "stereo": {"noise": round(found.disparity_noise.value, 3)},
    }
    return "\n".join(
        line
        for stage, values in sections.items()
        for line in [f"{stage}:", *(f"  {key}: {v:g}" for key, v in values.items() if v == v)]
    )


def _probability(value: float) -> float:
    return value if math.isnan(value) else round(min(max(value, LEAST), 1.0 - LEAST), 4)


def _print(
    found: StereoModel, examined: Examined, source: str, settings: Settings, mapped: bool
) -> None:
    from pipeline.recordings.base import counted

    for reason, names in examined.skipped.items():
        click.echo(f"skipped: {reason}: {counted(names)}")
    if lonely := examined.counts["pairs without truth"]:
        click.echo(f"skipped: pairs without truth: {lonely}")
    click.echo(
        f"{found.frames} pairs, {found.columns} columns with a known truth ({source}), "
        f"ranges up to {examined.compared.max_range:.1f} m, [95 % intervals]"
    )
    mapping = settings.mapping
    noise = settings.stereo.noise
    click.echo(f"P(O|E)         {_share(found.hit)}, in use {mapping.hit:g}, paper 54 %")
    click.echo(
        f"P(O|notE)      {_share(found.false_hit)}, in use {mapping.false_hit:g}, paper 10 %"
    )
    for bin_ in found.bins:
        if not (math.isnan(bin_.hit.value) and math.isnan(bin_.false_hit.value)):
            click.echo(
                f"  {bin_.low:.0f} to {bin_.high:.0f} m     P(O|E) {_share(bin_.hit)}, "
                f"P(O|notE) {_share(bin_.false_hit)}"
            )
    click.echo(f"unanswered     {_share(found.unanswered)} of the columns")
    click.echo(
        f"false ranges   {_share(found.false)} of the answered columns "
        f"({_share(found.at_edge)} of these at an edge)"
    )
    click.echo(f"false free     {_share(found.false_free)} of the columns")
    click.echo(f"noise          {_share(found.noise)} of the range, paper 2 %")
    click.echo(
        f"               {_number(found.disparity_noise, 3)} px of disparity, in use {noise:g}; "
        f"median {_number(found.disparity_bias, 3)} px"
    )
    click.echo(
        f"its own sigma  covers {_share(found.within_1)} (68 %), {_share(found.within_2)} (95 %)"
    )
    click.echo(
        f"false blocks   {_number(found.blocks, 2)} a frame, paper 1; width "
        f"{_number(found.block_width, 2)} deg, sd {_number(found.block_width_sd, 2)}"
    )
    click.echo(
        f"               range {_number(found.block_depth, 2)} m, sd "
        f"{_number(found.block_depth_sd, 2)}, paper N(4.886, 1.773)"
    )
    if mapped:
        click.echo("note: all of this includes the errors of the map and the path themselves")
    click.echo("for the settings file:")
    click.echo(_snippet(found))


def _share(estimate: Estimate) -> str:
    """In percent, with digits enough for small ones."""
    if math.isnan(estimate.value):
        return "-"
    digits = 2 if estimate.value < 0.1 else 1
    low, high = 100 * estimate.low, 100 * estimate.high
    return f"{100 * estimate.value:.{digits}f} % [{low:.{digits}f} to {high:.{digits}f}]"


def _number(estimate: Estimate, digits: int) -> str:
    if math.isnan(estimate.value):
        return "-"
    return f"{estimate.value:.{digits}f} [{estimate.low:.{digits}f} to {estimate.high:.{digits}f}]"
