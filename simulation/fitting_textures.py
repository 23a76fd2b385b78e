"""Textures of things with a layout of their own: doors, shelves, prints, boxes, screens.

u, v: place on the face [m], v upward; width, height: size of the face [m]; footprint: width of a
sample there [m].
"""

from __future__ import annotations

import math

from numba import njit

from simulation.patterns import fractal, hash01, inside, mix, noise, within
from simulation.surface_textures import ripple, wood


@njit(nogil=True)
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


@njit(nogil=True)
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


@njit(nogil=True)
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


@njit(nogil=True)
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


@njit(nogil=True)
def drawers(u, v, width, height, footprint, seed):
    """Pedestal of three drawers with grips, in grey board."""
    step = height / 3.0
    z = v - step * math.floor(v / step)
    board = 0.40 * (1.0 + 0.07 * fractal(u, v, 20.0, 4, 0.85, footprint, seed))
    front = within(u, z, 0.012, 0.008, width - 0.012, step - 0.008, footprint)
    grip = within(u, z, 0.3 * width, 0.7 * step, 0.7 * width, 0.7 * step + 0.02, footprint)
    return mix(mix(0.05, board, front), 0.08, grip)


@njit(nogil=True)
def cardboard(u, v, width, height, footprint, seed):
    """Brown box with tape across and print upon it."""
    tone = 0.30 * (1.0 + 0.12 * fractal(u, v, 12.0, 5, 0.8, footprint, seed))
    tape = inside(abs(u - width / 2.0), 0.0, 0.025, footprint)
    tone = mix(tone, 0.50, 0.7 * tape)
    stamp = within(u, v, 0.06, 0.05, 0.06 + 0.35 * width, 0.05 + 0.35 * height, footprint)
    blot = inside(noise(u * 45.0, v * 30.0, seed + 2), 0.0, 1.0, 45.0 * footprint)
    return mix(tone, 0.06, stamp * blot)


@njit(nogil=True)
def whiteboard(u, v, width, height, footprint, seed):
    """White board in an aluminium frame with scribbled lines."""
    bend = 0.03 * noise(u * 9.0, v * 2.0, seed) + 0.012 * noise(u * 40.0, v * 9.0, seed + 1)
    row = math.floor((v + bend) / 0.11)
    stroke = inside((v + bend) / 0.11 - row, 0.40, 0.47, footprint / 0.11)
    written = inside(noise(u * 11.0, row * 3.7, seed + 2), -0.1, 1.0, 11.0 * footprint)
    board = mix(0.76, 0.07, stroke * written * inside(u, 0.12, 0.75 * width, footprint))
    face = within(u, v, 0.025, 0.025, width - 0.025, height - 0.025, footprint)
    return mix(0.35, board, face)


@njit(nogil=True)
def screen(u, v, width, height, footprint, seed):
    """Monitor: black bezel, a glowing window with lines of text."""
    face = within(u, v, 0.02, 0.03, width - 0.02, height - 0.02, footprint)
    line = math.floor(v / 0.025)
    text = inside(v / 0.025 - line, 0.3, 0.7, footprint / 0.025)
    words = inside(noise(u * 35.0, line * 5.3, seed), -0.2, 1.0, 35.0 * footprint)
    return mix(0.03, mix(0.16, 0.5, text * words), face)


@njit(nogil=True)
def plain_door(u, v, width, height, footprint, seed):
    """Smooth painted leaf in a dark steel frame, with a gap and a handle."""
    leaf = within(u, v, 0.07, 0.0, width - 0.07, height - 0.07, footprint)
    gap = leaf - within(u, v, 0.078, 0.008, width - 0.078, height - 0.078, footprint)
    tone = mix(0.13, 0.50 * (1.0 + 0.006 * fractal(u, v, 3.0, 3, 0.7, footprint, seed)), leaf)
    tone = mix(tone, 0.03, gap)
    handle = within(u, v, width - 0.25, 1.03, width - 0.12, 1.05, footprint)
    plate = within(u, v, width - 0.15, 0.95, width - 0.115, 1.10, footprint)
    return mix(tone, 0.10, max(handle, plate))


@njit(nogil=True)
def notice(u, v, width, height, footprint, seed):
    """Cork board with sheets of print pinned on it, none quite straight."""
    cork = 0.19 * (1.0 + 0.20 * fractal(u, v, 35.0, 4, 0.85, footprint, seed))
    i = math.floor(u / 0.27)
    j = math.floor(v / 0.34)
    lean = 0.12 * (hash01(i, j, seed) - 0.5)
    x = u - 0.27 * i - 0.02 - 0.03 * hash01(i, j, seed + 1) + lean * (v - 0.34 * j)
    y = v - 0.34 * j - 0.02 - 0.03 * hash01(i, j, seed + 2)
    sheet = within(x, y, 0.0, 0.0, 0.21, 0.285, footprint)
    sheet *= 1.0 if hash01(i, j, seed + 3) < 0.75 else 0.0
    line = math.floor(y / 0.014)
    words = inside(noise(x * 60.0, line * 3.1, seed + i), -0.25, 1.0, 60.0 * footprint)
    ink = words * inside(y / 0.014 - line, 0.25, 0.7, footprint / 0.014)
    ink *= within(x, y, 0.02, 0.03, 0.19, 0.19, footprint)
    head = within(x, y, 0.03, 0.215, 0.05 + 0.13 * hash01(i, j, seed + 4), 0.25, footprint)
    page = mix(0.45 + 0.3 * hash01(i, j, seed + 5), 0.07, max(ink, head))
    face = within(u, v, 0.02, 0.02, width - 0.02, height - 0.02, footprint)
    return mix(0.25, mix(cork, page, sheet), face)


@njit(nogil=True)
def radiator(u, v, width, height, footprint):
    """Panel radiator: pressed ribs every 50 mm, all alike, between smooth rims."""
    ribs = within(u, v, 0.03, 0.05, width - 0.03, height - 0.05, footprint)
    rim = within(u, v, 0.008, 0.008, width - 0.008, height - 0.008, footprint)
    return mix(0.25, 0.55 + 0.10 * ribs * ripple(u - width / 2.0, 0.05, footprint), rim)


@njit(nogil=True)
def extinguisher(u, v, width, height, footprint, seed):
    """Red cylinder (dark in grey), a printed label, black fittings."""
    line = math.floor(v / 0.016)
    words = inside(noise(u * 70.0, line * 4.7, seed), -0.1, 1.0, 70.0 * footprint)
    text = words * inside(v / 0.016 - line, 0.2, 0.7, footprint / 0.016)
    label = within(u, v, 0.015, 0.38 * height, width - 0.015, 0.72 * height, footprint)
    tone = mix(0.13, mix(0.62, 0.07, text), label)
    return mix(tone, 0.03, inside(v, 0.85 * height, 2.0 * height, footprint))


@njit(nogil=True)
def sign(u, v, width, height, footprint, seed):
    """Plate with a pictogram and two lines of lettering."""
    face = within(u, v, 0.006, 0.006, width - 0.006, height - 0.006, footprint)
    box = 0.7 * min(width, height)
    low = 0.5 * (height - box)
    picture = within(u, v, 0.02, low, 0.02 + 0.6 * box, low + box, footprint)
    cut = inside(noise(u * 40.0, v * 40.0, seed), 0.05, 1.0, 40.0 * footprint)
    line = math.floor(v / (0.3 * height))
    letter = math.floor(u / 0.012)
    ink = 1.0 if hash01(letter, line, seed) < 0.65 else 0.0
    ink *= inside(v / (0.3 * height) - line, 0.3, 0.75, footprint / (0.3 * height))
    ink *= inside(u, 0.05 + 0.6 * box, width - 0.02, footprint)
    return mix(0.08, mix(0.62, 0.06, max(picture * cut, ink)), face)


@njit(nogil=True)
def crate(u, v, width, height, footprint, seed):
    """Stacking crate: ribbed plastic with a rim, a grip and a stuck-on label."""
    tone = 0.05 + 0.25 * hash01(seed, 4, 11)
    ribs = inside(ripple(u - width / 2.0, 0.08, footprint), 0.75, 2.0, 0.3)
    rim = 1.0 - within(u, v, 0.015, 0.03, width - 0.015, height - 0.03, footprint)
    grip = within(
        u, v, 0.5 * width - 0.06, 0.72 * height, 0.5 * width + 0.06, 0.82 * height, footprint
    )
    side = 0.1 * width + 0.4 * width * hash01(seed, 5, 12)
    label = within(u, v, side, 0.25 * height, side + 0.11, 0.25 * height + 0.07, footprint)
    bars = inside(noise(u * 160.0, 0.5, seed), 0.0, 1.0, 160.0 * footprint)
    scratches = 1.0 + 0.12 * fractal(u, v * 0.4, 30.0, 4, 0.8, footprint, seed)
    tone = mix(tone, 1.5 * tone, max(ribs, rim)) * scratches
    return mix(mix(tone, 0.02, grip), mix(0.70, 0.06, bars), label)


@njit(nogil=True)
def tools(u, v, width, height, footprint, seed):
    """Pegboard with tools: dark shapes with bright handles, each in its place."""
    a = u - 0.04 * math.floor(u / 0.04)
    b = v - 0.04 * math.floor(v / 0.04)
    board = mix(0.42, 0.08, within(a, b, 0.016, 0.016, 0.024, 0.024, footprint))
    i = math.floor(u / 0.16)
    j = math.floor(v / 0.36)
    x = u - 0.16 * i - 0.08
    y = v - 0.36 * j
    long = 0.14 + 0.15 * hash01(i, j, seed)
    thick = 0.006 + 0.012 * hash01(i, j, seed + 1)
    wide = 0.015 + 0.045 * hash01(i, j, seed + 2)
    shaft = within(x, y, -thick, 0.33 - long, thick, 0.32, footprint)
    head = within(x, y, -wide, 0.27, wide, 0.27 + wide, footprint)
    grip = within(x, y, -1.5 * thick, 0.33 - long, 1.5 * thick, 0.33 - 0.55 * long, footprint)
    there = 1.0 if hash01(i, j, seed + 3) < 0.8 else 0.0
    tone = mix(board, 0.05, there * max(shaft, head))
    tone = mix(tone, 0.15 + 0.5 * hash01(i, j, seed + 4), there * grip)
    face = within(u, v, 0.01, 0.01, width - 0.01, height - 0.01, footprint)
    return mix(0.20, tone, face)


@njit(nogil=True)
def manifestation(u, v, footprint, seed):
    """Tone and cover (0 clear, 1 opaque) of the marks on a pane that stands near the floor: dots
    about 0.85 m above its lower edge, a band of squares of several tones about 0.25 m above it."""
    a = u / 0.08 - math.floor(u / 0.08) - 0.5
    radius = 0.08 * math.sqrt(a * a + ((v - 0.85) / 0.08) ** 2)
    dots = inside(radius, -1.0, 0.022, footprint)
    x = u / 0.075
    square = math.floor(x)
    band = inside(x - square, 0.08, 0.92, footprint / 0.075) * inside(v, 0.19, 0.31, footprint)
    tone = 0.12 + 0.50 * hash01(square, 3, seed)
    return (tone, 0.92 * band) if band > dots else (0.60, 0.92 * dots)


@njit(nogil=True)
def frosting(u, v, footprint, seed):
    """Tone and cover of a pane frosted from 0.15 m to 1.6 m above its lower edge, as foil is: with
    clear lines left in it."""
    foil = inside(v, 0.15, 1.60, footprint)
    line = v / 0.18 - math.floor(v / 0.18)
    clear = inside(line, 0.0, 0.06, footprint / 0.18) * inside(v, 0.9, 1.60, footprint)
    tone = 0.46 * (1.0 + 0.004 * noise(u * 2.0, v * 2.0, seed))
    return tone, 0.94 * foil * (1.0 - clear)
