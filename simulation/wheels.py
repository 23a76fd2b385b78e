"""Wheel encoders of a differential drive that slips: true motion in, wrapping ticks out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from odometry.encoders import EncoderParameters

TICKS_PURPOSE = 2  # keys of the random generator: (seed, purpose)


# The minibee robot: what it believes of its own wheels.
MINIBEE_ENCODERS = EncoderParameters(
    ticks_per_revolution=2000, left_radius=0.075, right_radius=0.075, track=0.30, counter_bits=16
)


@dataclass(frozen=True)
class WheelNoise:
    """How the wheels betray the robot.

    along m and turn rad: standard deviations after `step` m of driving, growing as a random walk;
    right_error: true right radius over the nominal one, minus 1.
    """

    along: float = 0.010
    turn: float = math.radians(0.3)
    step: float = 0.2
    right_error: float = 0.002


def wheel_ticks(
    poses: np.ndarray, encoders: EncoderParameters, noise: WheelNoise, seed: int
) -> np.ndarray:
    """Counters (n, 2) int64, left and right, read at the true `poses` (n, 3).

    The headings must be continuous (not wrapped) and the robot must drive forward; the motion
    between two readings is taken as an arc. The counters begin at 0 and wrap, unsigned.
    """
    poses = np.asarray(poses, float)
    turn = np.diff(poses[:, 2])
    along = np.hypot(*np.diff(poses[:, :2], axis=0).T) / np.sinc(0.5 * turn / math.pi)
    chance = np.random.default_rng((seed, TICKS_PURPOSE)).standard_normal((len(along), 2)).T
    spread = np.sqrt(along / noise.step)
    along = along + noise.along * spread * chance[0]
    turn = turn + noise.turn * spread * chance[1]
    half = 0.5 * encoders.track * turn
    per_tick = encoders.metres_per_tick * (1.0, 1.0 + noise.right_error)
    counts = np.cumsum(np.stack([along - half, along + half], axis=1) / per_tick, axis=0)
    ticks = np.rint(np.concatenate([np.zeros((1, 2)), counts])).astype(np.int64)
    return ticks % (1 << encoders.counter_bits)
