"""Where a camera sits on a robot that drives in the plane, from both of their motions.

The robot moves by M (wheels), its camera by C (what it sees), and X, the camera's place on the
robot, makes both tell the same: M X = X C, that is, with p = (x, y) and yaw psi,

    s t_M + (R(theta) - I) p = R(psi) t_C

for each step. The turn theta is the camera's own: it sees turns better than wheels feel them.
s is the wheels' scale, which wrong radii change; it is estimated with a prior so that it neither
spoils the place nor hides. Straight driving tells psi, turning tells p.
(Planar case of hand-eye calibration; cf. Censi, Franchi, Marchionni and Oriolo 2013.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.errors import CalibrationError

LEAST_STEPS = 8
SCALE_SIGMA = 0.05  # prior of the wheels' scale about 1
# Priors about the first guess that keep an unseen direction finite: m, rad.
PLACE_SIGMA = 1.0
YAW_SIGMA = math.pi
STEPS = 30
TUKEY = 4.685


@dataclass(frozen=True)
class HandEye:
    """x, y [m], yaw [rad] of the camera on the robot with their standard deviations.

    scale: true over believed distance of the wheels, and its standard deviation; steps used.
    """

    x: float
    y: float
    yaw: float
    sigma: np.ndarray  # (3,) of x, y, yaw
    scale: float
    scale_sigma: float
    steps: int


def solve_hand_eye(
    wheels: np.ndarray,
    camera: np.ndarray,
    covariances: np.ndarray,
    start: tuple[float, float, float],
) -> HandEye:
    """The place from k steps.

    wheels, camera: (k, 3) increments (x m, y m, theta rad) of robot and camera; covariances:
    (k, 2, 2) [m^2] of the two translations' difference; start: x, y, yaw to begin with, which
    stay where nothing is told of them (then with a large sigma).

    Raises:
        CalibrationError: fewer than eight steps.
    """
    if len(wheels) < LEAST_STEPS:
        raise CalibrationError(
            f"only {len(wheels)} steps with motion of both wheels and camera: at least "
            f"{LEAST_STEPS} are needed: drive further, past things to see"
        )
    moved = _bent(wheels, camera[:, 2])
    whiten = np.linalg.inv(np.linalg.cholesky(covariances))
    prior_sigma = np.array([PLACE_SIGMA, PLACE_SIGMA, YAW_SIGMA, SCALE_SIGMA])
    x0 = np.array([*start[:2], _direction(moved, camera), 1.0])
    centre = np.array([*start, 1.0])
    x, A, spread, used = x0, np.eye(4), 1.0, 0
    for _ in range(STEPS):
        r, J = _residuals(x, moved, camera)
        r, J = np.einsum("kij,kj->ki", whiten, r), np.einsum("kij,kjl->kil", whiten, J)
        size = np.linalg.norm(r, axis=1)
        spread = max(float(np.median(size)) / 1.1774, 1e-9)  # the median of a Rayleigh variable
        weight = np.clip(1.0 - (size / (TUKEY * spread)) ** 2, 0.0, None) ** 2
        used = int(np.sum(weight > 0))
        # An honest sigma comes from how well the steps agree, not from what was promised.
        A = np.einsum("k,kij,kil->jl", weight, J, J) / max(spread, 1.0) ** 2
        b = np.einsum("k,kij,ki->j", weight, J, r) / max(spread, 1.0) ** 2
        A += np.diag(prior_sigma**-2.0)
        off = x - centre
        off[2] = (off[2] + math.pi) % (2.0 * math.pi) - math.pi
        step = -np.linalg.solve(A, b + off / prior_sigma**2)
        x = x + step
        if abs(step).max() < 1e-8:
            break
    sigma = np.sqrt(np.diag(np.linalg.inv(A)))
    yaw = (x[2] + math.pi) % (2.0 * math.pi) - math.pi
    return HandEye(
        float(x[0]), float(x[1]), float(yaw), sigma[:3], float(x[3]), float(sigma[3]), used
    )


def _bent(wheels: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """The wheels' translations (k, 2) along arcs with the turns that the camera saw."""
    half = 0.5 * (turns - wheels[:, 2])
    c, s = np.cos(half), np.sin(half)
    x, y = wheels[:, 0], wheels[:, 1]
    return np.column_stack([c * x - s * y, s * x + c * y])


def _direction(moved: np.ndarray, camera: np.ndarray) -> float:
    """First guess of the yaw, from the straightest half of the steps."""
    straight = abs(camera[:, 2]) <= np.median(abs(camera[:, 2]))
    robot, eye = (t[straight, 0] + 1j * t[straight, 1] for t in (moved, camera))
    return float(np.angle(np.sum(robot * np.conj(eye))))


def _residuals(
    x: np.ndarray, moved: np.ndarray, camera: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """s t_M + (R(theta) - I) p - R(psi) t_C (k, 2) and its Jacobian (k, 2, 4)."""
    px, py, yaw, scale = x
    c, s = np.cos(camera[:, 2]) - 1.0, np.sin(camera[:, 2])
    cy, sy = math.cos(yaw), math.sin(yaw)
    seen = camera[:, :2] @ np.array([[cy, sy], [-sy, cy]])
    r = scale * moved + np.column_stack([c * px - s * py, s * px + c * py]) - seen
    J = np.empty((len(moved), 2, 4))
    J[:, 0, 0], J[:, 1, 0] = c, s
    J[:, 0, 1], J[:, 1, 1] = -s, c
    J[:, 0, 2], J[:, 1, 2] = seen[:, 1], -seen[:, 0]
    J[:, :, 3] = moved
    return r, J
