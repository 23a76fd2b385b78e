"""Filming: all pairs of a drive with their truth, rendered on both cores, delivered in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from simulation.drive import Drive
from simulation.renderer import StereoRenderer
from simulation.route import Route
from simulation.true_ranges import TrueRanger

WORKERS = 2  # pairs rendered at once; within a pair the cameras share the cores too
AHEAD = 4  # pairs that may wait for the one who takes them


@dataclass(frozen=True)
class Shot:
    """One pair: left, right (H, W) uint8; depth (H, W) float32 m as in `RenderedPair`, None where
    not wanted; range, texture (b,) as in `TrueScans`."""

    left: np.ndarray
    right: np.ndarray
    depth: np.ndarray | None
    range: np.ndarray
    texture: np.ndarray


def film(
    renderer: StereoRenderer, ranger: TrueRanger, route: Route, trip: Drive, depth: bool
) -> Iterator[Shot]:
    """The pairs of `trip`, driven along `route`; the noise is keyed by the renderer's seed."""

    def shoot(frame: int) -> Shot:
        time = float(trip.times[frame])
        light = renderer.light(route.poses, time)
        left, right = renderer.sensor.expose(light, renderer.seed, frame)
        grey = renderer.sensor.noise_free(light.left, 0)
        truth = ranger(trip.poses[frame], grey, time)
        return Shot(left, right, renderer.depth(route.poses, time) if depth else None, *truth)

    waiting: deque[Future[Shot]] = deque()
    pool = ThreadPoolExecutor(WORKERS)
    try:
        for frame in range(len(trip.stamps)):
            waiting.append(pool.submit(shoot, frame))
            if len(waiting) > AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
