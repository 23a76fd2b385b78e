"""Procedural textures: the reflectance of every material at a point of a face, anti-aliased.

The helpers live in several files, and numba's cache sees edits of a kernel's own file only. So the
helpers that call into other files are not cached, and the one kernel that is carries their sources.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numba import njit

from simulation import fitting_textures, patterns, surface_textures
from simulation.fitting_textures import (
    books,
    cabinet,
    cardboard,
    crate,
    door,
    drawers,
    extinguisher,
    frosting,
    manifestation,
    notice,
    plain_door,
    poster,
    radiator,
    screen,
    sign,
    tools,
    whiteboard,
)
from simulation.materials import MATERIALS
from simulation.patterns import fractal
from simulation.surface_textures import (
    blinds,
    brick,
    carpet,
    ceiling,
    concrete,
    fabric,
    laminate,
    leaves,
    lino,
    metal,
    parquet,
    plaster,
    rug,
    shirt,
    tiles,
    vinyl,
    white,
    wood,
)

GLASS = MATERIALS.index("glass")


@njit(nogil=True)
def more(material, u, v, width, height, footprint, seed):
    """The second half of the opaque materials; see `look`."""
    if material == 18:
        return white(u, v, footprint, seed)
    if material == 19:
        return tiles(u, v, footprint)
    if material == 20:
        return blinds(u, footprint)
    if material == 21:
        return vinyl(u, v, footprint, seed)
    if material == 22:
        return lino(u, v, footprint, seed)
    if material == 23:
        return concrete(u, v, footprint, seed)
    if material == 24:
        return parquet(u, v, footprint, seed)
    if material == 25:
        return brick(u, v, footprint, seed)
    if material == 26:
        return rug(u, v, width, height, footprint, seed)
    if material == 27:
        return 0.025  # matte black
    if material == 28:
        return 0.025  # gloss black
    if material == 29:
        return 0.42 * (1.0 + 0.03 * fractal(u, v, 25.0, 3, 0.8, footprint, seed))
    if material == 30:
        return plain_door(u, v, width, height, footprint, seed)
    if material == 31:
        return notice(u, v, width, height, footprint, seed)
    if material == 32:
        return radiator(u, v, width, height, footprint)
    if material == 33:
        return extinguisher(u, v, width, height, footprint, seed)
    if material == 34:
        return sign(u, v, width, height, footprint, seed)
    if material == 35:
        return crate(u, v, width, height, footprint, seed)
    if material == 36:
        return tools(u, v, width, height, footprint, seed)
    if material == 37:
        return shirt(u, v, footprint, seed)
    return 0.36 * (1.0 + 0.06 * fractal(u, v, 14.0, 4, 0.8, footprint, seed))  # skin


@njit(nogil=True)
def albedo(material, u, v, width, height, footprint, seed):
    """Reflectance of the opaque materials; see `look`."""
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
    if material == 17:
        return drawers(u, v, width, height, footprint, seed)
    return more(material, u, v, width, height, footprint, seed)


@njit(nogil=True)
def look(material, u, v, width, height, footprint, seed):
    """Reflectance (0 to 1) of `material` (index into MATERIALS) at (u, v) m on its face, and how
    much of what lies behind is covered by it: 1 but for panes of glass.

    width, height: size of the face [m]; footprint: width of a sample on the face [m].
    """
    if material < GLASS:
        return albedo(material, u, v, width, height, footprint, seed), 1.0
    if material == GLASS:
        return manifestation(u, v, footprint, seed)
    if material == GLASS + 1:
        return 0.0, 0.0
    return frosting(u, v, footprint, seed)


def _cached(sources):
    """The kernel `reflectances`. What it closes over is part of its key in numba's cache."""

    @njit(cache=True, nogil=True)
    def reflectances(face, u, v, footprint, material, size, seed):
        """Reflectance and cover (n,) each (see `look`) of n places on the faces `face` (n,); 0
        where face is -1.

        u, v, footprint: (n,) m; material, size (m, 2), seed: those of all m faces.
        """
        _ = sources
        tone = np.zeros(len(face))
        cover = np.zeros(len(face))
        for i in range(len(face)):
            f = face[i]
            if f >= 0:
                tone[i], cover[i] = look(
                    material[f], u[i], v[i], size[f, 0], size[f, 1], footprint[i], seed[f]
                )
        return tone, cover

    return reflectances


def _digest(*modules) -> str:
    content = b"".join(Path(module.__file__).read_bytes() for module in modules)
    return hashlib.sha256(content).hexdigest()


reflectances = _cached(_digest(patterns, surface_textures, fitting_textures))
