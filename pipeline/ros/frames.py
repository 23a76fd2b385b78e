"""Frames of tf: where the camera sits on the robot, out of transforms and into them."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.rig import Mount

# What people call the robot's own frame; the first stands on the floor, as ours does.
BASES = ("base_footprint", "base_link", "base")


class Frames:
    """The first transform of every child frame that was told."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, np.ndarray, np.ndarray]] = {}

    def take(self, message: Any) -> None:
        """A tf2_msgs/TFMessage."""
        for stamped in message.transforms:
            q, p = stamped.transform.rotation, stamped.transform.translation
            quaternion = np.array([q.w, q.x, q.y, q.z], float)
            position = np.array([p.x, p.y, p.z], float)
            child, parent = _bare(stamped.child_frame_id), _bare(stamped.header.frame_id)
            # A rotation of no length is none.
            if np.isfinite([*quaternion, *position]).all() and quaternion.any():
                turn = rotation_of(quaternion / np.linalg.norm(quaternion))
                self._parents.setdefault(child, (parent, turn, position))

    def above(self, frame: str) -> list[str]:
        """The frames from `frame` (included) up to the root."""
        chain = [_bare(frame)]
        while (link := self._parents.get(chain[-1])) and link[0] not in chain:
            chain.append(link[0])
        return chain

    def pose(self, frame: str, base: str) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and position (3,) [m] of `frame`, which stands below `base`."""
        rotation, position = np.eye(3), np.zeros(3)
        for name in self.above(frame):
            if name == _bare(base):
                break
            _, turn, place = self._parents[name]
            rotation, position = turn @ rotation, turn @ position + place
        return rotation, position

    def mount(self, camera: str, base: str | None) -> tuple[Mount, str] | None:
        """The mount of the optical frame `camera`, and the robot's frame that it is told in.

        base: that frame; None: the first of BASES above the camera. None where there is none.
        """
        chain = self.above(camera)[1:]
        names = BASES if base is None else (_bare(base),)
        found = next((name for name in names if name in chain), None)
        if found is None:
            return None
        return Mount.from_pose(*self.pose(camera, found)), found


def rotation_of(q: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def quaternion_of(R: np.ndarray) -> np.ndarray:
    """Unit quaternion (w, x, y, z), w >= 0, of a rotation (3, 3): the eigenvector of the largest
    eigenvalue of the symmetric matrix of Bar-Itzhack (2000), which loses digits nowhere."""
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(R, float)
    K = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, d + b, c + g],
            [c - g, d + b, e - a - i, h + f],
            [d - b, c + g, h + f, i - a - e],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q[0] >= 0.0 else -q


def yaw_of(q: Any) -> float:
    """The turn about z of a quaternion message [rad]."""
    return float(np.arctan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z)))


def _bare(name: str) -> str:
    """ROS 1 once wrote a slash before frames."""
    return name.lstrip("/")
