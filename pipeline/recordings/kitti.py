"""A KITTI odometry folder (Geiger et al. 2012): rectified pairs and true camera poses.

calib.txt: rows `P0: 12 numbers`, or the first two rows without labels; images in
image_0/image_1, image_2/image_3 or image_l/image_r; times.txt [s] (10 Hz without it);
poses.txt: 12 numbers a line, camera frame (x right, y down, z forward).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibration.rig import CameraModel, Mount, StereoRig
from pipeline.errors import InputError
from pipeline.recordings.base import IMAGE_ENDINGS, PairFiles, Recording, image_size
from pipeline.textfiles import read_lines
from pipeline.trajectory import Trajectory, seconds_to_ns

LOOKED_FOR = "calib.txt with image_0/image_1 or image_l/image_r (KITTI odometry)"

FOLDERS = (("image_0", "image_1"), ("image_2", "image_3"), ("image_l", "image_r"))
PERIOD = 100_000_000  # 10 Hz, where times.txt is missing [ns]
# "The cameras are mounted 1.65 m above the road" (the data set's set-up page).
CAMERA_HEIGHT = 1.65


def recognises(path: Path) -> bool:
    """Whether `path` holds a calib.txt and a pair of KITTI's image folders."""
    return (path / "calib.txt").is_file() and _folders(path) is not None


def read(path: Path) -> Recording:
    """Open the folder. Raises InputError naming what is missing or wrong."""
    folders = _folders(path)
    assert folders is not None, "recognises() comes first"
    recording = Recording(path, "KITTI odometry folder", [])
    left, right = ({f.stem: f for f in _images(path / name)} for name in folders)
    # Lines of the tables count frames: one that only one camera has still takes its line.
    names = sorted(left.keys() | right.keys())
    times = _times(path, names)
    recording.pairs = [
        PairFiles(time, left[n], right[n])
        for n, time in zip(names, times, strict=True)
        if n in left and n in right
    ]
    for own, other, reason in (
        (left, right, "left image without a right one"),
        (right, left, "right image without a left one"),
    ):
        recording.skip(reason, [own[n].name for n in names if n in own and n not in other])
    if not recording.pairs:
        raise InputError(f"{path}: no image has the same name in {folders[0]} and {folders[1]}")
    recording.rig = _rig(path, folders, recording.pairs)
    recording.rig_source = "calib.txt"
    if (path / "poses.txt").is_file():
        recording.poses = _poses(path / "poses.txt", times)
        recording.poses_source = "poses.txt"
    return recording


def _folders(path: Path) -> tuple[str, str] | None:
    for pair in FOLDERS:
        if all((path / name).is_dir() for name in pair):
            return pair
    return None


def _images(folder: Path) -> list[Path]:
    return sorted(f for f in folder.iterdir() if f.suffix.lower() in IMAGE_ENDINGS)


def _times(path: Path, names: list[str]) -> list[int]:
    table = path / "times.txt"
    if not table.is_file():
        return [i * PERIOD for i in range(len(names))]
    try:
        times = [seconds_to_ns(line) for line in read_lines(table) if line.strip()]
    except ValueError:
        raise InputError(f"{table}: expected one time in seconds a line") from None
    if len(times) < len(names):
        raise InputError(f"{table}: {len(times)} times for {len(names)} images")
    return times[: len(names)]


def _rig(path: Path, folders: tuple[str, str], pairs: list[PairFiles]) -> StereoRig:
    """The rig of already rectified images, from the projection matrices."""
    rows: dict[str, np.ndarray] = {}
    unlabelled = []
    for number, line in enumerate(read_lines(path / "calib.txt"), start=1):
        label, colon, rest = line.rpartition(":")
        try:
            values = np.array([float(v) for v in rest.split()])
        except ValueError:
            raise InputError(f"{path / 'calib.txt'}, line {number}: not numbers") from None
        if values.size == 12 and colon:
            rows[label.strip()] = values.reshape(3, 4)
        elif values.size == 12:
            unlabelled.append(values.reshape(3, 4))
    wanted = ("P2", "P3") if folders[0] == "image_2" else ("P0", "P1")
    matrices = [rows[w] for w in wanted if w in rows] if rows else unlabelled[:2]
    if len(matrices) != 2:
        raise InputError(
            f"{path / 'calib.txt'}: needs two rows of 12 numbers ({wanted[0]} and {wanted[1]})"
        )
    left, right = matrices
    if not (np.isfinite(matrices).all() and left[0, 0] > 0.0 and left[1, 1] > 0.0):
        raise InputError(f"{path / 'calib.txt'}: the focal lengths must be positive numbers")
    baseline = (left[0, 3] - right[0, 3]) / left[0, 0]
    if baseline <= 0:
        raise InputError(f"{path / 'calib.txt'}: the second camera is not right of the first")
    size = image_size(pairs)
    if size is None:
        raise InputError(f"{path / folders[0]}: no image can be read")
    camera = CameraModel(left[0, 0], left[1, 1], left[0, 2], left[1, 2])
    return StereoRig(
        size,
        camera,
        camera,
        np.eye(3),
        np.array([-baseline, 0.0, 0.0]),
        rectified=True,
        mount=Mount(height=CAMERA_HEIGHT),
    )


def _poses(table: Path, times: list[int]) -> Trajectory:
    """Camera poses on the ground plane: forward is the optical axis, left is minus x."""
    rows = []
    for number, line in enumerate(read_lines(table), start=1):
        if not line.strip():
            continue
        try:
            rows.append(np.array([float(v) for v in line.split()]).reshape(3, 4))
        except ValueError:
            raise InputError(f"{table}, line {number}: expected 12 numbers") from None
    n = min(len(rows), len(times))
    if n == 0:
        raise InputError(f"{table}: holds no pose")
    P = np.array(rows[:n])
    poses = np.stack([P[:, 2, 3], -P[:, 0, 3], np.arctan2(-P[:, 0, 2], P[:, 2, 2])], axis=1)
    return Trajectory(np.array(times[:n], np.int64), poses)
