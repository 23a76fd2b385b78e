"""Kernels that follow small windows of an image into other images.

A window is compared after its mean is taken off and its contrast made one, so that another
exposure changes nothing. It is placed to a fraction of a pixel by Lucas and Kanade's method in
Baker and Matthews' inverse form (2004): gradients are those of the window remembered, found once.
All windows have 2 HALF + 1 pixels a side.
"""

from __future__ import annotations

import numba
import numpy as np

HALF = 4
SIDE = 2 * HALF + 1
PIXELS = SIDE * SIDE
ROUNDS = 12
SETTLED = 0.02  # px: a shorter step ends the search
LONGEST = 3.0  # px of all steps together at one level: further off is another thing
LEAST_CONTRAST = 1.0  # grey levels: a flat window tells nothing
LEAST_GRADIENT = 1e-4  # smaller eigenvalue of a window's normalised gradients, px^-2 a pixel


@numba.njit(cache=True, nogil=True, fastmath=True)
def _sample(image, x, y, scale, half, mixed, grey):
    """Fill `grey` (side * side,) with the image around (x, y) px, 2 half + 1 pixels a side; false
    where that leaves the image. mixed (W,): scratch."""
    height, width = image.shape
    reach = half * scale
    if not (x - reach >= 0 and y - reach >= 0 and x + reach < width - 1 and y + reach < height - 1):
        return False
    side = 2 * half + 1
    one = np.float32(1.0)
    plain = abs(scale - 1.0) < 0.02
    if plain:
        scale, reach = 1.0, float(half)
    first = int(x - reach)
    count = int(x + reach) + 2 - first
    a = np.float32(x - int(x))
    for j in range(side):
        # First between two rows of the image, then between their columns.
        place = y + (j - half) * scale
        v = int(place)
        b = np.float32(place - v)
        upper, lower = image[v, first : first + count], image[v + 1, first : first + count]
        for i in range(count):
            mixed[i] = (one - b) * np.float32(upper[i]) + b * np.float32(lower[i])
        row = grey[j * side : (j + 1) * side]
        if plain:
            for i in range(side):
                row[i] = (one - a) * mixed[i] + a * mixed[i + 1]
            continue
        for i in range(side):
            column = x + (i - half) * scale - first
            u = int(column)
            c = np.float32(column - u)
            row[i] = (one - c) * mixed[u] + c * mixed[u + 1]
    return True


@numba.njit(cache=True, nogil=True, fastmath=True)
def remember(image, points):
    """Windows of `image` uint8 (H, W) around points (n, 2) px.

    Returns:
        windows (n, PIXELS) float32, normalised; gradients (n, 2, PIXELS) of them, means taken
        off; inverses (n, 2, 2) of the gradients' sums of products; usable (n,) bool.
    """
    n = len(points)
    windows = np.zeros((n, PIXELS), np.float32)
    gradients = np.zeros((n, 2, PIXELS), np.float32)
    inverses = np.zeros((n, 2, 2), np.float32)
    usable = np.zeros(n, np.bool_)
    wide = SIDE + 2  # with the neighbours that the gradients need
    mixed, grey = np.empty(image.shape[1], np.float32), np.empty(wide * wide, np.float32)
    for i in range(n):
        x, y = np.float64(points[i, 0]), np.float64(points[i, 1])
        if not _sample(image, x, y, np.float64(1.0), HALF + 1, mixed, grey):
            continue
        window, along, down = windows[i], gradients[i, 0], gradients[i, 1]
        means = np.zeros(3, np.float32)
        for v in range(SIDE):
            at = (v + 1) * wide + 1
            for u in range(SIDE):
                k = v * SIDE + u
                window[k] = grey[at + u]
                along[k] = np.float32(0.5) * (grey[at + u + 1] - grey[at + u - 1])
                down[k] = np.float32(0.5) * (grey[at + u + wide] - grey[at + u - wide])
        for k in range(PIXELS):
            means[0] += window[k]
            means[1] += along[k]
            means[2] += down[k]
        means /= np.float32(PIXELS)
        power = np.float32(0.0)
        for k in range(PIXELS):
            window[k] -= means[0]
            power += window[k] * window[k]
        contrast = np.sqrt(power / np.float32(PIXELS))
        if contrast < LEAST_CONTRAST:
            continue
        a, b, c = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for k in range(PIXELS):
            window[k] /= contrast
            gx, gy = (along[k] - means[1]) / contrast, (down[k] - means[2]) / contrast
            along[k], down[k] = gx, gy
            a += gx * gx
            b += gx * gy
            c += gy * gy
        smaller = 0.5 * (a + c - np.sqrt((a - c) ** 2 + 4 * b * b))
        if smaller < LEAST_GRADIENT * PIXELS:
            continue
        det = a * c - b * b
        inverses[i, 0, 0], inverses[i, 1, 1] = c / det, a / det
        inverses[i, 0, 1] = inverses[i, 1, 0] = -b / det
        usable[i] = True
    return windows, gradients, inverses, usable


@numba.njit(cache=True, nogil=True, fastmath=True)
def follow(image, windows, gradients, inverses, usable, scale, position):
    """Place remembered windows in an image.

    Args:
        image: uint8 (H, W); windows ... usable: of `remember`; scale: (n,) how much larger the
            things appear now; position: (n, 2) float64 first guesses [px], replaced.

    Returns:
        likeness (n,): correlation of both windows (1 = the same); -1 where a window is not
        usable, leaves the image or does not settle: its guess stays.
    """
    n = len(position)
    likeness = np.full(n, -1.0)
    mixed, grey = np.empty(image.shape[1], np.float32), np.empty(PIXELS, np.float32)
    least = np.float32(PIXELS * LEAST_CONTRAST**2)
    for i in range(n):
        if not usable[i]:
            continue
        window, along, down = windows[i], gradients[i, 0], gradients[i, 1]
        own_p, own_q = np.float32(0.0), np.float32(0.0)
        for k in range(PIXELS):
            own_p += along[k] * window[k]
            own_q += down[k] * window[k]
        x, y = position[i, 0], position[i, 1]
        settled = False
        for _ in range(ROUNDS):
            if not _sample(image, x, y, scale[i], HALF, mixed, grey):
                settled = False
                break
            # Windows and gradients have no mean: that of the image falls out of the products. Its
            # middle is taken off, so that its power is no small difference of large numbers.
            middle = grey[PIXELS // 2]
            total, power, same = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            p, q = np.float32(0.0), np.float32(0.0)
            for k in range(PIXELS):
                g = grey[k] - middle
                total += g
                power += g * g
                same += g * window[k]
                p += g * along[k]
                q += g * down[k]
            power -= total * total / np.float32(PIXELS)
            if power < least:
                settled = False
                break
            contrast = np.sqrt(power / np.float32(PIXELS))
            likeness[i] = same / (contrast * np.float32(PIXELS))
            if settled:
                break
            p, q = p / contrast - own_p, q / contrast - own_q
            dx = scale[i] * (inverses[i, 0, 0] * p + inverses[i, 0, 1] * q)
            dy = scale[i] * (inverses[i, 1, 0] * p + inverses[i, 1, 1] * q)
            x -= dx
            y -= dy
            if abs(x - position[i, 0]) > LONGEST or abs(y - position[i, 1]) > LONGEST:
                settled = False
                break
            settled = dx * dx + dy * dy < SETTLED * SETTLED
        if settled:
            position[i, 0], position[i, 1] = x, y
        else:
            likeness[i] = -1.0
    return likeness


@numba.njit(cache=True, nogil=True)
def search_rows(left, right, points, disparities):
    """Whole disparities [px] at which points of the left image are found in the right one's row.

    left, right: rectified uint8 (H, W); points: (n, 2) px in the left one. Windows are compared
    by the sum of absolute differences after their means are taken off. -1 where the best is not
    clearly better than the second best elsewhere (by a fifth), or at the end of the search.
    """
    n = len(points)
    height, width = left.shape
    half = 4
    side = 2 * half + 1
    found = np.full(n, -1, np.int64)
    costs, offsets = np.empty(disparities, np.int32), np.empty(disparities, np.int32)
    strip = np.empty((side, disparities + side), np.int32)
    sums = np.empty(disparities + side, np.int32)
    for i in range(n):
        u, v = int(np.rint(points[i, 0])), int(np.rint(points[i, 1]))
        if u < half or v < half or u >= width - half or v >= height - half:
            continue
        most = min(disparities, u - half + 1)
        if most < 3:
            continue
        # The strip runs from right to left, as the disparities grow.
        sums[:] = 0
        for j in range(side):
            for k in range(most + side - 1):
                strip[j, k] = right[v - half + j, u + half - k]
                sums[k] += strip[j, k]
        mean = np.int32(0)
        for j in range(side):
            for k in range(side):
                mean += np.int32(left[v - half + j, u - half + k])
        for d in range(most):
            other = np.int32(0)
            for k in range(side):
                other += sums[d + k]
            offsets[d] = (mean - other) // np.int32(side * side)
            costs[d] = 0
        for j in range(side):
            for k in range(side):
                grey = np.int32(left[v - half + j, u + half - k])
                row = strip[j, k : k + most]
                for d in range(most):
                    costs[d] += abs(grey - row[d] - offsets[d])
        best = 0
        for d in range(1, most):
            if costs[d] < costs[best]:
                best = d
        second = np.int32(2**31 - 1)
        for d in range(most):
            if abs(d - best) > 2 and costs[d] < second:
                second = costs[d]
        if best < most - 1 and costs[best] * np.int64(6) < second * np.int64(5):
            found[i] = best
    return found
