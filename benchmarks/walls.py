"""A hall with one flat wall, and the pairs of a robot that drives up to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.rig import StereoRig
from simulation.renderer import StereoRenderer
from simulation.scene import Scene, scene_from_dict
from simulation.tracer import Tracer
from stereo.pair import StereoPair

OBSERVATIONS = 10
WIDTH, DEPTH = 40.0, 30.0  # of the hall [m]
WALL_X = 30.0  # the wall that is looked at
MIDDLE = 20.0


@dataclass(frozen=True)
class Place:
    """A pair and the pose (x m, y m, theta rad) of the robot that took it, y = 0 in the middle."""

    pair: StereoPair
    pose: np.ndarray


def wall_hall() -> Scene:
    """A hall whose wall to the east is brick, the others far away."""
    return scene_from_dict(
        {
            "beemap_scene": 1,
            "room": {
                "size": [DEPTH, WIDTH, 3.0],
                "floor": "carpet",
                "walls": "brick",
                "ceiling": "ceiling",
            },
            "objects": [{"material": "lamp", "at": [24.0, MIDDLE, 2.9], "size": [8.0, 20.0, 0.05]}],
            "route": {
                "waypoints": [[20.0, MIDDLE], [22.0, MIDDLE]],
                "fillet": 0.5,
                "speed": 0.34,
                "turn_rate": 27,
            },
        },
        "wall",
    )


def wall_pairs(
    tracer: Tracer, rig: StereoRig, distance: float, angle: float, spacing: float
) -> list[Place]:
    """Ten places on a straight way, turned by `angle` rad from the wall's normal; the camera's
    distance from the wall along its view is `distance` m at the middle of the way."""
    renderer = StereoRenderer(tracer, rig)
    assert rig.mount is not None
    heading = np.array([math.cos(angle), math.sin(angle)])
    places = []
    for number in range(OBSERVATIONS):
        along = (number - (OBSERVATIONS - 1) / 2.0) * spacing - rig.mount.x
        # Where the view meets the wall is y = 0.
        x, y = np.array([WALL_X, 0.0]) - (distance - along) * heading
        pair = renderer.render(np.array([x, y + MIDDLE, angle]), number)
        stamp = number * 500_000_000
        pose = np.array([x, y, angle])
        places.append(Place(StereoPair(stamp, pair.left, pair.right), pose))
    return places
