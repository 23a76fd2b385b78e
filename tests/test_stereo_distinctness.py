"""How far a match stands out from its rivals, and what an image's noise is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from stereo.columns import DISTINCT
from stereo.distinctness import (
    GROUP,
    LEAST,
    LOCKING,
    OWN,
    REACH,
    ROWS,
    SAMPLING,
    TILT,
    margins,
)
from stereo.image_noise import BLOCK, MOST, SMOOTHEST, gradient_noise
from stereo.image_noise import LEAST as LEAST_NOISE
from tests.stereo_rigs import texture

WIDTH, HEIGHT, BINS = 64, 16, 24
# No floor in view: all rows look up, and all that stands is high.
NO_FLOOR, HIGH = np.array([0.0, 0.0, -5.0]), np.array([1.0, 1.0])


def least_costs(costs: np.ndarray, winner: float) -> tuple[float, float]:
    """Of the winner, and of its rivals between whole disparities."""
    d = np.arange(len(costs))
    own = abs(d - winner) <= OWN
    lowered = costs.copy()
    for k in range(1, len(costs) - 1):
        sides = costs[[k - 1, k + 1]]
        if np.isfinite(sides).all() and costs[k] <= sides.min():
            lowered[k] = max(0.0, costs[k] - np.ptp(sides) / 2.0)
    finite = costs[np.isfinite(costs)]
    floor = max(1.0, SAMPLING * finite.mean()) if len(finite) else 1.0
    return max(floor, min(costs[own], default=np.inf)), min(lowered[~own], default=np.inf)


def window_costs(left, right, rows, first, last, u, d) -> list[float]:
    """Summed differences a pixel left of the column, right of it and of both."""
    if first < 0 or last - d > left.shape[1] or first - d < 0:
        return [np.inf] * 3
    window = left[rows, first:last].astype(int) - right[rows, first - d : last - d]
    by_column = abs(window).sum(axis=0)
    before, after = by_column[: u + 1 - first], by_column[u + 1 - first :]
    return [
        before.mean() if len(before) > LEAST else np.inf,
        after.mean() if len(after) >= LEAST else np.inf,
        by_column.mean(),
    ]


def floor_costs(left, right, rows, first, last, u, floor) -> np.ndarray:
    costs = np.full(3, np.inf)
    for shift in range(-TILT, TILT + 1):
        seen = []
        for v in rows:
            d = round(floor[0] * u + floor[1] * v + floor[2]) + shift
            if d >= 0 and first - d >= 0 and last - d <= left.shape[1]:
                row = left[v, first:last].astype(int) - right[v, first - d : last - d]
                seen.append(abs(row))
        if 2 * len(seen) <= len(rows):
            continue
        total = np.sum(seen, axis=0) * len(rows) / len(seen)
        before, after = total[: u + 1 - first], total[u + 1 - first :]
        sides = [before.mean(), after.mean() if len(after) else np.inf, total.mean()]
        costs = np.minimum(costs, sides)
    return costs


def fine(costs: np.ndarray, winner: float) -> float:
    whole = min(round(winner), len(costs) - 1)
    for d in (whole - 1, whole + 1):
        if 0 <= d < len(costs) and costs[d] < costs[whole]:
            whole = d
    if not 0 < whole < len(costs) - 1:
        return winner
    before, least, after = costs[whole - 1 : whole + 2]
    steep = max(before, after) - least
    if not steep > 0 or min(before, after) < least:
        return winner
    found = whole + 0.5 * (before - after) / steep
    return found if abs(found - winner) <= LOCKING else winner


def margin_of(disparity, left, right, u, winner, floor, shares, bins):
    """Margin and offset of one column, None where there is nothing to compare."""
    below = floor[0] * u + floor[1] * np.arange(len(disparity)) + floor[2]
    shows = (below <= shares[0] * winner) & (abs(disparity[:, u] / 16 - winner) <= OWN)
    rows = np.flatnonzero(shows)
    low = (below[rows] > shares[1] * winner).all()
    taken = min(len(rows), ROWS)
    limit = min(bins, u + 1)
    if taken < 2 or limit <= winner:
        return None
    rows = rows[[k * len(rows) // taken for k in range(taken)]]
    first, last = max(u - REACH, 0), min(u + REACH + 1, left.shape[1])
    costs = np.array(
        [window_costs(left, right, rows, max(first, d), last, u, d) for d in range(limit)]
    ).T
    floors = floor_costs(left, right, rows, first, last, u, floor)
    margins_of_sides = []
    for side, width in enumerate((u + 1 - first, last - u - 1, last - first)):
        own, rival = least_costs(costs[side], winner)
        rival = min(rival, floors[side])
        if np.isfinite(own) and np.isfinite(rival):
            sure = np.sqrt(taken * width / (ROWS * (2 * REACH + 1)))
            margins_of_sides.append(1.0 + sure * (rival / own - 1.0))
    best = max(margins_of_sides, default=-1.0)
    if low:
        best = 1.0 + 0.5 * (best - 1.0)
    return (best if best >= 0.0 else np.nan), fine(costs[2], winner) - winner


def margins_twin(disparity, left, right, winner, floor, shares, bins):
    margin, offset = np.full(len(winner), np.nan), np.zeros(len(winner))
    for begin in range(0, len(winner), GROUP):
        group = np.arange(begin, min(begin + GROUP, len(winner)))
        answered = group[winner[group] > 0]
        if not len(answered):
            continue
        middle = begin + GROUP // 2
        u = middle if middle in answered else answered[0]
        found = margin_of(disparity, left, right, u, winner[u], floor, shares, bins)
        if found is not None:
            margin[group], offset[group] = found
    return margin, offset


@hypothesis_settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 40),
    st.floats(0.0, 1.0),
    st.integers(61, 64),
    st.floats(-20.0, 20.0),
)
def test_margins_equal_plain_numpy(seed, contrast, share, width, corner):
    rng = np.random.default_rng(seed)
    left, right = rng.integers(-contrast, contrast + 1, (2, HEIGHT, width)).astype(np.int16)
    disparity = rng.integers(-16, 16 * BINS, (HEIGHT, width)).astype(np.int16)
    winner = rng.uniform(0.0, BINS, width)
    disparity[:, ::3] = np.rint(16 * winner[::3]) + rng.integers(-40, 41, disparity[:, ::3].shape)
    winner[rng.random(width) > share] = np.nan
    floor, shares = np.array([0.01, 0.7, corner]), np.array([0.67, 0.1])
    arguments = (disparity, left, right, winner, floor, shares, BINS)
    for found, expected in zip(margins(*arguments), margins_twin(*arguments), strict=True):
        assert np.allclose(found, expected, equal_nan=True)


def columns_of(left: np.ndarray, right: np.ndarray, d: float) -> np.ndarray:
    """Margins if all columns were matched at d."""
    disparity = np.full(left.shape, round(16 * d), np.int16)
    a, b = (cv2.Sobel(image, cv2.CV_16S, 1, 0, ksize=3) for image in (left, right))
    return margins(disparity, a, b, np.full(left.shape[1], d), NO_FLOOR, HIGH, BINS)[0]


def shifted(wide: np.ndarray, by: float) -> np.ndarray:
    v, u = np.indices((HEIGHT, WIDTH)).astype(np.float32)
    return cv2.remap(wide, u + np.float32(by), v, cv2.INTER_CUBIC)


@pytest.mark.parametrize("d", [6.0, 6.3, 6.5])
def test_a_texture_matches_in_one_place(d):
    wide = texture((HEIGHT, WIDTH + 40), 3)
    assert (columns_of(shifted(wide, 0), shifted(wide, d), d)[16:] > 1.3).all()


@pytest.mark.parametrize("period", [6.2, 8.0, 9.9])
@pytest.mark.parametrize("d", [9.0, 11.8])
def test_stripes_match_in_many_even_if_one_of_those_fits_the_pixels_better(period, d):
    row = 128 + 70 * np.sin(2 * np.pi * np.arange(WIDTH + 40) / period)
    wide = np.tile(row, (HEIGHT, 1)).astype(np.uint8)
    left, right = shifted(wide, 0), shifted(wide, d)
    for matched in (d, d + period, d - period):
        if 0.5 < matched < BINS - 1:
            assert (columns_of(left, right, matched)[27:50] < DISTINCT).all()


def noise_twin(gradients: np.ndarray, first: np.ndarray, last: np.ndarray) -> float:
    blocks = [
        np.mean(gradients[v : v + BLOCK, u : u + BLOCK].astype(float) ** 2)
        for v in range(0, gradients.shape[0] - BLOCK + 1, BLOCK)
        for u in range(0, gradients.shape[1] - BLOCK + 1, BLOCK)
        if u >= first[v : v + BLOCK].max() and u + BLOCK <= last[v : v + BLOCK].min()
    ]
    rms = np.sqrt(np.quantile(blocks, SMOOTHEST)) if blocks else 0.0
    return float(np.clip(rms, LEAST_NOISE, MOST))


@given(st.integers(0, 2**32 - 1), st.integers(0, 50), st.integers(0, 50), st.integers(1, 200))
def test_noise_equals_plain_numpy(seed, height, width, contrast):
    rng = np.random.default_rng(seed)
    gradients = rng.integers(-contrast, contrast + 1, (height, width)).astype(np.int16)
    first = rng.integers(0, width // 3 + 1, height).astype(np.int32)
    last = rng.integers(width // 2, width + 1, height).astype(np.int32)
    found = gradient_noise(gradients, first, last)
    assert found == pytest.approx(noise_twin(gradients, first, last), rel=1e-5)


def test_noise_is_that_of_the_blank_parts_and_not_of_the_rim():
    rng = np.random.default_rng(4)
    image = 128.0 + 3.0 * rng.normal(size=(80, 160))
    image[:, 80:] += texture((80, 80)) - 128.0
    image[:, :32] = 0.0
    gradients = cv2.Sobel(np.clip(np.rint(image), 0, 255).astype(np.uint8), cv2.CV_16S, 1, 0)
    first, last = np.full(80, 32), np.full(80, 160)
    # Sobel's operator sums twelve squares of weights.
    assert gradient_noise(gradients, first, last) == pytest.approx(3.0 * 12**0.5, rel=0.3)
    assert gradient_noise(gradients, 0 * first, last) == LEAST_NOISE
