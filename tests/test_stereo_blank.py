"""What shows nothing, or the same in many places, is unknown: neither an obstacle nor free."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo.ranger import StereoRanger
from stereo.scan import RangeScan
from tests.stereo_rigs import F, straight_rig
from tests.stereo_scenes import TEXEL, facing, see, well_inside

RIG = straight_rig()
RANGER = StereoRanger(RIG)
# A block and what SGBM passes on fatten whatever has texture by so many columns.
FATTER = 10
POSTS = ((-0.9, -0.6), (0.6, 0.9))


def flat(grey: int) -> np.ndarray:
    return np.full((4, 4), grey, np.uint8)


def stripes(row: np.ndarray) -> np.ndarray:
    """Upright stripes of these grey levels, one texel each."""
    return np.tile(np.clip(np.rint(row), 0, 255).astype(np.uint8), (4, 1))


def between(scan: RangeScan, x: float, y: tuple[float, float], margin: int = 0) -> np.ndarray:
    """Columns (n,) that look between two places at `x` ahead, `margin` columns inside."""
    at = x * np.tan(scan.bearing)
    return (at > y[0] + margin * x / F) & (at < y[1] - margin * x / F)


@pytest.mark.parametrize("noise", [0.5, 2.0, 4.0])
def test_a_blank_wall_between_two_posts_is_unknown(noise):
    sheets = [facing(2.0, grey=flat(128))]
    sheets += [facing(1.9, y, seed=k) for k, y in enumerate(POSTS)]
    answered = []
    for seed in range(4):
        scan = RANGER(see(RIG, sheets, noise, seed))
        blank = between(scan, 1.9, (-0.6, 0.6))
        assert not np.isposinf(scan.range[blank]).any()
        answered.append(np.isfinite(scan.range[between(scan, 1.9, (-0.6, 0.6), FATTER)]).mean())
        for y in POSTS:
            post = between(scan, 1.9, y)
            assert np.isfinite(scan.range[post]).mean() > 0.9
            truth = 1.9 / np.cos(scan.bearing[post])
            error = np.abs(scan.range[post] - truth) / scan.sigma[post]
            assert np.nanmax(error) < 4.0
    # Noise may match by chance, but rarely.
    assert np.mean(answered) < 0.03


@pytest.mark.parametrize(("noise", "chance"), [(0.5, 0.0), (2.0, 0.0), (4.0, 0.02)])
@pytest.mark.parametrize("half_width", [0.25, 0.5])
def test_the_way_through_a_blank_box_is_never_free(noise, chance, half_width):
    sides = (-half_width, half_width)
    sheets = [facing(2.5, seed=3), facing(1.3, sides, (0.0, 1.5), grey=flat(90))]
    beyond, unknown = [], []
    for seed in range(3):
        scan = RANGER(see(RIG, sheets, noise, seed))
        box = between(scan, 1.3, sides)
        assert not np.isposinf(scan.range[box]).any()
        beyond.append(np.mean(scan.range[box] > 1.1 * 1.3 / np.cos(scan.bearing[box])))
        unknown.append(np.isnan(scan.range[box]).mean())
        assert np.isfinite(scan.range[~box]).mean() > 0.7
    assert np.mean(beyond) <= chance
    assert np.mean(unknown) > 0.9


@pytest.mark.parametrize("depth", [1.2, 2.0, 2.7])
@pytest.mark.parametrize("period", [8, 10, 16, 20, 32])
@pytest.mark.parametrize("shape", ["steps", "waves"])
def test_blinds_are_unknown_rather_than_a_wrong_period_away(shape, period, depth):
    wave = np.sin(2.0 * np.pi * np.arange(period) / period)
    wave = np.sign(wave + 1e-9) if shape == "steps" else wave
    blinds = facing(depth, grey=stripes(128.0 + 70.0 * wave))
    scan = RANGER(see(RIG, [blinds], noise=1.0))
    truth = depth / np.cos(scan.bearing)
    wrong = np.abs(scan.range - truth) > 4.0 * scan.sigma
    assert wrong.mean() <= 0.02
    # Near the left border the rivals lie outside the right image: nothing tells them apart.
    inside = scan.bearing < np.arctan2(159.5 - F * (0.12 + period * TEXEL) / depth - 12, F)
    assert np.isnan(scan.range[inside]).mean() > 0.9
    assert not np.isposinf(scan.range[inside]).any()


def test_stripes_that_do_not_repeat_are_answered():
    noise = np.random.default_rng(5).normal(size=(1, 1600)).astype(np.float32)
    row = cv2.GaussianBlur(noise, (0, 0), 2.0)[0]
    for depth in (1.2, 2.0, 2.7):
        scan = RANGER(see(RIG, [facing(depth, grey=stripes(128 + 60 * row / row.std()))], 1.0))
        answered = np.isfinite(scan.range)
        assert answered.mean() > 0.5
        truth = depth / np.cos(scan.bearing)
        judged = answered & well_inside(scan, truth)
        off = np.abs(scan.range - truth)[judged] / scan.sigma[judged]
        # Rows that are all alike support each other less than sigma believes.
        assert (off < 4.0).mean() > 0.95
        assert off.max() < 6.0
