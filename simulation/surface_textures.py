"""Textures of surfaces that go on and on: walls, floors, cloth, wood, metal, tiles.

u, v: place on the face [m], v upward; footprint: width of a sample there [m].
"""

from __future__ import annotations

import math

from numba import njit

from simulation.patterns import fractal, hash01, inside, mix, noise, within


@njit(nogil=True)
def plaster(u, v, footprint, seed):
    """Painted wall: roller grain of a few grey levels, faint clouds, a scuff here and there."""
    grain = 0.018 * fractal(u, v, 18.0, 4, 0.9, footprint, seed)
    clouds = 0.020 * fractal(u, v, 1.7, 3, 0.6, footprint, seed + 7)
    scuff = max(0.0, fractal(u * 0.5, v * 3.0, 4.0, 3, 0.6, footprint, seed + 9) - 1.05)
    return 0.60 * (1.0 + grain + clouds - 0.7 * scuff * max(0.0, 1.0 - v))


@njit(nogil=True)
def carpet(u, v, footprint, seed):
    """Mottled loop carpet laid in squares of half a metre, turned by turns."""
    iu = math.floor(u * 2.0)
    iv = math.floor(v * 2.0)
    turned = (iu + iv) % 2 == 0
    a, b = (u, v) if turned else (v, u)
    patch = seed + 31 * (iu % 5) + 57 * (iv % 7)
    pile = 0.24 * fractal(a * 0.7, b, 28.0, 4, 0.95, footprint, patch)
    clouds = 0.10 * fractal(u, v, 5.0, 3, 0.7, footprint, seed)
    tone = 0.10 * hash01(iu, iv, seed) + (0.07 if turned else 0.0)
    return 0.10 * (0.95 + tone + pile + clouds)


@njit(nogil=True)
def wood(u, v, width, height, footprint, seed):
    """Veneer with the grain along the longer side."""
    a, b = (u, v) if width >= height else (v, u)
    warp = 0.06 * noise(a * 1.5, b * 4.0, seed)
    rings = 0.17 * fractal(a * 0.05, b + warp, 22.0, 4, 0.75, footprint, seed + 3)
    flecks = 0.07 * fractal(a * 0.25, b, 60.0, 3, 0.8, footprint, seed + 11)
    return 0.34 * (1.0 + rings + flecks)


@njit(nogil=True)
def laminate(u, v, width, height, footprint, seed):
    """Light grey board with a darker edge band and a faint speckle."""
    speckle = 0.055 * fractal(u, v, 30.0, 4, 0.85, footprint, seed)
    face = within(u, v, 0.012, 0.012, width - 0.012, height - 0.012, footprint)
    return mix(0.14, 0.33, face) * (1.0 + speckle)


@njit(nogil=True)
def fabric(u, v, footprint, seed):
    """Woven cloth: melange yarn, darker and lighter for every piece."""
    yarn = 0.20 * fractal(u, v, 25.0, 4, 0.9, footprint, seed)
    weave = 0.10 * fractal(u * 3.0, v * 0.6, 14.0, 4, 0.8, footprint, seed + 5)
    tone = 0.07 + 0.16 * hash01(seed, 3, 77)
    return tone * (1.0 + yarn + weave)


@njit(nogil=True)
def metal(u, v, footprint, seed):
    """Dark powder-coated tube."""
    return 0.10 * (1.0 + 0.12 * fractal(u, v, 30.0, 3, 0.8, footprint, seed))


@njit(nogil=True)
def leaves(u, v, footprint, seed):
    """Foliage of a pot plant: leaves against the dark between them."""
    # Stripes that wind: each a leaf, with its own tone.
    bend = 0.05 * noise(u * 8.0, v * 5.0, seed) + 0.02 * noise(u * 25.0, v * 15.0, seed + 1)
    at = (u + bend + 0.35 * abs(noise(u * 3.0, v * 3.0, seed + 2)) * v) / 0.035
    leaf = math.floor(at)
    part = math.floor(v / 0.12 + 3.0 * hash01(leaf, 5, seed))
    tone = 0.03 + 0.25 * hash01(leaf, part, seed + 3)
    blade = inside(at - leaf, 0.08, 0.85, footprint / 0.035)
    vein = inside(at - leaf, 0.42, 0.5, footprint / 0.035)
    return mix(0.015, mix(tone, 1.5 * tone, vein), blade)


@njit(nogil=True)
def ceiling(u, v, footprint, seed):
    """Mineral fibre tiles of 0.6 m on a grid."""
    a = u / 0.6 - math.floor(u / 0.6)
    b = v / 0.6 - math.floor(v / 0.6)
    tile = within(a, b, 0.02, 0.02, 0.98, 0.98, footprint / 0.6)
    return mix(0.45, 0.72 * (1.0 + 0.06 * fractal(u, v, 25.0, 3, 0.9, footprint, seed)), tile)


@njit(nogil=True)
def ripple(x, period, footprint):
    """Cosine in [-1, 1] of `period` m, faded where a sample is as wide as that."""
    fade = min(max(2.0 - 2.0 * footprint / period, 0.0), 1.0)
    return fade * math.cos(2.0 * math.pi * x / period)


@njit(nogil=True)
def white(u, v, footprint, seed):
    """Blank wall: fresh smooth paint, far less than a grey level of texture."""
    return 0.70 * (1.0 + 0.003 * noise(u * 1.3, v * 1.3, seed))


@njit(nogil=True)
def tiles(u, v, footprint):
    """White glazed tiles of 150 mm, all alike, with grey joints of 4 mm."""
    a = u - 0.15 * math.floor(u / 0.15)
    b = v - 0.15 * math.floor(v / 0.15)
    return mix(0.30, 0.66, within(a, b, 0.002, 0.002, 0.148, 0.148, footprint))


@njit(nogil=True)
def blinds(u, footprint):
    """Vertical blinds: bowed slats every 89 mm, all alike, each with a dark gap beside it."""
    x = u - 0.089 * math.floor(u / 0.089)
    slat = 0.50 + 0.10 * ripple(u - 0.03, 0.089, footprint)
    return mix(0.10, slat, inside(x, 0.003, 0.086, footprint))


@njit(nogil=True)
def vinyl(u, v, footprint, seed):
    """Polished sheet floor: hardly any grain, a welded seam every two metres."""
    grain = 0.025 * fractal(u, v, 9.0, 4, 0.8, footprint, seed)
    x = u - 2.0 * math.floor(u / 2.0)
    seam = inside(x, 0.998, 1.002, footprint)
    return mix(0.20 * (1.0 + grain), 0.12, seam)


@njit(nogil=True)
def lino(u, v, footprint, seed):
    """Marbled linoleum, worn dull."""
    bend = 0.08 * noise(u * 2.0, v * 2.0, seed + 4)
    marble = fractal(u + bend, 0.35 * v + bend, 9.0, 4, 0.75, footprint, seed)
    return 0.15 * (1.0 + 0.09 * marble)


@njit(nogil=True)
def concrete(u, v, footprint, seed):
    """Screed: clouds, grain and oil stains."""
    clouds = 0.10 * fractal(u, v, 1.1, 4, 0.65, footprint, seed)
    grain = 0.09 * fractal(u, v, 30.0, 4, 0.9, footprint, seed + 5)
    stain = max(0.0, fractal(u, v, 2.2, 3, 0.5, footprint, seed + 9) - 0.75)
    return 0.17 * (1.0 + clouds + grain - 0.9 * min(stain, 0.6))


@njit(nogil=True)
def parquet(u, v, footprint, seed):
    """Oak planks of 120 x 900 mm, shifted from row to row."""
    row = math.floor(v / 0.12)
    x = u / 0.9 + hash01(row, 1, seed)
    plank = math.floor(x)
    tone = 0.14 + 0.09 * hash01(plank, row, seed + 2)
    grain = 0.15 * fractal(u * 0.06, v, 30.0, 4, 0.8, footprint, seed + 3 * row)
    gap = inside(v / 0.12 - row, 0.006, 0.994, footprint / 0.12)
    gap *= inside(x - plank, 0.001, 0.999, footprint / 0.9)
    return mix(0.04, tone * (1.0 + grain), gap)


@njit(nogil=True)
def brick(u, v, footprint, seed):
    """Fair-faced bricks of 240 x 71 mm in running bond."""
    row = math.floor(v / 0.083)
    x = u / 0.25 + (0.5 if row % 2 else 0.0)
    number = math.floor(x)
    tone = 0.13 + 0.14 * hash01(number, row, seed)
    rough = 0.16 * fractal(u, v, 30.0, 4, 0.85, footprint, seed + 3)
    face = inside(v / 0.083 - row, 0.07, 0.93, footprint / 0.083)
    face *= inside(x - number, 0.02, 0.98, footprint / 0.25)
    return mix(0.36, tone, face) * (1.0 + rough)


@njit(nogil=True)
def rug(u, v, width, height, footprint, seed):
    """Woven rug: lozenges within borders."""
    a = abs(u - width / 2.0) / 0.30
    b = abs(v - height / 2.0) / 0.30
    ring = a + b
    band = math.floor(ring)
    tone = 0.06 + 0.24 * hash01(band, 2, seed)
    line = inside(ring - band, 0.0, 0.18, footprint / 0.21)
    tone = mix(tone, 0.40, line)
    inner = within(u, v, 0.14, 0.14, width - 0.14, height - 0.14, footprint)
    inlay = inside(ripple(u + v, 0.09, footprint), 0.2, 2.0, 0.4)
    edge = within(u, v, 0.02, 0.02, width - 0.02, height - 0.02, footprint)
    tone = mix(mix(0.04, mix(0.10, 0.33, inlay), edge), tone, inner)
    return tone * (1.0 + 0.15 * fractal(u, v, 40.0, 3, 0.9, footprint, seed))


@njit(nogil=True)
def shirt(u, v, footprint, seed):
    """Checked cloth."""
    tone = 0.10 + 0.25 * hash01(seed, 8, 3)
    warp = inside(ripple(u, 0.07, footprint), 0.3, 2.0, 0.5)
    weft = inside(ripple(v, 0.07, footprint), 0.3, 2.0, 0.5)
    creases = 0.20 * fractal(u * 1.6, v * 0.6, 6.0, 5, 0.75, footprint, seed)
    return tone * (1.0 - 0.35 * warp - 0.35 * weft) * (1.0 + creases)
