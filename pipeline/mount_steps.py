"""Steps of a recording in which wheels and cameras both tell how the robot moved."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from odometry.motion import Motion
from odometry.source import MotionSource
from pipeline.frontend import ahead, damage_of
from pipeline.recordings.base import DamagedFrameError, RecordedPair, Recording
from stereo.disparity import SUBPIXEL, DisparityMatcher
from stereo.errors import StereoError
from stereo.floor_motion import Features, find_features, motion_between
from stereo.rectify import Rectifier

# A step ends when the robot has moved so far [m, rad]; one much longer shows nothing twice.
STEP = (0.12, math.radians(8.0))
LONGEST = (0.6, math.radians(35.0))
# So many of the steps that turn most, which tell the place, and as many spread over the rest.
TURNING = 100
SPREAD = 100
UNFIT = "damaged or unfit image"


@dataclass(frozen=True)
class Steps:
    """wheels, camera: (k, 3) increments x m, y m, theta rad of the robot and of the camera's foot
    on the floor; covariances: (k, 2, 2) of the difference of their translations [m^2]."""

    wheels: np.ndarray
    camera: np.ndarray
    covariances: np.ndarray


@dataclass(frozen=True)
class _Step:
    first: RecordedPair
    last: RecordedPair
    motion: Motion


def camera_steps(
    recording: Recording,
    source: MotionSource,
    rectify: Rectifier,
    match: DisparityMatcher,
    scale: Callable[[np.ndarray], np.ndarray],
    progress: Callable[[int, int], None],
) -> Steps:
    """The steps of a recording that both tell.

    rectify: from a rig whose mount has the true height, pitch and roll, and no yaw, x and y;
    scale: brings a raw image to that rig's size.
    """
    chosen = _chosen(_wheel_steps(recording, source))
    files = {pair.stamp: pair for step in chosen for pair in (step.first, step.last)}
    seen: dict[int, Features] = {}
    looked = looked_at(recording, list(files.values()), rectify, match, scale)
    for done, (pair, found) in enumerate(looked, start=1):
        progress(done, len(files))
        if found is not None:
            seen[pair.stamp] = found
    wheels, camera, covariances = [], [], []
    for step in chosen:
        before, after = seen.get(step.first.stamp), seen.get(step.last.stamp)
        if before is None or after is None:
            continue
        motion = motion_between(before, after, rectify.camera)
        if motion is not None:
            wheels.append(step.motion.increment)
            camera.append(motion.increment)
            covariances.append(step.motion.covariance[:2, :2] + motion.covariance[:2, :2])
    shape = (len(wheels), 3)
    return Steps(
        np.reshape(wheels, shape), np.reshape(camera, shape), np.reshape(covariances, (-1, 2, 2))
    )


def looked_at(
    recording: Recording,
    pairs: list[RecordedPair],
    rectify: Rectifier,
    match: DisparityMatcher,
    scale: Callable[[np.ndarray], np.ndarray],
) -> Iterator[tuple[RecordedPair, Features | None]]:
    """Each pair with its features; None, counted and named, where it cannot be used."""

    def features(pair: RecordedPair) -> Features | ValueError:
        try:
            loaded = pair.load()
            left, right = rectify(scale(loaded.left), scale(loaded.right))
            disparity = match(left, right).astype(np.float32) / SUBPIXEL
            return find_features(left, disparity, rectify.camera)
        except (DamagedFrameError, StereoError) as error:
            return error
        except cv2.error as error:
            return DamagedFrameError(damage_of(pair, error))

    for pair, found in ahead(pairs, features, os.cpu_count() or 1):
        if not isinstance(found, Features):
            skip_unfit(recording, found)
        yield pair, found if isinstance(found, Features) else None


def skip_unfit(recording: Recording, error: ValueError) -> None:
    """Count and name an image that cannot be used, once however often it was met."""
    if str(error) not in recording.skipped.get(UNFIT, []):
        recording.skip(UNFIT, [str(error)])


def _wheel_steps(recording: Recording, source: MotionSource) -> list[_Step]:
    """Consecutive steps of about `STEP`, by the wheels."""
    steps: list[_Step] = []
    first: RecordedPair | None = None
    motion = Motion.none(0)
    for pair in recording.pairs:
        increment = source.until(pair.stamp)
        if increment is None:
            continue
        if first is None:
            first = pair
            continue
        motion = motion.then(increment)
        size = (math.hypot(*motion.increment[:2]), abs(motion.increment[2]))
        if size[0] < STEP[0] and size[1] < STEP[1]:
            continue
        if size[0] <= LONGEST[0] and size[1] <= LONGEST[1]:
            steps.append(_Step(first, pair, motion))
        first, motion = pair, Motion.none(pair.stamp)
    return steps


def _chosen(steps: list[_Step]) -> list[_Step]:
    """Those that turn most and, spread evenly, some of the others; in order of time."""
    turns = np.array([abs(step.motion.increment[2]) for step in steps])
    order = np.argsort(-turns, kind="stable")
    rest = np.sort(order[TURNING:])
    if len(rest) > SPREAD:
        rest = rest[np.linspace(0, len(rest) - 1, SPREAD).round().astype(int)]
    return [steps[i] for i in np.sort(np.concatenate([order[:TURNING], rest]))]
