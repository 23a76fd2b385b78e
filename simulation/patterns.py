"""What procedural textures are made of: hashed noise, and edges that a pixel's footprint softens.

Deterministic: all chance comes from hashing integers. Detail finer than the footprint is faded out
(octave by octave; edges are ramps as wide as the footprint), as a lens would average it.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
def hash01(ix, iy, seed):
    """Number in [0, 1) from three integers."""
    h = (ix * 374761393 + iy * 668265263 + seed * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 739982445) & 0xFFFFFFFF
    h = ((h ^ (h >> 12)) * 695872825) & 0xFFFFFFFF
    return (h ^ (h >> 15)) / 4294967296.0


@njit(cache=True, nogil=True)
def noise(x, y, seed):
    """Value noise in [-1, 1] with one random value per unit square's corner."""
    ix = math.floor(x)
    iy = math.floor(y)
    fx = x - ix
    fy = y - iy
    sx = fx * fx * (3.0 - 2.0 * fx)
    sy = fy * fy * (3.0 - 2.0 * fy)
    low = hash01(ix, iy, seed) * (1.0 - sx) + hash01(ix + 1, iy, seed) * sx
    high = hash01(ix, iy + 1, seed) * (1.0 - sx) + hash01(ix + 1, iy + 1, seed) * sx
    return 2.0 * (low * (1.0 - sy) + high * sy) - 1.0


@njit(cache=True, nogil=True)
def fractal(u, v, frequency, octaves, gain, footprint, seed):
    """Sum of `octaves` of noise from `frequency` (1/m) up, each `gain` times the one before."""
    total = 0.0
    amplitude = 1.0
    for octave in range(octaves):
        fade = 2.0 - 2.0 * frequency * footprint
        if fade <= 0.0:
            break
        total += amplitude * min(fade, 1.0) * noise(u * frequency, v * frequency, seed + octave)
        frequency *= 2.0
        amplitude *= gain
    return total


@njit(cache=True, nogil=True)
def inside(x, low, high, footprint):
    """Share of a pixel of width `footprint` at x that lies between `low` and `high`."""
    width = max(footprint, 1e-6)
    rise = min(max((x - low) / width + 0.5, 0.0), 1.0)
    fall = min(max((high - x) / width + 0.5, 0.0), 1.0)
    return rise * fall


@njit(cache=True, nogil=True)
def within(u, v, u0, v0, u1, v1, footprint):
    """Share of a pixel that lies in the rectangle."""
    return inside(u, u0, u1, footprint) * inside(v, v0, v1, footprint)


@njit(cache=True, nogil=True)
def mix(a, b, share):
    """a where `share` is 0, b where it is 1."""
    return a + (b - a) * share
