"""Corners, windows and rows: found to a fraction of a pixel, and as plain numpy finds them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo.features import CELLS, PER_CELL, find_corners
from stereo.patch_kernels import (
    HALF,
    LEAST_CONTRAST,
    LONGEST,
    ROUNDS,
    SETTLED,
    SIDE,
    follow,
    remember,
    search_rows,
)
from stereo.tracking import KeyFrame, Pyramids

SHAPE = (240, 320)


def picture(shift: tuple[float, float] = (0.0, 0.0), seed: int = 1) -> np.ndarray:
    """A smooth texture (240, 320), its content moved by (column, row) px."""
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(0, 255, (60, 80)).astype(np.float32)
    large = cv2.resize(coarse, None, fx=6.0, fy=6.0, interpolation=cv2.INTER_CUBIC)
    v, u = np.indices(SHAPE, dtype=np.float32)
    moved = cv2.remap(large, u + 80 - shift[0], v + 60 - shift[1], cv2.INTER_LANCZOS4)
    return np.clip(moved, 0, 255).astype(np.uint8)


def window(image: np.ndarray, x: float, y: float, scale: float) -> tuple[np.ndarray, float]:
    """The normalised window (SIDE, SIDE) around a point, and its contrast."""
    step = scale * np.arange(-HALF, HALF + 1)
    u, v = np.meshgrid(x + step, y + step)
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    a, b = u - i, v - j
    grey = image.astype(float)
    seen = (1 - b) * ((1 - a) * grey[j, i] + a * grey[j, i + 1])
    seen += b * ((1 - a) * grey[j + 1, i] + a * grey[j + 1, i + 1])
    seen -= seen.mean()
    contrast = float(seen.std())
    return seen / contrast, contrast


def gradients_of(image: np.ndarray, x: float, y: float) -> np.ndarray:
    """(2, SIDE, SIDE) of the window normalised by its own contrast."""
    contrast = window(image, x, y, 1.0)[1]
    sides = []
    for dx, dy in ((1.0, 0.0), (0.0, 1.0)):
        (more, m), (less, n) = (window(image, x + s * dx, y + s * dy, 1.0) for s in (1, -1))
        sides.append(0.5 * (m * more - n * less) / contrast)
    return np.array(sides)


def followed(image, shape, gradients, inverse, scale, place):
    """`follow` for one window in plain numpy."""
    x, y = place
    settled = False
    for _ in range(ROUNDS):
        seen, contrast = window(image, x, y, scale)
        assert contrast > LEAST_CONTRAST
        if settled:
            return x, y, float(np.mean(seen * shape))
        dx, dy = scale * inverse @ (gradients * (seen - shape)).sum(axis=(1, 2))
        x, y = x - dx, y - dy
        if max(abs(x - place[0]), abs(y - place[1])) > LONGEST:
            return *place, -1.0
        settled = dx * dx + dy * dy < SETTLED**2
    return *place, -1.0


def test_windows_are_remembered_as_numpy_would():
    image = picture()
    points = np.array([[60.0, 50.0], [100.25, 80.5], [200.0, 150.0]])
    windows, gradients, inverses, usable = remember(image, points)
    assert usable.all()
    for i, (x, y) in enumerate(points):
        expected = gradients_of(image, x, y)
        flat = expected.reshape(2, -1)
        assert np.allclose(windows[i].reshape(SIDE, SIDE), window(image, x, y, 1.0)[0], atol=1e-3)
        assert np.allclose(gradients[i].reshape(2, SIDE, SIDE), expected, atol=1e-3)
        assert np.allclose(inverses[i], np.linalg.inv(flat @ flat.T), rtol=1e-2)


@pytest.mark.parametrize("scale", [1.0, 1.1])
def test_windows_are_followed_as_numpy_would(scale):
    first, second = picture(), picture((1.3, -0.8))
    points = find_corners(first)[::8].astype(float)
    windows, gradients, inverses, usable = remember(first, points)
    place = points.copy()
    scales = np.full(len(points), scale)
    likeness = follow(second, windows, gradients, inverses, usable, scales, place)
    assert usable.sum() > 20
    for i in np.flatnonzero(usable):
        shape, slopes = windows[i].reshape(SIDE, SIDE), gradients[i].reshape(2, SIDE, SIDE)
        x, y, same = followed(second, shape, slopes, inverses[i], scale, points[i])
        if (same > 0) == (likeness[i] > 0):  # one round more or less at the limit of the steps
            assert place[i] == pytest.approx((x, y), abs=0.02)
            assert likeness[i] == pytest.approx(same, abs=1e-2)


@pytest.mark.parametrize("gain", [0.5, 1.0, 1.4])
def test_windows_are_found_again_whatever_the_exposure(gain):
    shift = (2.3, -1.6)
    first = (0.6 * picture() + 20).astype(np.uint8)
    second = (0.6 * gain * picture(shift) + 20).astype(np.uint8)
    points = find_corners(first)
    inner = ((points > 30) & (points < (290, 210))).all(axis=1)
    points = points[inner].astype(float)
    windows, gradients, inverses, usable = remember(first, points)
    place = points.copy()
    likeness = follow(second, windows, gradients, inverses, usable, np.ones(len(points)), place)
    found = likeness > 0.8
    assert found.mean() > 0.8
    error = place[found] - points[found] - shift
    assert np.abs(np.median(error, axis=0)).max() < 0.03
    assert np.percentile(np.hypot(*error.T), 90) < 0.2


def test_flat_windows_and_those_at_the_border_are_of_no_use():
    image = picture()
    image[100:140, 100:140] = 90
    points = np.array([[120.0, 120.0], [2.0, 50.0], [318.0, 50.0], [60.0, 60.0]])
    assert remember(image, points)[3].tolist() == [False, False, False, True]


def searched(left, right, point, disparities):
    """`search_rows` for one point in plain numpy."""
    u, v = np.rint(point).astype(int)
    shape = left[v - 4 : v + 5, u - 4 : u + 5].astype(int)
    costs = []
    for d in range(min(disparities, u - 3)):
        other = right[v - 4 : v + 5, u - 4 - d : u + 5 - d].astype(int)
        offset = (shape.sum() - other.sum()) // 81
        costs.append(np.abs(shape - other - offset).sum())
    best = int(np.argmin(costs))
    rest = [cost for d, cost in enumerate(costs) if abs(d - best) > 2]
    clear = best < len(costs) - 1 and costs[best] * 6 < min(rest) * 5
    return best if clear else -1


def test_rows_are_searched_as_numpy_would():
    left, right = picture(), picture((-9.0, 0.0))
    corners = find_corners(left)
    found = search_rows(left, right, corners, 40)
    inner = np.flatnonzero((corners[:, 0] > 60) & (corners[:, 0] < 300))[::4]
    expected = [searched(left, right, corners[i], 40) for i in inner]
    assert found[inner].tolist() == expected
    assert np.mean(found[inner] == 9) > 0.9


def test_images_of_different_things_have_no_depth():
    same = KeyFrame(Pyramids.of(picture(), picture((-9.0, 0.0))))
    assert len(KeyFrame(Pyramids.of(picture(), picture(seed=9)))) < 0.2 * len(same)


def test_corners_stand_in_all_parts_of_the_image():
    image = picture()
    corners = find_corners(image)
    side = (image.size / CELLS) ** 0.5
    cells = np.unique((corners // side).astype(int), axis=0, return_counts=True)
    assert len(cells[0]) > 0.7 * CELLS
    assert cells[1].max() <= PER_CELL
    assert not len(find_corners(np.full(SHAPE, 90, np.uint8)))


def test_a_key_frame_knows_depth_and_is_found_again():
    disparity = 12.25
    first = Pyramids.of(picture(), picture((-disparity, 0.0)))
    key = KeyFrame(first)
    assert len(key) > 200
    assert np.median(key.pixels[:, 0] - key.pixels[:, 2]) == pytest.approx(disparity, rel=0.01)
    assert np.abs(np.median(key.row_errors)) < 0.02
    second = Pyramids.of(picture((5.5, 1.0)), picture((5.5 - disparity, 1.0)))
    pixels, sigma, found = key.find(second, key.pixels, np.ones(len(key)))
    assert found.mean() > 0.8
    moved = pixels[found, :2] - key.pixels[found, :2]
    assert np.median(moved, axis=0) == pytest.approx([5.5, 1.0], abs=0.05)
    # Where each is, is as uncertain as its window says: not all windows alike.
    noise = 30.0 * np.random.default_rng(5).standard_normal((2, *SHAPE))
    grainy = [
        np.clip(image + n, 0, 255).astype(np.uint8)
        for image, n in zip((second.left[0], second.right[0]), noise, strict=True)
    ]
    pixels, sigmas, found_too = key.find(Pyramids.of(*grainy), key.pixels, np.ones(len(key)))
    both = found & found_too
    assert np.median(sigmas[both]) > 1.5 * np.median(sigma[both])
    error = np.abs(pixels[both, :2] - key.pixels[both, :2] - (5.5, 1.0)).mean(axis=1)
    surer = sigmas[both] < np.median(sigmas[both])
    assert np.median(error[surer]) < 0.9 * np.median(error[~surer])


def test_points_far_from_where_they_are_expected_are_told_by_their_looks():
    disparity = 12.0
    first = KeyFrame(Pyramids.of(picture(), picture((-disparity, 0.0))))
    shift = (60.0, -20.0)
    second = KeyFrame(Pyramids.of(picture(shift), picture((60.0 - disparity, -20.0))))
    i, j = first.alike(second)
    assert len(i) > 60
    moved = second.pixels[j, :2] - first.pixels[i, :2]
    assert np.mean(np.hypot(*(moved - shift).T) < 2.0) > 0.8
