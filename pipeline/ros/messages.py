"""Messages made of what a run holds: frames map, odom, base_link (REP 105), metres, radians."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from mapping.grid import OccupancyGrid
from odometry.motion import Motion
from pipeline.ros.frames import quaternion_of
from pipeline.ros.types import COMPRESSED, GRID, ODOMETRY, PATH, SCAN, TF
from stereo.scan import RangeScan

MAP, ODOM, ROBOT, SENSOR = "map", "odom", "base_link", "base_scan"
# Where x, y and the turn about z stand in a covariance of six.
PLANE = np.ix_([0, 1, 5], [0, 1, 5])


class Make(Protocol):
    """Makes a message of that type; see `BagWriter.make`."""

    def __call__(self, kind: str, **fields: Any) -> Any: ...


def header(make: Make, stamp: int, frame: str) -> Any:
    """stamp: ns."""
    return make("std_msgs/msg/Header", stamp=_time(make, stamp), frame_id=frame)


def grid_message(make: Make, stamp: int, grid: OccupancyGrid) -> Any:
    """What map_server publishes of map.yaml: 0 free, 100 occupied, -1 unknown or undecided."""
    cells = grid.classes
    info = make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=_time(make, stamp),
        resolution=float(grid.cell),
        width=cells.shape[1],
        height=cells.shape[0],
        origin=_pose(make, np.array([*grid.origin, 0.0])),
    )
    return make(GRID, header=header(make, stamp, MAP), info=info, data=cells.ravel())


def path_message(make: Make, stamp: int, stamps: np.ndarray, poses: np.ndarray) -> Any:
    """The whole path (n, 3) in the frame of the map, each pose with its own stamp."""
    stamped = [
        make(
            "geometry_msgs/msg/PoseStamped",
            header=header(make, when, MAP),
            pose=_pose(make, pose),
        )
        for when, pose in zip(stamps.tolist(), poses, strict=True)
    ]
    return make(PATH, header=header(make, stamp, MAP), poses=stamped)


def odometry_message(
    make: Make, stamp: int, pose: np.ndarray, covariance: np.ndarray | None, motion: Motion | None
) -> Any:
    """pose (3,) and its covariance (3, 3) in the frame odom; motion: that led there, for the twist.

    What is not known is zeros, as ROS has it.
    """
    seconds = 0.0 if motion is None else (motion.last - motion.first) / 1e9
    speed, doubt = np.zeros(3), np.zeros((3, 3))
    if motion is not None and seconds > 0.0:
        speed, doubt = motion.increment / seconds, motion.covariance / seconds**2
    twist = make(
        "geometry_msgs/msg/Twist",
        linear=_vector(make, np.array([speed[0], speed[1], 0.0])),
        angular=_vector(make, np.array([0.0, 0.0, speed[2]])),
    )
    return make(
        ODOMETRY,
        header=header(make, stamp, ODOM),
        child_frame_id=ROBOT,
        pose=make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=_pose(make, pose),
            covariance=_in_space(covariance),
        ),
        twist=make(
            "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=_in_space(doubt)
        ),
    )


def scan_message(make: Make, scan: RangeScan) -> Any:
    """The scan in the frame of the sensor: NaN where it does not know, +inf where it sees nothing
    up to its reach (REP 117).

    A LaserScan has even angles and a camera's columns do not: each beam is the column nearest to
    it.
    """
    angles = np.linspace(scan.bearing[0], scan.bearing[-1], len(scan.bearing))
    middles = (scan.bearing[1:] + scan.bearing[:-1]) / 2.0
    ranges = scan.range[np.searchsorted(middles, angles)]
    return make(
        SCAN,
        header=header(make, scan.stamp, SENSOR),
        angle_min=float(angles[0]),
        angle_max=float(angles[-1]),
        angle_increment=float(scan.spacing),
        time_increment=0.0,
        scan_time=0.0,
        range_min=0.0,
        range_max=float(scan.max_range),
        ranges=ranges.astype(np.float32),
        intensities=np.zeros(0, np.float32),
    )


def image_message(make: Make, stamp: int, frame: str, data: bytes, told: str) -> Any:
    """An image file; told: its format."""
    head = header(make, stamp, frame)
    return make(COMPRESSED, header=head, format=told, data=np.frombuffer(data, np.uint8))


def info_message(make: Make, stamp: int, frame: str, fields: dict[str, Any]) -> Any:
    """CameraInfo of the fields that `calibration.info_fields` gives."""
    none = dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0)
    return make(
        "sensor_msgs/msg/CameraInfo",
        header=header(make, stamp, frame),
        **fields,
        binning_x=0,
        binning_y=0,
        roi=make("sensor_msgs/msg/RegionOfInterest", **none, do_rectify=False),
    )


def transforms_message(make: Make, transforms: list[Any]) -> Any:
    """A message for /tf or /tf_static."""
    return make(TF, transforms=transforms)


def planar_transform(make: Make, stamp: int, parent: str, child: str, pose: np.ndarray) -> Any:
    """The frame `child` at a pose (3,) in `parent`."""
    x, y, theta = (float(v) for v in pose)
    turn = np.array([math.cos(theta / 2.0), 0.0, 0.0, math.sin(theta / 2.0)])
    return _transform(make, stamp, parent, child, np.array([x, y, 0.0]), turn)


def transform(
    make: Make, stamp: int, parent: str, child: str, rotation: np.ndarray, position: np.ndarray
) -> Any:
    """The frame `child` at a rotation (3, 3) and a position (3,) in `parent`."""
    return _transform(make, stamp, parent, child, position, quaternion_of(rotation))


def _transform(
    make: Make, stamp: int, parent: str, child: str, position: np.ndarray, turn: np.ndarray
) -> Any:
    return make(
        "geometry_msgs/msg/TransformStamped",
        header=header(make, stamp, parent),
        child_frame_id=child,
        transform=make(
            "geometry_msgs/msg/Transform",
            translation=_vector(make, position),
            rotation=_quaternion(make, turn),
        ),
    )


def _time(make: Make, stamp: int) -> Any:
    seconds, nanoseconds = divmod(int(stamp), 1_000_000_000)
    return make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)


def _pose(make: Make, pose: np.ndarray) -> Any:
    x, y, theta = (float(v) for v in pose)
    turn = np.array([math.cos(theta / 2.0), 0.0, 0.0, math.sin(theta / 2.0)])
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=_quaternion(make, turn),
    )


def _quaternion(make: Make, turn: np.ndarray) -> Any:
    """turn: (w, x, y, z)."""
    w, x, y, z = (float(v) for v in turn)
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def _vector(make: Make, xyz: np.ndarray) -> Any:
    x, y, z = (float(v) for v in xyz)
    return make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _in_space(planar: np.ndarray | None) -> np.ndarray:
    """A covariance (3, 3) of x, y, theta as the (36,) of six."""
    covariance = np.zeros((6, 6))
    if planar is not None:
        covariance[PLANE] = planar
    return covariance.ravel()
