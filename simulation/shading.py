"""From ray hits to grey levels: texture times light, averaged over a pixel's samples."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simulation.boxes import Faces
from simulation.lighting import Lightmap
from simulation.textures import reflectances

EXPOSURE = 0.66
GAMMA = 1.9
STEEPEST = 0.15  # cosine below which the footprint no longer grows


def radiance(
    rays: np.ndarray,
    depth: np.ndarray,
    triangle: np.ndarray,
    faces: Faces,
    light: Lightmap,
    sample_angle: float,
) -> np.ndarray:
    """Light (n,) of n pixels with k samples each, 1 = white; 0 where nothing is hit.

    rays: (n, k, 6) origins and directions; depth: (n, k) ray parameter of the hit, inf if none;
    triangle: (n, k), two to a face; sample_angle: width of a sample as seen from the camera, in
    units of the ray's direction vector.
    """
    face = np.where(np.isfinite(depth), triangle.astype(np.int64) // 2, -1).ravel()
    u, v, footprint = footprints(
        rays.reshape(-1, 6), depth.ravel(), face, faces.origin, faces.u_axis, faces.v_axis,
        faces.normal, sample_angle,
    )  # fmt: skip
    result = reflectances(face, u, v, footprint, faces.material, faces.size, faces.seed)
    result *= light_at(face, u, v, faces.size, light.values, light.first, light.shape)
    return EXPOSURE * result.reshape(depth.shape).mean(axis=1)


@njit(cache=True, nogil=True)
def footprints(rays, depth, face, origin, u_axis, v_axis, normal, sample_angle):
    """Where n rays land on their faces: u, v and the sample's width there (n,) each [m]."""
    u = np.zeros(len(face))
    v = np.zeros(len(face))
    width = np.zeros(len(face))
    for i in range(len(face)):
        f = face[i]
        if f < 0:
            continue
        cosine = 0.0
        reach = 0.0
        for axis in range(3):
            direction = float(rays[i, 3 + axis])
            offset = rays[i, axis] + depth[i] * direction - origin[f, axis]
            u[i] += offset * u_axis[f, axis]
            v[i] += offset * v_axis[f, axis]
            cosine += direction * normal[f, axis]
            reach += direction * direction
        cosine = max(abs(cosine) / math.sqrt(reach), STEEPEST)
        width[i] = depth[i] * sample_angle / math.sqrt(cosine)
    return u, v, width


@njit(cache=True, nogil=True)
def light_at(face, u, v, size, values, first, shape):
    """Light (n,) of a `Lightmap` at n places of its faces, bilinear; 0 where face is -1."""
    light = np.zeros(len(face))
    for i in range(len(face)):
        f = face[i]
        if f < 0:
            continue
        nv, nu = shape[f]
        x = min(max(u[i] / size[f, 0], 0.0), 1.0) * (nu - 1)
        y = min(max(v[i] / size[f, 1], 0.0), 1.0) * (nv - 1)
        ix = min(int(x), nu - 2)
        iy = min(int(y), nv - 2)
        fx = x - ix
        fy = y - iy
        at = first[f] + iy * nu + ix
        low = values[at] * (1.0 - fx) + values[at + 1] * fx
        high = values[at + nu] * (1.0 - fx) + values[at + nu + 1] * fx
        light[i] = low * (1.0 - fy) + high * fy
    return light
