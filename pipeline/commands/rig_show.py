"""`beemap rig show`: a rig file in words, and what it means for depth."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.rig import length_option, size_option

if TYPE_CHECKING:
    from calibration.exchange.formats import RigFile
    from calibration.rig import CameraModel, StereoRig

WIDTH = 14  # of the first column


@click.command()
@click.argument("source", metavar="RIG", type=click.Path(path_type=Path))
@click.argument("second", metavar="[RIG2]", required=False, type=click.Path(path_type=Path))
@click.option("--size", help="Image size of a file that holds none, as in 640x480.")
@click.option("--unit", help="What T counts in a file that does not say, as in 25mm (a square).")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def show(
    source: Path, second: Path | None, size: str | None, unit: str | None, as_json: bool
) -> None:
    """Print a rig for people: lenses, baseline, mount, and what it means for depth.

    RIG is a rig.yaml, or a file or folder of ROS camera_info, Kalibr, EuRoC or OpenCV; give the
    left camera's file as RIG and the right one's as RIG2 where they are two.
    """
    from calibration.exchange.formats import read_rig

    given = [source] if second is None else [source, second]
    found = read_rig(given, size_option(size), length_option(unit, "--unit"))
    facts = describe(found)
    for note in found.notes:
        click.echo(f"warning: {note}", err=True)
    if as_json:
        click.echo(json.dumps(facts, indent=2, default=str))
        return
    for name, text in _lines(facts):
        click.echo(f"{name:<{WIDTH}} {text}")
    _print_depth(facts["depth"])


def describe(found: RigFile) -> dict[str, Any]:
    """The facts that are printed; angles in degrees, lengths in metres, the rest as named."""
    from calibration.exchange.formats import KINDS

    rig = found.rig
    mount = None
    if rig.mount is not None:
        m = rig.mount
        angles = {f"{k}_deg": math.degrees(getattr(m, k)) for k in ("pitch", "roll", "yaw")}
        mount = {"height_m": m.height, **angles, "x_m": m.x, "y_m": m.y}
    return {
        "format": KINDS[found.kind],
        "image_size": list(rig.image_size),
        "rectified": rig.rectified,
        "left": _camera(rig.left, rig.image_size),
        "right": _camera(rig.right, rig.image_size),
        "baseline_m": rig.baseline,
        "rotation_deg": _rotation_vector(rig),
        "mount": mount,
        "depth": _depth(rig),
        **rig.sections,
    }


def _camera(camera: CameraModel, size: tuple[int, int]) -> dict[str, Any]:
    from dataclasses import replace

    from calibration.field_of_view import field_of_view

    straight = replace(camera, distortion_model="none", distortion=())
    return {
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "lens": camera.distortion_model,
        "distortion": list(camera.distortion),
        "field_of_view_deg": _degrees(field_of_view(camera, size)),
        "field_of_view_without_distortion_deg": _degrees(field_of_view(straight, size)),
    }


def _degrees(angles: tuple[float | None, ...]) -> list[float | None]:
    return [None if angle is None else math.degrees(angle) for angle in angles]


def _rotation_vector(rig: StereoRig) -> list[float]:
    """How the right camera is turned against the left, about x, y, z [deg]."""
    import cv2

    return [math.degrees(v) for v in cv2.Rodrigues(rig.R)[0].ravel()]


def _depth(rig: StereoRig) -> dict[str, Any]:
    """What mapping can expect of depth, by its own settings."""
    from calibration.depth_error import DISTANCES, TOLERANCE, depth_sigma, usable_range
    from stereo.disparity import choose_disparities
    from stereo.settings import StereoSettings

    noise = StereoSettings().noise
    focal = (rig.left.fx + rig.left.fy + rig.right.fx + rig.right.fy) / 4.0
    disparities = choose_disparities(focal, rig.baseline, rig.image_size[0])
    sigmas = depth_sigma(focal, rig.baseline, DISTANCES, noise).tolist()
    return {
        "disparity_sigma_px": noise,
        "table": [
            {"distance_m": z, "disparity_px": focal * rig.baseline / z, "sigma_m": sigma}
            for z, sigma in zip(DISTANCES, sigmas, strict=True)
        ],
        "tolerance_m": TOLERANCE,
        "usable_range_m": usable_range(focal, rig.baseline, noise, TOLERANCE),
        "disparities": disparities,
        "nearest_m": focal * rig.baseline / disparities,
    }


def _lines(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """(name, text) of what is printed above the table of depth."""
    sigma = (facts.get("calibration") or {}).get("sigma")
    sigma = sigma if isinstance(sigma, Mapping) else {}
    rotation = facts["rotation_deg"]
    lines = [
        ("format", facts["format"]),
        ("images", "{} x {} px".format(*facts["image_size"])),
        ("left camera", _camera_line(facts["left"], sigma, "left")),
        ("right camera", _camera_line(facts["right"], sigma, "right")),
        (
            "baseline",
            f"{facts['baseline_m'] * 1e3:.2f} mm; the right camera is turned by "
            f"{math.hypot(*rotation):.2f} deg (x {rotation[0]:z.2f}, y {rotation[1]:z.2f}, "
            f"z {rotation[2]:z.2f})",
        ),
        ("mount", _mount_line(facts["mount"])),
    ]
    if facts["rectified"]:
        lines.insert(2, ("rectified", "the images are rectified already"))
    if "calibration" in facts:
        lines.append(("calibration", _calibration_line(facts["calibration"])))
    for name in ("encoders", "devices"):
        if name in facts:
            lines.append((name, _flat(facts[name])))
    return lines


def _camera_line(camera: dict[str, Any], sigma: Mapping[str, Any], side: str) -> str:
    doubt = sigma.get(f"{side}.fx")
    doubt = f" ± {doubt:.2f}" if isinstance(doubt, (int, float)) else ""
    seen, straight = (
        " x ".join("?" if a is None else f"{a:.1f}" for a in camera[key])
        for key in ("field_of_view_deg", "field_of_view_without_distortion_deg")
    )
    folds = None in camera["field_of_view_deg"]
    beyond = "; ?: the lens model folds back before the edge" if folds else ""
    return (
        f"f {camera['fx']:.2f} x {camera['fy']:.2f}{doubt} px, centre {camera['cx']:.2f}, "
        f"{camera['cy']:.2f}; lens {camera['lens']}; sees {seen} deg "
        f"({straight} without distortion{beyond})"
    )


def _mount_line(mount: dict[str, float] | None) -> str:
    if mount is None:
        return "not known: 'beemap calibrate mount' finds it; taken as level, 0.3 m above the floor"
    return (
        f"{mount['height_m']:z.3f} m high, pitch {mount['pitch_deg']:z.2f} (nose down), roll "
        f"{mount['roll_deg']:z.2f}, yaw {mount['yaw_deg']:z.2f} deg; {mount['x_m']:z.3f} m ahead, "
        f"{mount['y_m']:z.3f} m left of the robot's origin"
    )


def _calibration_line(section: Any) -> str:
    if not isinstance(section, Mapping):
        return str(section)
    made = {k: v for k, v in section.items() if not isinstance(v, (Mapping, list))}
    age = _age(made.get("date"))
    return _flat({**made, **({"date": f"{made['date']} ({age})"} if age else {})})


def _age(day: Any) -> str | None:
    """How long ago, in days; None where `day` is no date."""
    try:
        then = date.fromisoformat(str(day)[:10])
    except ValueError:
        return None
    days = (datetime.now().date() - then).days
    return "today" if days == 0 else f"{days} days ago" if days > 0 else "a date to come"


def _flat(section: Any) -> str:
    """As in `ticks_per_revolution 2000, track 0.3`."""
    if not isinstance(section, Mapping):
        return str(section)
    return ", ".join(
        f"{key} {value:.5g}" if isinstance(value, float) else f"{key} {value}"
        for key, value in section.items()
    )


def _print_depth(depth: dict[str, Any]) -> None:
    rows = depth["table"]
    columns = {
        "distance": [f"{row['distance_m']:g} m" for row in rows],
        "disparity": [f"{row['disparity_px']:.1f} px" for row in rows],
        "depth ±": [f"{row['sigma_m'] * 1e3:.1f} mm" for row in rows],
    }
    for name, cells in columns.items():
        click.echo(f"{name:<{WIDTH}}" + "".join(f"{cell:>11}" for cell in cells))
    click.echo(
        f"{'usable range':<{WIDTH}} {depth['nearest_m']:.2f} to {depth['usable_range_m']:.1f} m: "
        f"with {depth['disparities']} disparities, until ± {depth['disparity_sigma_px']:g} px of "
        f"disparity make ± {depth['tolerance_m'] * 1e3:.0f} mm"
    )
