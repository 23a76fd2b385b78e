"""`beemap evaluate`: a path or a map against the truth."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from pipeline.evaluate_map import MapScore
    from pipeline.evaluate_path import PathScore
    from pipeline.evaluate_relations import RelationScore

as_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


@click.group()
def evaluate() -> None:
    """Compare a path or a map with the truth."""


@evaluate.command()
@click.argument("estimate", metavar="EST.tum", type=click.Path())
@click.argument("reference", metavar="REF.tum", type=click.Path())
@as_json
def path(estimate: str, reference: str, as_json: bool) -> None:
    """Errors of a path (TUM files): absolute after SE(2) alignment, relative over 1 m, heading."""
    from pipeline.evaluate_path import evaluate_path_files

    score = evaluate_path_files(estimate, reference)
    click.echo(_json(_path_fields(score)) if as_json else _path_text(score))


@evaluate.command("map")
@click.argument("generated", metavar="RUN|MAP.npz|MAP.yaml", type=click.Path())
@click.argument("ideal", metavar="IDEAL", type=click.Path())
@as_json
def map_(generated: str, ideal: str, as_json: bool) -> None:
    """Dissimilarity E of a map to the IDEAL one, and precision and recall of obstacle cells.

    IDEAL is a map as well: a result folder, .npz, or a map_server .yaml.
    """
    from pipeline.evaluate_map import evaluate_map_files

    score = evaluate_map_files(generated, ideal)
    click.echo(_json(_map_fields(score)) if as_json else _map_text(score))


@evaluate.command()
@click.argument("estimate", metavar="EST.tum", type=click.Path())
@click.argument("relations", metavar="FILE.relations", type=click.Path())
@as_json
def relations(estimate: str, relations: str, as_json: bool) -> None:
    """Errors of a path in hand-made relations between places (Kuemmerle et al. 2009).

    FILE.relations holds lines 't1 t2 x y z roll pitch yaw': the true pose at t2 seen from that at
    t1. The times must stand in EST.tum exactly; those that do not are counted and named.
    """
    from pipeline.evaluate_relations import evaluate_relation_files

    score = evaluate_relation_files(estimate, relations)
    click.echo(_json(_relation_fields(score)) if as_json else _relation_text(score))


def _path_fields(score: PathScore) -> dict[str, Any]:
    return {
        "poses": score.poses,
        "matched": score.matched,
        "ate_rmse_m": score.ate_rmse,
        "ate_mean_m": score.ate_mean,
        "ate_median_m": score.ate_median,
        "ate_max_m": score.ate_max,
        "heading_rmse_deg": math.degrees(score.heading_rmse),
        "relative_translation_rmse_m": score.relative_translation,
        "relative_rotation_rmse_deg": math.degrees(score.relative_rotation),
        "relative_segments": score.relative_segments,
        "length_m": score.length,
        "reference_length_m": score.reference_length,
    }


def _path_text(score: PathScore) -> str:
    fields = _path_fields(score)
    relative = "none: the path is shorter than 1 m"
    if score.relative_segments:
        relative = (
            f"{fields['relative_translation_rmse_m']:.3f} m, "
            f"{fields['relative_rotation_rmse_deg']:.2f} deg RMSE over 1 m "
            f"({score.relative_segments} stretches)"
        )
    return "\n".join(
        [
            f"matched         {score.matched} of {score.poses} poses",
            f"ATE             {score.ate_rmse:.3f} m RMSE (mean {score.ate_mean:.3f}, "
            f"median {score.ate_median:.3f}, max {score.ate_max:.3f})",
            f"heading error   {fields['heading_rmse_deg']:.2f} deg RMSE",
            f"relative error  {relative}",
            f"length          {score.length:.2f} m, reference {score.reference_length:.2f} m",
        ]
    )


def _map_fields(score: MapScore) -> dict[str, Any]:
    x, y, turn = score.motion
    return {
        "E": score.E,
        "E_cut": score.E_cut,
        "known_cells": score.known,
        "decided_share": score.decided,
        "overlap_share": score.overlap,
        "precision": score.precision,
        "recall": score.recall,
        "f1": score.f1,
        "alignment": {"x_m": x, "y_m": y, "turn_deg": math.degrees(turn)},
    }


def _map_text(score: MapScore) -> str:
    x, y, turn = score.motion
    return "\n".join(
        [
            f"E               {score.E:.1f} over {score.known} known cells "
            f"({score.overlap:.0%} of them known in the ideal map)",
            f"E, cut .7/.2    {score.E_cut:.1f} ({score.decided:.0%} of the known cells decided)",
            f"obstacle cells  precision {score.precision:.3f}, recall {score.recall:.3f}, "
            f"F1 {score.f1:.3f} (within one cell)",
            f"alignment       x {x:+.3f} m, y {y:+.3f} m, turn {math.degrees(turn):+.2f} deg",
        ]
    )


def _relation_fields(score: RelationScore) -> dict[str, Any]:
    return {
        "relations": score.relations,
        "scored": score.scored,
        "scored_share": score.scored / score.relations,
        "missing": score.missing,
        "damaged_lines": score.damaged,
        "translation_mean_m": score.translation,
        "translation_sd_m": score.translation_sd,
        "translation_max_m": score.translation_max,
        "rotation_mean_deg": math.degrees(score.rotation),
        "rotation_sd_deg": math.degrees(score.rotation_sd),
        "rotation_max_deg": math.degrees(score.rotation_max),
    }


def _relation_text(score: RelationScore) -> str:
    from pipeline.recordings.base import counted

    fields = _relation_fields(score)
    lines = [
        f"scored          {score.scored} of {score.relations} relations "
        f"({fields['scored_share']:.1%})",
        f"translation     {score.translation:.4f} ± {score.translation_sd:.4f} m "
        f"(max {score.translation_max:.3f})",
        f"rotation        {fields['rotation_mean_deg']:.3f} ± {fields['rotation_sd_deg']:.3f} deg "
        f"(max {fields['rotation_max_deg']:.2f})",
    ]
    if score.missing:
        lines.append(f"missing         {counted(score.missing)}: their times are not in the path")
    if score.damaged:
        lines.append(f"damaged         {counted(score.damaged)}: not 8 numbers")
    return "\n".join(lines)


def _json(fields: dict[str, Any]) -> str:
    """One object; a number that does not exist (a mean of nothing) is null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        return None if isinstance(value, float) and math.isnan(value) else value

    return json.dumps(plain(fields), indent=2)
