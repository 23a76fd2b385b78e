"""How far a path is from the true one: ATE, relative pose error, heading error, length.

Sources: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems (2012), for both
errors; the closed-form alignment is Umeyama's (1991) in the plane, without scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from odometry.motion import compose, inverse, wrap_angle
from pipeline.errors import InputError
from pipeline.trajectory import Trajectory, distance_travelled, read_tum

# The reference answers at a stamp this close to one of its own, or between two of its poses
# no further apart than LONGEST_INTERVAL_NS.
TOLERANCE_NS = 10_000_000
LONGEST_INTERVAL_NS = 1_000_000_000

SEGMENT_M = 1.0


@dataclass(frozen=True)
class PathScore:
    """Errors of an estimated path; lengths in metres, angles in radians.

    ate_*: distance from the reference after SE(2) alignment. heading_rmse: after the same
    alignment. relative_*: RMS error of the motion between a pose and the first one at least
    1 m further along the reference; NaN where it is shorter than that. *_length: over the
    matched poses.
    """

    poses: int
    matched: int
    ate_rmse: float
    ate_mean: float
    ate_median: float
    ate_max: float
    heading_rmse: float
    relative_translation: float
    relative_rotation: float
    relative_segments: int
    length: float
    reference_length: float


def evaluate_path_files(estimate: str | Path, reference: str | Path) -> PathScore:
    """Compare two TUM files.

    Raises:
        InputError: a file cannot be read, or fewer than two poses match.
    """
    paths = read_tum(Path(estimate)), read_tum(Path(reference))
    matched = match(*paths)
    if matched[0].size < 2:
        spans = " and ".join(
            f"{name} ({_span(path)})"
            for name, path in zip((estimate, reference), paths, strict=True)
        )
        raise InputError(
            f"{spans}: {matched[0].size} poses match in time, 2 are needed (within "
            f"{TOLERANCE_NS / 1e9:g} s of a reference pose, or between two no further than "
            f"{LONGEST_INTERVAL_NS / 1e9:g} s apart): give paths of the same recording"
        )
    return evaluate_path(*paths)


def evaluate_path(estimate: Trajectory, reference: Trajectory) -> PathScore:
    """Compare an estimated path with the true one; at least two poses must match."""
    index, true = match(estimate, reference)
    found = estimate.poses[index]
    aligned = compose(align(found, true), found)
    distance = np.hypot(*(aligned - true)[:, :2].T)
    heading = wrap_angle(aligned[:, 2] - true[:, 2])
    translation, rotation = relative_errors(found, true)
    return PathScore(
        poses=len(estimate),
        matched=len(index),
        ate_rmse=_rms(distance),
        ate_mean=float(distance.mean()),
        ate_median=float(np.median(distance)),
        ate_max=float(distance.max()),
        heading_rmse=_rms(heading),
        relative_translation=_rms(translation),
        relative_rotation=_rms(rotation),
        relative_segments=len(translation),
        length=float(distance_travelled(found)[-1]),
        reference_length=float(distance_travelled(true)[-1]),
    )


def match(estimate: Trajectory, reference: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Which poses of the estimate (m,) the reference can answer, and its poses there (m, 3).

    The reference is interpolated; beyond its ends and in its gaps the nearest pose answers
    within the tolerance.
    """
    order = np.argsort(reference.stamps, kind="stable")
    stamps, poses = reference.stamps[order], reference.poses[order]
    after = np.clip(np.searchsorted(stamps, estimate.stamps), 1, max(len(stamps) - 1, 1))
    before, after = after - 1, np.minimum(after, len(stamps) - 1)
    since, until = estimate.stamps - stamps[before], stamps[after] - estimate.stamps
    interval = np.maximum(since + until, 1)

    between = (since >= 0) & (until >= 0) & (interval <= LONGEST_INTERVAL_NS)
    near = np.minimum(np.abs(since), np.abs(until)) <= TOLERANCE_NS
    nearest = (np.abs(until) < np.abs(since)).astype(float)
    share = np.where(between, since / interval, nearest)[:, None]
    step = poses[after] - poses[before]
    step[:, 2] = wrap_angle(step[:, 2])
    index = np.flatnonzero(between | near)
    return index, (poses[before] + share * step)[index]


def align(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """The rigid motion (3,) that carries poses (n, 3) closest to their true positions."""
    a = found[:, :2] - found[:, :2].mean(axis=0)
    b = true[:, :2] - true[:, :2].mean(axis=0)
    cross = np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    angle = math.atan2(cross, np.sum(a * b))
    turned = compose(np.array([0.0, 0.0, angle]), np.append(found[:, :2].mean(axis=0), 0.0))
    return np.append(true[:, :2].mean(axis=0) - turned[:2], angle)


def relative_errors(found: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (k,) in metres and radians of the motion over each `SEGMENT_M` of true path."""
    travelled = distance_travelled(true)
    end = np.searchsorted(travelled, travelled + SEGMENT_M)
    begin = np.flatnonzero(end < len(true))
    end = end[begin]
    motions = [compose(inverse(poses[begin]), poses[end]) for poses in (true, found)]
    error = compose(inverse(motions[0]), motions[1])
    return np.hypot(error[:, 0], error[:, 1]), error[:, 2]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def _span(path: Trajectory) -> str:
    return f"{path.stamps.min() / 1e9:.3f} to {path.stamps.max() / 1e9:.3f} s"
