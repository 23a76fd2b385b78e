"""The native format: the EuRoC/ASL folder, with wheel ticks in `odom0`.

mav0/cam0, cam1: data.csv, data/*.png|jpg, sensor.yaml
mav0/odom0: data.csv (`#timestamp [ns],left [ticks],right [ticks]`), sensor.yaml
mav0/odometry0/data.csv: odometry that was kept as poses (`#timestamp [ns],x [m],y [m],theta [rad]`)
mav0/state_groundtruth_estimate0/data.csv: the truth, where there is one
mav0/stereo0 in place of cam0 and cam1: a camera that sends both images side by side
rig.yaml: beside mav0, the rig with which it was recorded; wins over the sensor.yaml files

In a recording with `odom0` the body frame of the `T_BS` matrices is the robot's, so that they
hold the camera's mount. Without it (as in EuRoC itself) the body is an IMU and says nothing
about the floor.

A recording that was cut off at any moment opens as it is: what is damaged is counted and named.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calibration.exchange import euroc
from calibration.rig import RigError
from odometry.encoders import encoder_parameters
from odometry.errors import OdometryError
from odometry.tick_log import parse_tick_log
from pipeline.errors import InputError
from pipeline.recordings.base import (
    BROKEN_RIG,
    BROKEN_TICKS,
    IMAGE_ENDINGS,
    HalvedPair,
    Recording,
    match_pairs,
)
from pipeline.recordings.recorded_rig import (
    META_FILE,
    RIG_FILE,
    load_recorded_rig,
    mapped_cell,
)
from pipeline.textfiles import ends_whole, read_fields, read_lines
from pipeline.trajectory import Trajectory

LOOKED_FOR = "mav0/cam0/data.csv (EuRoC/ASL)"

STAMP = re.compile(r"[0-9]{1,19}")
LAST_STAMP = 2**63 - 1  # int64 holds no later one [ns]


def recognises(path: Path) -> bool:
    """Whether `path` is an ASL folder, or the `mav0` in it."""
    return any(
        (path / "mav0" / camera).is_dir() or (path / camera / "data.csv").is_file()
        for camera in ("cam0", "stereo0")
    )


def read(path: Path) -> Recording:
    """Open the folder. Raises InputError or RigError naming what is missing or wrong."""
    root = path / "mav0" if (path / "mav0").is_dir() else path
    recording = Recording(path, "EuRoC/ASL folder", [])
    if (root / "stereo0").is_dir():
        recording.pairs = [HalvedPair(*i) for i in sorted(_image_list(root / "stereo0", recording))]
    else:
        left, right = (_image_list(root / camera, recording) for camera in ("cam0", "cam1"))
        recording.pairs = match_pairs(left, right, recording)
    robot_frame = (root / "odom0" / "data.csv").is_file()
    _add_rig(recording, root, robot_frame)
    if robot_frame:
        _add_ticks(recording, root / "odom0")
    recording.cell = mapped_cell(root.parent / META_FILE)
    odometry = root / "odometry0" / "data.csv"
    if odometry.is_file():
        recording.odometry = _odometry(odometry, recording)
    truth = root / "state_groundtruth_estimate0" / "data.csv"
    if truth.is_file():
        recording.poses = _truth(truth, recording)
        if recording.poses is not None:
            recording.poses_source = "state_groundtruth_estimate0"
    return recording


def _image_list(camera: Path, recording: Recording) -> list[tuple[int, Path]]:
    table = camera / "data.csv"
    if not table.is_file():
        raise InputError(f"{table}: missing: a stereo recording needs cam0 and cam1")
    images, broken, missing = [], [], []
    lines = read_lines(table)
    for number, line in enumerate(lines, start=1):
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
    if not images or not ends_whole(table):
        found = _unlisted(camera, images[-1][0] if images else -1)
        recording.skip("image beyond the end of a list cut short, taken by name", found)
        images += [(int(Path(name).stem), camera / "data" / name) for name in found]
    if not images:
        raise InputError(f"{table}: lists no image that exists in {camera / 'data'}")
    return images


def _unlisted(camera: Path, after: int) -> list[str]:
    """Images whose names are later stamps."""
    folder = camera / "data"
    names = [f for f in folder.iterdir() if f.suffix in IMAGE_ENDINGS] if folder.is_dir() else []
    later = [f for f in names if _is_stamp(f.stem) and int(f.stem) > after]
    return [f.name for f in sorted(later, key=lambda f: int(f.stem))]


def _is_stamp(text: str) -> bool:
    return STAMP.fullmatch(text) is not None and int(text) <= LAST_STAMP


def _add_rig(recording: Recording, root: Path, robot_frame: bool) -> None:
    """The rig that lies in the recording; a damaged one is no reason not to open it."""
    files = [root / camera / "sensor.yaml" for camera in ("cam0", "cam1")]
    recorded = root.parent / RIG_FILE
    if recorded.is_file():
        try:
            recording.rig = load_recorded_rig(recorded)
            recording.rig_source = f"own {RIG_FILE}"
        except RigError as error:
            recording.skip(BROKEN_RIG, [str(error)])
    if recording.rig is None and all(file.is_file() for file in files):
        try:
            sheets = tuple(read_fields(file) for file in files)
            sources = (str(files[0]), str(files[1]))
            recording.rig = euroc.read((sheets[0], sheets[1]), sources, body_is_robot=robot_frame)
            recording.rig_source = "sensor.yaml of both cameras"
        except (RigError, InputError) as error:
            recording.skip(BROKEN_RIG, [str(error)])


def _add_ticks(recording: Recording, folder: Path) -> None:
    sensor = folder / "sensor.yaml"
    table = folder / "data.csv"
    lines = read_lines(table)
    if not ends_whole(table):
        # The start of a count is a count, too: a line without its end is not believed.
        recording.skip("reading of the wheels cut short", lines[-1:])
        del lines[-1:]
    try:
        recording.encoders = encoder_parameters(read_fields(sensor), str(sensor))
        recording.ticks = parse_tick_log("\n".join(lines), str(table))
    except (OdometryError, InputError) as error:
        recording.skip(BROKEN_TICKS, [str(error)])


def _odometry(path: Path, recording: Recording) -> Trajectory | None:
    """Columns: stamp, x, y, theta."""
    rows = _rows(path, 3, "odometry", recording)
    if rows is None:
        return None
    stamps, values = rows
    return Trajectory(stamps, values)


def _truth(path: Path, recording: Recording) -> Trajectory | None:
    """Columns: stamp, position x y z, quaternion w x y z, and more that is not needed."""
    rows = _rows(path, 7, "ground truth", recording)
    if rows is None:
        return None
    stamps, values = rows
    x, y, _, w, i, j, k = values.T
    yaw = np.arctan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))
    return Trajectory(stamps, np.stack([x, y, yaw], axis=1))


def _rows(
    path: Path, count: int, what: str, recording: Recording
) -> tuple[np.ndarray, np.ndarray] | None:
    """Stamps (n,) int64 ns and the first `count` numbers (n, count) of every line; None: none."""
    rows, broken = [], []
    lines = read_lines(path)
    # The start of a number is a number, too: a line without its end is not believed.
    last = len(lines) + 1 if ends_whole(path) else len(lines)
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        stamp, *numbers = (part.strip() for part in line.split(","))
        try:
            values = [float(v) for v in numbers[:count]]
        except ValueError:
            values = []
        if (
            number < last
            and _is_stamp(stamp)
            and len(values) == count
            and np.isfinite(values).all()
        ):
            rows.append((int(stamp), *values))
        else:
            broken.append(f"line {number}")
    recording.skip(f"garbled line in the {what}", broken)
    if not rows:
        recording.skip(f"{what} that holds no pose", [str(path)])
        return None
    stamps = np.array([row[0] for row in rows], np.int64)
    return stamps, np.array([row[1:] for row in rows])
