"""Odometry calibration on simulated drives: `python -m benchmarks.wheel_calibration`."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from odometry.encoders import EncoderParameters
from odometry.motion import Motion, compose, inverse
from odometry.settings import OdometrySettings
from odometry.source import EncoderOdometry
from odometry.tick_log import TickLog
from pipeline.wheel_calibration import WheelEstimate, estimate_wheels
from simulation.route import Route
from simulation.wheels import MINIBEE_ENCODERS, WheelNoise, wheel_ticks

# What the robot believes of its wheels is wrong by this: left and right radius, track.
WRONG = (0.02, -0.02, 0.05)
PLACE = np.array([0.10, 0.06, math.radians(2.0)])
OFFSET_S = 0.035
# Of a step of the camera: m, m, rad. Features in rendered pairs err by half of this at the median.
STEP_SIGMA = np.array([0.005, 0.006, math.radians(0.12)])
SEEDS = 10
NOISES = {
    "the simulator's (22 mm, 0.67 deg after 1 m)": WheelNoise(right_error=0.0),
    "a careful robot's (4 mm, 0.22 deg after 1 m)": WheelNoise(0.002, math.radians(0.1), 0.2, 0.0),
}


def true_wheels() -> EncoderParameters:
    """The wheels as they are."""
    m = MINIBEE_ENCODERS
    left, right, track = 1.0 + np.array(WRONG)
    return replace(
        m,
        left_radius=m.left_radius * left,
        right_radius=m.right_radius * right,
        track=m.track * track,
    )


def simulated(minutes: float, seed: int, noise: WheelNoise) -> WheelEstimate:
    """Drive about at random and calibrate: ticks at 50 Hz, a camera that sees each 0.2 m."""
    rng = np.random.default_rng((seed, 5))
    route = _route(minutes, rng)
    times = np.arange(0.0, route.duration, 0.02)
    poses = route.poses(times)
    counts = wheel_ticks(poses, true_wheels(), noise, seed)
    stamps = (times * 1e9).astype(np.int64) + 10**18
    ticks = TickLog(stamps - round(OFFSET_S * 1e9), counts[:, 0], counts[:, 1])
    source = EncoderOdometry(ticks, MINIBEE_ENCODERS, OdometrySettings())
    camera = compose(poses, PLACE)
    seen = _views(poses)
    steps = compose(inverse(camera[seen[:-1]]), camera[seen[1:]])
    steps = steps + STEP_SIGMA * rng.standard_normal(steps.shape)
    motions = [
        Motion(step, np.diag(STEP_SIGMA**2), int(stamps[a]), int(stamps[b]))
        for step, a, b in zip(steps, seen[:-1], seen[1:], strict=True)
    ]
    return estimate_wheels(source.track, MINIBEE_ENCODERS, list(motions), OdometrySettings())


def errors(found: WheelEstimate) -> np.ndarray:
    """(7,) what was found less the truth: both radii and track as shares, x, y [m], yaw, time."""
    true = true_wheels()
    new = found.found.values * [
        MINIBEE_ENCODERS.left_radius,
        MINIBEE_ENCODERS.right_radius,
        *4 * [1],
    ]
    wheels = np.array([true.left_radius, true.right_radius, true.track])
    offset = found.offset.seconds - OFFSET_S if found.offset else np.nan
    return np.array([*(new[:3] / wheels - 1.0), *(new[3:] - PLACE), offset])


def doubt(found: WheelEstimate) -> np.ndarray:
    """(7,) the stated standard deviations of the same."""
    sigma = found.found.sigma.copy()
    sigma[:3] /= found.found.values[:3]
    return np.array([*sigma, found.offset.sigma if found.offset else np.nan])


def _route(minutes: float, rng: np.random.Generator) -> Route:
    """Legs of 1.6 to 3 m with turns of 20 to 100 deg either way."""
    legs = max(round(minutes * 9.5), 4)
    headings = np.cumsum(np.radians(rng.choice([-1.0, 1.0], legs) * rng.uniform(20, 100, legs)))
    lengths = rng.uniform(1.6, 3.0, legs)[:, None]
    steps = lengths * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return Route.through(np.cumsum(np.vstack([np.zeros(2), steps]), axis=0), 0.5, 0.4, 0.8)


def _views(poses: np.ndarray) -> np.ndarray:
    """Rows at which the camera looks: every 0.2 m or 15 deg, at 10 Hz."""
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    rows = [0]
    for row in range(5, len(poses), 5):
        turned = abs(poses[row, 2] - poses[rows[-1], 2])
        if travel[row] - travel[rows[-1]] >= 0.2 or turned >= math.radians(15.0):
            rows.append(row)
    return np.array(rows)


def main() -> str:
    """The section of the page."""
    lines = [
        "## Odometry calibration: `python -m benchmarks.wheel_calibration`",
        "",
        f"Radii believed wrong by {WRONG[0]:.0%} and {WRONG[1]:.0%}, the track by {WRONG[2]:.0%}, "
        f"the ticks early by {1000 * OFFSET_S:.0f} ms; {SEEDS} drives each. Worst error over "
        "them, and in brackets the RMS of error over stated sigma.",
        "",
        "| wheels' noise | minutes | radii | track | x, y [mm] | yaw [deg] | time [ms] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, noise in NOISES.items():
        for minutes in (10.0, 40.0):
            found = [simulated(minutes, seed, noise) for seed in range(SEEDS)]
            e = np.array([errors(f) for f in found])
            z = np.sqrt(np.mean((e / [doubt(f) for f in found]) ** 2, axis=0))
            worst = np.abs(e).max(axis=0)
            lines.append(
                f"| {name} | {minutes:.0f} | {100 * worst[:2].max():.2f} % ({z[:2].max():.1f}) | "
                f"{100 * worst[2]:.2f} % ({z[2]:.1f}) | "
                f"{1000 * worst[3:5].max():.1f} ({z[3:5].max():.1f}) | "
                f"{math.degrees(worst[5]):.2f} ({z[5]:.1f}) | {1000 * worst[6]:.1f} ({z[6]:.1f}) |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    print(main())
