"""Other images, matchers and rows of the same scene tell the same ranges."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibration.rig import Mount
from pipeline.recordings import open_recording
from stereo.disparity import DisparityMatcher
from stereo.errors import StereoError
from stereo.pair import StereoPair
from stereo.ranger import StereoRanger
from stereo.rectify import Rectifier
from stereo.scan import RangeScan
from stereo.settings import StereoSettings
from tests.conftest import OFFICE
from tests.stereo_rigs import BASELINE, F, crooked_rig, straight_rig, wall_pair
from tests.stereo_scenes import facing, see

RIG = straight_rig()
MATCHERS = ["bm", "3way", "sgbm", "hh", "hh4"]


@pytest.fixture(scope="module")
def office():
    """Rig and some pairs from all over the recording."""
    recording = open_recording(OFFICE)
    assert recording.rig is not None
    return recording.rig, [files.load() for files in recording.pairs[::40]]


def apart(a: RangeScan, b: RangeScan) -> np.ndarray:
    """By how many of the greater sigma two scans differ (n,)."""
    with np.errstate(invalid="ignore"):
        return np.abs(a.range - b.range) / np.maximum(a.sigma, b.sigma)


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_deeper_images_give_the_scan_of_their_first_eight_bits(office, bits):
    rig, pairs = office
    ranger = StereoRanger(rig)
    rng = np.random.default_rng(bits)
    errors = []
    for pair in pairs:
        # Full scale of the depth, with something below the first eight bits.
        deep = [
            np.minimum(
                (image.astype(int) << (bits - 8)) + rng.integers(0, 2 ** (bits - 8), image.shape),
                2**bits - 1,
            ).astype(np.uint16)
            for image in (pair.left, pair.right)
        ]
        deep[0][0, 0] = 2**bits - 1
        a, b = ranger(pair), ranger(StereoPair(pair.stamp, *deep))
        assert np.mean(np.isnan(a.range) == np.isnan(b.range)) > 0.9
        both = np.isfinite(a.range) & np.isfinite(b.range)
        errors.append(b.range[both] / a.range[both] - 1.0)
    errors = np.concatenate(errors)
    assert len(errors) > 500
    assert np.median(np.abs(errors)) < 0.01
    assert abs(np.median(errors)) < 0.002


@pytest.mark.parametrize("rig", [RIG, crooked_rig(5.0)])
def test_colour_equals_grey_and_deep_colour_shows_in_eight_bits(rig):
    grey = see(rig, [facing(1.6)], noise=1.0)
    colour = StereoPair(0, *(cv2.cvtColor(i, cv2.COLOR_GRAY2BGR) for i in (grey.left, grey.right)))
    deep = StereoPair(0, *(image.astype(np.uint16) * 257 for image in (colour.left, colour.right)))
    ranger = StereoRanger(rig)
    expected = ranger(grey)
    for pair in (colour, deep):
        frame = ranger.frame(pair)
        assert np.array_equal(frame.scan.range, expected.range, equal_nan=True)
        assert np.array_equal(frame.scan.sigma, expected.sigma, equal_nan=True)
        points, rgb = ranger.points(frame, pair.left)
        assert rgb.dtype == np.uint8
        assert rgb.max() > 200
        assert len(points) == len(rgb)


@pytest.mark.parametrize("matcher", MATCHERS)
@pytest.mark.parametrize("rows_joined", [1, 2])
@pytest.mark.parametrize("depth", [1.2, 2.1])
def test_every_matcher_answers_on_a_wall_within_sigma(matcher, rows_joined, depth):
    ranger = StereoRanger(RIG, StereoSettings(matcher=matcher, rows_joined=rows_joined))
    scan = ranger(see(RIG, [facing(depth)], noise=1.0))
    answered = np.isfinite(scan.range)
    assert answered.mean() > 0.85
    off = np.abs(scan.range - depth / np.cos(scan.bearing))[answered] / scan.sigma[answered]
    assert (off < 1.0).mean() > 0.68
    assert off.max() < 4.0


@pytest.mark.parametrize("matcher", MATCHERS)
def test_ranges_keep_to_fractions_of_a_pixel(matcher):
    """SGBM draws disparities to whole pixels, by up to 0.3 px: ranges must not follow."""
    ranger = StereoRanger(RIG, StereoSettings(matcher=matcher))
    biases = []
    for step, true in enumerate(np.arange(14.0, 15.0, 0.125)):
        scan = ranger(StereoPair(0, *wall_pair(F * BASELINE / true, step)))
        found = F * BASELINE / (scan.range * np.cos(scan.bearing))
        biases.append(np.nanmedian(found) - true)
    assert np.abs(biases).max() < 0.1
    assert abs(np.mean(biases)) < 0.05


def test_joined_rows_agree_with_single_ones(office):
    rig, pairs = office
    one, two = (StereoRanger(rig, StereoSettings(rows_joined=rows)) for rows in (1, 2))
    off = []
    for pair in pairs:
        a, b = one(pair), two(pair)
        both = np.isfinite(a.range) & np.isfinite(b.range)
        off.append(apart(a, b)[both])
    off = np.concatenate(off)
    assert len(off) > 500
    assert (off < 1.0).mean() > 0.95
    assert (off < 4.0).mean() > 0.99


@pytest.mark.parametrize("matcher", ["bm", "3way", "sgbm"])
def test_the_band_alone_tells_what_the_whole_image_does(office, matcher):
    rig, pairs = office
    settings = StereoSettings(matcher=matcher, disparities=32, height_max=0.5)
    band, whole = StereoRanger(rig, settings), StereoRanger(rig, settings)
    whole.rectify = Rectifier(rig, (-1e3, 1e3), 0.1, band.camera.rows_joined)
    whole.camera = whole.rectify.camera
    whole.match = DisparityMatcher(whole.camera, settings)
    assert band.camera.height < 0.6 * whole.camera.height
    far, answered = 0, 0
    for pair in pairs:
        a, b = band(pair), whole(pair)
        both = np.isfinite(a.range) & np.isfinite(b.range)
        answered += int(both.sum())
        far += int((apart(a, b)[both] > 2.0).sum())
        assert np.mean(np.isnan(a.range) != np.isnan(b.range)) < 0.10
    assert answered > 500
    assert far <= 0.005 * answered


@pytest.mark.parametrize("matcher", MATCHERS)
def test_a_narrow_band_is_matched_or_refused(matcher):
    narrow = {"matcher": matcher, "disparities": 16, "height_min": 0.59, "height_max": 0.61}
    scan = StereoRanger(RIG, StereoSettings(**narrow, rows_joined=2))(see(RIG, [facing(2.5)], 1.0))
    assert not np.isposinf(scan.range).any()
    level = straight_rig(Mount(height=0.6))
    with pytest.raises(StereoError, match="no image row can hold an obstacle"):
        StereoRanger(level, StereoSettings(**narrow, rows_joined=4))
