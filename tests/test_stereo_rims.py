"""What a camera did not see is black after rectification: it must not match itself."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibration.rig import CameraModel, Mount, StereoRig
from stereo.disparity import DisparityMatcher
from stereo.ranger import StereoRanger
from stereo.rectify import Rectifier
from stereo.settings import StereoSettings
from tests.stereo_rigs import BASELINE, SHAPE, SIZE, straight_rig, texture
from tests.stereo_scenes import facing, see

# Barrel and pincushion, straight and toed in: up to a sixth of the image is rim.
LENSES = [((-0.3, 0.09), 0.0), ((-0.3, 0.09), 3.0), ((0.2, 0.05), 3.0), ((0.2, 0.05), -3.0)]
WHITE = np.full(SHAPE, 255, np.uint8)


def bent_rig(k: tuple[float, float], toe_deg: float) -> StereoRig:
    """Strongly distorted lenses; the right camera turned about its columns."""
    lens = CameraModel(200.0, 200.0, 159.5, 119.5, "radtan", (*k, 0.0, 0.0))
    R, _ = cv2.Rodrigues(np.radians([0.0, toe_deg, 0.0]))
    return StereoRig(SIZE, lens, lens, R, R @ [-BASELINE, 0.0, 0.0], mount=Mount(height=0.6))


@pytest.mark.parametrize(("k", "toe"), LENSES)
def test_seen_columns_lie_inside_what_each_camera_saw(k, toe):
    rectify = Rectifier(bent_rig(k, toe), (0.1, 1.2), nearest=0.5)
    for side, image in enumerate(rectify(WHITE, WHITE)):
        inside = image == 255
        assert inside.mean() < 0.95
        first, last = rectify.seen[2 * side : 2 * side + 2]
        u = np.arange(inside.shape[1])
        seen = (u >= first[:, None]) & (u < last[:, None])
        assert not (seen & ~inside).any()
        # Little else is lost: the outline, and the lesser corner of rows that show only two.
        assert seen.sum() > 0.88 * inside.sum()
        # Neither a block nor a gradient at what counts as seen reaches the rim.
        assert not (
            seen & cv2.dilate((~inside).astype(np.uint8), np.ones((5, 5))).astype(bool)
        ).any()


def test_without_a_rim_every_column_is_seen():
    seen = Rectifier(straight_rig(), (0.1, 1.2), nearest=0.5).seen
    assert (seen == np.array([[0], [SIZE[0]], [0], [SIZE[0]]])).all()


@pytest.mark.parametrize(("k", "toe"), LENSES)
@pytest.mark.parametrize("grey", [60, 255])
def test_a_rim_around_a_blank_view_gives_no_range(k, toe, grey):
    rig = bent_rig(k, toe)
    blank = facing(2.0, grey=np.full((4, 4), grey, np.uint8))
    scan = StereoRanger(rig)(see(rig, [blank], noise=0.4))
    assert np.isnan(scan.range).all()


@pytest.mark.parametrize(("k", "toe"), LENSES)
def test_a_rim_around_a_wall_does_not_disturb_it(k, toe):
    rig = bent_rig(k, toe)
    scan = StereoRanger(rig)(see(rig, [facing(1.8)], noise=1.0))
    answered = np.isfinite(scan.range)
    off = np.abs(scan.range - 1.8 / np.cos(scan.bearing + scan.origin[2])) / scan.sigma
    assert answered.mean() > 0.7
    assert off[answered].max() < 4.0


@pytest.mark.parametrize("matcher", ["bm", "3way", "sgbm", "hh", "hh4"])
def test_no_match_lies_outside_the_right_image(matcher):
    camera = Rectifier(straight_rig(), (0.1, 1.2), nearest=0.5).camera
    match = DisparityMatcher(camera, StereoSettings(matcher=matcher))
    flat = np.full(SHAPE, 128, np.uint8)
    for left, right in ((texture(SHAPE, 1), texture(SHAPE, 2)), (flat, flat)):
        disparity = match(left, right)
        assert disparity.shape == SHAPE
        assert disparity.dtype == np.int16
        assert (disparity / 16.0 <= np.arange(SIZE[0])).all()


def test_near_things_that_only_the_left_camera_sees_are_not_answered():
    # 0.9 m are 33 px: further left the right image has ended.
    rig = straight_rig()
    scan = StereoRanger(rig)(see(rig, [facing(0.9)], noise=1.0))
    outside = np.arange(SIZE[0])[::-1] < 30
    right = np.abs(scan.range - 0.9 / np.cos(scan.bearing)) < 0.05
    assert (np.isnan(scan.range) | right)[outside].all()


def test_the_noise_of_an_image_is_not_taken_from_its_rim():
    rig = bent_rig((0.2, 0.05), 3.0)
    ranger = StereoRanger(rig)
    blank = facing(2.0, grey=np.full((4, 4), 60, np.uint8))
    scans = [ranger(see(rig, [blank], noise=3.0, seed=seed)) for seed in range(6)]
    # Some noise matches by chance; were none expected, a fifth of the columns would be answered.
    assert np.mean([scan.answered for scan in scans]) < 0.10
