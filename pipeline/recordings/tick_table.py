"""Wheel ticks from any table of numbers: `--ticks FILE --ticks-columns time,left,right`."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

from odometry.tick_log import TickLog, parse_tick_log
from pipeline.errors import InputError
from pipeline.textfiles import read_lines

UNITS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
_NUMBER = re.compile(r"([+-]?)(\d{1,19})(?:\.(\d*))?(?:[eE]([+-]?\d{1,2}))?")
# What names a unit at the end of a column's name: `t [ms]`, `time_us`, `stamp(ns)`.
_UNIT = re.compile(r"(?:^|[\s_(\[])(ns|us|ms|s|sec|seconds)[)\]]?$", re.IGNORECASE)


def read_tick_table(path: Path, columns: str, unit: str | None, offset: float) -> TickLog:
    """Ticks out of a table with commas, semicolons, tabs or blanks between its columns.

    Args:
        columns: names (of a header line) or numbers (from 1) of time, left and right.
        unit: of the time; None: as the column's name says, else seconds.
        offset: added to the time [s]: the images' clock is the one that counts.

    Raises:
        InputError: no such file or column; OdometryError: no usable lines.
    """
    lines = [line for line in read_lines(path) if line.strip()]
    if not lines:
        raise InputError(f"{path}: is empty")
    delimiter = _delimiter(lines[0])
    names = [name.strip() for name in columns.split(",")]
    if len(names) != 3:
        raise InputError(f"--ticks-columns {columns}: give three, as in time,left,right or 1,2,3")
    rows = [_fields(line, delimiter) for line in lines]
    header = [field.strip().lstrip("#").strip() for field in rows[0]]
    if all(_NUMBER.fullmatch(field) for field in header):
        header = [str(number) for number in range(1, len(header) + 1)]  # no names: by number
    indices = [_index(name, header, path) for name in names]
    scale = UNITS[unit or _unit_of(header[indices[0]])]
    shift = round(offset * 1e9)
    text = "\n".join(_row(row, indices, scale, shift) for row in rows[1:])
    if _row(rows[0], indices, scale, shift)[0] != "?":  # no header: the first line counts
        text = _row(rows[0], indices, scale, shift) + "\n" + text
    return parse_tick_log(text + "\n", str(path))


def _delimiter(line: str) -> str | None:
    return next((mark for mark in (",", ";", "\t") if mark in line), None)


def _fields(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return next(csv.reader([line], delimiter=delimiter))


def _index(name: str, header: Sequence[str], path: Path) -> int:
    lowered = [field.lower() for field in header]
    bare = [re.sub(r"\s*[\[(].*$", "", field) for field in lowered]
    for known in (lowered, bare):
        if name.lower() in known:
            return known.index(name.lower())
    if name.isdecimal() and 1 <= int(name) <= len(header):
        return int(name) - 1
    raise InputError(
        f"{path}: no column '{name}' (there are: {', '.join(header[:12])}): give names or numbers "
        "from 1 with --ticks-columns"
    )


def _unit_of(name: str) -> str:
    match = _UNIT.search(name.strip())
    return "s" if match is None or match[1].lower().startswith("s") else match[1].lower()


def _row(fields: Sequence[str], indices: Sequence[int], scale: int, shift: int) -> str:
    """The line of an odom0/data.csv; `?` stands for what is no number."""
    picked = [fields[i].strip() if i < len(fields) else "" for i in indices]
    stamp = _nanoseconds(picked[0], scale)
    counts = [_count(field) for field in picked[1:]]
    return f"{'?' if stamp is None else stamp + shift},{counts[0]},{counts[1]}"


def _nanoseconds(text: str, scale: int) -> int | None:
    """Whole nanoseconds of a decimal number, without the rounding of a float."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        return None
    sign, whole, fraction, exponent = match.groups()
    fraction = fraction or ""
    value = int(whole + fraction) * scale * 10 ** max(0, int(exponent or 0))
    value //= 10 ** (len(fraction) + max(0, -int(exponent or 0)))
    return -value if sign == "-" else value


def _count(text: str) -> str:
    """A whole count; tables out of spreadsheets write 12 as 12.0."""
    match = re.fullmatch(r"([+-]?\d{1,18})(?:\.0*)?", text)
    return match[1] if match else "?"
