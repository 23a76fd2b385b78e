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
def _sample(image, x, y, scale, window):
    """Fill `window` (PIXELS,) around (x, y) px, normalised; its contrast, or -1 where it leaves
    the image."""
    height, width = image.shape
    reach = HALF * scale
    if not (x - reach >= 0 and y - reach >= 0 and x + reach < width - 1 and y + reach < height - 1):
        return -1.0
    if abs(scale - 1.0) < 0.02:
        u, v = int(np.floor(x)), int(np.floor(y))
        a, b = np.float32(x - u), np.float32(y - v)
        w00, w01 = (1 - a) * (1 - b), a * (1 - b)
        w10, w11 = (1 - a) * b, a * b
        u, v = u - HALF, v - HALF
        for j in range(SIDE):
            upper, lower = image[v + j], image[v + j + 1]
            for i in range(SIDE):
                k = u + i
                window[j * SIDE + i] = (
                    w00 * upper[k] + w01 * upper[k + 1] + w10 * lower[k] + w11 * lower[k + 1]
                )
    else:
        for j in range(SIDE):
            row = y + (j - HALF) * scale
            v = int(row)
            b = np.float32(row - v)
            upper, lower = image[v], image[v + 1]
            for i in range(SIDE):
                column = x + (i - HALF) * scale
                u = int(column)
                a = np.float32(column - u)
                window[j * SIDE + i] = (1 - b) * ((1 - a) * upper[u] + a * upper[u + 1]) + b * (
                    (1 - a) * lower[u] + a * lower[u + 1]
                )
    mean = np.float32(0.0)
    for k in range(PIXELS):
        mean += window[k]
    mean /= PIXELS
    power = np.float32(0.0)
    for k in range(PIXELS):
        window[k] -= mean
        power += window[k] * window[k]
    contrast = np.sqrt(power / PIXELS)
    if contrast > 0:
        for k in range(PIXELS):
            window[k] /= contrast
    return contrast


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
    ahead, behind = np.empty(PIXELS, np.float32), np.empty(PIXELS, np.float32)
    one = np.float64(1.0)
    for i in range(n):
        x, y = np.float64(points[i, 0]), np.float64(points[i, 1])
        contrast = _sample(image, x, y, one, windows[i])
        if contrast < LEAST_CONTRAST:
            continue
        inside = True
        for axis in range(2):
            dx, dy = (1.0, 0.0) if axis == 0 else (0.0, 1.0)
            more = _sample(image, x + dx, y + dy, one, ahead)
            less = _sample(image, x - dx, y - dy, one, behind)
            if more < 0 or less < 0:
                inside = False
                break
            for k in range(PIXELS):
                gradients[i, axis, k] = 0.5 * (more * ahead[k] - less * behind[k]) / contrast
        if not inside:
            continue
        a, b, c = 0.0, 0.0, 0.0
        for k in range(PIXELS):
            gx, gy = gradients[i, 0, k], gradients[i, 1, k]
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
    window = np.empty(PIXELS, np.float32)
    for i in range(n):
        if not usable[i]:
            continue
        x, y = position[i, 0], position[i, 1]
        settled = False
        for _ in range(ROUNDS):
            if _sample(image, x, y, scale[i], window) < LEAST_CONTRAST:
                settled = False
                break
            p, q, same = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for k in range(PIXELS):
                same += window[k] * windows[i, k]
            for k in range(PIXELS):
                e = window[k] - windows[i, k]
                p += gradients[i, 0, k] * e
                q += gradients[i, 1, k] * e
            likeness[i] = same / PIXELS
            if settled:
                break
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


@numba.njit(cache=True, nogil=True, fastmath=True)
def search_rows(left, right, points, disparities):
    """Whole disparities [px] at which points of the left image are found in the right one's row.

    left, right: rectified uint8 (H, W); points: (n, 2) px in the left one. Windows are compared
    by the sum of absolute differences after their means are taken off. 0 where the best is not
    clearly better than the second best elsewhere (by a fifth), or at the end of the search.
    """
    n = len(points)
    height, width = left.shape
    half = 4
    size = (2 * half + 1) ** 2
    found = np.zeros(n, np.int64)
    costs = np.empty(disparities, np.int64)
    for i in range(n):
        u, v = int(np.rint(points[i, 0])), int(np.rint(points[i, 1]))
        if u < half or v < half or u >= width - half or v >= height - half:
            continue
        most = min(disparities, u - half + 1)
        if most < 3:
            continue
        mean = 0
        for j in range(-half, half + 1):
            for k in range(-half, half + 1):
                mean += np.int64(left[v + j, u + k])
        for d in range(most):
            other = 0
            for j in range(-half, half + 1):
                for k in range(-half, half + 1):
                    other += np.int64(right[v + j, u + k - d])
            offset = (mean - other) // size
            cost = 0
            for j in range(-half, half + 1):
                for k in range(-half, half + 1):
                    cost += abs(
                        np.int64(left[v + j, u + k]) - np.int64(right[v + j, u + k - d]) - offset
                    )
            costs[d] = cost
        best = 0
        for d in range(1, most):
            if costs[d] < costs[best]:
                best = d
        second = np.int64(1) << 60
        for d in range(most):
            if abs(d - best) > 2 and costs[d] < second:
                second = costs[d]
        if best < most - 1 and costs[best] * 6 < second * 5:
            found[i] = best + 1  # 0 says that nothing was found
    return found - 1
