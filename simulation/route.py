"""Route: waypoints with filleted corners, driven forward at constant speed; pose at any time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Route:
    """Straight lines joined by tangent arcs.

    start (n, 3): pose at the beginning of each piece (m, m, rad, heading not wrapped);
    length (n,) m; curvature (n,) 1/m, counter-clockwise positive; speed (n,) m/s.
    """

    start: np.ndarray
    length: np.ndarray
    curvature: np.ndarray
    speed: np.ndarray

    @property
    def distance(self) -> float:
        """Length of the whole route [m]."""
        return float(self.length.sum())

    @property
    def duration(self) -> float:
        """Time the whole route takes [s]."""
        return float((self.length / self.speed).sum())

    def poses(self, times: np.ndarray) -> np.ndarray:
        """Poses (n, 3) at `times` (n,) s; the robot stands before the start and after the end.

        The heading is continuous (not wrapped), so that differences are true turns.
        """
        times = np.asarray(times, float)
        begins = np.concatenate([[0.0], np.cumsum(self.length / self.speed)])
        piece = np.clip(np.searchsorted(begins, times, "right") - 1, 0, len(self.length) - 1)
        elapsed = np.clip(times - begins[piece], 0.0, None)
        along = np.minimum(elapsed * self.speed[piece], self.length[piece])
        x, y, heading = self.start[piece].T
        half = 0.5 * along * self.curvature[piece]
        chord = along * np.sinc(half / math.pi)
        return np.stack(
            [
                x + chord * np.cos(heading + half),
                y + chord * np.sin(heading + half),
                heading + 2.0 * half,
            ],
            axis=-1,
        )

    @staticmethod
    def through(waypoints: np.ndarray, fillet: float, speed: float, turn_rate: float) -> Route:
        """Route along `waypoints` (n, 2) m with corners rounded to the radius `fillet` m.

        Driven at `speed` m/s, in arcs no faster than `turn_rate` rad/s allows.

        Raises:
            ValueError: fewer than two points, a turn back, or legs too short for the fillets.
        """
        points = np.asarray(waypoints, float).reshape(-1, 2)
        legs = np.diff(points, axis=0)
        reach = np.hypot(legs[:, 0], legs[:, 1])
        if len(points) < 2 or not (reach > 0).all():
            raise ValueError("at least two different points in a row are needed")
        headings = np.arctan2(legs[:, 1], legs[:, 0])
        turns = np.mod(np.diff(headings) + math.pi, 2.0 * math.pi) - math.pi
        if (np.abs(turns) > math.radians(170.0)).any():
            raise ValueError("the route turns back on itself: the robot only drives forward")
        cut = np.concatenate([[0.0], fillet * np.tan(np.abs(turns) / 2.0), [0.0]])
        straight = reach - cut[:-1] - cut[1:]
        if (straight < 0).any():
            short = int(np.argmin(straight))
            raise ValueError(f"points {short} and {short + 1} are too close for the fillet radius")
        return _join(points, headings, turns, cut, straight, fillet, speed, turn_rate)


def _join(points, headings, turns, cut, straight, fillet, speed, turn_rate) -> Route:
    pieces = []
    heading = headings[0]
    for i, length in enumerate(straight):
        direction = np.array([math.cos(heading), math.sin(heading)])
        begin = points[i] + cut[i] * direction
        pieces.append((*begin, heading, length, 0.0, speed))
        if i < len(turns) and turns[i] != 0.0:
            end = points[i + 1] - cut[i + 1] * direction
            curvature = math.copysign(1.0 / fillet, turns[i])
            arc = fillet * abs(turns[i])
            pieces.append((*end, heading, arc, curvature, min(speed, turn_rate * fillet)))
            heading += turns[i]
    table = np.array(pieces)
    table = table[table[:, 3] > 1e-9]
    return Route(table[:, :3], table[:, 3], table[:, 4], table[:, 5])
