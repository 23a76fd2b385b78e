"""Kernels of the pose of a camera pair from points in space and their pixels in both images.

The pose (R (3, 3), t (3,)) is that of the robot now in its frame at the key frame. A point seen
at the key frame X (3,) m is X' = R^T (X - t) now, and in the rectified left camera, whose axes M
and place p on the robot are known, Y = M^T (X' - p). Its pixels are column and row in the left
image and column in the right one. Steps (6,): t and then R from the right, as R exp(w).

Where a point stands was measured at the key frame, too: its disparity there errs as its pixels
do now. The residuals' covariance is therefore s^2 (I + a a^T), with a (3,) the pixels'
derivative by that disparity, and its inverse I - a a^T / (1 + a^T a).
"""

from __future__ import annotations

import numba
import numpy as np

FIT_ROUNDS = 4
LONGEST_STEP = 10.0  # m, rad: a fit that goes further has gone astray
LEAST_TRIPLES = 5
SURE = 1e-3  # chance that no triple without a false match was drawn


@numba.njit(cache=True, nogil=True)
def _observe(X, ray, pixels, R, t, M, p, lens, r, J, a):
    """Residuals r (3,), their Jacobian J (3, 6) and a (3,) of one point; false behind the camera.

    ray (3,): d X / d disparity at the key frame. Rows without a pixel (NaN) become zero.
    """
    f, cx, cy, baseline = lens
    q0, q1, q2 = X[0] - t[0], X[1] - t[1], X[2] - t[2]
    x = R[0, 0] * q0 + R[1, 0] * q1 + R[2, 0] * q2
    y = R[0, 1] * q0 + R[1, 1] * q1 + R[2, 1] * q2
    z = R[0, 2] * q0 + R[1, 2] * q1 + R[2, 2] * q2
    d0, d1, d2 = x - p[0], y - p[1], z - p[2]
    depth = M[0, 2] * d0 + M[1, 2] * d1 + M[2, 2] * d2
    if depth < 0.05:
        return False
    side = M[0, 0] * d0 + M[1, 0] * d1 + M[2, 0] * d2
    down = M[0, 1] * d0 + M[1, 1] * d1 + M[2, 1] * d2
    inverse = f / depth
    r[0] = cx + side * inverse - pixels[0]
    r[1] = cy + down * inverse - pixels[1]
    r[2] = cx + (side - baseline) * inverse - pixels[2]
    for row in range(3):
        if row == 0:
            across, along, slope = 0, 2, side / depth
        elif row == 1:
            across, along, slope = 1, 2, down / depth
        else:
            across, along, slope = 0, 2, (side - baseline) / depth
        if np.isnan(r[row]):
            r[row] = 0.0
            a[row] = 0.0
            for k in range(6):
                J[row, k] = 0.0
            continue
        # d pixel / d X'
        g0 = inverse * (M[0, across] - slope * M[0, along])
        g1 = inverse * (M[1, across] - slope * M[1, along])
        g2 = inverse * (M[2, across] - slope * M[2, along])
        # d X' / d t = -R^T, d X' / d w = [X']x
        for k in range(3):
            J[row, k] = -(R[k, 0] * g0 + R[k, 1] * g1 + R[k, 2] * g2)
        J[row, 3] = g1 * z - g2 * y
        J[row, 4] = g2 * x - g0 * z
        J[row, 5] = g0 * y - g1 * x
        a[row] = -(J[row, 0] * ray[0] + J[row, 1] * ray[1] + J[row, 2] * ray[2])
    return True


@numba.njit(cache=True, nogil=True)
def misfits(X, rays, pixels, R, t, M, p, lens):
    """Squared Mahalanobis lengths (n,) of the residuals for s = 1 px; inf behind the camera."""
    n = len(X)
    out = np.empty(n)
    r, J, a = np.empty(3), np.empty((3, 6)), np.empty(3)
    for i in range(n):
        if not _observe(X[i], rays[i], pixels[i], R, t, M, p, lens, r, J, a):
            out[i] = np.inf
            continue
        ra = r[0] * a[0] + r[1] * a[1] + r[2] * a[2]
        aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
        out[i] = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] - ra * ra / (1.0 + aa)
    return out


@numba.njit(cache=True, nogil=True)
def normal_equations(X, rays, pixels, weights, R, t, M, p, lens):
    """Weighted sums over the points: J^T W J (6, 6), J^T W r (6,), and J^T W W J (6, 6)."""
    H, b, H2 = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6))
    r, J, a = np.empty(3), np.empty((3, 6)), np.empty(3)
    aJ = np.empty(6)
    for i in range(len(X)):
        w = weights[i]
        if w <= 0.0 or not _observe(X[i], rays[i], pixels[i], R, t, M, p, lens, r, J, a):
            continue
        aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
        ra = r[0] * a[0] + r[1] * a[1] + r[2] * a[2]
        c = 1.0 / (1.0 + aa)
        for k in range(6):
            aJ[k] = a[0] * J[0, k] + a[1] * J[1, k] + a[2] * J[2, k]
        # W = I - c a a^T, W W = I - (2 c - c^2 aa) a a^T
        c2 = 2.0 * c - c * c * aa
        for k in range(6):
            b[k] += w * (J[0, k] * r[0] + J[1, k] * r[1] + J[2, k] * r[2] - c * aJ[k] * ra)
            for m in range(k + 1):
                JJ = J[0, k] * J[0, m] + J[1, k] * J[1, m] + J[2, k] * J[2, m]
                H[k, m] += w * (JJ - c * aJ[k] * aJ[m])
                H2[k, m] += w * w * (JJ - c2 * aJ[k] * aJ[m])
    for k in range(6):
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
def _fit(X, rays, pixels, R, t, M, p, lens, prior):
    """Gauss and Newton's method from (R, t) on a few points; whether it settled, R, t."""
    ones = np.ones(len(X))
    for _ in range(FIT_ROUNDS):
        H, b, _ = normal_equations(X, rays, pixels, ones, R, t, M, p, lens)
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
def hypotheses(X, rays, pixels, triples, R, t, M, p, lens, prior, gate, head_start):
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
    n = len(X)
    squared = misfits(X, rays, pixels, R, t, M, p, lens)
    best, best_R, best_t = head_start * np.sum(np.maximum(gate - squared, 0.0)), R, t
    needed = len(triples)
    for k in range(len(triples)):
        if k >= needed:
            break
        three = triples[k]
        if three[0] == three[1] or three[1] == three[2] or three[0] == three[2]:
            continue
        settled, R1, t1 = _fit(X[three], rays[three], pixels[three], R, t, M, p, lens, prior)
        if not settled:
            continue
        squared = misfits(X, rays, pixels, R1, t1, M, p, lens)
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
