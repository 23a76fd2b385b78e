"""The path between local maps: the filter's poses joined by odometry.

The filter knows the pose only where a local map closed. Between two closings the path follows
odometry, leaving from the earlier pose and arriving at the later one: what the filter corrected
is spread over the way between them in proportion to the travel.
"""

from __future__ import annotations

import numpy as np

from odometry.motion import compose, inverse, wrap_angle

# A turn of one radian counts as this much travel [m]: turning in place has errors, too.
TURN_AS_TRAVEL = 0.3


def travelled(odometry: np.ndarray) -> np.ndarray:
    """Cumulative travel (n,) [m] along odometry poses (n, 3), turns included."""
    steps = np.diff(odometry, axis=0)
    length = np.hypot(steps[:, 0], steps[:, 1]) + TURN_AS_TRAVEL * np.abs(wrap_angle(steps[:, 2]))
    return np.concatenate([[0.0], np.cumsum(length)])


def join(odometry: np.ndarray, nodes: np.ndarray, node_poses: np.ndarray) -> np.ndarray:
    """Poses (n, 3) for every odometry pose (n, 3).

    nodes: (m,) increasing indices into `odometry` at which the filter's poses `node_poses`
    (m, 3) stand. Before the first and after the last node odometry alone leads.
    """
    way = travelled(odometry)
    path = np.empty_like(odometry)
    path[: nodes[0]] = _carried(odometry[: nodes[0]], odometry[nodes[0]], node_poses[0])
    for (i, a), (j, b) in zip(
        zip(nodes[:-1], node_poses[:-1], strict=True),
        zip(nodes[1:], node_poses[1:], strict=True),
        strict=True,
    ):
        between = odometry[i:j]
        forward = _carried(between, odometry[i], a)
        backward = _carried(between, odometry[j], b)
        share = (way[i:j] - way[i]) / max(way[j] - way[i], 1e-9)
        path[i:j, :2] = forward[:, :2] + share[:, None] * (backward - forward)[:, :2]
        turn = wrap_angle(backward[:, 2] - forward[:, 2])
        path[i:j, 2] = wrap_angle(forward[:, 2] + share * turn)
    last = nodes[-1]
    path[last:] = _carried(odometry[last:], odometry[last], node_poses[-1])
    return path


def _carried(odometry: np.ndarray, anchor: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Odometry poses seen from the map in which odometry's `anchor` stands at `pose`."""
    return compose(pose, compose(inverse(anchor), odometry))
