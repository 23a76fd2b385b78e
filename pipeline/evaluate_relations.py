"""How far a path is from hand-made relations between places: Kuemmerle's metric.

Source: Kuemmerle et al., On measuring the accuracy of SLAM algorithms, Autonomous Robots 27
(2009): a relation is the true pose of the robot at one time, seen from its pose at another. The
error of a path in it is the motion between the true relative pose and the path's own; its length
and its absolute turn are averaged over all relations. No alignment is needed, and an error at
one place does not count again all the way after it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from odometry.motion import compose, inverse
from pipeline.errors import InputError
from pipeline.textfiles import read_lines
from pipeline.trajectory import Trajectory, read_tum, seconds_to_ns


@dataclass(frozen=True)
class Relations:
    """True relative poses.

    stamps: (n, 2) int64 ns; poses: (n, 3) of the second in the frame of the first (x m, y m,
    theta rad); names: the two times of each as they stand in the file; damaged: lines passed over.
    """

    stamps: np.ndarray
    poses: np.ndarray
    names: list[str]
    damaged: list[str]


@dataclass(frozen=True)
class RelationScore:
    """Mean and standard deviation of the translation [m] and the absolute rotation [rad].

    missing: the two times of each relation whose stamps the path does not hold.
    """

    relations: int
    missing: list[str]
    damaged: list[str]
    translation: float
    translation_sd: float
    translation_max: float
    rotation: float
    rotation_sd: float
    rotation_max: float

    @property
    def scored(self) -> int:
        """Relations that were scored."""
        return self.relations - len(self.missing)


def read_relations(path: Path) -> Relations:
    """Read lines `t1 t2 x y z roll pitch yaw`; z, roll and pitch are passed over.

    Raises:
        InputError: the file cannot be read or holds no relation.
    """
    stamps, poses, names, damaged = [], [], [], []
    for number, line in enumerate(read_lines(path), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            if len(fields) != 8:
                raise ValueError
            pair = seconds_to_ns(fields[0]), seconds_to_ns(fields[1])
            x, y, _, _, _, yaw = (float(v) for v in fields[2:])
            if not all(map(math.isfinite, (x, y, yaw))):
                raise ValueError
        except ValueError:
            damaged.append(f"line {number}")
            continue
        stamps.append(pair)
        poses.append((x, y, yaw))
        names.append(f"{fields[0]} {fields[1]}")
    if not stamps:
        raise InputError(
            f"{path}: holds no relation: expected lines 't1 t2 x y z roll pitch yaw'"
            + (f" ({len(damaged)} others, the first {damaged[0]})" if damaged else "")
        )
    return Relations(np.array(stamps, np.int64), np.array(poses, float), names, damaged)


def evaluate_relation_files(estimate: str | Path, relations: str | Path) -> RelationScore:
    """Score a TUM file by a relations file.

    Raises:
        InputError: a file cannot be read, or they have no time in common.
    """
    path, truth = read_tum(Path(estimate)), read_relations(Path(relations))
    score = evaluate_relations(path, truth)
    if not score.scored:
        raise InputError(
            f"{estimate}: holds the times of none of the {score.relations} relations of "
            f"{relations} (the first: {truth.names[0]}): give the path of the same log, with the "
            "log's own stamps"
        )
    return score


def evaluate_relations(path: Trajectory, truth: Relations) -> RelationScore:
    """Score a path; relations are found by their exact stamps, the first where one repeats."""
    stamps, first = np.unique(path.stamps, return_index=True)
    place = np.minimum(np.searchsorted(stamps, truth.stamps), len(stamps) - 1)
    found = (stamps[place] == truth.stamps).all(axis=1)
    begin, end = first[place[found]].T
    estimated = compose(inverse(path.poses[begin]), path.poses[end])
    error = compose(inverse(truth.poses[found]), estimated)
    translation, rotation = np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])
    return RelationScore(
        len(found),
        [name for name, hit in zip(truth.names, found, strict=True) if not hit],
        truth.damaged,
        *_statistics(translation),
        *_statistics(rotation),
    )


def _statistics(errors: np.ndarray) -> tuple[float, float, float]:
    """Mean, standard deviation and largest; NaN of nothing."""
    if not errors.size:
        return math.nan, math.nan, math.nan
    return float(errors.mean()), float(errors.std()), float(errors.max())
