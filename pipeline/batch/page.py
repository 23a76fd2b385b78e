"""What a batch found out, to read: table.md, table.csv and index.html."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import cv2

from pipeline.batch.rows import Row
from pipeline.experiments.report import command_line, machine, markdown_table
from pipeline.new_files import new_files
from pipeline.pages.render import png_uri, render
from pipeline.picture import FOOTER

FILES = ("index.html", "table.md", "table.csv")
THUMBNAIL = (480, 360)  # at most, width and height [px]
HEADER = (
    "recording",
    "pairs",
    "path [m]",
    "free [m2]",
    "occupied [m2]",
    "local maps",
    "map",
    "ATE [m]",
    "seconds",
)
LEGEND = (
    "Pairs: with a pose (of scan logs: scans). Free, occupied: areas of the map. Map: the verdict "
    "of its report, from what the run measured of itself. ATE: RMSE to the recording's truth after "
    "SE(2) alignment, where it holds one. Seconds: as they were when it was mapped, with the "
    "others beside it."
)


def write_overview(output: Path, rows: Sequence[Row]) -> None:
    """Write the three files into the batch's folder, in place of older ones.

    Raises:
        InputError: they cannot be written.
    """
    with new_files([output / name for name in FILES], force=True) as partial:
        (partial / "table.csv").write_text(_csv(rows), encoding="utf-8", newline="")
        (partial / "table.md").write_text(_markdown(rows), encoding="utf-8")
        (partial / "index.html").write_text(_page(output, rows), encoding="utf-8")


def summary(rows: Sequence[Row]) -> str:
    """How many, as in "7 mapped, 1 failed"."""
    states = [row.state for row in rows]
    counts = {state: states.count(state) for state in ("mapped", "failed", "not done")}
    return ", ".join(f"{count} {state}" for state, count in counts.items() if count)


def cells(row: Row) -> list[str]:
    """A row of the table with `HEADER`."""
    return [
        row.name,
        _number(row.pairs, 0),
        _number(row.path_m, 1),
        _number(row.free_m2, 1),
        _number(row.occupied_m2, 1),
        _number(row.local_maps, 0),
        row.verdict or row.state,
        _number(row.ate_m, 3),
        _number(row.seconds, 1),
    ]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _csv(rows: Sequence[Row]) -> str:
    names = [name for name in Row.__struct_fields__ if name != "remarks"]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        values = (getattr(row, name) for name in names)
        writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in values])
    return text.getvalue()


def _markdown(rows: Sequence[Row]) -> str:
    parts = [
        f"# {len(rows)} recordings: {summary(rows)}",
        f"`{command_line()}`\n\n{machine()}.",
        markdown_table(HEADER, [[_escaped(cell) for cell in cells(row)] for row in rows]),
        LEGEND,
    ]
    told = [f"- {_escaped(row.name)}: {line}" for row in rows for line in _said(row)]
    if told:
        parts.append("## What they say\n\n" + "\n".join(told))
    return "\n\n".join(parts) + "\n"


def _said(row: Row) -> list[str]:
    """Why it failed, or what it remarks."""
    return [f"failed: {row.why}"] if row.why else list(row.remarks)


def _escaped(text: str) -> str:
    """With nothing that ends a cell of a table."""
    return text.replace("|", "\\|")


def _page(output: Path, rows: Sequence[Row]) -> str:
    return render(
        "pipeline.batch",
        "index.html.j2",
        summary=summary(rows),
        command=command_line(),
        machine=machine(),
        header=HEADER,
        legend=LEGEND,
        runs=[
            {
                "row": row,
                "cells": cells(row),
                "said": _said(row),
                "picture": _thumbnail(output / row.name / "map.png") if _is_mapped(row) else "",
                "links": _links(output, row) if _is_mapped(row) else [],
            }
            for row in rows
        ],
    )


def _is_mapped(row: Row) -> bool:
    return row.state == "mapped"


def _links(output: Path, row: Row) -> list[tuple[str, str]]:
    """(address beside the page, what it leads to) of what there is in the result folder."""
    wanted = (("report.html", "report"), ("map.png", "map"), ("run.json", "run.json"))
    return [
        (f"{quote(row.name)}/{file}", told)
        for file, told in wanted
        if (output / row.name / file).is_file()
    ]


def _thumbnail(file: Path) -> str:
    """A small picture as an address that holds it."""
    picture = cv2.imread(str(file))
    if picture is None:
        return ""
    picture = picture[:-FOOTER]  # its words could not be read
    height, width = picture.shape[:2]
    scale = min(1.0, THUMBNAIL[0] / width, THUMBNAIL[1] / height)
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return png_uri(small)
