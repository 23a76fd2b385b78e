"""RayCaster: where rays first meet a scene, by Open3D (Embree)."""

from __future__ import annotations

import numpy as np

from mapping.clouds import import_open3d
from simulation.boxes import Faces


class RayCaster:
    """Casts rays against the triangles of `faces`."""

    def __init__(self, faces: Faces) -> None:
        o3d = import_open3d()

        self._tensor = o3d.core.Tensor.from_numpy
        self._scene = o3d.t.geometry.RaycastingScene()
        vertices, triangles = faces.mesh()
        self._scene.add_triangles(self._tensor(vertices), self._tensor(triangles))

    def cast(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First hits of `rays` (..., 6) float32, C-contiguous: origin and direction.

        Returns the ray parameter (...) float32, in lengths of the direction vector, inf where
        nothing is hit; and the triangle (...) uint32, the largest number where nothing is hit.
        """
        hits = self._scene.cast_rays(self._tensor(rays))
        return hits["t_hit"].numpy(), hits["primitive_ids"].numpy()
