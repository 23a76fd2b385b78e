"""Whether the covariances of motion are true: errors normalised by them, over short and long spans.

The normalised estimation error squared (NEES; Bar-Shalom, Li and Kirubarajan 2001, Sec. 5.4) of a
motion of three coordinates is 3 on average when its covariance is true. Steps are joined by
`Motion.then`, as if their errors were independent: spans show whether they are.

    python -m benchmarks.consistency [--motion visual --motion fused] [RECORDING ...]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.rendered import cache
from benchmarks.report import OFFICE
from benchmarks.stereo_end_to_end import OPTIONS
from mapping.mapper import HierarchicalMapper
from odometry.motion import Motion, compose, inverse, wrap_angle
from pipeline.experiments.report import machine, markdown_table
from pipeline.fused_motion import FusedMotion
from pipeline.job import recording_job
from pipeline.motion import motion_of
from pipeline.recordings import open_recording
from pipeline.recordings.base import Recording
from pipeline.settings import Settings
from pipeline.visual_motion import VisualMotion
from stereo.scan import RangeScan

FACTOR = 1.5  # of the dimension, within which the mean must be
ROOMS = ("office", "clutter", "corridor", "glass")
STREET = Path("recordings/kitti-street")
# The truth of the street turns by the same angle in each of its first steps, as if interpolated,
# and the direction of travel differs from the camera's by a constant quarter of a degree.
STREET_SKIP = 12
HEADER = ("recording", "motion", "step", "1 s", "5 s", "20 steps", "standard deviation over error")
MAPPED_HEADER = (
    *("recording", "matched: step", "5 steps", "20 steps"),
    *("pose served", "standard deviation over error"),
)
BEGINNINGS = (0.0, 0.25, 0.5)  # as a share of the recording


def main(arguments: Sequence[str] = ()) -> str:
    """Measure; the section as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--motion", action="append", choices=("encoders", "visual", "fused"))
    given = parser.parse_args(list(arguments))
    cv2.setNumThreads(1)
    rows, mapped = [], []
    for path in given.recordings or _recordings():
        recording = open_recording(path)
        wheels = recording.ticks is not None or recording.odometry is not None
        for choice in given.motion or ("visual", "fused"):
            if choice == "visual" or wheels:
                rows += _rows(recording, choice)
        mapped.append([recording.path.name, *_mapped(recording)])
    return "\n\n".join(
        [
            "## Covariances of motion: `python -m benchmarks.consistency`",
            f"{machine()}. Mean normalised squared error of the motion fed to the mapper, default "
            f"settings; 3 is right, {3 / FACTOR:g} to {3 * FACTOR:g} asked for. Last column: x, y, "
            "heading of one step, root mean squares.",
            markdown_table(HEADER, rows),
            "The same after scan matching (observation to observation), and of the pose served: "
            "its error from where a run begins, where local maps close, over runs begun at "
            f"{len(BEGINNINGS)} places; standard deviations of x, y, heading, root mean squares.",
            markdown_table(MAPPED_HEADER, mapped),
        ]
    )


def nees(
    motions: Sequence[Motion], truth: np.ndarray, count: int
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mean normalised squared error of `count` consecutive steps joined, over all such spans.

    Args:
        motions: (n,) of steps; truth: (n + 1, 3) poses, of their ends.

    Returns:
        NaN without a span; root mean square of the errors and of their standard deviations, (3,) m,
        m, rad.
    """
    squared, errors, variances = [], [], []
    for first in range(0, len(motions) - count + 1, max(1, count // 4)):
        motion = motions[first]
        for step in motions[first + 1 : first + count]:
            motion = motion.then(step)
        error = motion.increment - compose(inverse(truth[first]), truth[first + count])
        error[2] = wrap_angle(error[2])
        if motion.covariance.any():
            squared.append(error @ np.linalg.solve(motion.covariance, error))
        errors.append(error)
        variances.append(np.diag(motion.covariance))
    if not squared:
        return float("nan"), np.full(3, np.nan), np.full(3, np.nan)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    return float(np.mean(squared)), rms, np.sqrt(np.mean(variances, axis=0))


def motions_of(recording: Recording, choice: str) -> tuple[list[Motion], np.ndarray]:
    """Steps (n,) of a motion by default settings, and the true poses (n + 1, 3) of their ends."""
    assert recording.rig is not None
    source = motion_of(choice, recording, recording.rig, Settings(), seed=1)
    motions = []
    for files in recording.pairs:
        if isinstance(source, VisualMotion | FusedMotion):
            motions.append(source.step(files.stamp, source.prepare(files.load())))
        else:
            motions.append(source.until(files.stamp))
    known = [motion for motion in motions if motion is not None]
    return known[1:], _true_poses(recording, [motion.last for motion in known])


def _true_poses(recording: Recording, stamps: Sequence[int]) -> np.ndarray:
    """True poses (n, 3) at the stamps (n,) [ns]."""
    assert recording.poses is not None, f"{recording.path}: holds no truth"
    poses = recording.poses.poses.copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    truth = [np.interp(stamps, recording.poses.stamps, column) for column in poses.T]
    return np.column_stack(truth)


class Watched(HierarchicalMapper):
    """Keeps the matched motions, and the poses served where local maps closed."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings.mapping, seed=1)
        self.matched: list[Motion] = []
        self.served: list[Motion] = []

    def observe(self, scan: RangeScan) -> None:
        """As the mapper; between two closings matched motion adds up in the local mapper."""
        closed, before = len(self.filter.health), self.local_mapper.move

        def move(motion: Motion) -> None:
            self.matched.append(motion)
            before(motion)

        self.local_mapper.move = move  # pyright: ignore[reportAttributeAccessIssue]
        super().observe(scan)
        del self.local_mapper.move
        if len(self.filter.health) > closed:
            stamp = self.stamps[-1]
            self.served.append(Motion(self.pose, self.covariance, self.stamps[0], stamp))


def _mapped(recording: Recording) -> list[str]:
    """Matched motion and the pose served, by the motion that is the default."""
    settings = Settings()
    job = recording_job(recording, None, None, settings, seed=1, threads=1)
    looks = [look for look in job.looks() if look.motion is not None]
    matched, squared, errors, variances = [], [], [], []
    for beginning in BEGINNINGS:
        mapper = Watched(settings)
        for k, (stamp, motion, scan) in enumerate(looks[int(beginning * len(looks)) :]):
            assert motion is not None
            mapper.move(motion if k else Motion.none(stamp))
            if scan is not None:
                mapper.observe(scan)
        matched = matched or mapper.matched[1:]
        for pose in mapper.served:
            start, end = _true_poses(recording, [pose.first, pose.last])
            error = pose.increment - compose(inverse(start), end)
            error[2] = wrap_angle(error[2])
            squared.append(error @ np.linalg.solve(pose.covariance, error))
            errors.append(error)
            variances.append(np.diag(pose.covariance))
    truth = _true_poses(recording, [matched[0].first, *(motion.last for motion in matched)])
    figures = [f"{nees(matched, truth, count)[0]:.1f}" for count in (1, 5, 20)]
    rms, sigma = (np.sqrt(np.mean(part, axis=0)) for part in (np.square(errors), variances))
    ratio = ", ".join(f"{share:.1f}" for share in sigma / rms)
    return [*figures, f"{np.mean(squared):.1f}", ratio]


def fitted_yaw(motions: Sequence[Motion], truth: np.ndarray) -> float:
    """Yaw of the robot's frame against the truth's [rad], which makes the errors across least."""
    true = compose(inverse(truth[:-1]), truth[1:])[:, :2]
    found = np.array([motion.increment[:2] for motion in motions])
    cross = np.sum(found[:, 0] * true[:, 1] - found[:, 1] * true[:, 0])
    return float(np.arctan2(cross, np.sum(found * true)))


def _recordings() -> list[Path]:
    found, folder = [OFFICE], cache()
    name = "_".join(option.strip("-") for option in OPTIONS)
    if folder is not None:
        rooms = [folder / end for room in ROOMS for end in (f"{room}_{name}", f"{room}_cheap")]
        found += [room for room in rooms if room.is_dir()]
    if data := os.environ.get("BEEMAP_REAL_DATA"):
        found.append(Path(data) / STREET)
    return found


def _rows(recording: Recording, choice: str) -> list[list[str]]:
    motions, truth = motions_of(recording, choice)
    rows = [[recording.path.name, choice, *_figures(motions, truth)]]
    if recording.path.name == STREET.name:
        motions, truth = motions[STREET_SKIP:], truth[STREET_SKIP:]
        turned = compose(truth, np.array([0.0, 0.0, fitted_yaw(motions, truth)]))
        name = f"{recording.path.name}, from pair {STREET_SKIP}, yaw fitted"
        rows.append([name, choice, *_figures(motions, turned)])
    return rows


def _figures(motions: Sequence[Motion], truth: np.ndarray) -> list[str]:
    seconds = float(np.median([motion.last - motion.first for motion in motions])) / 1e9
    counts = [1, *(max(1, round(span / seconds)) for span in (1.0, 5.0)), 20]
    _, rms, sigma = nees(motions, truth, 1)
    ratio = ", ".join(f"{share:.1f}" for share in sigma / rms)
    means = [nees(motions, truth, count)[0] for count in counts]
    return [*("–" if np.isnan(mean) else f"{mean:.1f}" for mean in means), ratio]


if __name__ == "__main__":
    import sys

    print(main(sys.argv[1:]))
