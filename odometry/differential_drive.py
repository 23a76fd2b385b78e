"""Differential drive: wheel paths to a pose increment on exact arcs, with its covariance.

Source: Siegwart and Nourbakhsh, Introduction to Autonomous Mobile Robots (2004), Sec. 5.2.4,
with their wheel errors restated in the robot's frame (along, across, heading): independent
wheel errors large enough for the error along the path would turn the robot far more than real
robots are seen to turn. Side slip keeps the covariance from being singular.
"""

from __future__ import annotations

import math

import numpy as np

from odometry.motion import wrap_angle
from odometry.settings import OdometrySettings

# Across a gap in the ticks the path's ends are known and its shape is not.
GAP_FACTOR = 3.0


def drive(
    paths: np.ndarray,
    track: float,
    tick: np.ndarray,
    settings: OdometrySettings,
    in_gap: np.ndarray | None = None,
    lost: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Drive k arcs one after the other.

    Args:
        paths: (k, 2) signed path of the left and right wheel in each arc [m].
        track: distance between the wheels [m].
        tick: (2,) length of one count of the left and right encoder [m].
        in_gap: (k,) true for arcs that bridge a gap in the ticks: their standard deviations
            are `GAP_FACTOR` times as large, and half of travel times turn is added along and
            across, because the robot may have turned first and driven later or the other way.
        lost: (k, 2) further variance along and across [m^2] and of the heading [rad^2].

    Returns:
        The increment (x m, y m, theta rad) and its covariance (3, 3), both in the frame in
        which the robot stood before the first arc. All zero where no count changed.
    """
    left, right = paths.T
    travel = 0.5 * (np.abs(left) + np.abs(right))
    turn = (right - left) / track
    variances = step_variances(travel, turn, settings)
    if in_gap is not None and in_gap.any():
        variances[in_gap] *= GAP_FACTOR**2
        variances[in_gap, :2] += ((0.5 * travel * turn)[in_gap, None]) ** 2

    if lost is not None:
        variances += lost[:, [0, 0, 1]]

    headings = turn.cumsum() - 0.5 * turn
    chords = np.empty_like(paths)
    length = chord(0.5 * (left + right), turn)
    chords[:, 0], chords[:, 1] = length * np.cos(headings), length * np.sin(headings)
    positions = chords.cumsum(axis=0)
    end = np.array([positions[-1, 0], positions[-1, 1], turn.sum()])

    levers = positions[-1] - positions + 0.5 * chords
    J = error_at_the_end(headings, levers).reshape(3, -1)
    covariance = (J * variances.ravel()) @ J.T
    covariance += rounding_covariance(end, paths, track, tick)
    end[2] = wrap_angle(end[2])
    return end, covariance


def chord(distance: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Length of the chord of arcs of that length [m] and turn [rad]; exact at no turn too."""
    # np.sinc is sin(pi x) / (pi x), continued to 1 at 0.
    return distance * np.sinc(turn / (2.0 * math.pi))


def step_variances(travel: np.ndarray, turn: np.ndarray, settings: OdometrySettings) -> np.ndarray:
    """Variances (k, 3) along [m^2], across [m^2] and of the heading [rad^2] of k arcs.

    travel: (k,) mean path of both wheels [m], so that turning on the spot counts too.
    turn: (k,) rad.
    """
    variances = np.empty((len(travel), 3))
    variances[:, 0] = settings.along**2 * travel
    variances[:, 1] = settings.across**2 * travel
    variances[:, 2] = math.radians(settings.heading) ** 2 * travel
    variances[:, 2] += math.radians(settings.turn) ** 2 * np.abs(turn)
    return variances


def rounding_covariance(
    end: np.ndarray, paths: np.ndarray, track: float, tick: np.ndarray
) -> np.ndarray:
    """Covariance (3, 3) from counts being whole numbers.

    It belongs to the whole interval, not to each arc: the roundings of readings in between
    cancel. Each end contributes tick^2 / 12 a wheel, and a wheel whose count did not change
    contributes nothing, so that a robot at rest stays where it is.
    """
    variance = tick**2 / 6.0 * paths.any(axis=0)
    wheels = np.array([[0.5, 0.5], [0.0, 0.0], [-1.0 / track, 1.0 / track]])
    J = error_at_the_end(np.array([0.5 * end[2]]), 0.5 * end[None, :2])[:, 0] @ wheels
    return (J * variance) @ J.T


def error_at_the_end(headings: np.ndarray, levers: np.ndarray) -> np.ndarray:
    """Jacobians (3, k, 3) of the final pose by an error (along, across, heading) on the way.

    headings: (k,) rad where the error happens; levers: (k, 2) m from there to the end.
    """
    c, s = np.cos(headings), np.sin(headings)
    J = np.zeros((3, len(headings), 3))
    J[0, :, 0], J[0, :, 1], J[0, :, 2] = c, -s, -levers[:, 1]
    J[1, :, 0], J[1, :, 1], J[1, :, 2] = s, c, levers[:, 0]
    J[2, :, 2] = 1.0
    return J
