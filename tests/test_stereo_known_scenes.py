"""Whole pairs of scenes whose ranges are known: they come out within their sigma."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from calibration.rig import Mount, minibee
from stereo.pair import StereoPair
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan
from tests.stereo_rigs import BASELINE, F, straight_rig, wall_pair
from tests.stereo_scenes import UP, Sheet, facing, grain, see, well_inside

RIG = straight_rig()
RANGER = StereoRanger(RIG)
NOISE = 1.0  # grey levels
# The outline of a box 1.3 m away is known to two columns [m].
OUTLINE = 2 * 1.3 / F
MOUNTS = [
    Mount(height=0.6, pitch=math.radians(10.0)),
    Mount(height=0.6, roll=math.radians(8.0)),
    Mount(height=0.6, pitch=math.radians(15.0), roll=math.radians(-6.0), yaw=0.3),
]


def slanted(x: float, angle: float, seed: int = 0) -> Sheet:
    """A wall through (x, 0), turned by an angle from facing the robot."""
    c, s = math.cos(angle), math.sin(angle)
    return Sheet((x - 4.0 * s, -4.0 * c, -4.0), (s, c, 0.0), UP, (8.0, 8.0), grain(seed))


def to_slanted(scan: RangeScan, x: float, angle: float) -> np.ndarray:
    """True ranges (n,) from a sensor at the robot's origin; NaN where the wall is not ahead."""
    towards = np.cos(scan.bearing + angle)
    return np.where(towards > 0.05, x * math.cos(angle) / towards, np.nan)


def off(scan: RangeScan, truth: np.ndarray) -> np.ndarray:
    """|error| over sigma of every finite range that has a truth."""
    both = np.isfinite(scan.range) & np.isfinite(truth)
    assert both.mean() > 0.35
    return np.abs(scan.range - truth)[both] / scan.sigma[both]


def shared(scan: RangeScan, x: float) -> np.ndarray:
    """Columns (n,) in which both cameras see what is `x` ahead."""
    return scan.bearing < math.atan2(159.5 - F * BASELINE / x, F)


def test_walls_at_all_distances_and_angles_keep_their_sigma():
    rng = np.random.default_rng(2)
    offs = []
    for number in range(24):
        x, angle = rng.uniform(0.9, 2.6), math.radians(rng.uniform(-50.0, 50.0))
        scan = RANGER(see(RIG, [slanted(x, angle, number)], NOISE, number))
        truth = to_slanted(scan, x, angle)
        offs.append(off(scan, np.where(well_inside(scan, truth), truth, np.nan)))
    offs = np.concatenate(offs)
    assert (offs < 1.0).mean() > 0.68
    assert (offs < 2.0).mean() > 0.95
    assert offs.max() < 4.0


@hypothesis_settings(max_examples=15)
@given(st.floats(0.8, 3.0), st.integers(0, 99))
def test_a_wall_straight_ahead_keeps_its_sigma(x, seed):
    scan = RANGER(see(RIG, [facing(x, seed=seed)], NOISE, seed))
    offs = off(scan, np.where(shared(scan, x), x / np.cos(scan.bearing), np.nan))
    # All columns share one fraction of a pixel, and with it how SGBM errs at that fraction.
    assert np.mean(offs) < 1.5
    assert offs.max() < 4.0


@pytest.mark.parametrize("height", [(0.0, 0.5), (0.0, 1.3), (0.75, 1.5)])
def test_a_box_before_a_wall(height):
    """Standing, tall and hung from above."""
    box = facing(1.3, (-0.25, 0.25), height, seed=2)
    scan = RANGER(see(RIG, [facing(2.8, seed=1), box], NOISE))
    side = np.abs(1.3 * np.tan(scan.bearing))
    inside = side < 0.25
    truth = np.where(inside, 1.3, 2.8) / np.cos(scan.bearing)
    clear = np.abs(side - 0.25) > OUTLINE
    assert off(scan, np.where(clear, truth, np.nan)).max() < 4.0
    assert np.isfinite(scan.range[inside]).mean() > 0.8
    assert np.isfinite(scan.range[~inside]).mean() > 0.8


@pytest.mark.parametrize("width", [0.04, 0.06, 0.10])
def test_a_post_before_a_textured_wall_is_seen_though_nothing_in_view_is_blank(width):
    rig = minibee()
    assert rig.mount is not None
    ranger = StereoRanger(rig)
    x, wall = 1.3 + rig.mount.x, 3.0 + rig.mount.x
    for seed in range(2):
        y = -0.2 + 0.4 * seed
        post = facing(x, (y - width / 2, y + width / 2), (0.0, 1.5), seed=20 + seed)
        scan = ranger(see(rig, [facing(wall, seed=seed), post], NOISE, seed))
        at = 1.3 * np.tan(scan.bearing) + rig.mount.y
        columns = np.abs(at - y) < width / 2
        truth = 1.3 / np.cos(scan.bearing)
        assert not (scan.range > 1.1 * truth)[columns].any()
        assert (np.abs(scan.range - truth) < 0.05)[columns].mean() > 0.9


@pytest.mark.parametrize(("low", "high"), [(1.2, 2.5), (2.5, 1.2)])
def test_of_two_depths_in_a_column_the_nearer_counts_wherever_it_is(low, high):
    sheets = [facing(low, z=(0.0, 0.6), seed=3), facing(high, z=(0.6, 2.0), seed=4)]
    scan = RANGER(see(RIG, sheets, NOISE))
    # Further left the right camera does not see what is near, only what is far.
    near = shared(scan, 1.2)
    assert np.isfinite(scan.range[near]).mean() > 0.9
    expected = 1.2 / np.cos(scan.bearing)
    assert np.nanmax((np.abs(scan.range - expected) / scan.sigma)[near]) < 4.0


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_pitched_and_rolled_rig_sees_walls_and_boxes_where_they_are(mount):
    rig = straight_rig(mount)
    box = facing(1.3, (-0.25, 0.25), (0.0, 1.3), seed=2)
    scan = StereoRanger(rig)(see(rig, [facing(2.6, seed=1), box], NOISE))
    at = scan.bearing + scan.origin[2]
    side = np.abs(1.3 * np.tan(at))
    truth = np.where(side < 0.25, 1.3, 2.6) / np.cos(at)
    clear = np.abs(side - 0.25) > OUTLINE
    assert off(scan, np.where(clear, truth, np.nan)).max() < 4.0
    assert np.isfinite(scan.range[clear]).mean() > 0.7


@hypothesis_settings(max_examples=12)
@given(st.floats(1.4, 3.0), st.integers(1, 12), st.integers(0, 99))
def test_a_right_image_shifted_brings_all_nearer_by_as_much_disparity(depth, shift, seed):
    left, right = wall_pair(depth, seed)
    moved = cv2.copyMakeBorder(right[:, shift:], 0, 0, 0, shift, cv2.BORDER_REFLECT)
    a, b = RANGER(StereoPair(0, left, right)), RANGER(StereoPair(0, left, moved))
    both = np.isfinite(a.range) & np.isfinite(b.range)
    assert both.mean() > 0.6
    factor = F * BASELINE / np.cos(a.bearing)
    apart = (factor / b.range - factor / a.range)[both]
    assert np.median(apart) == pytest.approx(shift, abs=0.03)
    assert (np.abs(apart - shift) < 0.25).mean() > 0.98
