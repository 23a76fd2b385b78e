"""Bags written with rosbags from a recording, in all three containers, for the tests."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CONTAINERS = ("ros1", "sqlite3", "mcap")
TICKS_PER_REVOLUTION = 2000
SIZE = (320, 240)
TF = "tf2_msgs/msg/TFMessage"

Message = tuple[str, str, int, Any]  # topic, type, time ns, content


class Types:
    """Makes messages of ROS 1 or 2; fields by ROS 2's names, unless they are all capitals there."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        if version == 1:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(definition, TF))

    def __call__(self, kind: str, **fields: Any) -> Any:
        kind = kind.replace("/", "/msg/", 1)
        if self.version == 1 and kind.endswith("CameraInfo"):
            fields = {k.upper() if len(k) == 1 else k: v for k, v in fields.items()}
        return self.store.types[kind](**fields)

    def time(self, stamp: int) -> Any:
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        return self("builtin_interfaces/Time", sec=seconds, nanosec=nanoseconds)

    def header(self, stamp: int, frame: str) -> Any:
        seq = {"seq": 0} if self.version == 1 else {}
        return self("std_msgs/Header", stamp=self.time(stamp), frame_id=frame, **seq)


def write_bag(path: Path, container: str, messages: Callable[[Types], Iterator[Message]]) -> Path:
    """Write the messages in the order given; the bag's path."""
    types = Types(1 if container == "ros1" else 2)
    if container == "ros1":
        path = path.with_suffix(".bag")
        writer: Any = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if container == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=8, storage_plugin=plugin)
    pack = types.store.serialize_ros1 if container == "ros1" else types.store.serialize_cdr
    with writer:
        connections = {}
        for topic, kind, time, content in messages(types):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types.store)
            writer.write(connections[topic], time, pack(content, kind))
    return path


def office_messages(recording: Path) -> Callable[[Types], Iterator[Message]]:
    """All that a robot with the recording's cameras and wheels would have published."""

    def messages(types: Types) -> Iterator[Message]:
        found: list[Message] = [*_static(recording, types)]
        for camera, side in (("cam0", "left"), ("cam1", "right")):
            for stamp, file in _rows(recording / "mav0" / camera / "data.csv"):
                data = (recording / "mav0" / camera / "data" / file).read_bytes()
                image = compressed(types, int(stamp), f"{side}_optical", data)
                topic = f"/stereo/{side}/image_raw/compressed"
                # The right image comes later, as over a network; its header says when it was taken.
                late = 3_000_000 if side == "right" else 1_000_000
                kind = "sensor_msgs/msg/CompressedImage"
                found.append((topic, kind, int(stamp) + late, image))
                info = camera_info(types, recording, side, int(stamp))
                topic = f"/stereo/{side}/camera_info"
                kind = "sensor_msgs/msg/CameraInfo"
                found.append((topic, kind, int(stamp) + late, info))
        found += _wheels(recording, types)
        found += _odometry(recording, types)
        yield from sorted(found, key=lambda message: message[2])

    return messages


def compressed(types: Types, stamp: int, frame: str, data: bytes, told: str = "jpeg") -> Any:
    return types(
        "sensor_msgs/CompressedImage",
        header=types.header(stamp, frame),
        format=told,
        data=np.frombuffer(data, np.uint8),
    )


@cache
def stereo_rectified(recording: Path) -> dict[str, tuple[np.ndarray, ...]]:
    """K, D, R, P of each side, as `cv2.stereoRectify` and ROS have them, made here anew."""
    sheets = [_sheet(recording, camera) for camera in ("cam0", "cam1")]
    (K1, D1, A), (K2, D2, B) = sheets
    pose = np.linalg.inv(B) @ A  # left camera to right camera
    R1, R2, P1, P2 = cv2.stereoRectify(
        K1, D1, K2, D2, SIZE, pose[:3, :3], pose[:3, 3:], flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
    )[:4]
    return {"left": (K1, D1, R1, P1), "right": (K2, D2, R2, P2)}


def camera_info(types: Types, recording: Path, side: str, stamp: int) -> Any:
    """The calibration of one camera."""
    K, D, R, P = stereo_rectified(recording)[side]
    return types(
        "sensor_msgs/CameraInfo",
        header=types.header(stamp, f"{side}_optical"),
        width=SIZE[0],
        height=SIZE[1],
        distortion_model="plumb_bob",
        d=np.append(D, 0.0),
        k=K.ravel(),
        r=R.ravel(),
        p=P.ravel(),
        binning_x=0,
        binning_y=0,
        roi=types(
            "sensor_msgs/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        ),
    )


def transform(types: Types, parent: str, child: str, xyz: tuple, q: tuple, stamp: int = 0) -> Any:
    """q: (x, y, z, w)."""
    return types(
        "geometry_msgs/TransformStamped",
        header=types.header(stamp, parent),
        child_frame_id=child,
        transform=types(
            "geometry_msgs/Transform",
            translation=types("geometry_msgs/Vector3", x=xyz[0], y=xyz[1], z=xyz[2]),
            rotation=types("geometry_msgs/Quaternion", x=q[0], y=q[1], z=q[2], w=q[3]),
        ),
    )


def _static(recording: Path, types: Types) -> Iterator[Message]:
    """base_footprint -> base_link -> left_camera -> left_optical, as a robot description has it."""
    start = int(_rows(recording / "mav0" / "cam0" / "data.csv")[0][0])
    links = [
        transform(types, "base_footprint", "base_link", (0.0, 0.0, 0.05), (0.0, 0.0, 0.0, 1.0)),
        transform(types, "base_link", "left_camera", (0.1, 0.06, 0.25), (0.0, 0.0, 0.0, 1.0)),
        transform(types, "left_camera", "left_optical", (0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5)),
    ]
    yield "/tf_static", TF, start, types("tf2_msgs/TFMessage", transforms=links)


def _wheels(recording: Path, types: Types) -> Iterator[Message]:
    """The joints' angles since the start: counters of 16 bits made continuous."""
    rows = [tuple(map(int, row)) for row in _rows(recording / "mav0" / "odom0" / "data.csv")]
    before, total = rows[0][1:], [0, 0]
    for stamp, *counts in rows:
        for wheel, (now, then) in enumerate(zip(counts, before, strict=True)):
            total[wheel] += (now - then + 2**15) % 2**16 - 2**15
        before = tuple(counts)
        angles = [2.0 * math.pi * n / TICKS_PER_REVOLUTION for n in total]
        state = types(
            "sensor_msgs/JointState",
            header=types.header(stamp, ""),
            name=["lidar_joint", "wheel_left_joint", "wheel_right_joint"],
            position=np.array([0.3, *angles]),
            velocity=np.zeros(0),
            effort=np.zeros(0),
        )
        yield "/joint_states", "sensor_msgs/msg/JointState", stamp + 500_000, state


def _odometry(recording: Path, types: Types) -> Iterator[Message]:
    """The true path as an odometry that stands elsewhere in its own frame."""
    zeros = np.zeros(36)
    for row in _rows(recording / "mav0" / "state_groundtruth_estimate0" / "data.csv"):
        stamp, (x, y, _, w, _, _, z) = int(row[0]), map(float, row[1:8])
        point = types("geometry_msgs/Point", x=x + 3.0, y=y - 1.0, z=0.0)
        turn = types("geometry_msgs/Quaternion", x=0.0, y=0.0, z=z, w=w)
        pose = types("geometry_msgs/Pose", position=point, orientation=turn)
        none = types("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
        twist = types("geometry_msgs/Twist", linear=none, angular=none)
        odometry = types(
            "nav_msgs/Odometry",
            header=types.header(stamp, "odom"),
            child_frame_id="base_footprint",
            pose=types("geometry_msgs/PoseWithCovariance", pose=pose, covariance=zeros),
            twist=types("geometry_msgs/TwistWithCovariance", twist=twist, covariance=zeros),
        )
        yield "/odom", "nav_msgs/msg/Odometry", stamp + 700_000, odometry


def _rows(table: Path) -> list[list[str]]:
    lines = table.read_text().splitlines()
    return list(csv.reader(line for line in lines if not line.startswith("#")))


def _sheet(recording: Path, camera: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Camera matrix, distortion (4,), and the pose (4, 4) on the robot."""
    sheet = yaml.safe_load((recording / "mav0" / camera / "sensor.yaml").read_text())
    fx, fy, cx, cy = sheet["intrinsics"]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    D = np.array(sheet["distortion_coefficients"], float)
    return K, D, np.array(sheet["T_BS"]["data"], float).reshape(4, 4)
