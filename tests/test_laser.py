"""Readings of a laser as a RangeScan: bearings, maximum readings, usable range, sigma."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.recordings.laser import Beams, LaserSettings, maximum_reading, range_scan


@pytest.mark.parametrize(
    ("n", "first", "last"), [(180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90)]
)
def test_flaser_beams_lie_as_carmen_and_gmapping_have_them(n, first, last):
    bearing = np.degrees(Beams.flaser(n).bearing)
    assert (bearing[0], bearing[-1]) == pytest.approx((first, last))
    assert np.diff(bearing) == pytest.approx(180.0 / (n if n % 2 == 0 else n - 1))


@pytest.mark.parametrize(
    ("readings", "limit"),
    [
        ([[1.0, 81.83], [81.83, 2.0]], 80.0),  # a SICK in centimetres
        ([[1.0, 81.91], [2.0, 81.83]], 80.0),  # its largest code stands once only
        ([[1.0, 8.191], [8.183, 8.191]], 8.18),  # in millimetres
        ([[1.0, 50.0], [50.0, 50.0]], 50.0),
        ([[1.0, 7.31], [2.0, 3.0]], math.nextafter(7.31, 8.0)),  # never out of range
        ([[math.nan, 5.0], [5.0, math.inf]], 5.0),
        ([], math.nextafter(0.0, 1.0)),
    ],
)
def test_the_maximum_reading_is_found(readings, limit):
    assert maximum_reading([np.array(r) for r in readings]) == limit


def test_a_reading_beyond_the_usable_range_means_free_up_to_it():
    readings = np.array([1.0, 5.0, 12.0, 30.0, math.nan, math.inf])
    beams = Beams.flaser(6)
    scan = range_scan(0, (0, 0, 0), beams, readings, 20.0, LaserSettings(), usable=6.0)
    assert scan.max_range == 6.0
    assert scan.range.tolist()[:3] == [1.0, 5.0, math.inf]
    assert np.isnan(scan.range[3:]).all()


def test_sigma_joins_floor_and_noise():
    laser = LaserSettings(floor=0.03, noise=0.02)
    scan = range_scan(0, (0, 0, 0), Beams.flaser(2), np.array([2.0, 9.0]), 5.0, laser)
    assert scan.sigma[0] == pytest.approx(0.05)
    assert np.isnan(scan.sigma[1])


def test_the_field_of_view_crops_and_spreads():
    def bearings(beams: Beams, angle: float | None) -> list[float]:
        laser = LaserSettings(field_of_view=angle)
        ones = np.ones(beams.bearing.size)
        scan = range_scan(0, (0, 0, 0), beams, ones, 5.0, laser)
        assert scan.range.size == scan.sigma.size == scan.bearing.size
        return np.degrees(scan.bearing).tolist()

    assert bearings(Beams.flaser(181), 66.0) == pytest.approx(list(range(-33, 34)))
    assert bearings(Beams.flaser(3), None) == pytest.approx([-90, 0, 90])
    assert bearings(Beams.flaser(3), 240.0) == pytest.approx([-120, 0, 120])
    stated = Beams(np.radians([-90.0, 0.0, 90.0]), 8.0, False)
    assert bearings(stated, 240.0) == pytest.approx([-90, 0, 90])
    assert bearings(stated, 90.0) == pytest.approx([0])
