"""The finished path, smoothed: every window aligned to all others that show the same walls.

The filter lives forward: a loop that closes late corrects what comes after it, hardly what came
before. At the end the best particle's path is good enough to know which windows overlap. They are
matched to one another, and the path is bent to agree with all matches and with the motion
between them (Lu and Milios 1997).
"""

from __future__ import annotations

import numpy as np

from mapping.pose_graph import Measurements, contradictions, relax
from mapping.surface_matching import Surface, match_surfaces
from odometry.motion import compose, inverse

# Rounds of matching and bending, by the standard deviation of a surface in the density, in
# cells: wide to catch the errors of the filter's path, then narrow.
ROUNDS = (3.0, 1.5, 1.0)
# The mean normalised squared error of motion over so many windows is 3 where its covariance is
# true; bent to three times that it contradicts the matches.
STRETCH = 10
MAX_STRAIN = 9.0
# Keeps the information of motion finite in directions it claims to know exactly [m, m, rad].
LEAST_DOUBT = np.array([1e-6, 1e-6, 1e-6])


def smooth(surfaces: list[Surface], poses: np.ndarray, cell: float) -> np.ndarray:
    """The poses (n + 1, 3) at which n windows ended, the start first, made to agree.

    poses: the best particle's; cell: of the map [m].
    """
    middle = np.array([surface.middle for surface in surfaces])
    moved = _motions(surfaces, middle)
    nodes = np.concatenate([poses[:1], compose(poses[1:], middle)])
    for width in ROUNDS:
        matches = match_surfaces(surfaces, nodes[1:], cell, width * cell)
        nodes = _relaxed(nodes, moved, matches.shifted(1))
    return np.concatenate([poses[:1], compose(nodes[1:], inverse(middle))])


def _relaxed(nodes: np.ndarray, moved: Measurements, matches: Measurements) -> np.ndarray:
    """The nodes (n + 1, 3) that agree best. Where the matches across a stretch of the way bend its
    motion beyond belief, all of them that close a loop over it are left out, and not one by one:
    false matches of one place confirm each other."""
    while True:
        bent = relax(nodes, moved, matches)
        strain = np.convolve(contradictions(bent, moved), np.ones(STRETCH) / STRETCH, "valid")
        if not len(strain) or strain.max() <= MAX_STRAIN:
            return bent
        first = int(strain.argmax())
        across = (matches.base < first + STRETCH) & (matches.other > first)
        loops = across & (matches.other - matches.base > 1)
        if not loops.any():
            return bent
        matches = matches.only(~loops)


def _motions(surfaces: list[Surface], middle: np.ndarray) -> Measurements:
    """The motion from the start to the first window's middle, and on from middle to middle."""
    n = len(surfaces)
    before = np.concatenate([np.zeros((1, 3)), middle[:-1]])
    closing = np.array([surface.motion.increment for surface in surfaces])
    covariance = np.array([surface.motion.covariance for surface in surfaces])
    return Measurements(
        np.arange(n),
        np.arange(1, n + 1),
        compose(inverse(before), compose(closing, middle)),
        np.linalg.inv(covariance + np.diag(LEAST_DOUBT**2)),
    )
