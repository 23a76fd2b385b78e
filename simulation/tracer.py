"""Tracer: the light that reaches a camera along its rays through a scene, free of sensor effects.

The scene's light is baked once; rays are cast by Open3D (Embree) and shaded by numba kernels.
"""

from __future__ import annotations

import numpy as np

from simulation.lighting import bake
from simulation.raycaster import RayCaster
from simulation.scene import Scene
from simulation.shading import GAMMA, radiance


class Tracer:
    """Traces rays through `scene`. `time` [s] tells where its movers stand."""

    def __init__(self, scene: Scene) -> None:
        self._faces = scene.faces()
        self._caster = RayCaster(self._faces)
        self._light = bake(self._caster, self._faces)

    def grey(self, rays: np.ndarray, angle: float, time: float = 0.0) -> np.ndarray:
        """Grey levels (n,) float32, 0 to 255, of n pixels; see `linear`."""
        return to_grey(self.linear(rays, angle, time))

    def linear(self, rays: np.ndarray, angle: float, time: float = 0.0) -> np.ndarray:
        """Light (n,) float64 of n pixels: 1 saturates at nominal exposure, 0 where nothing is hit.

        rays: (n, k, 6) float32 origins and directions of the k samples of each pixel;
        angle: width of a sample in units of the direction vector, by which textures are averaged.
        """
        depth, triangle = self._caster.cast(rays)
        return radiance(rays, depth, triangle, self._faces, self._light, angle)

    def depth(self, rays: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Ray parameter (...) float32 of the first solid surface of `rays` (..., 6) float32, in
        lengths of the direction vector; inf where there is none. Panes of glass are solid."""
        return self._caster.cast(rays)[0]


def to_grey(linear: np.ndarray) -> np.ndarray:
    """Grey levels float32, 0 to 255, of the light `linear`: gamma, and white above 1."""
    return (255.0 * np.minimum(linear, 1.0) ** (1.0 / GAMMA)).astype(np.float32)
