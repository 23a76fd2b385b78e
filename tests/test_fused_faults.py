"""Wheels and images damaged in turn: the path by both stays what it is when both are sound."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from odometry.encoders import unwrap_counts
from odometry.motion import Motion, compose
from odometry.source import EncoderOdometry
from odometry.tick_log import TickLog
from pipeline.evaluate_path import align
from pipeline.fused_motion import FusedMotion
from pipeline.motion import looking
from pipeline.motion_told import told
from pipeline.recordings import open_recording
from pipeline.recordings.base import Recording
from pipeline.settings import Settings
from stereo.pair import StereoPair
from stereo.tracking import Pyramids

HEALTHY = 0.01  # m: path error over the piece's 6.4 m
Counts = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def recording(office_piece) -> Recording:
    return open_recording(office_piece)


def looking_at(recording: Recording, ticks: TickLog) -> FusedMotion:
    """Motion from the images and these ticks."""
    assert recording.rig is not None
    assert recording.encoders is not None
    wheels = EncoderOdometry(ticks, recording.encoders, Settings().odometry)
    motion = looking(recording.rig, wheels, Settings(), 1)
    assert isinstance(motion, FusedMotion)
    return motion


@pytest.fixture(scope="module")
def pairs(recording) -> list[StereoPair]:
    return [files.load() for files in recording.pairs]


@pytest.fixture(scope="module")
def seen(recording, pairs) -> list[Pyramids]:
    motion = looking_at(recording, recording.ticks)
    return [motion.prepare(pair) for pair in pairs]


def damaged(ticks: TickLog, change: Counts) -> TickLog:
    """Ticks whose continuous counts (n,), (n,) and stamps (n,) are changed."""
    counts = [unwrap_counts(side, 16).astype(float) for side in (ticks.left, ticks.right)]
    stamps, left, right = change(ticks.stamps, *counts)
    sides = [np.round(side).astype(np.int64) % 65536 for side in (left, right)]
    return TickLog(stamps, sides[0], sides[1])


def drive(motion: FusedMotion, pairs: list[StereoPair], seen: list[Pyramids | None]):
    return [motion.step(p.stamp, pyramids) for p, pyramids in zip(pairs, seen, strict=True)]


def path_error(recording: Recording, motions: list[Motion | None]) -> float:
    """ATE [m] of the chained motions; every stamp from the first answered on has one."""
    pose, path, stamps = np.zeros(3), [], []
    for motion in motions:
        if motion is not None:
            pose = compose(pose, motion.increment)
            path.append(pose)
            stamps.append(motion.last)
    assert recording.poses is not None
    places = dict(zip(recording.poses.stamps.tolist(), recording.poses.poses, strict=True))
    found, true = np.array(path), np.array([places[stamp] for stamp in stamps])
    off = compose(align(found, true), found)[:, :2] - true[:, :2]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def frozen(first: float, last: float) -> Counts:
    """Counters that stand still for a share of the time."""

    def change(stamps, left, right):
        at = np.linspace(0.0, 1.0, len(stamps))
        still = (at > first) & (at < last)
        steps = [np.where(still, 0, np.diff(side, prepend=0)) for side in (left, right)]
        return stamps, np.cumsum(steps[0]), np.cumsum(steps[1])

    return change


def without(first: float, last: float) -> Counts:
    """Readings that are missing for a share of the time."""

    def change(stamps, left, right):
        at = np.linspace(0.0, 1.0, len(stamps))
        kept = (at <= first) | (at >= last)
        return stamps[kept], left[kept], right[kept]

    return change


def garbage(stamps, left, right):
    rng = np.random.default_rng(1)
    return stamps, rng.integers(0, 65536, len(left)), rng.integers(0, 65536, len(left))


DISAGREED, SILENT = "wheels disagreed with the images in", "the wheels reported nothing in"
WHEELS: dict[str, tuple[Counts, str]] = {
    "left wheel 3 % too large": (lambda t, a, b: (t, 1.03 * a, b), ""),
    "both twice too large": (lambda t, a, b: (t, 2.0 * a, 2.0 * b), "the wheels count 2 times"),
    "a quarter": (lambda t, a, b: (t, a / 4.0, b / 4.0), "the wheels count 4 times too little"),
    "ten times": (lambda t, a, b: (t, 10.0 * a, 10.0 * b), "the wheels count 10 times too much"),
    "both reversed": (lambda t, a, b: (t, -a, -b), "both wheels count backwards"),
    "left reversed": (lambda t, a, b: (t, -a, b), "the left wheel is reversed"),
    "right reversed": (lambda t, a, b: (t, a, -b), "the right wheel is reversed"),
    "exchanged": (lambda t, a, b: (t, b, a), "left and right wheel are exchanged, as"),
    "increments": (
        lambda t, a, b: (t, np.diff(a, prepend=a[0]), np.diff(b, prepend=b[0])),
        "the counts are those since the line before",
    ),
    "right unplugged": (lambda t, a, b: (t, a, 0 * b), DISAGREED),
    "stuck in the middle": (frozen(0.3, 0.7), DISAGREED),
    "garbage": (garbage, DISAGREED),
    "a table that begins late": (without(-1.0, 0.5), SILENT),
    "a table that ends early": (without(0.5, 2.0), SILENT),
    "of another day": (lambda t, a, b: (t + 10**14, a, b), SILENT),
}


@pytest.mark.parametrize("fault", WHEELS)
def test_where_the_wheels_fail_the_images_do(recording, pairs, seen, fault):
    change, line = WHEELS[fault]
    motion = looking_at(recording, damaged(recording.ticks, change))
    motions = drive(motion, pairs, seen)
    assert None not in motions
    assert path_error(recording, motions) < HEALTHY
    lines = [finding.line for finding in told(motion, pairs[0].stamp)]
    assert any(text.startswith(line) for text in lines) or not line, lines


def dark(pair: StereoPair) -> StereoPair:
    return replace(pair, left=np.full_like(pair.left, 8), right=np.full_like(pair.right, 8))


def covered(pair: StereoPair) -> StereoPair:
    return replace(pair, right=np.full_like(pair.right, 8))


@pytest.mark.parametrize(
    ("fault", "which"),
    [
        (dark, range(6)),
        (dark, range(34, 40)),
        (dark, range(0, 40, 2)),
        (covered, range(0, 40, 2)),
        (covered, range(15, 21)),
        (None, range(15, 21)),
        (None, range(0, 40, 3)),
    ],
)
def test_where_the_images_fail_the_wheels_do(recording, pairs, seen, fault, which):
    motion = looking_at(recording, recording.ticks)
    shown: list[Pyramids | None] = list(seen)
    for number in which:
        shown[number] = motion.prepare(fault(pairs[number])) if fault else None
    motions = drive(motion, pairs, shown)
    assert None not in motions
    assert path_error(recording, motions) < 3.0 * HEALTHY
    counts = motion.counts
    # Pairs that can be read count, whatever came before them.
    assert counts["wheels_alone"] <= len(which) + 1
    assert counts["fused"] >= 39 - len(which) - 2
    if fault is not covered:  # the left image alone shows a motion while its key frame lasts
        assert counts["wheels_alone"] >= len(which) - 1
        lines = [finding.line for finding in told(motion, pairs[0].stamp)]
        assert any("the images did not show the motion in" in text for text in lines)


def test_a_camera_that_sends_its_last_image_again_is_no_robot_that_stands(recording, pairs, seen):
    motion = looking_at(recording, recording.ticks)
    shown = [*seen[:10], *[seen[9]] * 10, *seen[20:]]
    motions = drive(motion, pairs, shown)
    assert path_error(recording, motions) < 3.0 * HEALTHY
    assert motion.counts["images_frozen"] >= 8
    assert any("sent the same images again" in f.line for f in told(motion, pairs[0].stamp))


def test_errors_that_wheels_always_make_are_learnt(recording, pairs, seen):
    motion = looking_at(
        recording, damaged(recording.ticks, lambda t, a, b: (t, 1.03 * a, 1.03 * b))
    )
    drive(motion, pairs, seen)
    errors = motion.wheel_errors()
    assert errors.value[0] == pytest.approx(0.03, abs=3.0 * errors.error[0])
    assert abs(errors.value[2]) < math.radians(1.5)
