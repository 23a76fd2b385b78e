"""The matched proposal: where it draws particles, which of them survive."""

import math

import numpy as np
import pytest

from mapping.local_map import LocalMapper
from mapping.mapper import HierarchicalMapper
from mapping.particle_filter import ParticleFilter
from mapping.proposal import MIN_HITS, propose
from mapping.settings import MappingSettings
from mapping.tiles import TileMaps
from odometry.motion import Motion, compose, inverse
from tests.mapping_data import (
    CELL,
    MIRROR,
    drive,
    fed,
    mirrored,
    room_ranges,
    round_the_room,
    scan,
    wall,
)

pytestmark = pytest.mark.usefixtures("one_thread")

KAPPA = 1.0 / 3.0
LASER = (181, 180.0)  # beams, field of view [deg]
ONE = MappingSettings(method="per-scan", particles=1)
TRUE = round_the_room(66)  # a lap has 55 steps
DOUBT = np.array([0.04, 0.04, math.radians(2.0)])


def lap():
    """Scans and exact odometry once round the room."""
    return drive(TRUE[:56], (0.0, 0.0), 0, *LASER)


@pytest.fixture(scope="module")
def known_room():
    """The map of one particle after that lap."""
    return fed(HierarchicalMapper(ONE), lap()).filter.maps


def copies(maps, n):
    """The same map for n particles."""
    many = TileMaps(n)
    many.tiles, many.obstacles, many.corner = maps.tiles, maps.obstacles, maps.corner
    many.table = np.repeat(maps.table, n, axis=0)
    many.references = n * maps.references
    return many


def hits_of(seen):
    """Hits (n, 2) of a scan whose beams all hit."""
    return seen.range[:, None] * np.stack([np.cos(seen.bearing), np.sin(seen.bearing)], axis=1)


def seen_from(step):
    """The true pose after so many steps in the map's frame, and the hits seen from there."""
    seen = scan(room_ranges(TRUE[step], *LASER), fov=LASER[1])
    return compose(inverse(TRUE[0]), TRUE[step]), hits_of(seen)


def proposed(maps, predicted, points, noise=None, covariance=None):
    """Poses for the predicted (N, 3) after a step, by default known up to DOUBT;
    no noise: at the best match."""
    covariance = np.diag(DOUBT**2) if covariance is None else covariance
    motion = Motion(np.array([0.17, 0.0, 0.0]), covariance)
    noise = np.zeros_like(predicted) if noise is None else noise
    return propose(maps, predicted, motion, points, KAPPA, CELL, noise)


def off(poses, true):
    """Poses (N, 3) in the frame of the true one."""
    return compose(inverse(true), poses)


@pytest.mark.parametrize("step", [57, 61, 65])
def test_particles_are_pulled_to_the_truth(known_room, step):
    """A cell is as well as the map can tell where the walls stand."""
    true, points = seen_from(step)
    predicted = compose(true, DOUBT * np.random.default_rng(step).standard_normal((40, 3)))
    poses = proposed(copies(known_room, 40), predicted, points)
    before, after = (np.median(np.abs(off(p, true)), axis=0) for p in (predicted, poses))
    assert before[:2].min() > 0.02
    assert np.hypot(*after[:2]) < CELL
    assert after[2] < 0.3 * before[2]
    # They all arrive at the same place.
    assert (np.median(np.abs(off(poses, np.median(poses, axis=0))), axis=0) < 0.35 * before).all()


def test_the_draws_scatter_about_the_match_less_than_odometry(known_room):
    true, points = seen_from(58)
    predicted = np.tile(compose(true, 0.5 * DOUBT), (400, 1))
    noise = np.random.default_rng(3).standard_normal((400, 3))
    maps = copies(known_room, 400)
    best = proposed(maps, predicted, points)
    poses = proposed(maps, predicted, points, noise)
    spread = off(poses, best[0])
    sd = spread.std(axis=0)
    assert (sd < 0.6 * DOUBT).all()
    assert (sd > 0.02 * DOUBT).all()
    assert (np.abs(spread.mean(axis=0)) < 4.0 * sd / math.sqrt(400)).all()


def test_along_a_blank_wall_odometrys_doubt_remains():
    maps = fed(HierarchicalMapper(ONE), [(scan(wall(2.0)), Motion.none(0))]).filter.maps
    noise = np.random.default_rng(4).standard_normal((400, 3))
    points = hits_of(scan(wall(2.0, 81, fov=40)))
    poses = proposed(copies(maps, 400), np.zeros((400, 3)), points, noise)
    sd = poses.std(axis=0)
    assert sd[1] > 0.9 * DOUBT[1]  # along the wall
    assert sd[0] < 0.5 * DOUBT[0]  # towards it


def test_weights_prefer_the_right_map(known_room):
    """Particles that stand ever further from where their maps put them; the last sees nothing of
    its map and is not judged."""
    settings = MappingSettings(method="per-scan", particles=5, resample_below=0.0)
    true, _ = seen_from(60)
    wrong = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.0, 0.8, 0], [0.4, 0.4, 0.6], [50.0, 0, 0]])
    f, mapper = ParticleFilter(settings), LocalMapper(settings)
    f.maps, f.poses = copies(known_room, len(wrong)), compose(true, wrong)
    still = Motion(np.zeros(3), np.diag(DOUBT**2) * 0.01)
    local = mapper.add(scan(room_ranges(TRUE[60], *LASER), fov=LASER[1]), still)
    assert local is not None
    health = f.add(local)
    assert health.judged == 4
    assert health.matched > 0.9
    assert f.best == 0
    assert (f.log_likelihood[0] > f.log_likelihood[1:] + 1.0).all()
    assert f.log_likelihood[4] == pytest.approx(np.log(np.exp(f.log_likelihood[:4]).mean()))


def test_odometry_that_claims_to_be_exact_is_believed(known_room):
    true, points = seen_from(60)
    predicted = compose(true, np.array([[0.03, 0.0, 0.0], [0.0, 0.02, 0.01]]))
    maps, noise = copies(known_room, 2), np.ones((2, 3))
    poses = proposed(maps, predicted, points, noise, np.zeros((3, 3)))
    np.testing.assert_array_equal(poses, predicted)


def test_with_too_few_hits_odometry_alone_leads(known_room):
    """Its covariance, given in the frame before the motion, is that of the draws seen from there:
    along x much, along y little."""
    noise = np.random.default_rng(5).standard_normal((2000, 3))
    covariance = np.diag([0.08, 0.01, 0.02]) ** 2
    motion = Motion(np.array([0.1, 0.0, math.radians(60)]), covariance)
    predicted = np.tile(motion.increment, (2000, 1))
    few, maps = np.ones((MIN_HITS - 1, 2)), copies(known_room, 2000)
    poses = propose(maps, predicted, motion, few, KAPPA, CELL, noise)
    sd = (poses - motion.increment).std(axis=0)
    assert sd[0] / sd[1] == pytest.approx(8.0, rel=0.1)
    assert sd[0] >= 0.95 * 0.08


def test_a_mirrored_world_gives_mirrored_matches(known_room):
    """Nine in ten particles agree within a tenth of a cell; others find another of two places
    that fit almost alike."""
    mirror = fed(HierarchicalMapper(ONE), mirrored(lap())).filter.maps
    true, points = seen_from(58)
    predicted = compose(true, DOUBT * np.random.default_rng(6).standard_normal((100, 3)))
    poses = proposed(copies(known_room, 100), predicted, points)
    again = proposed(copies(mirror, 100), predicted * MIRROR, points * MIRROR[:2])
    difference = np.abs(again * MIRROR - poses)
    assert (np.quantile(difference, 0.9, axis=0) < (0.005, 0.005, 0.005)).all()


def test_ten_particles_that_are_matched_keep_a_room_better_than_ten_drawn_blindly():
    """Two laps with poor odometry: the error of the path."""
    poses = round_the_room(110)
    true = compose(inverse(poses[0]), poses)
    pairs = drive(poses, (0.02, math.radians(1.0)), 3, *LASER)
    errors = {}
    for proposal in ("motion", "matched"):
        settings = MappingSettings(
            method="per-scan",
            proposal=proposal,
            particles=10,
            ego_motion="raw",
            smoothing=False,
        )
        path = fed(HierarchicalMapper(settings, 1), pairs).path()
        errors[proposal] = np.sqrt(((path - true)[:, :2] ** 2).sum(axis=1).mean())
    assert errors["matched"] < 0.06
    assert errors["matched"] < 0.5 * errors["motion"]
