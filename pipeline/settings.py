"""All settings of a run: one typed struct per stage, read from YAML and from --set."""

from __future__ import annotations

import math
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from calibration.yamlfile import YamlFileError, dump_yaml, parse_yaml, read_yaml
from mapping.settings import MappingSettings
from odometry.settings import OdometrySettings
from pipeline.errors import InputError
from pipeline.recordings.laser import LaserSettings
from stereo.settings import StereoSettings
from stereo.visual_settings import VisualSettings


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Every value that decides the result, beside the input and the seed."""

    stereo: StereoSettings = msgspec.field(default_factory=StereoSettings)
    laser: LaserSettings = msgspec.field(default_factory=LaserSettings)
    odometry: OdometrySettings = msgspec.field(default_factory=OdometrySettings)
    visual: VisualSettings = msgspec.field(default_factory=VisualSettings)
    mapping: MappingSettings = msgspec.field(default_factory=MappingSettings)


# Where nobody sets it, or sets it to null, the input decides (`pipeline.fitting`).
CELL = ("mapping", "cell")


def load_settings(
    path: Path | None,
    overrides: tuple[str, ...] = (),
    suggested: dict[str, dict[str, Any]] | None = None,
) -> Settings:
    """Defaults, what a log `suggested` of itself, the file, then `overrides` (stage.key=value).

    Raises:
        InputError: an unknown or ill-typed key; names it, where it stands and what is allowed.
    """
    return check(given_settings(path, overrides, suggested), "settings")


def sets_cell(data: dict[str, Any]) -> bool:
    """Whether given settings say how large the cells are."""
    stage, key = CELL
    return (data.get(stage) or {}).get(key) is not None


def given_settings(
    path: Path | None,
    overrides: tuple[str, ...] = (),
    suggested: dict[str, dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """What `load_settings` puts in place of defaults: stage -> key -> value. Raises as it does."""
    data: Any = suggested or {}
    if path is not None:
        try:
            chosen = read_yaml(path) or {}
        except YamlFileError as error:
            raise InputError(str(error)) from None
        check(chosen, str(path))
        data = {
            stage: {**(data.get(stage) or {}), **(chosen.get(stage) or {})}
            for stage in {**data, **chosen}
        }
    for override in overrides:
        where = f"--set {override}"
        key, equals, text = override.partition("=")
        stage, dot, name = key.strip().partition(".")
        if not (equals and dot):
            raise InputError(f"{where}: write it as stage.key=value (beemap settings lists all)")
        try:
            value = parse_yaml(text, where)
        except YamlFileError as error:
            raise InputError(str(error)) from None
        data = {**data, stage: {**(data.get(stage) or {}), name: value}}
        check(data, where)
    return data


def check(data: Any, source: str) -> Settings:
    """`data` as typed settings; an InputError names the key and what is allowed."""
    stages = typing.get_type_hints(Settings)
    if not isinstance(data, dict):
        raise InputError(f"{source}: expected the stages {', '.join(stages)}")
    for stage, values in data.items():
        if stage not in stages:
            raise InputError(f"{source}: unknown stage '{stage}' (known: {', '.join(stages)})")
        if values is not None and not isinstance(values, dict):
            raise InputError(f"{source}: {stage}: expected key: value lines, got {values!r}")
        known = stages[stage].__struct_fields__
        for key, value in (values or {}).items():
            if key not in known:
                raise InputError(
                    f"{source}: unknown key '{stage}.{key}' (known: {', '.join(sorted(known))})"
                )
            if _not_finite(value):
                raise InputError(f"{source}: {stage}.{key} is {value!r}: expected a number")
    data = {
        stage: {k: v for k, v in (values or {}).items() if v is not None or (stage, k) != CELL}
        for stage, values in data.items()
    }
    try:
        return msgspec.convert(data, Settings)
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at ")
        key = place.strip("`").removeprefix("$.")
        value: Any = data
        for part in re.findall(r"\w+", key):
            value = value[int(part)] if isinstance(value, list) else value.get(part)
        raise InputError(f"{source}: {key} is {value!r}: {message}") from None


def _not_finite(value: Any) -> bool:
    """Whether nan or inf stands somewhere in it: the limits of the settings let them pass."""
    if isinstance(value, list):
        return any(_not_finite(item) for item in value)
    return isinstance(value, float) and not math.isfinite(value)


def as_yaml(settings: Settings) -> str:
    """The settings as a file that `load_settings` reads back."""
    return dump_yaml(msgspec.to_builtins(settings))


def defaults_as_yaml() -> str:
    """A file that sets nothing."""
    data = msgspec.to_builtins(Settings())
    stage, key = CELL
    data[stage][key] = None
    return dump_yaml(data)


def described() -> Iterator[tuple[str, Any, str, str]]:
    """(stage.key, default, unit, meaning) of every setting."""
    for stage, struct in typing.get_type_hints(Settings).items():
        hints = typing.get_type_hints(struct, include_extras=True)
        for field in msgspec.structs.fields(struct):
            for meta in getattr(hints[field.name], "__metadata__", ()):
                unit = (meta.extra or {}).get("unit", "")
                default = None if (stage, field.name) == CELL else field.default
                yield f"{stage}.{field.name}", default, unit, meta.description or ""
