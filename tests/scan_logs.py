"""CARMEN logs of a small room, written line by line, for the tests that read and map them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from odometry.motion import compose, inverse

ROOM = (6.0, 4.0)  # m; the origin lies in its middle
PILLAR = (0.4, 0.4)  # m, in the middle of the room
BEAMS = 90
FIELD_OF_VIEW = math.radians(180.0)


@dataclass(frozen=True)
class Drive:
    """truth, odometry: (n, 3); stamps: n decimal strings; ranges: (n, BEAMS) m."""

    truth: np.ndarray
    odometry: np.ndarray
    stamps: list[str]
    ranges: np.ndarray

    def flaser(self, i: int) -> str:
        """The FLASER line of scan i."""
        pose = " ".join(f"{v:.6f}" for v in self.odometry[i])
        numbers = " ".join(f"{r:.4f}" for r in self.ranges[i])
        return f"FLASER {BEAMS} {numbers} {pose} {pose} {self.stamps[i]} host 0.0"

    def robotlaser(self, i: int, maximum: float = 20.0) -> str:
        """The ROBOTLASER1 line of scan i, with two remissions."""
        pose = " ".join(f"{v:.6f}" for v in self.odometry[i])
        numbers = " ".join(f"{r:.4f}" for r in self.ranges[i])
        step = FIELD_OF_VIEW / BEAMS
        return (
            f"ROBOTLASER1 0 {-FIELD_OF_VIEW / 2:.9f} {FIELD_OF_VIEW:.9f} {step:.9f} {maximum} 0.01 "
            f"0 {BEAMS} {numbers} 2 7 8 {pose} {pose} 0.3 0.1 1 1 0 {self.stamps[i]} host 0.0"
        )


def drive(n: int = 80, seed: int = 1) -> Drive:
    """Round the pillar with odometry that drifts, one scan every 0.12 m."""
    angle = np.linspace(0.0, 2.0 * math.pi, n)
    truth = np.stack([1.8 * np.sin(angle), -1.1 * np.cos(angle), angle], axis=1)
    steps = np.diff(truth[:, :2], axis=0)
    truth[:-1, 2] = np.arctan2(steps[:, 1], steps[:, 0])
    truth[-1, 2] = truth[0, 2]
    rng = np.random.default_rng(seed)
    odometry = np.zeros((n, 3))
    for i, move in enumerate(compose(inverse(truth[:-1]), truth[1:])):
        noise = rng.normal(0.0, (0.01, 0.005, math.radians(0.6)))
        odometry[i + 1] = compose(odometry[i], move + noise + (0.0, 0.0, math.radians(0.2)))
    stamps = [f"{1000 + i // 2}.{500000 * (i % 2) + 7:06d}" for i in range(n)]
    ranges = np.array([look(pose) for pose in truth]) + rng.normal(0.0, 0.01, (n, BEAMS))
    return Drive(truth, odometry, stamps, ranges)


def look(pose: np.ndarray) -> np.ndarray:
    """Ranges (BEAMS,) to the walls of the room and of the pillar in it."""
    angle = pose[2] - FIELD_OF_VIEW / 2 + np.arange(BEAMS) * (FIELD_OF_VIEW / BEAMS)
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    far = np.minimum.reduce(
        [_reach(pose[k], heading[:, k], ROOM[k] / 2) for k in range(2)]  # from the inside
    )
    near, leave = (np.full(BEAMS, v) for v in (-np.inf, np.inf))
    for k in range(2):
        with np.errstate(divide="ignore"):
            a, b = ((s * PILLAR[k] / 2 - pose[k]) / heading[:, k] for s in (-1, 1))
        near, leave = np.maximum(near, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
    return np.where((near > 0) & (near < leave), np.minimum(near, far), far)


def _reach(at: float, along: np.ndarray, wall: float) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.where(along > 0, (wall - at) / along, (-wall - at) / along)


def write_log(path: Path, lines: list[str]) -> Path:
    """The lines as a log with the head that CARMEN writes."""
    head = [
        "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
        "PARAM robot_frontlaser_offset 0.0 nohost 0",
    ]
    path.write_text("\n".join([*head, *lines]) + "\n")
    return path
