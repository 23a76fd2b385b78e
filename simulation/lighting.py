"""Soft light baked once per scene: how much of the hemisphere above a face glows.

One gather of cosine-distributed rays per texel: lamps shine, the white ceiling and the walls throw
light back, furniture hardly any. It yields the dimness under desks and in corners, and depends on
the place only, never on the viewer (Lambertian), so that both cameras see the same grey.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulation.boxes import Faces
from simulation.materials import MATERIALS, PANES
from simulation.raycaster import RayCaster

TEXEL = 0.12  # m
RAYS = 160
LIFT = 0.01  # m above the face, so that rays do not start inside it
GLOW = {
    "lamp": 6.0,
    "ceiling": 0.85,
    "plaster": 0.50,
    "white": 0.55,
    "tiles": 0.55,
    "carpet": 0.16,
    "matte_black": 0.02,
    "gloss_black": 0.02,
}
GLOW_ELSEWHERE = 0.25
CHUNK = 2048  # texels cast at a time


@dataclass(frozen=True)
class Lightmap:
    """Light on grids over the faces: face i owns shape[i] = (nv, nu) values from first[i] on.

    values: float32; 1 = the mean over the first box, the floor, which is dark below;
    floor: the mean over its upper face.
    """

    values: np.ndarray
    first: np.ndarray
    shape: np.ndarray
    floor: float

    def extended(self, light: np.ndarray) -> Lightmap:
        """With faces added that are evenly lit by `light` (n,)."""
        values = np.concatenate([self.values, np.repeat(light, 4).astype(np.float32)])
        first = np.concatenate([self.first, len(self.values) + 4 * np.arange(len(light))])
        return Lightmap(
            values, first, np.concatenate([self.shape, np.full((len(light), 2), 2)]), self.floor
        )


def bake(faces: Faces) -> Lightmap:
    """Gather the light on all `faces` of a scene; panes of glass do not hinder it."""
    shape = np.maximum(2, np.ceil(faces.size[:, ::-1] / TEXEL).astype(np.int64) + 1)
    counts = shape.prod(axis=1)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    owner = np.repeat(np.arange(len(counts)), counts)
    points = _texels(faces, owner, np.arange(counts.sum()) - first[owner], shape[owner])
    glow = np.full(len(MATERIALS), GLOW_ELSEWHERE)
    for material, value in GLOW.items():
        glow[MATERIALS.index(material)] = value
    solid = faces.chosen(~np.isin(faces.material, [MATERIALS.index(pane) for pane in PANES]))
    caster = RayCaster(solid)
    # A ray that leaves the scene meets the dark, which stands behind the last face.
    face_glow = np.append(glow[solid.material], 0.0)
    values = np.concatenate(
        [
            _gather(caster, faces, points[i : i + CHUNK], owner[i : i + CHUNK], face_glow)
            for i in range(0, len(points), CHUNK)
        ]
    )
    floor = faces.seed[owner] == 0
    values = values / values[floor].mean()
    above = values[floor & (faces.normal[owner, 2] > 0.5)].mean()
    return Lightmap(values.astype(np.float32), first, shape, float(above))


def _texels(faces: Faces, owner: np.ndarray, index: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """(m, 3) points LIFT above the faces `owner` (m,), texel `index` (m,) of grids `shape`."""
    nv, nu = shape.T
    width, height = faces.size[owner].T
    u = width * (index % nu) / (nu - 1)
    v = height * (index // nu) / (nv - 1)
    # Texels on an edge look from just inside it, not into the neighbour.
    u = np.clip(u, np.minimum(LIFT, width / 2), np.maximum(width - LIFT, width / 2))
    v = np.clip(v, np.minimum(LIFT, height / 2), np.maximum(height - LIFT, height / 2))
    return (
        faces.origin[owner]
        + u[:, None] * faces.u_axis[owner]
        + v[:, None] * faces.v_axis[owner]
        + LIFT * faces.normal[owner]
    )


def _gather(caster: RayCaster, faces: Faces, points, owner, face_glow) -> np.ndarray:
    directions = _hemisphere() @ np.stack([faces.u_axis, faces.v_axis, faces.normal], axis=1)[owner]
    origins = np.broadcast_to(points[:, None, :], directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    _, triangle = caster.cast(rays)
    face = np.minimum(triangle // 2, len(face_glow) - 1)
    return face_glow[face].mean(axis=1)


def _hemisphere() -> np.ndarray:
    """(RAYS, 3) cosine-distributed directions about z: a Fibonacci spiral on the disc."""
    i = np.arange(RAYS)
    radius = np.sqrt((i + 0.5) / RAYS)
    angle = i * np.pi * (3.0 - np.sqrt(5.0))
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([x, y, np.sqrt(1.0 - radius**2)], axis=-1)
