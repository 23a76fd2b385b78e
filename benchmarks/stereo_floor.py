"""Floor taken for obstacles: pitched cameras in an empty hall, mount right and wrong.

The walls of the hall are farther than 5 m from every place that is looked from: whatever is said
to stand within 4 m is floor. Patterned, glossy floors are told apart: they repeat and reflect.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from calibration.rig import StereoRig
from pipeline.experiments.report import markdown_table
from simulation.renderer import StereoRenderer
from simulation.rigs import bent_minibee
from simulation.scene import scene_from_dict
from simulation.tracer import Tracer
from stereo.errors import StereoError
from stereo.pair import StereoPair
from stereo.ranger import StereoRanger

PITCHES = (-5, 0, 5, 10, 15, 20, 25)  # deg, nose down
MOUNT_ERRORS = (0.0, 0.5, -0.5)  # deg
FLOORS = ("carpet", "parquet", "tiles", "lino")
PLACES = 2  # and headings, on each floor
WITHIN = 4.0  # m
SIDE = 16.0  # of the hall [m]


def main() -> str:
    """Measure; the section as Markdown."""
    cv2.setNumThreads(1)
    tracers = [Tracer(scene_from_dict(_hall(floor), f"hall with {floor}")) for floor in FLOORS]
    rows = [_row(pitch, tracers) for pitch in PITCHES]
    header = ["pitch [deg]", "answered within 4 m or free"]
    header += [f"phantoms, mount {e:+g} deg" if e else "phantoms, true mount" for e in MOUNT_ERRORS]
    header += [f"on {floor}" for floor in FLOORS]
    return "\n\n".join(
        [
            "## Floor taken for obstacles: `python -m benchmarks.stereo_floor`",
            markdown_table(header, rows),
            f"An empty hall with floors of {', '.join(FLOORS)}, {PLACES} places on each, camera "
            f"0.3 m high, 640x480. phantoms: columns said to hold an obstacle within {WITHIN:g} m, "
            "of all columns; on each floor, with the true mount, of its columns. Asked for: at "
            "most 0.5 % with the true mount, 2 % with one wrong by 0.5 deg.",
        ]
    )


def _hall(floor: str) -> dict:
    middle = SIDE / 2.0
    return {
        "beemap_scene": 1,
        "room": {"size": [SIDE, SIDE, 3.0], "floor": floor, "walls": "brick", "ceiling": "ceiling"},
        "objects": [{"material": "lamp", "at": [middle, middle, 2.9], "size": [6.0, 6.0, 0.05]}],
        "route": {
            "waypoints": [[middle, middle], [middle + 1.0, middle]],
            "fillet": 0.5,
            "speed": 0.34,
            "turn_rate": 27,
        },
    }


def _row(pitch: float, tracers: list[Tracer]) -> list[str]:
    rig = _pitched(bent_minibee(), pitch)
    seen: list[list[StereoPair]] = []
    for number, tracer in enumerate(tracers):
        renderer = StereoRenderer(tracer, rig, seed=number)
        seen.append([])
        for place in range(PLACES):
            # Not along the tiles' edges only.
            pose = np.array([8.0 + 0.37 * place, 8.0 - 0.29 * place, 0.3 + 1.61 * place])
            pair = renderer.render(pose, place)
            seen[-1].append(StereoPair(place, pair.left, pair.right))
    pairs = [pair for floor in seen for pair in floor]
    mounts = [_pitched(bent_minibee(), pitch + error) for error in MOUNT_ERRORS]
    found = [_phantoms(mount, pairs) for mount in mounts]
    found += [_phantoms(rig, floor) for floor in seen]
    answered = "-" if found[0] is None else f"{100 * found[0][1]:.0f} %"
    return [str(pitch), answered, *("-" if f is None else f"{100 * f[0]:.2f} %" for f in found)]


def _pitched(rig: StereoRig, degrees: float) -> StereoRig:
    assert rig.mount is not None
    return rig.with_mount(replace(rig.mount, pitch=math.radians(degrees)))


def _phantoms(rig: StereoRig, pairs: list[StereoPair]) -> tuple[float, float] | None:
    """Shares of the columns with an obstacle within reach, and with any answer; None where no row
    of the image can hold an obstacle."""
    try:
        ranger = StereoRanger(rig)
    except StereoError:
        return None
    ranges = np.concatenate([ranger(pair).range for pair in pairs])
    return float(np.mean(ranges < WITHIN)), float(np.mean(~np.isnan(ranges)))


if __name__ == "__main__":
    print(main())
