"""The inner loops of columns to ranges: disparities gathered by bearing, the nearest that stands.

Pixels are counted, and weighed by what they show: across a blank surface SGBM passes on what it
found at the surface's edges, right or wrong, and only a gradient beyond the image's noise is
evidence of its own.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stereo.disparity import SUBPIXEL

# Neighbours that confirm a column, on either side; fewer than LEAST_ALIKE in all: false.
NEIGHBOURS = 4
LEAST_ALIKE = 2
# Roughness of a column without enough neighbours on either side [px].
LONELY = 0.5
# A pixel's evidence ends at a gradient of so many times the noise: many pixels must agree.
FULL = 3.0
# Evidence [noise^2] wanted for each pixel needed, and in standard deviations of pure noise.
EVIDENCE = 3.0
BEYOND_NOISE = 4.0
# Share of it wanted of the nearest two of three disparities.
FRONT = 0.35


@njit(cache=True, nogil=True)
def gather(disparity, gradients, seen, rotation, intrinsics, height, band, noise, bins):
    """Pixels in the height band by column and whole disparity.

    disparity (H, W) int16 sixteenths; gradients (H, W) int16 across the rectified left image and
    their noise; seen (4, H) as `Rectifier.seen`; rotation (3, 3) from the camera to the level
    sensor frame; intrinsics f, f_rows, cx, cy, baseline; height of the camera [m]; band lowest,
    highest [m], tangent of the tilt's doubt, noise of a disparity [px].

    Returns what `nearest_standing` takes, (filled, evidence, weights, nearness, energy), and
    closest. filled (W, bins) int32: the number of pixels; evidence (W, bins): by how much their
    squared gradients exceed the noise, in units of its square; weights and nearness (W, bins):
    the sums of those squares and of squares over range; energy (W, bins): of squares without
    bound; closest (W,): the greatest 1/range of any pixel.
    """
    f, f_rows, cx, cy, baseline = intrinsics
    low, high, tilt, doubt_of_match = band
    least, full = noise * noise, (FULL * noise) ** 2
    # Floor seen through a tilt or a disparity error must not become an obstacle: both raise it
    # in proportion to the depth.
    doubt = 3.0 * math.hypot(tilt, height * doubt_of_match / (f * baseline))
    rows, columns = disparity.shape
    filled = np.zeros((columns, bins), np.int32)
    evidence = np.zeros((columns, bins), np.float64)
    weights = np.zeros((columns, bins), np.float64)
    nearness = np.zeros((columns, bins), np.float64)
    energy = np.zeros((columns, bins), np.float64)
    closest = np.zeros(columns, np.float64)
    for v in range(rows):
        y = (v - cy) / f_rows
        ahead, left, above = (
            rotation[0, 1] * y + rotation[0, 2],
            rotation[1, 1] * y + rotation[1, 2],
            rotation[2, 1] * y + rotation[2, 2],
        )
        for u in range(seen[0, v], seen[1, v]):
            raw = disparity[v, u]
            if raw <= 0:
                continue
            d = raw / SUBPIXEL
            if not seen[2, v] <= u - d < seen[3, v]:
                continue
            x = (u - cx) / f
            Z = f * baseline / d
            up = height + Z * (rotation[2, 0] * x + above)
            if up < low or up > high or up < doubt * Z:
                continue
            X, Y = Z * (rotation[0, 0] * x + ahead), Z * (rotation[1, 0] * x + left)
            if X <= 0.0:
                continue
            column = round(cx - f * Y / X)
            if not 0 <= column < columns:
                continue
            near = 1.0 / math.sqrt(X * X + Y * Y)
            closest[column] = max(closest[column], near)
            bin_ = min(round(d), bins - 1)
            square = float(gradients[v, u]) ** 2
            weight = min(square, full)
            filled[column, bin_] += 1
            evidence[column, bin_] += weight / least - 1.0
            weights[column, bin_] += weight
            nearness[column, bin_] += weight * near
            energy[column, bin_] += square
    return (filled, evidence, weights, nearness, energy), closest


@njit(cache=True, nogil=True)
def nearest_standing(filled, evidence, weights, nearness, energy, needed, veto, one_surface):
    """Range (W,) [m], pixels behind it (W,), energy (W,) of the column's own gradients there.

    The first five as `gather` returns them; needed (bins,): pixels that an obstacle at that
    disparity must show in three columns. Where `veto` times as many are filled in, and nothing
    with evidence follows within `one_surface` of the disparity, a blank obstacle may stand:
    unknown.
    """
    columns, bins = filled.shape
    ranges = np.full(columns, np.nan)
    support = np.zeros(columns, np.int32)
    outline = np.zeros(columns, np.float64)
    for u in range(columns):
        first, last = max(u - 1, 0), min(u + 2, columns)
        blank = 0  # nearest disparity at which something blank may stand
        for d in range(bins - 1, 0, -1):
            if blank - d > max(1.0, one_surface * d):
                break
            if filled[u, d] == 0:
                continue
            pixels = filled[first:last, max(d - 2, 0) : d + 1].sum()
            found = evidence[first:last, max(d - 2, 0) : d + 1].sum()
            wanted = max(EVIDENCE * needed[d], BEYOND_NOISE * math.sqrt(2.0 * pixels))
            # Most of it may lie behind: then this is the front of another surface.
            if found < wanted or evidence[first:last, d - 1 : d + 1].sum() < FRONT * wanted:
                filling = filled[first:last, d - 1 : d + 1].sum()
                if blank == 0 and filling >= veto * needed[d]:
                    blank = d
                continue
            # The window that first holds enough sits on the near slope of the surface's peak.
            weight = weights[first:last, d - 1 : d + 1].sum()
            if d > 1 and weights[first:last, d - 2 : d].sum() > weight:
                d -= 1
                weight = weights[first:last, d - 1 : d + 1].sum()
            if blank - d > max(1.0, one_surface * d):
                break
            if weight > 0.0:
                ranges[u] = weight / nearness[first:last, d - 1 : d + 1].sum()
                support[u] = pixels
                outline[u] = energy[u, d - 1 : d + 1].sum()
                break
    return ranges, support, outline


@njit(cache=True, nogil=True)
def trim_outlines(ranges, outline, reach, step):
    """Ranges (W,) without the columns by which block matching fattens whatever stands before
    something else.

    outline (W,): squared gradients of the column's own pixels at its range. Where a surface
    ends, its outline is the strongest of the last `reach` columns; what lies beyond it is not
    the surface's. Ranges that differ by more than the factor `step` are of different surfaces.
    """
    columns = ranges.size
    trimmed = ranges.copy()
    for side in (-1, 1):
        for u in range(columns):
            beyond = u + side
            r = ranges[u]
            if not r < np.inf or not 0 <= beyond < columns:
                continue
            if ranges[beyond] < r * step:  # the surface goes on, or a nearer one begins
                continue
            best, strongest = 0, -1.0
            for k in range(reach):
                at = u - side * k
                if not 0 <= at < columns or not abs(ranges[at] - r) <= (step - 1.0) * r:
                    break
                if outline[at] > strongest:
                    best, strongest = k, outline[at]
            for k in range(best):
                trimmed[u - side * k] = np.nan
    return trimmed


@njit(cache=True, nogil=True)
def confirm(ranges, factor, one_surface):
    """Ranges (W,) that neighbours confirm, and by how much those differ (W,) [px].

    factor (W,): disparity times range of each column. A surface is several columns wide: a column
    with fewer than LEAST_ALIKE others of its disparity (within `one_surface` of it or 1 px) is a
    false match. The roughness is the lesser of the distances to both sides' medians: at an
    outline only one side is of the same surface.
    """
    columns = ranges.size
    confirmed = ranges.copy()
    roughness = np.zeros(columns)
    disparity = factor / ranges  # 0 beyond the range, NaN unknown
    side = np.empty(NEIGHBOURS)
    for u in range(columns):
        if not ranges[u] < np.inf:
            continue
        alike = 0
        rough = np.inf
        for direction in (-1, 1):
            number = 0
            for k in range(1, NEIGHBOURS + 1):
                at = u + direction * k
                if not 0 <= at < columns or not disparity[at] > 0.0:
                    continue
                off = abs(disparity[at] - disparity[u])
                alike += off <= max(1.0, one_surface * disparity[u])
                side[number] = off
                number += 1
            if number >= LEAST_ALIKE:
                rough = min(rough, np.median(side[:number]))
        if alike < LEAST_ALIKE:
            confirmed[u] = np.nan
        roughness[u] = rough if rough < np.inf else LONELY
    return confirmed, roughness
