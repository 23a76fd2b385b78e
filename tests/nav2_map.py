"""nav2's map_server, as its documentation and its map_io have it; independent of ours.

Only PGM (P5) images without transparency. Source: nav2_map_server, map_io.cpp (loadMapFromFile):
occupancy p = 1 - grey / 255, or grey / 255 where negate is set; 100 where p > occupied_thresh,
0 where p < free_thresh, else -1 (trinary), or (p - free) / (occupied - free) in percent (scale).
The image's first row is the map's uppermost; data begin at the lower left.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import yaml


@dataclass(frozen=True)
class Nav2Map:
    """What would be published: data row by row from the lower left."""

    width: int
    height: int
    resolution: float
    origin: tuple[float, float, float]
    data: list[int]


def load(file: Path) -> Nav2Map:
    """The map that nav2 loads from a map.yaml."""
    sheet = yaml.safe_load(file.read_text())
    negate, occupied, free = sheet["negate"], sheet["occupied_thresh"], sheet["free_thresh"]
    mode = sheet.get("mode", "trinary")
    x, y, yaw = sheet["origin"]
    pgm = (file.parent / sheet["image"]).read_bytes()
    head = re.match(rb"P5\s+(\d+)\s+(\d+)\s+255\s", pgm)
    assert head is not None
    width, height = int(head[1]), int(head[2])
    pixels = pgm[head.end() :]
    assert len(pixels) == width * height
    data = []
    for row in range(height - 1, -1, -1):
        for grey in pixels[row * width : (row + 1) * width]:
            p = grey / 255.0 if negate else 1.0 - grey / 255.0
            if p > occupied:
                data.append(100)
            elif p < free:
                data.append(0)
            elif mode == "trinary":
                data.append(-1)
            else:
                data.append(round(100.0 * (p - free) / (occupied - free)))
    return Nav2Map(width, height, sheet["resolution"], (x, y, yaw), data)
