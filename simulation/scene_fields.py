"""Checks of a scene file: what its fields hold, or one line that names field and remedy."""

from __future__ import annotations

import math
from collections.abc import Set
from typing import Any

from simulation.materials import MATERIALS


class SceneError(ValueError):
    """A scene file that cannot be used; the message names the file, the field and the remedy."""


def fields(
    data: Any, where: str, required: Set[str], optional: Set[str] = frozenset()
) -> dict[str, Any]:
    """`data` as a mapping that has all `required` fields and none but these and the `optional`."""
    if not isinstance(data, dict):
        raise SceneError(f"{where}: expected the fields {listed(required)}")
    for key in data:
        if key not in required | optional:
            known = listed(required | optional)
            raise SceneError(f"{where}: unknown field '{key}' (known: {known})")
    for key in sorted(required):
        if key not in data:
            raise SceneError(f"{where}: field '{key}' is missing")
    return data


def entries(value: Any, where: str) -> list[tuple[str, Any]]:
    """The entries of a list that is not empty, each with its place."""
    if not isinstance(value, list) or not value:
        raise SceneError(f"{where}: expected a list, got {value!r}")
    return [(f"{where}[{i}]", entry) for i, entry in enumerate(value)]


def named(value: Any, where: str) -> dict[str, Any]:
    """A mapping."""
    if not isinstance(value, dict):
        raise SceneError(f"{where}: expected names with what they stand for, got {value!r}")
    return value


def material(value: Any, where: str) -> str:
    """One of MATERIALS."""
    if value not in MATERIALS:
        raise SceneError(f"{where}: '{value}' unknown (known: {listed(MATERIALS)})")
    return value


def numbers(value: Any, count: int, where: str) -> tuple[float, ...]:
    """A list of `count` finite numbers."""
    good = isinstance(value, list) and len(value) == count
    if not good or not all(_is_number(v) for v in value):
        raise SceneError(f"{where}: expected {count} finite number(s), got {value!r}")
    return tuple(float(v) for v in value)


def number(value: Any, where: str) -> float:
    """A finite number."""
    return numbers([value], 1, where)[0]


def positive(value: Any, count: int, where: str) -> tuple[Any, ...]:
    """A list of `count` finite numbers above 0."""
    result = numbers(value, count, where)
    if min(result) <= 0:
        raise SceneError(f"{where}: {value!r} must be positive")
    return result


def length(value: Any, where: str) -> float:
    """A finite number above 0."""
    return positive([value], 1, where)[0]


def points(value: Any, where: str) -> list[tuple[float, ...]]:
    """A list of points [x, y]."""
    return [numbers(point, 2, place) for place, point in entries(value, where)]


def listed(names: Any) -> str:
    """Names in a row, for messages."""
    return ", ".join(sorted(names))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
