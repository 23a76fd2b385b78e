"""A run that begins in a map made before, at a pose that is known or searched."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.errors import MappingError
from mapping.grid import OccupancyGrid
from mapping.known_map import KnownMap, tile_maps
from mapping.local_map import LocalMap
from mapping.localise import locate
from mapping.mapper import HierarchicalMapper
from mapping.sensor_model import probability
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse, placed, wrap_angle

SETTINGS = MappingSettings(particles=20)
CELL = SETTINGS.cell
REACH = 3.0


def room(*things: tuple[float, float, float, float]) -> OccupancyGrid:
    """6 x 4 m with walls and solid things (x0, y0, x1, y1) m; the corner lies at (-2, -1) m."""
    p = np.full((80, 120), 0.05, np.float32)
    p[[0, 1, -2, -1], :] = p[:, [0, 1, -2, -1]] = 0.95
    for thing in things:
        c0, r0, c1, r1 = (
            round((v - o) / CELL) for v, o in zip(thing, (-2, -1, -2, -1), strict=True)
        )
        p[r0:r1, c0:c1] = 0.95
    return OccupancyGrid(p, (-2.0, -1.0), CELL)


FURNISHED = room(
    (-1.0, 0.0, -0.2, 0.4), (1.5, 1.5, 1.8, 2.6), (3.0, -0.5, 3.5, 0.1), (-2, 1.8, -1.2, 3)
)
BARE = room()


def seen_from(grid: OccupancyGrid, pose: np.ndarray) -> LocalMap:
    """The map around a pose as a local map would show it: turned into the robot's frame."""
    n = round(2 * REACH / CELL)
    middles = (np.arange(n) + 0.5) * CELL - REACH
    x, y = (axis.ravel() for axis in np.meshgrid(middles, middles))
    points = placed(pose, np.stack([x, y], axis=1))
    at = np.floor((points - grid.origin) / CELL).astype(int)
    height, width = grid.probability.shape
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    p = np.full(n * n, np.nan)
    p[inside] = grid.probability[at[inside, 1], at[inside, 0]]
    ahead = np.abs(np.arctan2(y, x)) < 1.2
    p[~ahead] = np.nan
    hit = np.nan_to_num(p) > 0.7
    hits = np.stack([x, y], axis=1)[hit]
    return LocalMap(
        np.log(p / (1 - p)).reshape(n, n).astype(np.float32), hit.reshape(n, n),
        (-REACH, -REACH), CELL, hits, 0.1, Motion.none(0), 0, 10, 1.0,
    )  # fmt: skip


@pytest.mark.parametrize("pose", [(0.5, 0.8, 0.3), (2.0, 0.5, 1.9), (-0.5, 2.2, -1.2)])
def test_the_place_is_found(pose):
    found = locate(seen_from(FURNISHED, np.array(pose)), FURNISHED, SETTINGS)
    assert np.hypot(*(found - pose)[:2]) < 0.08
    assert abs(float(wrap_angle(found[2] - pose[2]))) < 0.05


def test_places_that_look_alike_are_an_error_not_a_guess():
    with pytest.raises(MappingError, match=r"looks alike at .* --pose x,y,deg"):
        locate(seen_from(BARE, np.array([0.0, 0.5, 0.4])), BARE, SETTINGS)


def test_what_fits_nowhere_is_an_error():
    rng = np.random.default_rng(1)
    local = seen_from(FURNISHED, np.array([0.5, 0.8, 0.3]))
    object.__setattr__(local, "points", rng.uniform(-2.5, 2.5, (200, 2)))
    with pytest.raises(MappingError, match="fits nowhere"):
        locate(local, FURNISHED, SETTINGS)
    object.__setattr__(local, "points", np.zeros((3, 2)))
    with pytest.raises(MappingError, match="too few obstacles in view"):
        locate(local, FURNISHED, SETTINGS)


def test_every_particle_begins_with_the_map_and_shares_its_tiles():
    maps = tile_maps(FURNISHED, 5, SETTINGS)
    tiles = maps.tiles_in_use
    for particle in (0, 4):
        log_odds, corner = maps.log_odds(particle)
        grid = OccupancyGrid(
            probability(log_odds).astype(np.float32), (corner[0] * CELL, corner[1] * CELL), CELL
        ).trimmed()
        assert grid.origin == pytest.approx(FURNISHED.origin)
        np.testing.assert_allclose(grid.probability, FURNISHED.probability, atol=0.01)
    assert tiles == np.count_nonzero(maps.table[0] >= 0)
    bits = np.unpackbits(maps.obstacles[:tiles].view(np.uint8)).sum()
    assert bits == np.count_nonzero(FURNISHED.probability > SETTINGS.occupied)
    with pytest.raises(MappingError, match=r"set mapping\.cell=0\.05"):
        tile_maps(FURNISHED, 5, MappingSettings(cell=0.1))


def test_a_mapper_goes_on_at_a_given_pose():
    pose = np.array([0.5, 0.8, 0.3])
    mapper = HierarchicalMapper(SETTINGS, 1, KnownMap(FURNISHED, pose))
    mapper.move(Motion(np.zeros(3), np.zeros((3, 3)), 0, 0))
    np.testing.assert_allclose(mapper.pose, pose)
    step = Motion(np.array([0.5, 0.0, 0.1]), np.diag([1e-4, 1e-4, 1e-4]), 0, 1)
    mapper.move(step)
    np.testing.assert_allclose(mapper.pose, compose(pose, step.increment))
    grid, path = mapper.finish()
    assert np.isfinite(grid.probability).sum() == FURNISHED.probability.size
    np.testing.assert_allclose(path[-1], compose(pose, step.increment))
    assert np.allclose(compose(inverse(path[0]), path[-1]), step.increment)


def test_a_second_run_goes_on_in_the_map_of_the_first(office, tmp_path, beemap, refused):
    quick = ("--quiet", "--set", "mapping.particles=20", "--threads", "1")
    assert beemap("map", office, "-o", tmp_path / "first", *quick).code == 0
    begin = ("--continue", tmp_path / "first")
    outcome = beemap("map", office, "-o", tmp_path / "second", *quick, *begin, "--pose", "0,0,0")
    assert outcome.code == 0, outcome.err
    ends = [np.loadtxt(tmp_path / run / "trajectory.tum")[-1] for run in ("first", "second")]
    assert np.hypot(*(ends[0] - ends[1])[1:3]) < 0.1
    assert "--pose: belongs to --continue" in refused(
        "map", office, "-o", tmp_path / "third", "--pose", "0,0,0"
    )
    assert "write x,y,deg" in refused(
        "map", office, "-o", tmp_path / "third", *begin, "--pose", "here"
    )
