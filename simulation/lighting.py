"""Soft light baked once per scene: how much of the hemisphere above a face glows.

One gather of cosine-distributed rays per texel: the white ceiling and the walls throw light back,
furniture hardly any. Lamps are added point by point, each with its shadow, so that blank walls stay
blank; "coarse" light takes them from the gather's rays too, which leaves faint clouds. Light makes
it dim under desks and in corners, and depends on the place only, never on the viewer (Lambertian),
so that both cameras see the same grey.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from simulation.boxes import Faces
from simulation.materials import MATERIALS, PANES
from simulation.raycaster import RayCaster

TEXEL = 0.12  # m
RAYS, COARSE_RAYS = 96, 160  # lamps need more
LIFT = 0.01  # m above the face, so that rays do not start inside it
LAMP = 6.0
GLOW = {
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
LAMP_POINT = 0.35  # m between the points of a lamp
FLOOR = 1.4  # mean light on the floor's upper face
FAINTEST = 0.0015  # light of a lamp's point that is not worth a ray


@dataclass(frozen=True)
class Lightmap:
    """Light on grids over the faces: face i owns shape[i] = (nv, nu) values from first[i] on.

    values: float32; floor: their mean over the upper face of the first box, the floor: FLOOR, or
    with coarse light such that the mean over all of that box is 1.
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


def bake(faces: Faces, coarse: bool = False) -> Lightmap:
    """Gather the light on all `faces` of a scene; panes of glass do not hinder it."""
    shape = np.maximum(2, np.ceil(faces.size[:, ::-1] / TEXEL).astype(np.int64) + 1)
    counts = shape.prod(axis=1)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    owner = np.repeat(np.arange(len(counts)), counts)
    points = _texels(faces, owner, np.arange(counts.sum()) - first[owner], shape[owner])
    solid = faces.chosen(~np.isin(faces.material, [MATERIALS.index(pane) for pane in PANES]))
    caster = RayCaster(solid)
    # A ray that leaves the scene meets the dark, which stands behind the last face.
    face_glow = np.append(_glow(coarse)[solid.material], 0.0)
    lamps = None if coarse else _Lamps.of(faces)
    directions = _hemisphere(COARSE_RAYS if coarse else RAYS)
    values = np.zeros(len(points))
    # Outside of everything it is dark.
    corners = faces.mesh()[0]
    inside = (points > corners.min(axis=0)) & (points < corners.max(axis=0))
    within = np.flatnonzero(inside.all(axis=1))
    for i in range(0, len(within), CHUNK):
        chunk = within[i : i + CHUNK]
        at, face = points[chunk], owner[chunk]
        values[chunk] = _gather(caster, faces, at, face, face_glow, directions)
        if lamps is not None:
            values[chunk] += lamps.light(caster, at, faces.normal[face])
    floor = faces.seed[owner] == 0
    above = floor & (faces.normal[owner, 2] > 0.5)
    values = values / values[floor].mean() if coarse else FLOOR * values / values[above].mean()
    return Lightmap(values.astype(np.float32), first, shape, float(values[above].mean()))


def _glow(coarse: bool) -> np.ndarray:
    """Light that each material gives or throws back."""
    glow = np.full(len(MATERIALS), GLOW_ELSEWHERE)
    for material, value in GLOW.items():
        glow[MATERIALS.index(material)] = value
    glow[MATERIALS.index("lamp")] = LAMP if coarse else GLOW["ceiling"]
    return glow


@dataclass(frozen=True)
class _Lamps:
    """Points (p, 3) m of the lamps' faces, which way they shine (p, 3), the area of each (p,)."""

    points: np.ndarray
    normal: np.ndarray
    area: np.ndarray

    @staticmethod
    def of(faces: Faces) -> _Lamps:
        lamps = faces.chosen(faces.material == MATERIALS.index("lamp"))
        points, normal, area = [], [], []
        for i, (width, height) in enumerate(lamps.size):
            if width * height < 0.5 * lamps.size[lamps.seed == lamps.seed[i]].prod(axis=1).max():
                continue  # the narrow sides of a flat lamp
            nu, nv = (max(round(side / LAMP_POINT), 1) for side in (width, height))
            u, v = np.meshgrid((np.arange(nu) + 0.5) / nu * width, (np.arange(nv) + 0.5) / nv)
            on = u.ravel()[:, None] * lamps.u_axis[i] + v.reshape(-1, 1) * height * lamps.v_axis[i]
            points.append(lamps.origin[i] + on + LIFT * lamps.normal[i])
            normal.append(np.broadcast_to(lamps.normal[i], on.shape))
            area.append(np.full(nu * nv, width * height / (nu * nv)))
        if not points:
            return _Lamps(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
        return _Lamps(np.concatenate(points), np.concatenate(normal), np.concatenate(area))

    def light(self, caster: RayCaster, at: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Light (n,) of all lamps at the places `at` (n, 3) of surfaces that face `normal`."""
        place, point, share = shares(at, normal, self.points, self.normal, self.area)
        way = self.points[point] - at[place]
        rays = np.concatenate([at[place], way], axis=1).astype(np.float32)
        seen = caster.cast(rays)[0] > 1.0 - 1e-3
        return np.bincount(place, share * seen, len(at))


@njit(cache=True, nogil=True)
def shares(at, normal, points, shines, area):
    """Which places (n, 3) get how much light from which points (p, 3) if nothing is between:
    place (m,), point (m,), light (m,)."""
    place = np.empty(len(at) * len(points), np.int64)
    point = np.empty_like(place)
    share = np.empty(len(place))
    count = 0
    for i in range(len(at)):
        for j in range(len(points)):
            far2, leaves, meets = 0.0, 0.0, 0.0
            for axis in range(3):
                way = points[j, axis] - at[i, axis]
                far2 += way * way
                leaves -= way * shines[j, axis]
                meets += way * normal[i, axis]
            if leaves <= 0.0 or meets <= 0.0:
                continue
            # A point's area under the bar keeps its light finite close by.
            light = LAMP * area[j] * leaves * meets / (math.pi * far2 * (far2 + area[j]))
            if light > FAINTEST:
                place[count], point[count], share[count] = i, j, light - FAINTEST
                count += 1
    return place[:count], point[:count], share[:count]


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


def _gather(
    caster: RayCaster, faces: Faces, points, owner, face_glow, hemisphere: np.ndarray
) -> np.ndarray:
    directions = hemisphere @ np.stack([faces.u_axis, faces.v_axis, faces.normal], axis=1)[owner]
    origins = np.broadcast_to(points[:, None, :], directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    _, triangle = caster.cast(rays)
    face = np.minimum(triangle // 2, len(face_glow) - 1)
    return face_glow[face].mean(axis=1)


def _hemisphere(n: int) -> np.ndarray:
    """(n, 3) cosine-distributed directions about z: a Fibonacci spiral on the disc."""
    i = np.arange(n)
    radius = np.sqrt((i + 0.5) / n)
    angle = i * np.pi * (3.0 - np.sqrt(5.0))
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([x, y, np.sqrt(1.0 - radius**2)], axis=-1)
