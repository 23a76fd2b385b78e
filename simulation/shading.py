"""From ray hits to light: where a ray lands, how bright it is there, and what goes on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simulation.boxes import Faces

EXPOSURE = 0.66
GAMMA = 1.9
STEEPEST = 0.15  # cosine below which the footprint no longer grows
PASSES = 0.98  # of the light that a pane does not reflect
LEAST = 0.004  # share of a sample's light below which a ray is not followed
LIFT = 1e-4  # m that a new ray starts off its surface


class Beams(NamedTuple):
    """m rays on their way. rays: (m, 6) float32, origin and direction; sample: (m,) int64, to which
    its light goes; share: (m,) of its light that counts; width: (m,) m at the origin; spread: (m,)
    growth of the width per length of the direction vector."""

    rays: np.ndarray
    sample: np.ndarray
    share: np.ndarray
    width: np.ndarray
    spread: np.ndarray

    @staticmethod
    def first(rays: np.ndarray, angle: float) -> Beams:
        """One beam a sample, straight from the camera; rays: (m, 6)."""
        m = len(rays)
        return Beams(rays, np.arange(m), np.ones(m), np.zeros(m), np.full(m, angle))


class Hits(NamedTuple):
    """Where m beams land: face (m,) int64 or -1, u and v (m,) m on it, width (m,) of the beam there
    as it lies on the face [m]."""

    face: np.ndarray
    u: np.ndarray
    v: np.ndarray
    width: np.ndarray


def land(beams: Beams, depth: np.ndarray, triangle: np.ndarray, faces: Faces) -> Hits:
    """Hits of `beams` at the ray parameters `depth` (m,), inf if none, on `triangle` (m,)."""
    face = np.where(np.isfinite(depth), triangle.astype(np.int64) // 2, -1)
    u, v, width = footprints(
        beams.rays, beams.width, beams.spread, depth, face, faces.origin, faces.u_axis,
        faces.v_axis, faces.normal,
    )  # fmt: skip
    return Hits(face, u, v, width)


@njit(cache=True, nogil=True)
def footprints(rays, start, spread, depth, face, origin, u_axis, v_axis, normal):
    """Where n rays land on their faces: u, v and the beam's width there (n,) each [m]."""
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
        width[i] = (start[i] + depth[i] * spread[i]) / math.sqrt(cosine)
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


@njit(cache=True, nogil=True)
def schlick(cosine, facing, grazing):
    """Mirrored share of light that meets a surface under `cosine` to its normal (Schlick 1994)."""
    return facing + (grazing - facing) * (1.0 - cosine) ** 5


@njit(cache=True, nogil=True)
def scatter(
    rays, sample, share, width, spread, depth, face, own, cover, surface, gloss, mirrors, sums
):
    """Add what m beams see to `sums` (per sample), and send on what is mirrored or let through.

    own, cover (m,): light of the surface itself, and how much of it is opaque; surface (f, 9): u
    axis, v axis and normal of all faces; gloss (f, 3): their facing, grazing, blur; mirrors
    (k, 3): for each of a pixel's k samples, how much its mirrored ray counts, and by how many blurs
    the mirror is tilted. Returns the parts of `Beams` for the next round.
    """
    new_rays = np.empty((2 * len(face), 6), np.float32)
    new_sample = np.empty(2 * len(face), np.int64)
    values = np.empty((3, 2 * len(face)))
    count = 0
    for i in range(len(face)):
        f = face[i]
        if f < 0:
            continue
        if gloss[f, 1] == 0.0:
            sums[sample[i]] += share[i] * own[i]
            continue
        length = math.sqrt(rays[i, 3] ** 2 + rays[i, 4] ** 2 + rays[i, 5] ** 2)
        slope = 0.0
        for axis in range(3):
            slope += rays[i, 3 + axis] * surface[f, 6 + axis] / length
        mirrored = schlick(min(abs(slope), 1.0), gloss[f, 0], gloss[f, 1])
        sums[sample[i]] += share[i] * (1.0 - mirrored) * cover[i] * own[i]
        side = -1.0 if slope > 0.0 else 1.0
        here = width[i] + depth[i] * spread[i]
        through = share[i] * (1.0 - mirrored) * PASSES * (1.0 - cover[i])
        if through > LEAST:
            for axis in range(3):
                direction = rays[i, 3 + axis]
                new_rays[count, axis] = rays[i, axis] + (depth[i] + LIFT / length) * direction
                new_rays[count, 3 + axis] = direction
            new_sample[count] = sample[i]
            values[0, count], values[1, count], values[2, count] = through, here, spread[i]
            count += 1
        which = sample[i] % len(mirrors)
        reflected = share[i] * mirrored * mirrors[which, 0]
        if reflected > LEAST:
            a = gloss[f, 2] * mirrors[which, 1]
            b = gloss[f, 2] * mirrors[which, 2]
            stretch = math.sqrt(1.0 + a * a + b * b)
            along = 0.0
            for axis in range(3):
                n = surface[f, 6 + axis] + a * surface[f, axis] + b * surface[f, 3 + axis]
                along += rays[i, 3 + axis] * n / stretch
            # A mirror that is tilted too far to be looked at would send light into the surface.
            if along * slope <= 0.0 or abs(along) < 0.5 * abs(slope) * length:
                a, b, stretch, along = 0.0, 0.0, 1.0, slope * length
            for axis in range(3):
                n = surface[f, 6 + axis] + a * surface[f, axis] + b * surface[f, 3 + axis]
                hit = rays[i, axis] + depth[i] * rays[i, 3 + axis]
                new_rays[count, axis] = hit + side * LIFT * surface[f, 6 + axis]
                new_rays[count, 3 + axis] = rays[i, 3 + axis] - 2.0 * along * n / stretch
            new_sample[count] = sample[i]
            values[0, count], values[1, count] = reflected, here
            values[2, count] = spread[i] + gloss[f, 2] * length
            count += 1
    return new_rays[:count], new_sample[:count], values[:, :count]
