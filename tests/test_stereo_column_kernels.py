"""The kernels from disparities to ranges equal plain numpy, whatever they are given."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stereo.column_kernels import (
    BEYOND_NOISE,
    EVIDENCE,
    FRONT,
    LEAST_ALIKE,
    LONELY,
    NEIGHBOURS,
    confirm,
    gather,
    nearest_standing,
    trim_outlines,
)
from tests.stereo_rigs import level_camera

ROWS, COLUMNS, BINS = 12, 9, 17
CAMERA = level_camera(COLUMNS, ROWS)
INTRINSICS = np.array([20.0, 15.0, CAMERA.cx, CAMERA.cy, 0.5])  # f, f_rows, cx, cy, baseline

disparities = arrays(np.int16, (ROWS, COLUMNS), elements=st.integers(-16, 16 * 20))
slopes = arrays(np.int16, (ROWS, COLUMNS), elements=st.integers(-300, 300))
limits = arrays(np.int32, (4, ROWS), elements=st.integers(0, COLUMNS))
ranges_of = arrays(
    np.float64, 24, elements=st.one_of(st.floats(0.3, 4.0), st.sampled_from([np.nan, np.inf, 1.0]))
)


def gather_twin(disparity, gradients, seen, rotation, height, band, noise):
    f, f_rows, cx, cy, baseline = INTRINSICS
    low, high, tilt, doubt_of_match = band
    v, u = np.indices(disparity.shape)
    d = np.where(disparity > 0, disparity, 16) / 16.0
    valid = (disparity > 0) & (u >= seen[0][:, None]) & (u < seen[1][:, None])
    valid &= (u - d >= seen[2][:, None]) & (u - d < seen[3][:, None])
    Z = f * baseline / d
    rays = np.stack([(u - cx) / f, (v - cy) / f_rows, np.ones(u.shape)])
    X, Y, up = Z * np.tensordot(rotation, rays, 1)
    up = up + height
    doubt = 3.0 * np.hypot(Z * tilt, height * doubt_of_match / d)
    valid &= (up >= np.maximum(low, doubt)) & (up <= high) & (X > 0)
    column = np.rint(cx - f * Y / np.where(X > 0, X, 1.0)).astype(int)
    valid &= (column >= 0) & (column < COLUMNS)
    where = column[valid], np.minimum(np.rint(d[valid]).astype(int), BINS - 1)
    near = 1.0 / np.hypot(X, Y)[valid]
    energy = gradients[valid].astype(float) ** 2
    weight = np.minimum(energy, (3.0 * noise) ** 2)

    def histogram(values):
        sums = np.zeros((COLUMNS, BINS))
        np.add.at(sums, where, values)
        return sums

    closest = np.zeros(COLUMNS)
    np.maximum.at(closest, column[valid], near)
    sums = (np.ones(len(near)), weight / noise**2 - 1.0, weight, weight * near, energy)
    return [histogram(values) for values in sums], closest


@hypothesis_settings(max_examples=40)
@given(disparities, slopes, limits, st.floats(-0.3, 0.3), st.floats(1.0, 100.0))
def test_gathered_pixels(disparity, gradients, seen, pitch, noise):
    c, s = math.cos(pitch), math.sin(pitch)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    rotation, band = CAMERA.rotation @ tilt, np.array([0.1, 1.2, 0.01, 0.25])
    seen[1], seen[3] = np.maximum(seen[:2], seen[2:])  # most rows are seen somewhere
    found, closest = gather(
        disparity, gradients, seen, rotation, INTRINSICS, 0.6, band, noise, BINS
    )
    expected, expected_closest = gather_twin(disparity, gradients, seen, rotation, 0.6, band, noise)
    for a, b in zip(found, expected, strict=True):
        assert np.allclose(a, b)
    assert np.allclose(closest, expected_closest)


def standing_twin(filled, evidence, weights, nearness, energy, needed, veto, one_surface):
    columns = len(filled)
    ranges, support, outline = np.full(columns, np.nan), np.zeros(columns), np.zeros(columns)
    for u in range(columns):
        three = slice(max(u - 1, 0), u + 2)
        blank = None
        for d in np.flatnonzero(filled[u])[::-1]:
            if d == 0 or (blank is not None and blank - d > max(1.0, one_surface * d)):
                break
            window = three, slice(max(d - 2, 0), d + 1)
            pixels, found = filled[window].sum(), evidence[window].sum()
            wanted = max(EVIDENCE * needed[d], BEYOND_NOISE * math.sqrt(2 * pixels))
            if found < wanted or evidence[three, d - 1 : d + 1].sum() < FRONT * wanted:
                if blank is None and filled[three, d - 1 : d + 1].sum() >= veto * needed[d]:
                    blank = d
                continue
            peak = max(
                (p for p in (d, d - 1) if p > 0), key=lambda p: weights[three, p - 1 : p + 1].sum()
            )
            if blank is not None and blank - peak > max(1.0, one_surface * peak):
                break
            surface = three, slice(peak - 1, peak + 1)
            ranges[u] = weights[surface].sum() / nearness[surface].sum()
            support[u], outline[u] = pixels, energy[u, peak - 1 : peak + 1].sum()
            break
    return ranges, support, outline


@hypothesis_settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 30.0), st.floats(0.2, 3.0), st.floats(0.0, 0.9))
def test_nearest_that_stands(seed, needed, veto, empty):
    rng = np.random.default_rng(seed)
    filled = rng.integers(1, 12, (COLUMNS, BINS)).astype(np.int32)
    filled[rng.random(filled.shape) < empty] = 0
    share = 9.0 * rng.random(filled.shape) ** 3  # mean weight of a pixel, in units of the noise
    weights = filled * share
    near = weights * np.maximum(np.arange(BINS), 0.5) / 10.0
    sums = (filled, filled * (share - 1.0), weights, near, 2.0 * weights)
    arguments = (*sums, np.full(BINS, needed), veto, 0.1)
    for found, expected in zip(
        nearest_standing(*arguments), standing_twin(*arguments), strict=True
    ):
        assert np.allclose(found, expected, equal_nan=True)


def trim_twin(ranges, outline, reach, step):
    trimmed = ranges.copy()
    columns = len(ranges)
    for u in np.flatnonzero(np.isfinite(ranges)):
        r = ranges[u]
        for side in (-1, 1):
            beyond = u + side
            if not 0 <= beyond < columns or ranges[beyond] < r * step:
                continue
            inward = [u - side * k for k in range(reach) if 0 <= u - side * k < columns]
            alike = [abs(ranges[at] - r) <= (step - 1.0) * r for at in inward]
            inward = inward[: alike.index(False)] if False in alike else inward
            trimmed[inward[: int(np.argmax(outline[inward]))]] = np.nan
    return trimmed


@given(ranges_of, arrays(np.float64, 24, elements=st.floats(0.0, 9.0)), st.integers(1, 5))
def test_trimmed_outlines(ranges, outline, reach):
    found = trim_outlines(ranges, outline, reach, 1.1)
    assert np.array_equal(found, trim_twin(ranges, outline, reach, 1.1), equal_nan=True)


def test_what_fattens_a_surface_is_trimmed_up_to_its_strongest_column():
    ranges = np.array([2.0] * 8 + [1.0] * 8 + [np.nan] * 4)
    outline = np.ones(20)
    outline[[10, 14]] = 9.0  # two columns inside one end, one inside the other
    trimmed = trim_outlines(ranges, outline, 4, 1.1)
    assert np.flatnonzero(np.isnan(trimmed)).tolist() == [8, 9, 15, 16, 17, 18, 19]
    # The wall behind ends at something nearer: it is hidden there, not fattened.
    assert (trimmed[:8] == 2.0).all()


def confirm_twin(ranges, factor, one_surface):
    confirmed, roughness = ranges.copy(), np.zeros(len(ranges))
    with np.errstate(divide="ignore"):
        disparity = factor / ranges
    for u in np.flatnonzero(np.isfinite(ranges)):
        sides = disparity[max(u - NEIGHBOURS, 0) : u], disparity[u + 1 : u + 1 + NEIGHBOURS]
        off = [abs(side[side > 0] - disparity[u]) for side in sides]
        alike = np.concatenate(off) <= max(1.0, one_surface * disparity[u])
        if alike.sum() < LEAST_ALIKE:
            confirmed[u] = np.nan
        medians = [np.median(side) for side in off if len(side) >= LEAST_ALIKE]
        roughness[u] = min(medians, default=LONELY)
    return confirmed, roughness


@given(ranges_of, st.floats(1.0, 60.0))
def test_confirmed_ranges(ranges, factor):
    factors = np.linspace(factor, 1.2 * factor, len(ranges))
    for found, expected in zip(
        confirm(ranges, factors, 0.1), confirm_twin(ranges, factors, 0.1), strict=True
    ):
        assert np.allclose(found, expected, equal_nan=True)
