"""The floor in a rectified pair: a plane, and what it tells of the camera's mount.

A plane is a plane in disparity space too: with n the unit vector from the camera straight down
to the floor, h the height and d = f B / Z, the equation n . X = h becomes

    d = a (u - cx) + b (v - cy) + c        (a, b, c / f) = (B / h) n

exactly. Planes are given as these three numbers (a, b, c).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.errors import CalibrationError
from calibration.rig import Mount

# Mounts that a floor is looked for at: metres, degrees.
HEIGHTS = (0.05, 3.0)
PITCHES = (-20.0, 60.0)
MOST_ROLL = 20.0

TOLERANCE = 1.0  # a disparity this near a plane belongs to it [px]
FARTHEST = 1.0  # planes are judged where their disparity is larger than this [px]
HYPOTHESES = 1500
PROMISING = 30  # hypotheses that are refined
REFINEMENTS = 5
# The floor holds at least this share of what is seen at or above it, and little is seen below it.
# Floors of rendered offices and of a street held 0.33 to 0.84; the best planes where there was
# no floor, through furniture and far walls, 0.04 to 0.21.
LEAST_SHARE = 0.25
MOST_BELOW = 0.5
NO_FLOOR = (
    "no floor in view: no plane below the camera (0.05 to 3 m, pitch -20 to 60 deg, roll within "
    "20 deg) holds in these images: record some seconds with open, textured floor before the robot"
)


@dataclass(frozen=True)
class RectifiedView:
    """Geometry of the rectified pair: pixels, metres.

    raw_from_rectified: (3, 3) from the rectified left camera's axes to those of the raw one.
    """

    f: float
    cx: float
    cy: float
    baseline: float
    raw_from_rectified: np.ndarray

    def disparity(self, plane: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Disparity [px] of a plane at pixels u, v."""
        return plane[0] * (u - self.cx) + plane[1] * (v - self.cy) + plane[2]

    def plane(self, height: float, pitch: float, roll: float) -> np.ndarray:
        """The floor (3,) seen from that mount of the raw left camera [m, rad]."""
        down = -Mount(height, pitch, roll).rotation.T @ np.array([0.0, 0.0, 1.0])
        n = self.raw_from_rectified.T @ down
        return self.baseline / height * n * (1.0, 1.0, self.f)

    def mount(self, plane: np.ndarray) -> np.ndarray:
        """Height [m], pitch and roll [rad] of the raw left camera above that floor: (..., 3)."""
        scaled = np.asarray(plane) / (1.0, 1.0, self.f)
        length = np.linalg.norm(scaled, axis=-1)
        x, y, z = np.moveaxis(scaled / length[..., None] @ self.raw_from_rectified.T, -1, 0)
        pitch, roll = np.arcsin(np.clip(z, -1.0, 1.0)), np.arctan2(x, y)
        return np.stack([self.baseline / length, pitch, roll], axis=-1)


def find_floor(samples: np.ndarray, view: RectifiedView, seed: int = 0) -> np.ndarray:
    """The floor (3,) that many frames share, to about a fifth of a pixel.

    samples: (n, 3) pixels u, v and disparity of points drawn from all frames alike. Three of them
    at a time give a hypothesis (RANSAC, Fischler and Bolles 1981); it must be a mount that can
    be, and the best one holds the most points with the fewest below it: nothing lies under a
    floor, but much under a table.

    Raises:
        CalibrationError: no floor is in view.
    """
    if len(samples) < 100:
        raise CalibrationError(NO_FLOOR)
    planes = _hypotheses(samples, view, np.random.default_rng((seed, 0)))
    scores = np.array([_score(samples, view, plane) for plane in planes])
    promising = planes[np.argsort(-scores, kind="stable")[:PROMISING]]
    # A patch of far wall passes for a steep floor until it is fitted to all of its points.
    refined = [_refined(samples, view, plane) for plane in promising]
    floors = [plane for plane in refined if possible(view.mount(plane))]
    if not floors:
        raise CalibrationError(NO_FLOOR)
    best = max(floors, key=lambda plane: _score(samples, view, plane))
    at, below, above = _counts(samples, view, best)
    share, under = at / max(at + above, 1), below / max(at + below, 1)
    if share < LEAST_SHARE or under > MOST_BELOW:
        raise CalibrationError(NO_FLOOR)
    return best


def possible(mounts: np.ndarray) -> np.ndarray:
    """Which mounts (..., 3: height m, pitch, roll rad) a floor is looked for at."""
    height, pitch, roll = np.moveaxis(mounts, -1, 0)
    return (
        (HEIGHTS[0] <= height)
        & (height <= HEIGHTS[1])
        & (math.radians(PITCHES[0]) <= pitch)
        & (pitch <= math.radians(PITCHES[1]))
        & (abs(roll) <= math.radians(MOST_ROLL))
    )


def _hypotheses(
    samples: np.ndarray, view: RectifiedView, chance: np.random.Generator
) -> np.ndarray:
    """Planes (k, 3) through three points each, those that can be a floor."""
    threes = samples[chance.integers(len(samples), size=(20 * HYPOTHESES, 3))]
    design = _design(threes, view)
    # Three points nearly on a line carry no plane.
    threes, design = (part[abs(np.linalg.det(design)) > view.f] for part in (threes, design))
    planes = np.linalg.solve(design, threes[..., 2:])[..., 0]
    return planes[possible(view.mount(planes))][:HYPOTHESES]


def _design(samples: np.ndarray, view: RectifiedView) -> np.ndarray:
    """Rows (..., 3) whose product with a plane is the plane's disparity."""
    u, v = samples[..., 0], samples[..., 1]
    return np.stack([u - view.cx, v - view.cy, np.ones_like(u)], axis=-1)


def _refined(samples: np.ndarray, view: RectifiedView, plane: np.ndarray) -> np.ndarray:
    """The plane that fits all samples near it best."""
    for _ in range(REFINEMENTS):
        near = abs(samples[:, 2] - view.disparity(plane, *samples.T[:2])) < TOLERANCE
        if near.sum() < 3:
            break
        plane = np.linalg.lstsq(_design(samples[near], view), samples[near, 2], rcond=None)[0]
    return plane


def _score(samples: np.ndarray, view: RectifiedView, plane: np.ndarray) -> float:
    """Disparity of the points at the plane less that of points below: near ones count most, as a
    pixel of tolerance lets almost any plane pass through far ones."""
    expected, excess = _excess(samples, view, plane)
    at, below = abs(excess) < TOLERANCE, excess <= -TOLERANCE
    return float(expected[at].sum() - expected[below].sum())


def _counts(samples: np.ndarray, view: RectifiedView, plane: np.ndarray) -> tuple[int, int, int]:
    """Points at, below and above a plane."""
    _, excess = _excess(samples, view, plane)
    at, below = int(np.sum(abs(excess) < TOLERANCE)), int(np.sum(excess <= -TOLERANCE))
    return at, below, len(excess) - at - below


def _excess(
    samples: np.ndarray, view: RectifiedView, plane: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The plane's disparity and how far the samples exceed it, where matching can find it."""
    expected = view.disparity(plane, *samples.T[:2])
    seen = (expected > FARTHEST) & (expected < samples[:, 2].max())
    return expected[seen], samples[seen, 2] - expected[seen]
