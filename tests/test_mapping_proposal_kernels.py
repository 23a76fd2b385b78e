"""The inner loops of the matched proposal equal their twins in plain numpy."""

import math
from itertools import product

import numpy as np
import pytest

from mapping.proposal_kernels import hit_score, refine
from mapping.tiles import NO_TILE, TILE, TileMaps
from odometry.motion import compose
from tests.mapping_data import CELL, filled_maps

GAIN, KAPPA = 20.0, 1.0 / 3.0


def dense(maps, k):
    """Sureness (H, W) in 0..1 of obstacles in a particle's map, and the cell of its corner."""
    _, rows, columns = maps.table.shape
    sure = np.zeros((rows * TILE, columns * TILE))
    for row, column in np.ndindex(rows, columns):
        if maps.table[k, row, column] != NO_TILE:
            tile = maps.tiles[maps.table[k, row, column]]
            place = np.s_[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]
            sure[place] = np.maximum(tile.astype(float), 0.0) / 127.0
    return sure, maps.corner * TILE


def hit_score_twin(maps, k, points, pose):
    """`hit_score` in plain numpy; beyond the table there is nothing."""
    sure, corner = dense(maps, k)
    padded = np.pad(sure, 200)
    placed = compose(pose, np.column_stack([points, np.zeros(len(points))]))
    u = placed[:, 0] / CELL - 0.5 - corner[1] + 200
    v = placed[:, 1] / CELL - 0.5 - corner[0] + 200
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    a, b = u - column, v - row
    m = (
        (1 - a) * (1 - b) * padded[row, column]
        + a * (1 - b) * padded[row, column + 1]
        + (1 - a) * b * padded[row + 1, column]
        + a * b * padded[row + 1, column + 1]
    )
    return np.log1p(GAIN * m).sum()


@pytest.mark.parametrize("n", [50, 3000])
def test_the_score_of_hits_equals_its_numpy_twin(n):
    """3000 hits: the product of their terms would overflow. Some lie beyond the map."""
    rng = np.random.default_rng(1)
    maps = filled_maps(rng, 2)
    for k, _ in product(range(2), range(5)):
        points = rng.uniform(-4.0, 4.0, (n, 2))
        pose = rng.uniform([-1.0, -1.0, -4.0], [2.0, 2.0, 4.0])
        got = hit_score(maps.tiles, maps.table[k], maps.corner, CELL, points, GAIN, *pose)
        assert got == pytest.approx(hit_score_twin(maps, k, points, pose), rel=1e-9)


def test_a_hit_on_a_sure_obstacle_by_hand():
    maps = TileMaps(1)
    maps.cover(np.array([0, 0]), np.array([0, 0]))
    maps.make_writable(np.ones((1, 1, 1), bool))
    maps.tiles[:] = -128
    maps.tiles[maps.table[0, 0, 0], 3, 5] = 127
    one = (maps.tiles, maps.table[0], maps.corner, CELL)
    points = np.array([[5.5 * CELL, 3.5 * CELL]])
    assert hit_score(*one, points, GAIN, 0.0, 0.0, 0.0) == pytest.approx(math.log(21.0))
    # Half a cell aside the map is half as sure, a whole one aside it tells nothing.
    assert hit_score(*one, points, GAIN, 0.5 * CELL, 0.0, 0.0) == pytest.approx(math.log(11.0))
    assert hit_score(*one, points, GAIN, -CELL, 0.0, 0.0) == pytest.approx(0.0)


def posterior_twin(maps, k, points, information, pose, xi):
    hit = hit_score_twin(maps, k, points, compose(pose, xi))
    return KAPPA * hit - 0.5 * xi @ information @ xi


def refine_twin(maps, k, points, information, pose, first_step, last_step, h):
    """`refine` of one particle in plain Python: the better of both ways along each axis in turn,
    halved when none helps; then differences of the hits' score alone."""
    xi, scale = np.zeros(3), 1.0
    while scale >= last_step:
        before = xi
        for axis in np.eye(3):
            tries = [xi + way * scale * first_step * axis for way in (0.0, -1.0, 1.0)]
            heights = [posterior_twin(maps, k, points, information, pose, t) for t in tries]
            xi = tries[np.argmax(heights)]
        if (xi == before).all():
            scale *= 0.5
    gained = np.zeros((3, 3))
    for (i, j), a, b in product(np.ndindex(3, 3), (-1, 1), (-1, 1)):
        at = xi + h * (a * np.eye(3)[i] + b * np.eye(3)[j])
        value = posterior_twin(maps, k, points, np.zeros((3, 3)), pose, at)
        gained[i, j] -= a * b * value / (4.0 * h[i] * h[j])
    return xi, gained


def test_refining_equals_its_numpy_twin():
    rng = np.random.default_rng(2)
    maps = filled_maps(rng, 4)
    maps.resample(np.array([0, 1, 2, 2]))
    poses = rng.uniform([-0.5, -0.5, -4.0], [1.0, 1.0, 4.0], (4, 3))
    points = rng.uniform(-1.5, 1.5, (40, 2))
    information = np.diag([1.0 / 0.05**2, 1.0 / 0.04**2, 1.0 / 0.03**2])
    first_step, h = np.array([CELL, CELL, 0.02]), np.array([0.02, 0.02, 0.01])
    moves, gained = refine(
        maps.tiles,
        maps.table,
        maps.corner,
        poses,
        CELL,
        points,
        GAIN,
        KAPPA,
        information,
        first_step,
        0.1,
        h,
    )
    assert np.abs(moves).max() > 0.02
    for k in range(4):
        xi, hessian = refine_twin(maps, k, points, information, poses[k], first_step, 0.1, h)
        np.testing.assert_allclose(moves[k], xi, atol=1e-12)
        np.testing.assert_allclose(gained[k], hessian, atol=1e-6 * np.abs(hessian).max())
