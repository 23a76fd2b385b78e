"""Boxes and their faces: all geometry of a scene.

Everything is a box, turned about the vertical axis only: walls, desk tops, posters (thin boxes).
A pane of glass is one sheet amid its box.
A face carries its own uv frame in metres, so that textures lie straight on it.
World frame: x along the room's length, y along its width, z up, origin in a corner on the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from simulation.materials import MATERIALS, PANES


@dataclass(frozen=True)
class Box:
    """Upright box: centre of its footprint (x, y) m, bottom z m, size (3,) m, turn rad about z."""

    material: str
    centre: tuple[float, float]
    bottom: float
    size: tuple[float, float, float]
    turn: float = 0.0

    @property
    def top(self) -> float:
        """Height of the upper face [m]."""
        return self.bottom + self.size[2]

    @property
    def corners(self) -> np.ndarray:
        """(4, 2) corners of the footprint, counter-clockwise [m]."""
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * self.size[:2]
        c, s = math.cos(self.turn), math.sin(self.turn)
        return half @ np.array([[c, s], [-s, c]]) + self.centre

    def placed(self, x: float, y: float, turn: float) -> Box:
        """The same box as part of a model that stands at (x, y), turned by `turn`."""
        c, s = math.cos(turn), math.sin(turn)
        cx, cy = self.centre
        centre = (x + c * cx - s * cy, y + s * cx + c * cy)
        return Box(self.material, centre, self.bottom, self.size, self.turn + turn)


@dataclass(frozen=True)
class Faces:
    """All faces of a scene as rectangles: point = origin + u * u_axis + v * v_axis.

    origin, u_axis, v_axis, normal: (n, 3) float64, m; axes of unit length, normal outward,
    v upward on upright faces; size (n, 2) m; material (n,) index into MATERIALS; seed (n,).
    Face i owns the triangles 2 i and 2 i + 1 of the mesh.
    """

    origin: np.ndarray
    u_axis: np.ndarray
    v_axis: np.ndarray
    normal: np.ndarray
    size: np.ndarray
    material: np.ndarray
    seed: np.ndarray

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (4 n, 3) float32 and triangles (2 n, 3) uint32."""
        along = self.u_axis * self.size[:, :1]
        up = self.v_axis * self.size[:, 1:]
        corners = np.stack(
            [self.origin, self.origin + along, self.origin + along + up, self.origin + up], axis=1
        )
        first = 4 * np.arange(len(self.origin))[:, None, None]
        triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        return corners.reshape(-1, 3).astype(np.float32), triangles.astype(np.uint32)

    def placed(self, x: float, y: float, turn: float) -> Faces:
        """The same faces turned by `turn` rad about z, then moved by (x, y) m."""
        c, s = math.cos(turn), math.sin(turn)
        turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        frames = (self.u_axis @ turned, self.v_axis @ turned, self.normal @ turned)
        return Faces(
            self.origin @ turned + (x, y, 0.0), *frames, self.size, self.material, self.seed
        )

    def chosen(self, which: np.ndarray) -> Faces:
        """The faces that `which` (n,) bool, or indices, selects."""
        return Faces(*(getattr(self, field.name)[which] for field in fields(self)))

    @staticmethod
    def joined(parts: list[Faces]) -> Faces:
        """All faces of `parts` in their order."""
        return Faces(
            *(np.concatenate([getattr(p, field.name) for p in parts]) for field in fields(Faces))
        )


def box_faces(boxes: tuple[Box, ...], first: int = 0) -> Faces:
    """The faces of `boxes`: six each, in the order +x, +y, -x, -y, top, bottom; of a pane the one
    across its thinnest side. A face's seed is the number of its box, counted from `first`."""
    origin, u_axis, v_axis, size, material, seed = [], [], [], [], [], []
    up = np.array([0.0, 0.0, 1.0])
    for number, box in enumerate(boxes, first):
        c, s = math.cos(box.turn), math.sin(box.turn)
        ex, ey = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
        middle = np.array([*box.centre, box.bottom + box.size[2] / 2.0])
        sx, sy, sz = box.size
        sides = [
            (ex, sx, ey, sy, up, sz),
            (ey, sy, -ex, sx, up, sz),
            (-ex, sx, -ey, sy, up, sz),
            (-ey, sy, ex, sx, up, sz),
            (up, sz, ex, sx, ey, sy),
            (-up, sz, ex, sx, -ey, sy),
        ]
        if box.material in PANES:
            normal, depth, *sheet = min(sides, key=lambda side: side[1])
            sides = [(normal, 0.0, *sheet)]
        for normal, depth, u, width, v, height in sides:
            origin.append(middle + 0.5 * (depth * normal - width * u - height * v))
            u_axis.append(u)
            v_axis.append(v)
            size.append((width, height))
            material.append(MATERIALS.index(box.material))
            seed.append(number)
    u, v = np.array(u_axis), np.array(v_axis)
    return Faces(
        np.array(origin), u, v, np.cross(u, v), np.array(size), np.array(material), np.array(seed)
    )
