"""Small rooms for the tests of the simulation, quick to render."""

from __future__ import annotations

from typing import Any

from calibration.rig import StereoRig
from simulation.rigs import bent_minibee
from simulation.scene import Scene, scene_from_dict


def room_sheet(*objects: dict[str, Any], walls: str = "plaster") -> dict[str, Any]:
    """The content of a scene file: 6 x 4 m, a lamp, `objects`, a route to the east."""
    lamp = {"material": "lamp", "at": [3.0, 2.0, 2.4], "size": [1.2, 0.6, 0.05]}
    return {
        "beemap_scene": 1,
        "room": {"size": [6.0, 4.0, 2.5], "floor": "carpet", "walls": walls, "ceiling": "ceiling"},
        "objects": [lamp, *objects],
        "route": {
            "waypoints": [[1.0, 2.0], [4.0, 2.0]],
            "fillet": 0.5,
            "speed": 0.34,
            "turn_rate": 27,
        },
    }


def room(*objects: dict[str, Any], walls: str = "plaster") -> Scene:
    """The scene of `room_sheet`."""
    return scene_from_dict(room_sheet(*objects, walls=walls), "room")


def small_rig() -> StereoRig:
    """The bent minibee at 160 x 120."""
    return bent_minibee(0.25)
