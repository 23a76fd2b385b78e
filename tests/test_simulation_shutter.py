"""When each row looks: motion blur, rolling shutter and cameras out of step, against geometry.

The world of these tests is a sky without end, dark to the right of a bearing and bright to its
left (a soft edge a few pixels wide), so that a turning robot moves it by angles known beforehand.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from calibration.rig import StereoRig, minibee
from simulation import renderer as module
from simulation.faults import CameraFaults
from simulation.renderer import StereoRenderer, placed, standing
from simulation.tracer import Tracer

RATE = 1.2  # rad/s, to the left: the edge moves to the right in the image


SOFTNESS = 80.0  # 1/rad


class Sky(Tracer):
    """Light near 0.6 to the left of azimuth 0, 0.1 to its right; `depth` is the time itself."""

    def __init__(self) -> None:
        pass

    def linear(self, rays: np.ndarray, angle: float, time: float = 0.0) -> np.ndarray:
        azimuth = np.arctan2(rays[..., 4], rays[..., 3])
        return (0.35 + 0.25 * np.tanh(SOFTNESS * azimuth)).mean(axis=1)

    def depth(self, rays: np.ndarray, time: float = 0.0) -> np.ndarray:
        return np.full(rays.shape[:-1], time, np.float32)


class Clock(Sky):
    """A world that is as bright as it is late."""

    def linear(self, rays: np.ndarray, angle: float, time: float = 0.0) -> np.ndarray:
        return np.full(len(rays), time)


def rig() -> StereoRig:
    return minibee().scaled(0.25)


def turning(times: np.ndarray) -> np.ndarray:
    return np.stack([0 * times, 0 * times, RATE * times], axis=-1)


def edge(light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and width of the edge in every row: mean and deviation of its derivative [px]."""
    step = -np.diff(light.astype(float), axis=1)
    column = np.arange(step.shape[1]) + 0.5
    mean = step @ column / step.sum(axis=1)
    return mean, np.sqrt((step * (column - mean[:, None]) ** 2).sum(axis=1) / step.sum(axis=1))


def place(angle: float) -> float:
    """Column that shows the bearing `angle` rad."""
    return rig().left.cx - rig().left.fx * math.tan(angle)


def light(time: float = 0.0, samples: int = 2, **faults: Any):
    return StereoRenderer(
        Sky(), rig(), samples=samples, faults=CameraFaults(**faults)
    ).light(turning, time)  # fmt: skip


def test_an_open_shutter_widens_an_edge_by_the_speed_times_its_time():
    sharp_at, sharp = edge(light().left)
    for shutter in (0.02, 0.05, 0.08):
        blurred_at, blurred = edge(light(shutter=shutter).left)
        width = np.sqrt(12.0 * (blurred**2 - sharp**2))  # of a box
        assert width.mean() == pytest.approx(rig().left.fx * RATE * shutter, rel=0.04)
        # The stamp lies in the middle of the exposure.
        np.testing.assert_allclose(blurred_at, sharp_at, atol=0.05)


def test_blur_averages_light_and_not_grey():
    across = light(shutter=0.08).left
    assert across.sum() == pytest.approx(light().left.sum(), rel=1e-4)


def test_a_shutter_that_is_hardly_open_changes_nothing():
    still, quick = light(0.1), light(0.1, shutter=1e-9)
    np.testing.assert_allclose(quick.left, still.left, atol=1e-6)
    np.testing.assert_allclose(quick.right, still.right, atol=1e-6)


def test_rolling_rows_shear_an_edge_under_rotation():
    readout = 0.04
    at, width = edge(light(readout=readout).left)
    row = np.arange(120)
    expected = [place(-RATE * readout * ((v + 0.5) / 120 - 0.5)) for v in row]
    np.testing.assert_allclose(at, expected, atol=0.05)
    assert at[-1] - at[0] == pytest.approx(rig().left.fx * RATE * readout, rel=0.03)
    np.testing.assert_allclose(width, edge(light().left)[1].mean(), rtol=0.02)


def test_the_late_camera_sees_what_it_would_see_later():
    together, late, later = light(0.1), light(0.1, skew=0.05), light(0.15)
    assert (late.left == together.left).all()
    assert (late.right == later.right).all()
    moved = edge(late.right)[0] - edge(together.right)[0]
    np.testing.assert_allclose(moved, place(-RATE * 0.15) - place(-RATE * 0.1), atol=0.05)


def test_movers_are_seen_at_the_time_of_the_row():
    faults = CameraFaults(shutter=0.01, readout=0.12, skew=0.03)
    renderer = StereoRenderer(Clock(), rig(), samples=1, faults=faults)
    pair = renderer.light(turning, 5.0)
    rows = 5.0 + 0.12 * ((np.arange(120) + 0.5) / 120 - 0.5)
    late = 0.12 * 0.5 * module.ROWS / 120  # a block of rows is one moment to the scene
    np.testing.assert_allclose(pair.left[:, 0], rows, atol=late)
    np.testing.assert_allclose(pair.right[:, 0], rows + 0.03, atol=late)
    assert pair.left[:, 0].mean() == pytest.approx(5.0, abs=1e-6)
    np.testing.assert_allclose(renderer.depth(turning, 5.0)[:, 0], rows, atol=late)


def test_rays_start_and_point_as_their_row_and_sample_are_placed():
    chance = np.random.default_rng(3)
    directions = chance.standard_normal((4, 5, 2, 3)).astype(np.float32)
    rotations = chance.standard_normal((4, 2, 3, 3)).astype(np.float32)
    positions = chance.standard_normal((4, 2, 3)).astype(np.float32)
    rays = placed(directions, rotations, positions)
    turned = np.einsum("hkij,hwkj->hwki", rotations, directions)
    np.testing.assert_allclose(rays[..., 3:], turned, rtol=1e-4, atol=1e-5)
    assert (rays[..., :3] == positions[:, None]).all()


def test_a_standing_robot_stays():
    assert standing(np.array([1.0, 2.0, 3.0]))(np.zeros(2)).tolist() == [[1.0, 2.0, 3.0]] * 2
