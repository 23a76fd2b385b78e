"""Tracer: the light that reaches a camera along its rays through a scene, free of sensor effects.

The scene's light is baked once; rays are cast by Open3D (Embree) and shaded by numba kernels. Most
end where they land. Glass lets them through and mirrors them, polished surfaces mirror them: such
rays go on, round by round, until what is left of them does not count.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from simulation.boxes import Faces
from simulation.lighting import Lightmap, bake
from simulation.materials import GLOSS, MATERIALS
from simulation.raycaster import RayCaster
from simulation.scene import Scene
from simulation.shading import EXPOSURE, GAMMA, Beams, land, light_at, scatter
from simulation.textures import reflectances

ROUNDS = 8  # hits of one ray, at most
TILE = 32768  # pixels traced at a time: what they need stays in the processor's cache
# Light on movers by the way a face looks, in units of the floor's mean: sides, top, bottom.
MOVER_LIGHT = (0.55, 0.9, 0.15)


class Tracer:
    """Traces rays through `scene`. `time` [s] tells where its movers stand."""

    def __init__(self, scene: Scene) -> None:
        self._movers = scene.movers
        self._parts = scene.mover_faces()
        faces = scene.faces()
        self._still = _Stage(faces, bake(faces, scene.coarse_light), RayCaster(faces))
        self._latest = (math.nan, self._still)

    def grey(self, rays: np.ndarray, angle: float, time: float = 0.0) -> np.ndarray:
        """Grey levels (n,) float32, 0 to 255, of n pixels; see `linear`."""
        return to_grey(self.linear(rays, angle, time))

    def linear(self, rays: np.ndarray, angle: float, time: float = 0.0) -> np.ndarray:
        """Light (n,) float64 of n pixels: 1 saturates at nominal exposure, 0 where nothing is hit.

        rays: (n, k, 6) float32 origins and directions of the k samples of each pixel;
        angle: width of a sample in units of the direction vector, by which textures are averaged.
        """
        stage = self._at(time)
        n, k = rays.shape[:2]
        light = np.empty(n)
        for i in range(0, n, TILE):
            tile = np.ascontiguousarray(rays[i : i + TILE].reshape(-1, 6), np.float32)
            light[i : i + TILE] = stage.trace(tile, angle, k).reshape(-1, k).mean(axis=1)
        return EXPOSURE * light

    def depth(self, rays: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Ray parameter (...) float32 of the first solid surface of `rays` (..., 6) float32, in
        lengths of the direction vector; inf where there is none. Panes of glass are solid."""
        return self._at(time).caster.cast(rays)[0]

    def _at(self, time: float) -> _Stage:
        if not self._movers:
            return self._still
        # Read and written as one, so that threads at different times do not mix them up.
        moment, stage = self._latest
        if moment != time:
            stage = self._still.joined(
                [
                    part.placed(*mover.pose(time))
                    for mover, part in zip(self._movers, self._parts, strict=True)
                ]
            )
            self._latest = (time, stage)
        return stage


def to_grey(linear: np.ndarray) -> np.ndarray:
    """Grey levels float32, 0 to 255, of the light `linear`: gamma, and white above 1."""
    return (255.0 * np.minimum(linear, 1.0) ** (1.0 / GAMMA)).astype(np.float32)


def mirrors(k: int) -> np.ndarray:
    """(k, 3) of a pixel's k samples: how much the ray counts that it mirrors, and by how many blurs
    (x, y) the mirror is tilted for it.

    Every other sample stands for its neighbour too, as reflections are faint. The tilts are a
    Fibonacci spiral, the same for every pixel, so that nothing sticks to the image.
    """
    i = np.arange(k)
    side = max(math.isqrt(k), 1)
    used = (i // side + i % side) % 2 == 0
    turn = np.cumsum(used) - 1
    angle = turn * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(turn / used.sum())
    tilt = radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([used * (k / used.sum()), *tilt], axis=1)


class _Stage(NamedTuple):
    """A scene at one moment: `caster` holds the same `faces`."""

    faces: Faces
    light: Lightmap
    caster: RayCaster

    def joined(self, others: list[Faces]) -> _Stage:
        """With faces added whose light is guessed, not baked."""
        faces = Faces.joined([self.faces, *others])
        new = faces.normal[len(self.faces.normal) :]
        side, top, bottom = self.light.floor * np.array(MOVER_LIGHT)
        guess = np.where(new[:, 2] > 0.5, top, np.where(new[:, 2] < -0.5, bottom, side))
        return _Stage(faces, self.light.extended(guess), RayCaster(faces))

    def trace(self, rays: np.ndarray, angle: float, k: int) -> np.ndarray:
        """Light (m,) of the samples `rays` (m, 6), k to a pixel, before exposure."""
        faces, light = self.faces, self.light
        gloss = _GLOSS[faces.material]
        surface = np.concatenate([faces.u_axis, faces.v_axis, faces.normal], axis=1)
        kept = mirrors(k)
        sums = np.zeros(len(rays))
        beams = Beams.first(rays, angle)
        for _ in range(ROUNDS):
            depth, triangle = self.caster.cast(beams.rays)
            face, u, v, width = land(beams, depth, triangle, faces)
            own, cover = reflectances(face, u, v, width, faces.material, faces.size, faces.seed)
            own *= light_at(face, u, v, faces.size, light.values, light.first, light.shape)
            rays, sample, values = scatter(
                *beams, depth, face, own, cover, surface, gloss, kept, sums
            )
            if not len(rays):
                break
            beams = Beams(rays, sample, *values)
        return sums


_GLOSS = np.array([GLOSS.get(name, (0.0, 0.0, 0.0)) for name in MATERIALS])
