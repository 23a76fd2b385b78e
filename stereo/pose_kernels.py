"""Kernels of the pose of a camera pair from points matched in four images.

The pose (R (3, 3), t (3,)) is that of the robot now in its frame at the key frame. A point is its
pixels at the key frame, k (3,): column and row in the left image, column in the right one. Its
disparity d = k0 - k2 - o is its inverse depth, o the offset that the calibration leaves; with the
ray c = (k0 - cx, k1 - cy, f), the camera's axes M and position p on the robot, and baseline B, its
place now in the left camera, times d, is

    q = M^T (R^T (B M c + d (p - t)) - d p)

which is as well defined at infinity (d = 0) as near by. Its pixels now, g(k), are cx + f q0 / q2,
cy + f q1 / q2 and, in the right image, B d f / q2 + o to the left of the first. Steps (6,): t and
then R from the right, as R exp(w). lens: f, cx, cy, B, o.

Pixels of both pairs are measured with the same noise: the reprojection error in all four images
is least (the gold standard of Hartley and Zisserman 2004, Sec. 4.2.3 and 16.4). With k measured
as z, linearised at an estimate `at`, r = g(at) + D (z - at) - m has the covariance
s^2 (I + D D^T), D = dg/dk; the least error over k is r^T (I + D D^T)^-1 r, at
z - D^T (I + D D^T)^-1 r. Depth is not linear in disparity, so `at` must be that least point, not
z: points measured too near would count for more than those measured too far.
"""

from __future__ import annotations

import numba
import numpy as np

FIT_ROUNDS = 4
LONGEST_STEP = 10.0  # m, rad: a fit that goes further has gone astray
LEAST_TRIPLES = 5
SOME = 60
WIDTHS = (64.0, 16.0, 4.0, 1.0, 1.0)
SURE = 1e-3  # chance that no triple without a false match was drawn
MIN_DEPTH = 0.05  # m
MIN_SHRINK = 0.02  # of the depth of a point at infinity that may be left after a motion


@numba.njit(cache=True, nogil=True)
def _placed(R, t, M, p):
    """A (3, 3) and T (3,) of q = B A c + d T."""
    C = M.T @ R.T
    return C @ M, C @ (p - t) - M.T @ p


@numba.njit(cache=True, nogil=True)
def _observe(z, at, pixels, R, A, T, M, p, lens, derive, r, J, D, L):
    """Residual r (3,) of one point, its Jacobians J (3, 7) by the pose and the offset and D (3, 3)
    by the key frame's pixels, and the Cholesky factor L (3, 3) of I + D D^T.

    False behind the camera. Rows without a pixel (NaN) become zero. J is found if `derive`.
    """
    f, cx, cy, baseline, offset = lens
    x, y, d = baseline * (at[0] - cx), baseline * (at[1] - cy), at[0] - at[2] - offset
    q0 = A[0, 0] * x + A[0, 1] * y + A[0, 2] * baseline * f + d * T[0]
    q1 = A[1, 0] * x + A[1, 1] * y + A[1, 2] * baseline * f + d * T[1]
    q2 = A[2, 0] * x + A[2, 1] * y + A[2, 2] * baseline * f + d * T[2]
    if q2 < MIN_DEPTH * d or q2 < MIN_SHRINK * baseline * f:
        return False
    scale = f / q2
    # The point times d in the robot's frame now.
    s0 = M[0, 0] * q0 + M[0, 1] * q1 + M[0, 2] * q2 + d * p[0]
    s1 = M[1, 0] * q0 + M[1, 1] * q1 + M[1, 2] * q2 + d * p[1]
    s2 = M[2, 0] * q0 + M[2, 1] * q1 + M[2, 2] * q2 + d * p[2]
    for row in range(3):
        if row == 0:
            across, side, here = 0, q0, cx
        elif row == 1:
            across, side, here = 1, q1, cy
        else:
            across, side, here = 0, q0 - baseline * d, cx - offset
        r[row] = here + side * scale - pixels[row]
        if np.isnan(r[row]):
            r[row] = 0.0
            for k in range(7):
                J[row, k] = 0.0
            for k in range(3):
                D[row, k] = 0.0
            continue
        # d pixel / d q: `scale` for q_across, -slope for q2.
        slope = side * scale / q2
        by_u = baseline * (scale * A[across, 0] - slope * A[2, 0])
        by_v = baseline * (scale * A[across, 1] - slope * A[2, 1])
        by_d = scale * T[across] - slope * T[2]
        if row == 2:
            by_d -= scale * baseline
        D[row, 0], D[row, 1], D[row, 2] = by_u + by_d, by_v, -by_d
        if not derive:
            continue
        # by the point on the robot now, times d
        g0 = M[0, across] * scale - M[0, 2] * slope
        g1 = M[1, across] * scale - M[1, 2] * slope
        g2 = M[2, across] * scale - M[2, 2] * slope
        for k in range(3):
            J[row, k] = -d * (R[k, 0] * g0 + R[k, 1] * g1 + R[k, 2] * g2)
        J[row, 3] = g1 * s2 - g2 * s1
        J[row, 4] = g2 * s0 - g0 * s2
        J[row, 5] = g0 * s1 - g1 * s0
        J[row, 6] = -by_d - (1.0 if row == 2 else 0.0)
    e0, e1, e2 = z[0] - at[0], z[1] - at[1], z[2] - at[2]
    for row in range(3):
        r[row] += D[row, 0] * e0 + D[row, 1] * e1 + D[row, 2] * e2
    s00 = 1.0 + D[0, 0] * D[0, 0] + D[0, 1] * D[0, 1] + D[0, 2] * D[0, 2]
    s10 = D[1, 0] * D[0, 0] + D[1, 1] * D[0, 1] + D[1, 2] * D[0, 2]
    s20 = D[2, 0] * D[0, 0] + D[2, 1] * D[0, 1] + D[2, 2] * D[0, 2]
    s11 = 1.0 + D[1, 0] * D[1, 0] + D[1, 1] * D[1, 1] + D[1, 2] * D[1, 2]
    s21 = D[2, 0] * D[1, 0] + D[2, 1] * D[1, 1] + D[2, 2] * D[1, 2]
    s22 = 1.0 + D[2, 0] * D[2, 0] + D[2, 1] * D[2, 1] + D[2, 2] * D[2, 2]
    L[0, 0] = np.sqrt(s00)
    L[1, 0], L[2, 0] = s10 / L[0, 0], s20 / L[0, 0]
    L[1, 1] = np.sqrt(s11 - L[1, 0] * L[1, 0])
    L[2, 1] = (s21 - L[2, 0] * L[1, 0]) / L[1, 1]
    L[2, 2] = np.sqrt(s22 - L[2, 0] * L[2, 0] - L[2, 1] * L[2, 1])
    return True


@numba.njit(cache=True, nogil=True)
def _whiten(L, v):
    """L^-1 v for v (3,), in place."""
    v[0] /= L[0, 0]
    v[1] = (v[1] - L[1, 0] * v[0]) / L[1, 1]
    v[2] = (v[2] - L[2, 0] * v[0] - L[2, 1] * v[1]) / L[2, 2]


@numba.njit(cache=True, nogil=True)
def _unwhiten(L, v):
    """L^-T v for v (3,), in place."""
    v[2] /= L[2, 2]
    v[1] = (v[1] - L[2, 1] * v[2]) / L[1, 1]
    v[0] = (v[0] - L[1, 0] * v[1] - L[2, 0] * v[2]) / L[0, 0]


@numba.njit(cache=True, nogil=True)
def misfits(keys, at, pixels, R, t, M, p, lens):
    """Least squared reprojection errors (n,) [px^2] of points linearised at `at` (n, 3); inf
    behind the camera."""
    n = len(keys)
    out = np.empty(n)
    r, J, D, L = np.empty(3), np.empty((3, 7)), np.empty((3, 3)), np.empty((3, 3))
    A, T = _placed(R, t, M, p)
    for i in range(n):
        if not _observe(keys[i], at[i], pixels[i], R, A, T, M, p, lens, False, r, J, D, L):
            out[i] = np.inf
            continue
        _whiten(L, r)
        out[i] = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    return out


@numba.njit(cache=True, nogil=True)
def relinearised(keys, at, pixels, agree, R, t, M, p, lens):
    """The pixels at the key frame (n, 3) that make the reprojection error least, by one step from
    `at`; those measured where a point does not agree."""
    out = keys.copy()
    r, J, D, L = np.empty(3), np.empty((3, 7)), np.empty((3, 3)), np.empty((3, 3))
    A, T = _placed(R, t, M, p)
    for i in range(len(keys)):
        if not agree[i]:
            continue
        if not _observe(keys[i], at[i], pixels[i], R, A, T, M, p, lens, False, r, J, D, L):
            continue
        _whiten(L, r)
        _unwhiten(L, r)
        for k in range(3):
            out[i, k] -= D[0, k] * r[0] + D[1, k] * r[1] + D[2, k] * r[2]
    return out


@numba.njit(cache=True, nogil=True)
def normal_equations(keys, at, pixels, sigma, weights, R, t, M, p, lens):
    """Sums over the points of w J^T W J (7, 7), w J^T W r (7,), and w w J^T W W sigma^2 J (7, 7).

    W = (I + D D^T)^-1 / sigma^2, w the weights; the last of the unknowns is the offset.
    """
    H, b, H2 = np.zeros((7, 7)), np.zeros(7), np.zeros((7, 7))
    r, J, D, L = np.empty(3), np.empty((3, 7)), np.empty((3, 3)), np.empty((3, 3))
    white, WJ, v = np.empty((7, 3)), np.empty((7, 3)), np.empty(3)
    A, T = _placed(R, t, M, p)
    for i in range(len(keys)):
        if weights[i] <= 0.0:
            continue
        w, square = weights[i] / sigma[i] ** 2, weights[i] ** 2 / sigma[i] ** 2
        if not _observe(keys[i], at[i], pixels[i], R, A, T, M, p, lens, True, r, J, D, L):
            continue
        _whiten(L, r)
        for k in range(7):
            v[0], v[1], v[2] = J[0, k], J[1, k], J[2, k]
            _whiten(L, v)
            white[k, 0], white[k, 1], white[k, 2] = v[0], v[1], v[2]
            _unwhiten(L, v)
            WJ[k, 0], WJ[k, 1], WJ[k, 2] = v[0], v[1], v[2]
        for k in range(7):
            b[k] += w * (white[k, 0] * r[0] + white[k, 1] * r[1] + white[k, 2] * r[2])
            for m in range(k + 1):
                H[k, m] += w * (
                    white[k, 0] * white[m, 0]
                    + white[k, 1] * white[m, 1]
                    + white[k, 2] * white[m, 2]
                )
                H2[k, m] += square * (
                    WJ[k, 0] * WJ[m, 0] + WJ[k, 1] * WJ[m, 1] + WJ[k, 2] * WJ[m, 2]
                )
    for k in range(7):
        for m in range(k):
            H[m, k], H2[m, k] = H[k, m], H2[k, m]
    return H, b, H2


@numba.njit(cache=True, nogil=True)
def stepped(R, t, step):
    """The pose after a step (6,)."""
    angle = np.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    if angle < 1e-9:
        s, c = 1.0, 0.5
    else:
        s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    x, y, z = step[3], step[4], step[5]
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return R @ (np.eye(3) + s * K + c * (K @ K)), t + step[:3]


@numba.njit(cache=True, nogil=True)
def _fit(keys, pixels, R, t, M, p, lens, prior):
    """Gauss and Newton's method from (R, t) on a few points; whether it settled, R, t."""
    ones = np.ones(len(keys))
    for _ in range(FIT_ROUNDS):
        H, b, _ = normal_equations(keys, keys, pixels, ones, ones, R, t, M, p, lens)
        H, b = H[:6, :6].copy(), b[:6].copy()
        for m in range(6):
            H[m, m] += prior[m] + 1e-9
        b[2] += prior[2] * t[2]
        b[3] += prior[3] * R[2, 1]
        b[4] -= prior[4] * R[2, 0]
        step = -np.linalg.solve(H, b)
        size = np.sqrt(np.sum(step * step))
        if not size < LONGEST_STEP:
            return False, R, t
        R, t = stepped(R, t, step)
        if size < 1e-3:
            break
    return True, R, t


@numba.njit(cache=True, nogil=True)
def improved(keys, pixels, R, t, M, p, lens, prior, gate):
    """The pose near the guess (R, t) on which the points agree, or the guess where that is better.

    Gauss and Newton's method on about `SOME` points, with the weights of Geman and McClure, whose
    width shrinks to that of `gate` (graduated non-convexity, Blake and Zisserman 1987). prior,
    gate: as of `hypotheses`, which then mostly has nothing to search.
    """
    some = max(len(keys) // SOME, 1)
    few, seen = keys[::some], pixels[::some]
    ones = np.ones(len(few))
    R1, t1 = R, t
    for wide in WIDTHS:
        squared = misfits(few, few, seen, R1, t1, M, p, lens)
        weights = (wide * gate / (wide * gate + squared)) ** 2
        H, b, _ = normal_equations(few, few, seen, ones, weights, R1, t1, M, p, lens)
        H, b = H[:6, :6].copy(), b[:6].copy()
        for m in range(6):
            H[m, m] += prior[m] + 1e-9
        b[2] += prior[2] * t1[2]
        b[3] += prior[3] * R1[2, 1]
        b[4] -= prior[4] * R1[2, 0]
        step = -np.linalg.solve(H, b)
        if not np.sqrt(np.sum(step * step)) < LONGEST_STEP:
            return R, t
        R1, t1 = stepped(R1, t1, step)
    before = np.sum(np.maximum(gate - misfits(keys, keys, pixels, R, t, M, p, lens), 0.0))
    after = np.sum(np.maximum(gate - misfits(keys, keys, pixels, R1, t1, M, p, lens), 0.0))
    if after > before:
        return R1, t1
    return R, t


@numba.njit(cache=True, nogil=True)
def hypotheses(keys, pixels, triples, R, t, M, p, lens, prior, gate, head_start):
    """The pose on which most points agree, of those that three points each give.

    Each of the triples (k, 3) is fitted by Gauss and Newton's method from the pose (R, t), as
    libviso2 does (Geiger et al., StereoScan, 2011), until a better one is no longer to be
    expected (RANSAC, Fischler and Bolles 1981). prior: (6,) weights that hold height, roll and
    pitch. A point agrees when its misfit is below `gate`; what counts is the sum of
    (gate - misfit) (MSAC, Torr and Zisserman 2000), which does not reward a sloppy fit. Others
    must beat (R, t) itself by the factor `head_start`.

    Returns:
        R, t of the best.
    """
    n = len(keys)
    squared = misfits(keys, keys, pixels, R, t, M, p, lens)
    best, best_R, best_t = head_start * np.sum(np.maximum(gate - squared, 0.0)), R, t
    needed = len(triples)
    for k in range(len(triples)):
        if k >= needed or best >= gate * n:  # no pose can score more than that
            break
        three = triples[k]
        if three[0] == three[1] or three[1] == three[2] or three[0] == three[2]:
            continue
        settled, R1, t1 = _fit(keys[three], pixels[three], R, t, M, p, lens, prior)
        if not settled:
            continue
        squared = misfits(keys, keys, pixels, R1, t1, M, p, lens)
        score = np.sum(np.maximum(gate - squared, 0.0))
        if score > best:
            best, best_R, best_t = score, R1, t1
            share = np.sum(squared < gate) / n
            missed = 1.0 - share**3
            if missed <= 0.0:
                break
            if missed < 1.0:
                needed = min(needed, LEAST_TRIPLES + int(np.log(SURE) / np.log(missed)))
    return best_R, best_t
