"""Maps as ROS map_server reads them: a binary PGM and the YAML that places it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibration.yamlfile import dump_yaml
from mapping.grid import OccupancyGrid

# Grey values of map_server's own saver. Its reader takes 205 for an occupancy of 0.19608, hence
# the threshold 0.196: nav2's default of 0.25 would turn unknown into free.
OCCUPIED, FREE, UNKNOWN = 0, 254, 205
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196


def write_map_server(path: Path, grid: OccupancyGrid) -> None:
    """Write `path` (its ending is replaced) as .pgm and .yaml, in three grey levels."""
    path = Path(path)
    probability = grid.probability
    grey = np.full(probability.shape, UNKNOWN, np.uint8)
    grey[probability < FREE_THRESH] = FREE
    grey[probability > OCCUPIED_THRESH] = OCCUPIED
    image = b"P5\n%d %d\n255\n" % grey.shape[::-1] + grey[::-1].tobytes()
    path.with_suffix(".pgm").write_bytes(image)
    sheet = {
        "image": path.with_suffix(".pgm").name,
        "mode": "trinary",
        "resolution": float(grid.cell),
        "origin": [float(grid.origin[0]), float(grid.origin[1]), 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESH,
        "free_thresh": FREE_THRESH,
    }
    path.with_suffix(".yaml").write_text(dump_yaml(sheet), encoding="utf-8")
