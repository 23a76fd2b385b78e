"""Wheel radii, track and the sensor's place on the robot, from wheels and a sensor's motion.

Source: Censi, Franchi, Marchionni and Oriolo, Simultaneous calibration of odometry and sensor
parameters for mobile robots, IEEE T-RO 29(2), 2013. The turns give each radius over the track by
linear least squares (their eq. 9 ff.); with the headings thus known the wheels' translations are
linear in the track, and track, place and yaw follow from a quadratic form under the constraint
cos^2 + sin^2 = 1. All six are then refined together with robust weights, which also gives their
covariance.

A stretch should be long enough for its turn and travel to be much larger than the wheels' own
noise, or that noise, standing in the regressor, makes the track come out too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from odometry.errors import OdometryError
from odometry.motion import rotation, wrap_angle
from odometry.settings import OdometrySettings
from odometry.walk import step_covariances

LEAST_STRETCHES = 12
LEAST_TURN = math.radians(20.0)  # of the stretches together, root of the sum of squares
ROUNDS = 4  # of estimating how far the stretches scatter, and steps of each
STEPS = 8
TUKEY = 4.685
# Steps of numerical derivatives, and priors about the start that keep what is not told finite:
# scales of both radii, track [m], x, y [m], yaw [rad].
DELTA = 1e-6
PRIOR = np.array([0.2, 0.2, 0.5, 1.0, 1.0, math.pi])


@dataclass(frozen=True)
class Stretches:
    """k stretches of a drive.

    wheels: (k, m, 2) path of the left and right wheel by their nominal radii in m parts of each
    [m]; sensor: (k, 3) motion of the sensor in its own frame (x m, y m, theta rad), with
    covariances (k, 3, 3).
    """

    wheels: np.ndarray
    sensor: np.ndarray
    covariances: np.ndarray


@dataclass(frozen=True)
class WheelCalibration:
    """values: (6,) left and right radius over the nominal one, track [m], x, y [m], yaw [rad] of
    the sensor on the robot; covariance (6, 6). scatter: (2,) of the translations and turns about
    the solution, over what was expected; used: stretches that were not taken as outliers.
    """

    values: np.ndarray
    covariance: np.ndarray
    scatter: np.ndarray
    used: int

    @property
    def sigma(self) -> np.ndarray:
        """(6,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def calibrate_wheels(
    stretches: Stretches, track: float, settings: OdometrySettings
) -> WheelCalibration:
    """The six numbers that make wheels and sensor tell the same.

    track: nominal one [m]; settings: how far the wheels are doubted, beside the sensor's own
    covariance; only their proportion matters.

    Raises:
        OdometryError: too few stretches, or hardly any turn in them.
    """
    turned = float(np.linalg.norm(stretches.sensor[:, 2]))
    if len(stretches.sensor) < LEAST_STRETCHES or turned < LEAST_TURN:
        raise OdometryError(
            f"{len(stretches.sensor)} stretches with {math.degrees(turned):.0f} deg of turning: "
            f"at least {LEAST_STRETCHES} and {math.degrees(LEAST_TURN):.0f} are needed: drive "
            "further, with turns both ways"
        )
    start = closed_form(stretches, track)
    expected = _expected(start, stretches, settings)
    return _refined(start, np.array([1.0, 1.0, track, *start[3:]]), stretches, expected)


def closed_form(stretches: Stretches, track: float) -> np.ndarray:
    """The six numbers by Censi's two steps, each stretch counting alike."""
    left, right = stretches.wheels.sum(axis=1).T
    turns = stretches.sensor[:, 2]
    A = np.stack([-left, right], axis=1)
    # A little pull to the nominal wheels: driving in a circle tells only one number.
    pull = 1e-6 * float(np.sum(A**2)) * np.eye(2)
    scale = np.linalg.solve(A.T @ A + pull, A.T @ turns + pull @ np.full(2, 1.0 / track))
    unit = _robot_motion(stretches.wheels, scale)  # translations for a track of 1 m
    M = np.zeros((len(turns), 2, 5))
    c, s = np.cos(turns) - 1.0, np.sin(turns)
    M[:, :, 0] = unit[:, :2]
    M[:, 0, 1], M[:, 1, 1], M[:, 0, 2], M[:, 1, 2] = c, s, -s, c
    x, y = stretches.sensor[:, 0], stretches.sensor[:, 1]
    M[:, 0, 3], M[:, 1, 3], M[:, 0, 4], M[:, 1, 4] = -x, -y, y, -x
    Q = np.einsum("kij,kil->jl", M, M)
    Q[1:3, 1:3] += 1e-9 * np.trace(Q) * np.eye(2)  # the place, where nothing turns
    # min q'Qq with |(cos, sin)| = 1: the other three eliminated, an eigenvector remains.
    K = np.linalg.solve(Q[:3, :3], Q[:3, 3:])
    direction = np.linalg.eigh(Q[3:, 3:] - Q[3:, :3] @ K)[1][:, 0]
    b, px, py = -K @ direction
    if b < 0.0:
        b, px, py, direction = -b, -px, -py, -direction
    yaw = math.atan2(direction[1], direction[0])
    return np.array([scale[0] * b, scale[1] * b, b, px, py, yaw])


def _robot_motion(wheels: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Motions (k, 3) of the robot; scale: (2,) of both wheels' paths, over the track.

    x and y are in units of the track.
    """
    left, right = scale[0] * wheels[..., 0], scale[1] * wheels[..., 1]
    turn = right - left
    heading = turn.cumsum(axis=1) - 0.5 * turn
    chord = 0.5 * (left + right) * np.sinc(turn / (2.0 * math.pi))
    x, y = np.sum(chord * np.cos(heading), axis=1), np.sum(chord * np.sin(heading), axis=1)
    return np.stack([x, y, turn.sum(axis=1)], axis=1)


def _residuals(values: np.ndarray, stretches: Stretches) -> np.ndarray:
    """(k, 3) motion of the sensor as the wheels have it, less as it was."""
    motion = _robot_motion(stretches.wheels, values[:2] / values[2])
    turn = motion[:, 2]
    px, py = values[3:5]
    c, s = np.cos(turn) - 1.0, np.sin(turn)
    moved = values[2] * motion[:, :2] + np.stack([c * px - s * py, s * px + c * py], axis=1)
    off = np.empty_like(motion)
    off[:, :2] = moved @ rotation(values[5]) - stretches.sensor[:, :2]
    off[:, 2] = wrap_angle(turn - stretches.sensor[:, 2])
    return off


def _expected(values: np.ndarray, stretches: Stretches, settings: OdometrySettings) -> np.ndarray:
    """Covariances (k, 3, 3) of the residuals: the sensor's and the wheels'."""
    motion = _robot_motion(stretches.wheels, values[:2] / values[2]) * [values[2], values[2], 1.0]
    doubt = step_covariances(motion, settings)
    # A turn of the robot moves the sensor: J of its motion by the robot's.
    J = np.zeros((len(motion), 3, 3))
    J[:, :2, :2] = rotation(values[5]).T
    c, s = np.cos(motion[:, 2]), np.sin(motion[:, 2])
    px, py = values[3:5]
    lever = np.stack([-s * px - c * py, c * px - s * py], axis=1)
    J[:, :2, 2], J[:, 2, 2] = lever @ rotation(values[5]), 1.0
    return stretches.covariances + J @ doubt @ J.transpose(0, 2, 1)


def _refined(
    values: np.ndarray, centre: np.ndarray, stretches: Stretches, expected: np.ndarray
) -> WheelCalibration:
    scatter = np.ones(2)
    A, B, used = np.eye(6), np.eye(6), 0
    for _ in range(ROUNDS):
        # An honest sigma comes from how well the stretches agree, not from what was promised.
        D = np.diag([scatter[0], scatter[0], scatter[1]])
        whiten = np.linalg.inv(np.linalg.cholesky(D @ expected @ D))
        for _ in range(STEPS):
            r = np.einsum("kij,kj->ki", whiten, _residuals(values, stretches))
            J = np.einsum("kij,kjl->kil", whiten, _jacobian(values, stretches))
            size = np.linalg.norm(r, axis=1) / math.sqrt(3.0)
            weight = np.clip(1.0 - (size / TUKEY) ** 2, 0.0, None) ** 2
            used = int(np.count_nonzero(weight))
            A = np.einsum("k,kij,kil->jl", weight, J, J) + np.diag(PRIOR**-2.0)
            off = values - centre
            off[5] = wrap_angle(off[5])
            pulls = np.einsum("k,kij,ki->kj", weight, J, r)
            B = pulls.T @ pulls
            values = values - np.linalg.solve(A, pulls.sum(axis=0) + off / PRIOR**2)
        scatter = scatter * _scatter(values, stretches, D @ expected @ D)
    values[5] = wrap_angle(values[5])
    return WheelCalibration(values, _covariance(A, B), scatter, used)


def _covariance(information: np.ndarray, pulls: np.ndarray) -> np.ndarray:
    """(6, 6): as the weights promise, widened to how far the stretches pull apart (White 1980):
    the errors along and across the path need not stand in the proportion that was expected."""
    promised = np.linalg.inv(information)
    seen = promised @ pulls @ promised
    widen = np.sqrt(np.maximum(np.diag(seen) / np.diag(promised), 1.0))
    return promised * np.outer(widen, widen)


def _scatter(values: np.ndarray, stretches: Stretches, expected: np.ndarray) -> np.ndarray:
    """(2,) how far translations and turns are off, over what is expected (robust, at least a bit).

    Medians of a chi variable with two and one degrees of freedom are 1.1774 and 0.6745.
    """
    r = _residuals(values, stretches)
    whiten = np.linalg.inv(np.linalg.cholesky(expected[:, :2, :2]))
    translation = np.linalg.norm(np.einsum("kij,kj->ki", whiten, r[:, :2]), axis=1)
    turn = np.abs(r[:, 2]) / np.sqrt(expected[:, 2, 2])
    found = np.array([np.median(translation) / 1.1774, np.median(turn) / 0.6745])
    return np.maximum(found, 1e-3)


def _jacobian(values: np.ndarray, stretches: Stretches) -> np.ndarray:
    """(k, 3, 6) by central differences."""
    J = np.empty((len(stretches.sensor), 3, 6))
    for i in range(6):
        step = np.zeros(6)
        step[i] = DELTA
        ahead, behind = _residuals(values + step, stretches), _residuals(values - step, stretches)
        J[:, :, i] = (ahead - behind) / (2.0 * DELTA)
    return J
