"""The inner loops of scan-matched ego-motion equal their twins in plain numpy."""

from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest

from mapping.density_kernels import BUMP_REACH, accumulate, bumps, climb, curvature, joined, score
from odometry.motion import compose

CELL = 0.05
LOW = (-1.0, -0.7)
SHAPE = (28, 40)


def joined_twin(points, doubt, most, step):
    """`joined` in plain numpy."""
    hits, parts = np.column_stack([points, doubt]), []
    for a, b in pairwise(hits):
        gap = np.hypot(*(b - a)[:2])
        between = int(gap / step) if gap < most else 0
        parts.append(np.linspace(a, b, between + 1, endpoint=False))
    parts.append(hits[-1:])
    surface = np.concatenate(parts)
    return surface[:, :2], surface[:, 2]


def test_joined_hits_equal_their_numpy_twin():
    rng = np.random.default_rng(0)
    points = np.cumsum(rng.normal(0, 0.2, (40, 2)), axis=0)
    doubt = rng.uniform(0.01, 0.1, 40)
    surface, doubts = joined(points, doubt, 0.3, 0.02)
    expected, expected_doubts = joined_twin(points, doubt, 0.3, 0.02)
    np.testing.assert_allclose(surface, expected, atol=1e-12)
    np.testing.assert_allclose(doubts, expected_doubts, atol=1e-12)
    assert len(surface) > 150
    apart = np.hypot(*np.diff(surface, axis=0).T)
    assert ((apart <= 0.02 + 1e-12) | (apart >= 0.3)).all()


@pytest.mark.parametrize("n", [0, 1])
def test_none_or_one_hit_has_nothing_to_be_joined_with(n):
    surface, doubts = joined(np.ones((n, 2)), np.ones(n), 0.3, 0.02)
    assert (surface.shape, doubts.shape) == ((n, 2), (n,))


def random_hits(rng, n):
    """Hits in and around the box from (-1, -0.7) to (1, 0.7), and their doubts."""
    return rng.uniform([-1.6, -1.3], [1.6, 1.3], (n, 2)), rng.uniform(0.02, 0.25, n)


def bumps_twin(points, eye, doubt, across):
    """`bumps` in plain numpy, as a density (H, W): the highest of all Gaussians in every cell."""
    x = LOW[0] + (np.arange(SHAPE[1]) + 0.5) * CELL
    y = LOW[1] + (np.arange(SHAPE[0])[:, None] + 0.5) * CELL
    density = np.zeros(SHAPE)
    for point, sd in zip(points, doubt, strict=True):
        ahead = (point - eye) / np.hypot(*(point - eye))
        along = (x - point[0]) * ahead[0] + (y - point[1]) * ahead[1]
        aside = (y - point[1]) * ahead[0] - (x - point[0]) * ahead[1]
        off = (along / sd) ** 2 + (aside / across) ** 2
        bump = np.where(off <= BUMP_REACH**2, np.exp(-0.5 * off), 0.0)
        density = np.maximum(density, bump)
    return density


def test_bumps_equal_their_numpy_twin_and_leave_the_scratch_layer_zero():
    rng = np.random.default_rng(1)
    layer = np.zeros(SHAPE)
    for across in (0.015, 0.06):
        points, doubt = random_hits(rng, 60)
        eye = rng.uniform(-0.5, 0.5, 2)
        cells, values = bumps(layer, *LOW, CELL, points, eye, doubt, across)
        assert not layer.any()
        assert len(np.unique(cells)) == len(cells) > 256
        got = np.zeros(SHAPE)
        got.flat[cells] = values
        np.testing.assert_allclose(got, bumps_twin(points, eye, doubt, across), atol=1e-9)


def test_a_bump_is_long_along_the_line_of_sight_and_narrow_beside_it():
    layer = np.zeros(SHAPE)
    wall = np.array([[0.025, 0.025]])
    cells, values = bumps(layer, *LOW, CELL, wall, np.array([-3.0, 0.025]), np.array([0.2]), 0.05)
    got = np.zeros(SHAPE)
    got.flat[cells] = values
    row, column = 14, 20
    assert got[row, column] == pytest.approx(1.0)
    assert got[row, column + 4] == pytest.approx(np.exp(-0.5))
    assert got[row + 1, column] == pytest.approx(np.exp(-0.5))
    assert got[row + 3, column] == 0.0


def test_what_is_accumulated_can_be_taken_away_again():
    rng = np.random.default_rng(2)
    density = np.zeros(SHAPE)
    scans = [random_hits(rng, 40) for _ in range(4)]
    layer, shares, eye = np.zeros(SHAPE), [], np.zeros(2)
    for points, doubt in scans:
        cells, values = bumps(layer, *LOW, CELL, points, eye, doubt, 0.03)
        accumulate(density, cells, values, 1.0)
        shares.append((cells, values))
    whole = sum(bumps_twin(points, eye, doubt, 0.03) for points, doubt in scans)
    np.testing.assert_allclose(density, whole, atol=1e-9)
    for cells, values in shares[:2]:
        accumulate(density, cells, values, -1.0)
    rest = sum(bumps_twin(points, eye, doubt, 0.03) for points, doubt in scans[2:])
    np.testing.assert_allclose(density, rest, atol=1e-9)
    for cells, values in shares[2:]:
        accumulate(density, cells, values, -1.0)
    assert (density >= 0.0).all()
    assert density.max() < 1e-12


def score_twin(density, x0, y0, cell, points, prior, information, kappa, pose):
    """`score` in plain numpy."""
    placed = compose(pose, np.column_stack([points, np.zeros(len(points))]))
    u, v = (placed[:, 0] - x0) / cell - 0.5, (placed[:, 1] - y0) / cell - 0.5
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    inside = (row >= 0) & (row < density.shape[0] - 1)
    inside &= (column >= 0) & (column < density.shape[1] - 1)
    u, v, row, column = u[inside], v[inside], row[inside], column[inside]
    a, b = u - column, v - row
    d = (
        (1 - a) * (1 - b) * density[row, column]
        + a * (1 - b) * density[row, column + 1]
        + (1 - a) * b * density[row + 1, column]
        + a * b * density[row + 1, column + 1]
    )
    off = pose - prior
    return kappa * np.log1p(d).sum() - 0.5 * off @ information @ off


def random_terms(rng, n=80):
    """Arguments of `score` up to kappa: a density, hits in and around it, a prior."""
    root = rng.normal(0, 5, (3, 3))
    prior = rng.uniform(-0.3, 0.3, 3)
    information = root @ root.T + np.eye(3)
    points, _ = random_hits(rng, n)
    return 3.0 * rng.random(SHAPE), *LOW, CELL, points, prior, information, 0.15


@pytest.mark.parametrize("n", [80, 2000])
def test_score_equals_its_numpy_twin(n):
    """2000 hits: the product of their terms would overflow."""
    rng = np.random.default_rng(2)
    for _ in range(10):
        terms = random_terms(rng, n)
        pose = terms[5] + rng.normal(0, [0.1, 0.1, 0.3])
        assert score(*terms, pose) == pytest.approx(score_twin(*terms, pose), rel=1e-10)


def climb_twin(terms: tuple[Any, ...], first_step, last_step):
    """`climb` in plain Python: the better of both ways along each axis in turn."""
    pose, scale = terms[5].copy(), 1.0
    while scale >= last_step:
        before = pose.copy()
        for axis in np.eye(3):
            tries = [pose + way * scale * first_step * axis for way in (0.0, -1.0, 1.0)]
            pose = tries[np.argmax([score_twin(*terms, pose=trial) for trial in tries])]
        if (pose == before).all():
            scale *= 0.5
    return pose


def test_the_climb_equals_its_numpy_twin():
    rng = np.random.default_rng(3)
    first_step, last = np.array([0.02, 0.02, 0.01]), 0.25
    for _ in range(10):
        terms = random_terms(rng)
        best = climb(*terms, first_step, last)
        np.testing.assert_allclose(best, climb_twin(terms, first_step, last), atol=1e-12)
        height = score(*terms, best)
        assert height >= score(*terms, terms[5])
        for step in np.diag(last * first_step):
            assert score(*terms, best + step) <= height
            assert score(*terms, best - step) <= height


def test_curvature_is_the_negative_hessian_of_the_score():
    rng = np.random.default_rng(4)
    h = np.array([0.01, 0.012, 0.005])
    for _ in range(5):
        density, x0, y0, cell, points, pose, _, kappa = random_terms(rng)
        expected = np.zeros((3, 3))
        for (i, j), a, b in product(np.ndindex(3, 3), (-1, 1), (-1, 1)):
            moved = pose + h * (a * np.eye(3)[i] + b * np.eye(3)[j])
            value = score_twin(density, x0, y0, cell, points, pose, np.zeros((3, 3)), kappa, moved)
            expected[i, j] -= a * b * value / (4.0 * h[i] * h[j])
        got = curvature(density, x0, y0, cell, points, kappa, pose, h)
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_curvature_of_a_smooth_wall_by_hand():
    """Where ln(1 + D) falls as -x^2 / 2 s^2, the information on x is kappa n / s^2, there is none
    on y, and on the turn that of the lever arms."""
    cell, s, kappa = 0.01, 0.2, 0.5
    x = -1.0 + (np.arange(200) + 0.5) * cell
    # 1 + D = exp(1 - x^2 / 2 s^2): its logarithm bends by 1 / s^2 everywhere.
    density = np.tile(np.exp(1.0 - 0.5 * (x / s) ** 2) - 1.0, (200, 1))
    points = np.column_stack([np.zeros(21), np.linspace(-0.5, 0.5, 21)])
    h = np.array([0.05, 0.05, 0.05])
    got = curvature(density, -1.0, -1.0, cell, points, kappa, np.zeros(3), h)
    assert got[0, 0] == pytest.approx(kappa * 21 / s**2, rel=0.01)
    assert abs(got[1, 1]) < 1e-3 * got[0, 0]
    assert got[2, 2] == pytest.approx(kappa * (points[:, 1] ** 2).sum() / s**2, rel=0.02)
    assert abs(got[0, 2]) < 1e-3 * got[0, 0]
