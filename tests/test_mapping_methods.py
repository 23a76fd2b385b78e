"""The whole mapper, by both methods: exact where odometry is, fair to every direction, the same
bytes from any number of threads, and never lost for a number."""

import csv
import math

import numba
import numpy as np
import pytest

from mapping.mapper import HierarchicalMapper
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from tests.mapping_data import CELL, drive, fed, mirrored, round_the_room, scan, wall
from tests.scan_logs import drive as log_drive
from tests.scan_logs import write_log

pytestmark = pytest.mark.usefixtures("one_thread")

HIERARCHICAL = {"method": "hierarchical"}
PER_SCAN = {"method": "per-scan", "proposal": "motion"}
MATCHED = {"method": "per-scan", "proposal": "matched"}
ALL = pytest.mark.parametrize("how", [HIERARCHICAL, PER_SCAN, MATCHED], ids=str)
NOISE = (0.01, math.radians(0.4))


def mapper_of(how, particles=10, seed=1, **others):
    return HierarchicalMapper(MappingSettings(**how, particles=particles, **others), seed)


def known_cells(mapper):
    """{(row, column) from the origin: p} of the map's known cells."""
    grid = mapper.filter.grid()
    row, column = np.nonzero(~np.isnan(grid.probability))
    first_column, first_row = (round(v / CELL) for v in grid.origin)
    places = zip((row + first_row).tolist(), (column + first_column).tolist(), strict=True)
    return dict(zip(places, grid.probability[row, column].tolist(), strict=True))


def share_alike(cells, others):
    """Share of the cells known in either map that have the same probability in both."""
    union = cells.keys() | others.keys()
    return sum(cells.get(place) == others.get(place) for place in union) / len(union)


def rmse(path, true):
    return float(np.sqrt(np.mean(np.sum((path[:, :2] - true[:, :2]) ** 2, axis=1))))


def in_first_frame(poses):
    return compose(inverse(poses[0]), poses)


@ALL
def test_perfect_odometry_gives_the_exact_path(how):
    poses = round_the_room(75, 0.12)
    mapper = fed(mapper_of(how), drive(poses, (0.0, 0.0)))
    np.testing.assert_allclose(mapper.path(), in_first_frame(poses), atol=1e-9)
    np.testing.assert_allclose(np.array(mapper.online), in_first_frame(poses), atol=1e-9)
    assert 200 < sum(p > 0.7 for p in known_cells(mapper).values()) < 1200


@ALL
def test_a_mirrored_world_gives_the_mirrored_map(how):
    """Row r becomes row -r - 1. Rounding decides the few cells through whose corner a beam goes,
    as all beams from the sensor's own do."""
    pairs = drive(round_the_room(60), (0.0, 0.0))
    cells = known_cells(fed(mapper_of(how, 1), pairs))
    mirror = known_cells(fed(mapper_of(how, 1), mirrored(pairs)))
    back = {(-row - 1, column): p for (row, column), p in mirror.items()}
    assert share_alike(cells, back) > 0.99
    assert share_alike(cells, mirror) < 0.7  # the world has no symmetry of its own


@ALL
@pytest.mark.parametrize("ego_motion", ["raw", "matched"])
def test_a_turned_world_gives_the_turned_map(how, ego_motion):
    """The same noisy drive from a start a quarter turn to the left: every cell (r, c) becomes
    (c, -r - 1), whatever the particles draw and how they are resampled."""
    pairs = drive(round_the_room(60), NOISE)
    straight, turned = (mapper_of(how, ego_motion=ego_motion) for _ in range(2))
    turned.filter.poses[:] = [0.0, 0.0, math.pi / 2]
    cells, quarter = (known_cells(fed(mapper, pairs)) for mapper in (straight, turned))
    back = {(-column - 1, row): p for (row, column), p in quarter.items()}
    assert share_alike(cells, back) > 0.999
    path = compose(np.array([0.0, 0.0, math.pi / 2]), straight.filter.path())
    np.testing.assert_allclose(turned.filter.path(), path, atol=1e-6)


@ALL
def test_a_single_particle_works(how):
    mapper = fed(mapper_of(how, 1), drive(round_the_room(30), NOISE))
    assert np.isfinite(mapper.path()).all()
    assert all(h.n_eff == 1.0 and not h.resampled for h in mapper.filter.health)
    assert len(known_cells(mapper)) > 1000


@ALL
def test_a_robot_standing_still_adds_no_observation(how):
    """Neither does the noise of its odometry; what it does add is the scan it stands at."""
    mapper, rng = mapper_of(how, 3), np.random.default_rng(0)
    standing = scan(wall(2.0))
    mapper.add(standing, Motion.none(0))
    for i in range(300):
        jitter = rng.normal(0.0, 1e-3, 3)
        mapper.add(standing, Motion(jitter, 1e-6 * np.eye(3), i, i + 1))
    _, path = mapper.finish()
    assert [h.observations for h in mapper.filter.health] == [1]
    assert len(path) == 301


@ALL
def test_threads_do_not_change_a_byte(how):
    try:
        numba.set_num_threads(2)
    except ValueError:
        pytest.skip("this machine has one core")
    pairs = drive(round_the_room(25), NOISE)
    results = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        mapper = fed(mapper_of(how), pairs)
        grid = mapper.filter.grid()
        results.append((grid.probability.tobytes(), mapper.path().tobytes(), mapper.filter.health))
    numba.set_num_threads(1)
    assert results[0] == results[1]


@ALL
def test_seeds_change_the_draws_and_nothing_else_does(how):
    pairs = drive(round_the_room(25), NOISE)
    paths = [fed(mapper_of(how, seed=seed), pairs).path().tobytes() for seed in (1, 1, 2)]
    assert paths[0] == paths[1] != paths[2]


@ALL
def test_the_best_path_ends_where_the_best_particle_is_and_health_is_complete(how):
    f = fed(mapper_of(how), drive(round_the_room(60), NOISE)).filter
    np.testing.assert_array_equal(f.path()[-1], f.poses[f.best])
    assert len(f.path()) == len(f.health) + 1
    assert all(1.0 - 1e-9 <= h.n_eff <= 10.0 + 1e-9 for h in f.health)
    assert not any(h.recovered for h in f.health)


@pytest.mark.parametrize("how", [HIERARCHICAL, PER_SCAN], ids=str)
def test_after_three_laps_the_filter_beats_dead_reckoning(how):
    """The first lap's drift goes into the map; what is driven on it again drifts no further."""
    poses, errors = round_the_room(210), []
    for seed in (1, 2, 3):
        mapper = mapper_of(how, 60, seed)
        path = fed(mapper, drive(poses, (0.01, math.radians(0.6)), seed)).path()
        true = in_first_frame(poses)
        errors.append((rmse(path, true), rmse(np.array(mapper.odometry), true)))
    filtered, dead = np.mean(errors, axis=0)
    assert dead > 0.2
    assert filtered < 0.6 * dead


def test_one_hit_makes_an_obstacle_and_one_miss_frees_per_scan_only():
    """A local map of one look leaves its free cells undecided (.338 is not below .2)."""
    cells = {}
    for how in (PER_SCAN, HIERARCHICAL):
        looked_once = fed(mapper_of(how, 1), [(scan(wall(2.02)), Motion.none(0))])
        cells[how["method"]] = known_cells(looked_once)
    # Cells at 1 m, at the wall, and behind it, straight ahead.
    p = [cells["per-scan"].get((0, column)) for column in (20, 40, 45)]
    assert p == [pytest.approx(0.338, abs=0.005), pytest.approx(0.844, abs=0.005), None]
    p = [cells["hierarchical"].get((0, column)) for column in (20, 40, 45)]
    assert p == [None, pytest.approx(0.844, abs=0.005), None]


def test_the_proposal_follows_the_method_unless_it_is_set():
    assert not MappingSettings().matched_proposal
    assert MappingSettings(method="per-scan").matched_proposal
    assert not MappingSettings(method="per-scan", proposal="motion").matched_proposal
    assert MappingSettings(proposal="matched").matched_proposal


def test_the_per_scan_method_takes_every_observation_for_itself():
    health = fed(mapper_of(PER_SCAN), drive(round_the_room(23), NOISE)).filter.health
    assert [h.observations for h in health] == [1] * 23
    health = fed(mapper_of(HIERARCHICAL), drive(round_the_room(23), NOISE)).filter.health
    assert [h.observations for h in health] == [10, 10, 3]


@ALL
@pytest.mark.parametrize("lost", [np.nan, -np.inf])
def test_weights_that_all_vanish_are_set_equal_and_the_run_goes_on(how, lost, monkeypatch):
    """As when every likelihood of one step underflows, or is no number."""
    mapper, pairs = mapper_of(how), drive(round_the_room(60), NOISE)
    weigh = mapper.filter._weigh

    def vanished(log_l):
        return weigh(np.full_like(log_l, lost) if len(mapper.filter.health) == 2 else log_l)

    monkeypatch.setattr(mapper.filter, "_weigh", vanished)
    health = fed(mapper, pairs).filter.health
    assert [i for i, h in enumerate(health) if h.recovered] == [2]
    assert health[2].n_eff == pytest.approx(10.0)
    assert all(math.isfinite(h.n_eff) for h in health)
    assert np.isfinite(mapper.path()).all()
    assert np.isfinite(mapper.filter.log_likelihood).all()


@pytest.mark.filterwarnings("ignore:overflow")
def test_likelihoods_that_overflow_together_recover_and_are_counted_in_health_csv(beemap, tmp_path):
    """With a match weight near the largest number all likelihoods soon are minus infinity."""
    d = log_drive(40)
    log = write_log(tmp_path / "room.log", [d.flaser(i) for i in range(40)])
    run = tmp_path / "run"
    settings = ["method=per-scan", "proposal=motion", "particles=4", "match_weight=1.7e308"]
    settings += ["match_tolerance=0", "resample_below=0"]
    options = [option for s in settings for option in ("--set", f"mapping.{s}")]
    outcome = beemap("map", log, "-o", run, "--quiet", *options)
    assert outcome.code == 0, outcome
    with (run / "health.csv").open() as file:
        rows = list(csv.DictReader(file))
    recovered = [row for row in rows if row["recovered"] == "1"]
    assert 0 < len(recovered) < len(rows)
    assert all(math.isfinite(float(value)) for row in rows for value in row.values())
    assert np.isfinite(np.loadtxt(run / "trajectory.tum")).all()
