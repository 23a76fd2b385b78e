"""Procedural textures: the albedo of every material at a point of a face, anti-aliased.

Deterministic: all chance comes from hashing integers. Detail finer than the pixel's footprint is
faded out (octave by octave; edges are ramps as wide as the footprint), as a lens would average it.
Kernels and the helpers they call live in this one file: numba's cache does not see edits
elsewhere.
"""

from __future__ import annotations

import math

import numpy as np
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


@njit(cache=True, nogil=True)
def plaster(u, v, footprint, seed):
    """Painted wall: roller grain of a few grey levels, faint clouds, a scuff here and there."""
    grain = 0.018 * fractal(u, v, 18.0, 4, 0.9, footprint, seed)
    clouds = 0.020 * fractal(u, v, 1.7, 3, 0.6, footprint, seed + 7)
    scuff = max(0.0, fractal(u * 0.5, v * 3.0, 4.0, 3, 0.6, footprint, seed + 9) - 1.05)
    return 0.60 * (1.0 + grain + clouds - 0.7 * scuff * max(0.0, 1.0 - v))


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def wood(u, v, width, height, footprint, seed):
    """Veneer with the grain along the longer side."""
    a, b = (u, v) if width >= height else (v, u)
    warp = 0.06 * noise(a * 1.5, b * 4.0, seed)
    rings = 0.17 * fractal(a * 0.05, b + warp, 22.0, 4, 0.75, footprint, seed + 3)
    flecks = 0.07 * fractal(a * 0.25, b, 60.0, 3, 0.8, footprint, seed + 11)
    return 0.34 * (1.0 + rings + flecks)


@njit(cache=True, nogil=True)
def laminate(u, v, width, height, footprint, seed):
    """Light grey board with a darker edge band and a faint speckle."""
    speckle = 0.055 * fractal(u, v, 30.0, 4, 0.85, footprint, seed)
    face = within(u, v, 0.012, 0.012, width - 0.012, height - 0.012, footprint)
    return mix(0.14, 0.33, face) * (1.0 + speckle)


@njit(cache=True, nogil=True)
def fabric(u, v, footprint, seed):
    """Woven cloth: melange yarn, darker and lighter for every piece."""
    yarn = 0.20 * fractal(u, v, 25.0, 4, 0.9, footprint, seed)
    weave = 0.10 * fractal(u * 3.0, v * 0.6, 14.0, 4, 0.8, footprint, seed + 5)
    tone = 0.07 + 0.16 * hash01(seed, 3, 77)
    return tone * (1.0 + yarn + weave)


@njit(cache=True, nogil=True)
def metal(u, v, footprint, seed):
    """Dark powder-coated tube."""
    return 0.10 * (1.0 + 0.12 * fractal(u, v, 30.0, 3, 0.8, footprint, seed))


@njit(cache=True, nogil=True)
def books(u, v, width, height, footprint, seed):
    """Boards every 0.32 m; between them spines of their own width, height, tone and label."""
    pitch = 0.32
    row = math.floor(v / pitch)
    z = v - row * pitch
    board = 1.0 - inside(z, 0.022, pitch, footprint)
    side = 1.0 - inside(u, 0.022, width - 0.022, footprint)
    # Spines sit in slots of 45 mm that hold one thick or two thin books.
    slot = math.floor(u / 0.045)
    x = u - slot * 0.045
    split = 0.015 + 0.018 * hash01(slot, row, seed + 1)
    thin = hash01(slot, row, seed + 2) < 0.6
    first = thin and x < split
    low = 0.0 if first or not thin else split
    high = split if first else 0.045
    book = 2 * slot + (1 if first else 0)
    tall = 0.022 + 0.20 + 0.075 * hash01(book, row, seed + 3)
    if hash01(slot // 3, row, seed + 4) < 0.12:
        tall = 0.0
    tone = 0.04 + 0.62 * hash01(book, row, seed + 5) ** 1.5
    label = inside(z, 0.07 + 0.1 * hash01(book, row, seed + 6), 0.21, footprint)
    stripe = inside(z, 0.045, 0.055, footprint)
    ink = 0.6 if tone < 0.3 else 0.08
    label *= 0.8 if hash01(book, row, seed + 7) < 0.5 else 0.15
    spine = mix(mix(tone, ink, 0.5 * label), ink, 0.6 * stripe)
    spine *= 1.0 + 0.10 * fractal(u, v, 40.0, 3, 0.8, footprint, seed)
    gap = inside(x, low + 0.0015, high - 0.0015, footprint) * inside(z, 0.0, tall, footprint)
    shelf = 0.33 * (1.0 + 0.2 * fractal(u * 0.2, v, 40.0, 3, 0.7, footprint, seed + 8))
    return mix(mix(0.035, spine, gap), shelf, max(board, side))


@njit(cache=True, nogil=True)
def poster(u, v, width, height, footprint, seed):
    """Print with a headline, a picture and columns of text on white, in a dark frame."""
    a = u / width
    b = v / height
    fa = footprint / width
    fb = footprint / height
    paper = 0.78
    picture = 0.30 + 0.32 * fractal(u, v, 5.0, 6, 0.75, footprint, seed)
    picture += 0.25 * inside(noise(u * 7.0, v * 7.0, seed + 3), 0.15, 0.7, 12.0 * footprint)
    picture = min(max(picture, 0.03), 0.85)
    top = 0.38 + 0.25 * hash01(seed, 1, 5)
    tone = mix(paper, picture, inside(a, 0.08, 0.92, fa) * inside(b, top, 0.80, fb))
    # Words: dashes of random length on lines of 22 mm.
    line = math.floor(v / 0.022)
    word = math.floor(u / 0.013)
    letters = inside(v / 0.022 - line, 0.25, 0.75, footprint / 0.022)
    ink = letters * (1.0 if hash01(word, line, seed + 9) < 0.68 else 0.0)
    tone = mix(tone, 0.08, ink * inside(a, 0.10, 0.90, fa) * inside(b, 0.06, top - 0.04, fb))
    letter = math.floor(u / 0.035)
    head = 1.0 if hash01(letter, 2, seed + 10) < 0.75 else 0.0
    head *= inside(u / 0.035 - letter, 0.1, 0.8, footprint / 0.035)
    tone = mix(tone, 0.06, head * inside(a, 0.10, 0.90, fa) * inside(b, 0.86, 0.94, fb))
    edge = within(u, v, 0.015, 0.015, width - 0.015, height - 0.015, footprint)
    return mix(0.05, tone, edge)


@njit(cache=True, nogil=True)
def door(u, v, width, height, footprint, seed):
    """Veneered leaf in a light frame, with a gap, two panels, a handle and a kick plate."""
    leaf = within(u, v, 0.08, 0.0, width - 0.08, height - 0.08, footprint)
    gap = leaf - within(u, v, 0.09, 0.008, width - 0.09, height - 0.09, footprint)
    tone = mix(0.62, 0.8 * wood(u, v, width, height, footprint, seed), leaf)
    tone = mix(tone, 0.03, gap)
    for panel in range(2):
        low = 0.30 + 0.85 * panel
        outer = within(u, v, 0.20, low, width - 0.20, low + 0.70, footprint)
        inner = within(u, v, 0.215, low + 0.015, width - 0.215, low + 0.685, footprint)
        tone = mix(tone, 0.08, outer - inner)
    handle = within(u, v, width - 0.26, 1.03, width - 0.13, 1.055, footprint)
    plate = within(u, v, width - 0.165, 0.93, width - 0.125, 1.12, footprint)
    kick = within(u, v, 0.11, 0.02, width - 0.11, 0.20, footprint)
    scratches = 0.12 * fractal(u * 0.3, v, 40.0, 4, 0.8, footprint, seed + 4)
    tone = mix(tone, 0.36 * (1.0 + scratches), kick)
    return mix(tone, 0.75, max(handle, plate))


@njit(cache=True, nogil=True)
def cabinet(u, v, width, height, footprint, seed):
    """Two sheet-metal doors with a gap, handles, a lock, vents and a label."""
    sheet = 0.34 * (1.0 + 0.05 * fractal(u, v, 14.0, 5, 0.85, footprint, seed))
    middle = width / 2.0
    seam = inside(u, middle - 0.004, middle + 0.004, footprint)
    border = 1.0 - within(u, v, 0.02, 0.06, width - 0.02, height - 0.02, footprint)
    tone = mix(sheet, 0.6 * sheet, border)
    tone = mix(tone, 0.03, seam * inside(v, 0.06, height - 0.02, footprint))
    grip = within(u, v, middle - 0.06, 0.5 * height, middle - 0.035, 0.5 * height + 0.16, footprint)
    tone = mix(tone, 0.05, grip)
    vents = inside(abs(u - middle), 0.10, 0.10 + 0.22 * width, footprint)
    slit = v / 0.025
    slit = inside(slit - math.floor(slit), 0.0, 0.4, footprint / 0.025)
    tone = mix(tone, 0.05, vents * slit * inside(v, 0.12, 0.25, footprint))
    label = within(u, v, 0.08, 0.62 * height, 0.22, 0.62 * height + 0.08, footprint)
    print_ = 0.75 - 0.6 * inside(noise(u * 90.0, v * 60.0, seed), 0.1, 1.0, 60.0 * footprint)
    return mix(tone, print_, label)


@njit(cache=True, nogil=True)
def drawers(u, v, width, height, footprint, seed):
    """Pedestal of three drawers with grips, in grey board."""
    step = height / 3.0
    z = v - step * math.floor(v / step)
    board = 0.40 * (1.0 + 0.07 * fractal(u, v, 20.0, 4, 0.85, footprint, seed))
    front = within(u, z, 0.012, 0.008, width - 0.012, step - 0.008, footprint)
    grip = within(u, z, 0.3 * width, 0.7 * step, 0.7 * width, 0.7 * step + 0.02, footprint)
    return mix(mix(0.05, board, front), 0.08, grip)


@njit(cache=True, nogil=True)
def cardboard(u, v, width, height, footprint, seed):
    """Brown box with tape across and print upon it."""
    tone = 0.30 * (1.0 + 0.12 * fractal(u, v, 12.0, 5, 0.8, footprint, seed))
    tape = inside(abs(u - width / 2.0), 0.0, 0.025, footprint)
    tone = mix(tone, 0.50, 0.7 * tape)
    stamp = within(u, v, 0.06, 0.05, 0.06 + 0.35 * width, 0.05 + 0.35 * height, footprint)
    blot = inside(noise(u * 45.0, v * 30.0, seed + 2), 0.0, 1.0, 45.0 * footprint)
    return mix(tone, 0.06, stamp * blot)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def whiteboard(u, v, width, height, footprint, seed):
    """White board in an aluminium frame with scribbled lines."""
    bend = 0.03 * noise(u * 9.0, v * 2.0, seed) + 0.012 * noise(u * 40.0, v * 9.0, seed + 1)
    row = math.floor((v + bend) / 0.11)
    stroke = inside((v + bend) / 0.11 - row, 0.40, 0.47, footprint / 0.11)
    written = inside(noise(u * 11.0, row * 3.7, seed + 2), -0.1, 1.0, 11.0 * footprint)
    board = mix(0.76, 0.07, stroke * written * inside(u, 0.12, 0.75 * width, footprint))
    face = within(u, v, 0.025, 0.025, width - 0.025, height - 0.025, footprint)
    return mix(0.35, board, face)


@njit(cache=True, nogil=True)
def screen(u, v, width, height, footprint, seed):
    """Monitor: black bezel, a glowing window with lines of text."""
    face = within(u, v, 0.02, 0.03, width - 0.02, height - 0.02, footprint)
    line = math.floor(v / 0.025)
    text = inside(v / 0.025 - line, 0.3, 0.7, footprint / 0.025)
    words = inside(noise(u * 35.0, line * 5.3, seed), -0.2, 1.0, 35.0 * footprint)
    return mix(0.03, mix(0.16, 0.5, text * words), face)


@njit(cache=True, nogil=True)
def ceiling(u, v, footprint, seed):
    """Mineral fibre tiles of 0.6 m on a grid."""
    a = u / 0.6 - math.floor(u / 0.6)
    b = v / 0.6 - math.floor(v / 0.6)
    tile = within(a, b, 0.02, 0.02, 0.98, 0.98, footprint / 0.6)
    return mix(0.45, 0.72 * (1.0 + 0.06 * fractal(u, v, 25.0, 3, 0.9, footprint, seed)), tile)


@njit(cache=True, nogil=True)
def albedo(material, u, v, width, height, footprint, seed):
    """Reflectance (0 to 1) of `material` (index into MATERIALS) at (u, v) m on its face.

    width, height: size of the face [m]; footprint: width of a sample on the face [m].
    """
    if material == 0:
        return plaster(u, v, footprint, seed)
    if material == 1:
        return carpet(u, v, footprint, seed)
    if material == 2:
        return wood(u, v, width, height, footprint, seed)
    if material == 3:
        return laminate(u, v, width, height, footprint, seed)
    if material == 4:
        return fabric(u, v, footprint, seed)
    if material == 5:
        return metal(u, v, footprint, seed)
    if material == 6:
        return books(u, v, width, height, footprint, seed)
    if material == 7:
        return poster(u, v, width, height, footprint, seed)
    if material == 8:
        return door(u, v, width, height, footprint, seed)
    if material == 9:
        return cabinet(u, v, width, height, footprint, seed)
    if material == 10:
        return 0.16 * (1.0 + 0.25 * fractal(u, v, 12.0, 5, 0.8, footprint, seed))
    if material == 11:
        return ceiling(u, v, footprint, seed)
    if material == 12:
        return 8.0  # it shines
    if material == 13:
        return cardboard(u, v, width, height, footprint, seed)
    if material == 14:
        return leaves(u, v, footprint, seed)
    if material == 15:
        return whiteboard(u, v, width, height, footprint, seed)
    if material == 16:
        return screen(u, v, width, height, footprint, seed)
    return drawers(u, v, width, height, footprint, seed)


@njit(cache=True, nogil=True)
def reflectances(face, u, v, footprint, material, size, seed):
    """Albedo (n,) of n places on the faces `face` (n,); 0 where face is -1.

    u, v, footprint: (n,) m; material, size (m, 2), seed: those of all m faces.
    """
    result = np.zeros(len(face))
    for i in range(len(face)):
        f = face[i]
        if f >= 0:
            result[i] = albedo(
                material[f], u[i], v[i], size[f, 0], size[f, 1], footprint[i], seed[f]
            )
    return result
