"""The message types of ROS 1 and ROS 2, with the names that `rosbags` gives both."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
JOINTS = "sensor_msgs/msg/JointState"
SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
GRID = "nav_msgs/msg/OccupancyGrid"
PATH = "nav_msgs/msg/Path"
TF = "tf2_msgs/msg/TFMessage"
OLD_TF = "tf/msg/tfMessage"  # what /tf was called in the days of ROS 1

_TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms"


@cache
def typestore(version: int) -> Any:
    """The types of ROS `version` 1 or 2. Standard messages are the same in all distributions of
    one version, and some bags come without definitions."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if version == 2:
        return get_typestore(Stores.ROS2_HUMBLE)
    store = get_typestore(Stores.ROS1_NOETIC)
    for name in (TF, OLD_TF):
        store.register(get_types_from_msg(_TF_DEFINITION, name))
    return store


def reader_of(version: int) -> Callable[[bytes, str], Any]:
    """The function (data, type) -> message."""
    store = typestore(version)
    return store.deserialize_ros1 if version == 1 else store.deserialize_cdr


def stamp_of(header: Any) -> int:
    """The header's stamp [ns]."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
