"""From ray hits to grey levels: texture times light, averaged over a pixel's samples."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simulation.textures import albedo

EXPOSURE = 0.66
GAMMA = 1.9
STEEPEST = 0.15  # cosine below which the footprint no longer grows


@njit(cache=True, nogil=True)
def light_at(values, first, nv, nu, u, v):
    """Bilinear light at the fractions u, v (0 to 1) of a face's width and height."""
    x = min(max(u, 0.0), 1.0) * (nu - 1)
    y = min(max(v, 0.0), 1.0) * (nv - 1)
    ix = min(int(x), nu - 2)
    iy = min(int(y), nv - 2)
    fx = x - ix
    fy = y - iy
    at = first + iy * nu + ix
    low = values[at] * (1.0 - fx) + values[at + 1] * fx
    high = values[at + nu] * (1.0 - fx) + values[at + nu + 1] * fx
    return low * (1.0 - fy) + high * fy


@njit(cache=True, nogil=True)
def shade(
    rays,
    depth,
    triangle,
    origin,
    u_axis,
    v_axis,
    normal,
    size,
    material,
    seed,
    light,
    light_first,
    light_shape,
    sample_angle,
):
    """Grey levels (n,) float32, 0 to 255, of n pixels with k samples each.

    rays: (n, k, 6) origins and directions; depth: (n, k) ray parameter of the hit, inf if none;
    triangle: (n, k); then the fields of `Faces` and `Lightmap`; sample_angle: width of a sample
    as seen from the camera, in units of the ray's direction vector.
    """
    pixels, samples = depth.shape
    grey = np.zeros(pixels, np.float32)
    for i in range(pixels):
        total = 0.0
        for k in range(samples):
            t = depth[i, k]
            if not math.isfinite(t):
                continue
            f = triangle[i, k] // 2
            u = 0.0
            v = 0.0
            cosine = 0.0
            reach = 0.0
            for axis in range(3):
                direction = rays[i, k, 3 + axis]
                offset = rays[i, k, axis] + t * direction - origin[f, axis]
                u += offset * u_axis[f, axis]
                v += offset * v_axis[f, axis]
                cosine -= direction * normal[f, axis]
                reach += direction * direction
            cosine = max(abs(cosine) / math.sqrt(reach), STEEPEST)
            footprint = t * sample_angle / math.sqrt(cosine)
            width = size[f, 0]
            height = size[f, 1]
            share = light_at(
                light, light_first[f], light_shape[f, 0], light_shape[f, 1], u / width, v / height
            )
            total += share * albedo(material[f], u, v, width, height, footprint, seed[f])
        grey[i] = 255.0 * min(EXPOSURE * total / samples, 1.0) ** (1.0 / GAMMA)
    return grey
