"""The numbers that the experiments report: intervals, consistency, maps that drifted askew."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.grid import OccupancyGrid
from odometry.motion import compose
from pipeline.evaluate_map import evaluate_map
from pipeline.experiments.batch import Run
from pipeline.experiments.consistency import band, nees, share_inside
from pipeline.experiments.measure import FILTER_SEED, as_points, ideal_of, map_run, measure
from pipeline.experiments.options import mapping_settings
from pipeline.experiments.presets import OURS, PAPER
from pipeline.experiments.scores import best_score, carried, frames, least_E
from pipeline.experiments.spec import place
from pipeline.experiments.summary import grouped, lost, of, spread, wilson
from simulation.paper import PaperSettings, simulate
from tests.experiment_runs import result, spec, tiny_world


@pytest.fixture(autouse=True)
def threads_as_before():
    """`measure` sets the threads of its process, which is not ours to keep."""
    before = numba.get_num_threads()
    yield
    numba.set_num_threads(before)


COVARIANCE = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.004], [0.002, -0.004, 0.01]])


@pytest.mark.parametrize(
    ("failures", "runs", "low", "high"),
    [
        (0, 24, 0.0, 0.1380),  # z2 / (n + z2)
        (0, 200, 0.0, 0.0188),
        (1, 10, 0.0179, 0.4042),
        (5, 5, 0.5655, 1.0),
        (0, 0, 0.0, 1.0),
    ],
)
def test_wilson_interval_by_hand(failures, runs, low, high):
    assert wilson(failures, runs) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_holds_the_rate_and_is_symmetric(seen):
    failures, runs = seen
    low, high = wilson(failures, runs)
    assert 0.0 <= low <= failures / runs + 1e-12
    assert failures / runs - 1e-12 <= high <= 1.0
    assert wilson(runs - failures, runs) == pytest.approx((1.0 - high, 1.0 - low))


def test_wilson_interval_covers_the_true_rate():
    lost_runs = np.random.default_rng(1).binomial(50, 0.1, size=2000)
    covered = [low <= 0.1 <= high for low, high in (wilson(int(n), 50) for n in lost_runs)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.03)


def test_spread_leaves_out_what_was_not_measured():
    found = spread([0.1, math.nan, 0.4, 0.2, 0.3])
    assert (found.mean, found.median, found.worst) == pytest.approx((0.25, 0.25, 0.4))
    assert (found.lower, found.upper) == pytest.approx((0.175, 0.325))
    assert math.isnan(spread([math.nan]).median)


def test_runs_are_grouped_and_their_losses_counted(tmp_path):
    world = tiny_world(tmp_path)
    runs = [
        Run(spec(world, seed, alpha=alpha), result(ate=ate, lost=int(ate > 1.0)))
        for seed, alpha, ate in ((1, 4.0, 1.5), (1, 0.0, 0.1), (2, 4.0, 0.5), (2, 0.0, 0.3))
    ]
    groups = grouped(runs, lambda spec: spec.alpha)
    assert list(groups) == [4.0, 0.0]
    assert lost(groups[4.0]) == (1, *wilson(1, 2))
    assert of(groups[0.0], "ate").mean == pytest.approx(0.2)


def test_nees_of_a_fair_spread_is_chi_square():
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(COVARIANCE)
    pose = np.array([3.0, -2.0, math.pi - 0.05])  # some headings lie beyond pi

    def drawn(n: int) -> np.ndarray:
        return compose(pose, np.zeros(3)) + rng.standard_normal((n, 3)) @ root.T

    def wrapped(poses: np.ndarray) -> np.ndarray:
        return compose(np.zeros(3), poses)

    values = np.array(
        [nees(wrapped(drawn(400)), np.zeros(400), wrapped(drawn(1))[0]) for _ in range(800)]
    )
    assert values.mean() == pytest.approx(3.0, abs=0.3)
    assert share_inside(values, band(1)) == pytest.approx(0.95, abs=0.02)
    low, high = band(800)
    assert low < values.mean() < high


def test_nees_by_hand():
    poses = np.array([[-0.1, 0, 0], [0.1, 0, 0], [0, -0.2, 0], [0, 0.2, 0], [0, 0, -0.3],
                      [0, 0, 0.3]])  # fmt: skip
    variance = np.array([0.01, 0.04, 0.09]) / 3.0
    error = np.array([0.05, 0.1, -0.2])
    expected = np.sum(error**2 / variance)
    assert nees(poses, np.zeros(6), error) == pytest.approx(expected)
    # Weights count as so many particles.
    doubled = np.concatenate([poses, poses[:2]])
    weights = np.log([2.0, 2.0, 1.0, 1.0, 1.0, 1.0])
    assert nees(poses, weights, error) == pytest.approx(nees(doubled, np.zeros(8), error))


def test_nees_where_the_particles_agree():
    same = np.tile([1.0, 2.0, 0.5], (50, 1))
    assert nees(same, np.zeros(50), np.array([1.0, 2.0, 0.5])) == 0.0
    assert nees(same, np.zeros(50), np.array([1.0, 2.01, 0.5])) == math.inf
    # Along x they differ, the error lies across.
    same[:25, 0] += 0.2
    assert nees(same, np.zeros(50), np.array([1.1, 2.0, 0.5])) == pytest.approx(0.0)
    assert nees(same, np.zeros(50), np.array([1.1, 2.01, 0.5])) == math.inf


def test_bands_of_chi_square():
    assert band(1) == pytest.approx((0.2158, 9.3484), abs=1e-4)
    assert band(1, 3.0) == pytest.approx((0.2158 / 3.0, 3.0 * 9.3484), abs=1e-3)
    low, high = band(200)
    assert 2.6 < low < 3.0 < high < 3.4
    values = np.array([0.1, 1.0, 9.0, 10.0, np.inf])
    assert share_inside(values, band(1)) == 0.4


@pytest.fixture(scope="module")
def room() -> OccupancyGrid:
    """A room of 6 x 4 m with an inner wall."""
    p = np.zeros((80, 120), np.float32)
    p[[0, -1], :] = p[:, [0, -1]] = p[40, :70] = 1.0
    return OccupancyGrid(p, (-3.0, -2.0), 0.05)


def test_a_quarter_turn_moves_every_cell(room):
    turned = carried(room, np.array([1.0, 0.5, math.pi / 2.0]))
    trimmed = turned.trimmed()
    assert np.array_equal(trimmed.probability, np.rot90(room.probability, -1))
    assert trimmed.origin == pytest.approx((1.0 - 2.0, 0.5 - 3.0))
    assert np.array_equal(carried(room, np.zeros(3)).trimmed().probability, room.probability)


def test_a_map_askew_is_compared_where_its_path_puts_it(room):
    askew = np.array([0.8, -0.4, math.radians(12.0)])
    drawn = carried(room, askew)
    turn = np.array([0.0, 0.0, -askew[2]])
    back = compose(turn, np.array([-askew[0], -askew[1], 0.0]))
    places = frames(drawn, back)
    assert len(places) == 2
    assert best_score(places, room).f1 > 0.98 > evaluate_map(drawn, room).f1
    assert least_E(places, room) < 0.3 * evaluate_map(drawn, room).E
    # Within reach of the search the map stays where it is.
    assert frames(room, np.array([0.1, 0.1, 0.01])) == [room]


def test_the_paper_s_settings_are_the_paper_s():
    paper = mapping_settings(PAPER.settings)
    assert (paper.hit, paper.false_hit, paper.occupied, paper.free) == (0.54, 0.1, 0.7, 0.2)
    assert (paper.match_weight, paper.particles, paper.window, paper.cell) == (50, 100, 10, 0.05)
    assert (paper.ego_motion, paper.match_tolerance, paper.min_overlap) == ("raw", 1, 50)
    assert not PAPER.sigma
    ours = mapping_settings(OURS.settings)
    assert (ours.ego_motion, ours.match_weight, ours.window) == ("matched", 20, 10)
    assert OURS.sigma


def test_perfect_sensors_give_the_ideal_map_and_the_exact_path(tmp_path):
    one = spec(tiny_world(tmp_path), 1, "mapping.particles=5")
    settings = PaperSettings(positions=one.positions)
    perfect = simulate(*place(one.world, None), settings, 1, perfect=True)
    mapped = map_run(as_points(perfect.scans), perfect, one.mapping, FILTER_SEED)
    assert mapped.path == pytest.approx(perfect.truth, abs=1e-9)
    ideal = ideal_of(one)
    assert np.array_equal(mapped.grid.probability, ideal.probability, equal_nan=True)
    assert mapped.nees == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("method", ["hierarchical", "per-scan"])
def test_a_run_is_measured_the_same_twice(tmp_path, method):
    task = (spec(tiny_world(tmp_path), 4, f"mapping.method={method}", keep_map=True), tmp_path)
    first, second = measure(task), measure(task)
    clock = ("cpu_s", "wall_s")
    names = [name for name in first.__struct_fields__ if name not in clock]
    assert [getattr(first, n) for n in names] == [getattr(second, n) for n in names]
    assert 0.0 < first.ate < 0.3
    assert 0.0 < first.dead_reckoning < 0.3
    assert len(first.nees_series) == 3
    assert first.travelled_m == pytest.approx(7.59, abs=0.02)
    assert (tmp_path / "maps" / f"{task[0].key}.npz").is_file()
