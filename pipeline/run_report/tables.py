"""The tables of a report: facts, odometry's errors, time, losses, settings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from calibration.yamlfile import dump_yaml
from pipeline.health.parting import STRETCH
from pipeline.health.run_health import RunHealth
from pipeline.recordings.base import counted
from pipeline.settings import Settings, described

STAGES = {
    "reading": "reading images",
    "stereo": "stereo matching",
    "mapping": "mapping",
    "total": "all, by the clock",
}


@dataclass(frozen=True)
class Setting:
    """One that differs from its default."""

    name: str
    value: str
    default: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Stage:
    """seconds of a stage, and ms for each pair; share: of the longest."""

    name: str
    seconds: str
    each: str
    share: float


def facts_rows(summary: Mapping[str, Any], cell: float) -> list[tuple[str, str]]:
    """What was mapped, as names and values; summary: the content of run.json."""
    counts = summary["counts"]
    chosen = summary.get("request", {}).get("chosen", {})
    unit = "scans" if "scans used" in counts else "pairs"
    rows = [
        ("input", f"{summary.get('input', '')} ({summary.get('format', 'unknown')})"),
        ("rig", summary.get("rig")),
        ("motion", summary.get("motion")),
        (unit, counts.get(f"{unit} used", 0)),
        ("observations", counts.get("observations", 0)),
        ("local maps", summary["local_maps"]),
        ("path", f"{summary['path_m']:.1f} m"),
        ("mapped", f"{summary['free_m2']:.1f} m² free, {summary['occupied_m2']:.1f} m² occupied"),
        ("cells", chosen.get("mapping.cell") or f"{cell:g} m, as set"),
        ("seed", summary.get("seed")),
        ("memory", f"{summary['peak_memory_mb']:.0f} MB at most"),
        ("beemap", f"{summary['versions']['beemap']}, Python {summary['python']}"),
    ]
    return [(name, str(value)) for name, value in rows if value is not None]


def odometry_rows(health: RunHealth) -> list[tuple[str, str, str]]:
    """What odometry says too much or too little: what, how much, how sure."""
    rows = []
    if health.errors is not None:
        named = zip(
            ("distance", "rotation", "drift"),
            health.errors.value.tolist(),
            health.errors.error.tolist(),
            health.errors.significant.tolist(),
            strict=True,
        )
        for name, value, error, sure in named:
            if name == "drift":
                side = "left" if value > 0 else "right"
                size, doubt = abs(math.degrees(value)), math.degrees(error)
                told = f"{size:.2f} ± {doubt:.2f} deg a metre to the {side}"
            else:
                told = f"{100 * value:+.1f} ± {100 * error:.1f} %"
            rows.append((name, told, "certain" if sure else "not certain"))
    if (apart := health.parting) is not None:
        told = f"{1000 * apart.distance:.0f} mm and {math.degrees(apart.angle):.1f} deg"
        rows.append((f"parted in {STRETCH:g} m", told, f"median of {apart.stretches}"))
    return rows


def stage_rows(seconds: Mapping[str, float], used: int) -> list[Stage]:
    """Time of each stage; used: pairs or scans."""
    longest = max(seconds.values(), default=0.0) or 1.0
    return [
        Stage(name, f"{seconds[key]:.1f}", f"{1000 * seconds[key] / max(used, 1):.1f}",
              seconds[key] / longest)
        for key, name in STAGES.items()
        if key in seconds
    ]  # fmt: skip


def live_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How soon a live run answered."""
    rows = []
    for key, name in (("pair_to_pose_s", "image to pose"), ("map_to_file_s", "map to file")):
        if times := summary.get(key):
            told = ", ".join(
                f"{1000 * times[part]:.0f} ms {word}"
                for part, word in (("median", "median"), ("p95", "95 %"), ("most", "at most"))
            )
            rows.append((name, told))
    return rows


def loss_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What was passed over, by reason: how many, and the first names."""
    rows = []
    opened = summary.get("recording")
    for reasons in (opened if isinstance(opened, dict) else {}, summary["skipped"]):
        rows += [(reason, counted(list(names))) for reason, names in reasons.items()]
    for key, value in summary.get("odometry", {}).items():
        if value and key.startswith(("ticks_", "tick_gaps", "longest", "poses_skipped")):
            rows.append((f"odometry: {key.replace('_', ' ')}", f"{value:g}"))
    cameras = summary.get("cameras", {})
    late = {
        "images without a partner": cameras.get("lonely", 0),
        "pairs that nobody took in time": cameras.get("late", 0),
        "pairs stamped no later than the one before": cameras.get("backwards", 0),
        "pairs that mapping was too late for": summary.get("pairs_skipped", 0),
        "pairs that the disk was too slow for": summary.get("recorded", {}).get("dropped", 0),
    }
    return rows + [(name, str(count)) for name, count in late.items() if count]


def changed_settings(settings: Settings) -> list[Setting]:
    """Those that differ from the defaults."""
    ours, usual = (msgspec.to_builtins(s) for s in (settings, Settings()))
    changed = []
    for name, _, unit, meaning in described():
        stage, _, key = name.partition(".")
        if ours[stage][key] != usual[stage][key]:
            told = (_value(ours[stage][key]), _value(usual[stage][key]))
            changed.append(Setting(name, *told, unit, meaning))
    return changed


def _value(value: Any) -> str:
    """As it is written in a settings file."""
    return dump_yaml([value]).strip()[1:-1]
