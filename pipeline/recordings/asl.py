"""The native format: the EuRoC/ASL folder, with wheel ticks in `odom0`.

mav0/cam0, cam1: data.csv, data/*.png|jpg, sensor.yaml
mav0/odom0: data.csv (`#timestamp [ns],left [ticks],right [ticks]`), sensor.yaml
mav0/state_groundtruth_estimate0/data.csv: the truth, where there is one

In a recording with `odom0` the body frame of the `T_BS` matrices is the robot's, so that they
hold the camera's mount. Without it (as in EuRoC itself) the body is an IMU and says nothing
about the floor.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calibration.exchange import euroc
from calibration.rig import StereoRig
from odometry.encoders import encoder_parameters
from odometry.tick_log import read_tick_log
from pipeline.errors import InputError
from pipeline.recordings.base import Recording, match_pairs
from pipeline.textfiles import read_fields, read_lines
from pipeline.trajectory import Trajectory

LOOKED_FOR = "mav0/cam0/data.csv (EuRoC/ASL)"

STAMP = re.compile(r"[0-9]{1,19}")
LAST_STAMP = 2**63 - 1  # int64 holds no later one [ns]


def recognises(path: Path) -> bool:
    """Whether `path` is an ASL folder, or the `mav0` in it."""
    return (path / "mav0" / "cam0").is_dir() or (path / "cam0" / "data.csv").is_file()


def read(path: Path) -> Recording:
    """Open the folder. Raises InputError or RigError naming what is missing or wrong."""
    root = path / "mav0" if (path / "mav0").is_dir() else path
    recording = Recording(path, "EuRoC/ASL folder", [])
    left, right = (_image_list(root / camera, recording) for camera in ("cam0", "cam1"))
    recording.pairs = match_pairs(left, right, recording)
    robot_frame = (root / "odom0" / "data.csv").is_file()
    if (root / "cam0" / "sensor.yaml").is_file() and (root / "cam1" / "sensor.yaml").is_file():
        recording.rig = _rig(root, robot_frame)
        recording.rig_source = "sensor.yaml of both cameras"
    if robot_frame:
        recording.ticks = read_tick_log(root / "odom0" / "data.csv")
        sensor = root / "odom0" / "sensor.yaml"
        recording.encoders = encoder_parameters(read_fields(sensor), str(sensor))
    truth = root / "state_groundtruth_estimate0" / "data.csv"
    if truth.is_file():
        recording.poses = _truth(truth, recording)
        recording.poses_source = "state_groundtruth_estimate0"
    return recording


def _image_list(camera: Path, recording: Recording) -> list[tuple[int, Path]]:
    table = camera / "data.csv"
    if not table.is_file():
        raise InputError(f"{table}: missing: a stereo recording needs cam0 and cam1")
    images, broken, missing = [], [], []
    for number, line in enumerate(read_lines(table), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        stamp, _, name = (part.strip() for part in line.partition(","))
        if not _is_stamp(stamp) or not name:
            broken.append(f"{camera.name}/data.csv line {number}")
        elif not (camera / "data" / name).is_file():
            missing.append(f"{camera.name}/data/{name}")
        else:
            images.append((int(stamp), camera / "data" / name))
    recording.skip("garbled line in an image list", broken)
    recording.skip("listed image is missing", missing)
    if not images:
        raise InputError(f"{table}: lists no image that exists in {camera / 'data'}")
    return images


def _is_stamp(text: str) -> bool:
    return STAMP.fullmatch(text) is not None and int(text) <= LAST_STAMP


def _rig(root: Path, robot_frame: bool) -> StereoRig:
    files = [root / camera / "sensor.yaml" for camera in ("cam0", "cam1")]
    left, right = (read_fields(file) for file in files)
    return euroc.read((left, right), (str(files[0]), str(files[1])), body_is_robot=robot_frame)


def _truth(path: Path, recording: Recording) -> Trajectory:
    """Columns: stamp, position x y z, quaternion w x y z, and more that is not needed."""
    rows, broken = [], []
    for number, line in enumerate(read_lines(path), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        stamp, *numbers = (part.strip() for part in line.split(","))
        try:
            values = [float(v) for v in numbers[:7]]
        except ValueError:
            values = []
        if _is_stamp(stamp) and len(values) == 7 and np.isfinite(values).all():
            rows.append((int(stamp), *values))
        else:
            broken.append(f"line {number}")
    recording.skip("garbled line in the ground truth", broken)
    if not rows:
        raise InputError(f"{path}: holds no pose")
    stamps = np.array([row[0] for row in rows], np.int64)
    x, y, _, w, i, j, k = np.array([row[1:] for row in rows]).T
    yaw = np.arctan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))
    return Trajectory(stamps, np.stack([x, y, yaw], axis=1))
