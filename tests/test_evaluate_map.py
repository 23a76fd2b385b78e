"""`beemap evaluate map`: E by hand, motions found back, obstacle cells within one cell."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from mapping.grid import OccupancyGrid
from pipeline.commands.evaluate import evaluate
from pipeline.dissimilarity import KnownCells, dissimilarities, known_cells, least_dissimilarity
from pipeline.errors import InputError
from pipeline.evaluate_map import cut, evaluate_map, obstacle_rates
from pipeline.map_files import read_map, write_map_server, write_npz

NAN = math.nan
STILL = np.zeros(3)


def grid(rows, origin=(0.0, 0.0), cell=0.05) -> OccupancyGrid:
    return OccupancyGrid(np.array(rows, np.float32), origin, cell)


def room(cell: float, motion=(0.0, 0.0, 0.0), size: float = 8.0) -> OccupancyGrid:
    """A room of 6 x 5 m with a pillar and a wall, as seen in a frame moved by `motion`."""
    n = round(size / cell)
    centres = -size / 2 + (np.arange(n) + 0.5) * cell
    X, Y = np.meshgrid(centres, centres)
    c, s = math.cos(motion[2]), math.sin(motion[2])
    x, y = motion[0] + c * X - s * Y, motion[1] + s * X + c * Y
    wall = (np.abs(x) > 2.9) | (np.abs(y) > 2.4)
    wall |= np.hypot(x - 1.5, y - 1.0) < 0.3
    wall |= (np.abs(x + 1.0) < 0.05) & (y > 0.0)
    p = np.where((np.abs(x) > 3.0) | (np.abs(y) > 2.5), NAN, wall)
    return OccupancyGrid(p.astype(np.float32), (-size / 2, -size / 2), cell)


def dissimilarity_twin(cells: KnownCells, ideal: OccupancyGrid, motion: np.ndarray) -> float:
    """Eqs. (9), (10) in plain numpy."""
    x, y = cells.moved(motion)
    column = np.floor((x - ideal.origin[0]) / ideal.cell).astype(int)
    row = np.floor((y - ideal.origin[1]) / ideal.cell).astype(int)
    height, width = ideal.probability.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    t = np.full(len(x), NAN)
    t[inside] = ideal.probability[row[inside], column[inside]]
    return float(np.where(np.isnan(t), 0.1, np.abs(cells.probability - t)).sum())


def test_dissimilarity_by_hand():
    ideal = grid([[0, 0, 1], [0, NAN, 1], [0, 0, NAN]])
    generated = grid([[0.1, NAN, 0.8], [0.5, 0.9, 1.0], [NAN, 0.3, NAN]])
    # .1 + .2 | .5 + unknown ideal .1 + 0 | .3; unknown generated cells cost nothing.
    expected = 0.1 + 0.2 + 0.5 + 0.1 + 0.0 + 0.3
    (cost,) = dissimilarities(known_cells(generated), ideal, STILL[None])
    assert cost == pytest.approx(expected, abs=1e-6)


def test_cells_beyond_the_ideal_map_cost_as_unknown_ones():
    ideal = grid([[0.0]], origin=(10.0, 10.0))
    (cost,) = dissimilarities(known_cells(grid([[1.0, 0.0, NAN]])), ideal, STILL[None])
    assert cost == pytest.approx(0.2)


def test_the_cut_map_by_hand():
    p = cut(grid([[0.71, 0.7, 0.5, 0.2, 0.19, NAN]])).probability
    assert np.array_equal(p, np.array([[1, NAN, NAN, NAN, 0, NAN]], np.float32), equal_nan=True)
    ideal = grid([[1, 0, 0, 0, 0, 0]])
    score = evaluate_map(grid([[0.71, 0.9, 0.5, 0.2, 0.19, NAN]]), ideal)
    assert score.known == 5
    assert score.decided == pytest.approx(3 / 5)


def test_the_kernel_equals_its_numpy_twin():
    rng = np.random.default_rng(5)
    p = rng.random((40, 30)).astype(np.float32)
    p[rng.random(p.shape) < 0.3] = NAN
    t = np.where(rng.random((25, 45)) < 0.2, NAN, rng.random((25, 45)))
    generated, ideal = grid(p, (-0.3, 0.2), 0.05), grid(t, (-0.5, 0.1), 0.07)
    motions = rng.uniform(-1.0, 1.0, (50, 3)) * [0.6, 0.6, 0.2]
    cells = known_cells(generated)
    expected = [dissimilarity_twin(cells, ideal, motion) for motion in motions]
    assert dissimilarities(cells, ideal, motions) == pytest.approx(expected)


@pytest.mark.parametrize(
    "motion", [(0.3, -0.2, 3.0), (-0.42, 0.37, -4.0), (0.07, 0.0, 0.5), (0.0, 0.0, 0.0)]
)
@pytest.mark.parametrize("cell", [0.05, 0.08])
def test_a_moved_copy_is_found_back(motion, cell):
    motion = np.array([motion[0], motion[1], math.radians(motion[2])])
    generated = room(cell, motion)
    ideal = room(0.05)
    cost, found = least_dissimilarity(generated, ideal)
    cells = known_cells(generated)
    # Where the found motion puts each cell, against where it belongs.
    x, y = cells.x + cells.centre[0], cells.y + cells.centre[1]
    c, s = math.cos(motion[2]), math.sin(motion[2])
    belongs = motion[0] + c * x - s * y, motion[1] + s * x + c * y
    off = np.hypot(*np.subtract(cells.moved(found), belongs))
    assert off.max() < 0.05
    assert cost < 0.01 * len(cells.x)
    (as_it_stands,) = dissimilarities(cells, ideal, STILL[None])
    assert cost <= as_it_stands
    again = least_dissimilarity(generated, ideal)
    assert again[0] == cost
    assert np.array_equal(again[1], found)


def test_the_same_map_scores_perfectly():
    score = evaluate_map(room(0.05), room(0.05))
    assert score.E == 0.0
    assert score.E_cut == 0.0
    assert (score.precision, score.recall, score.f1) == (1.0, 1.0, 1.0)
    assert (score.decided, score.overlap) == (1.0, 1.0)


def test_obstacles_count_within_one_cell():
    ideal = np.zeros((12, 12))
    ideal[3, 2:10] = 1.0
    ideal[8, 2:10] = 1.0
    generated = np.zeros((12, 12))
    generated[4, 2:10] = 1.0  # one row off: right
    generated[10, 2:6] = 1.0  # two rows off: wrong
    precision, recall = obstacle_rates(grid(generated), grid(ideal), STILL)
    assert precision == pytest.approx(8 / 12)
    assert recall == pytest.approx(8 / 16)
    # Moved down by a cell, the second wall is one row off too.
    precision, recall = obstacle_rates(grid(generated), grid(ideal), np.array([0, -0.05, 0]))
    assert precision == pytest.approx(1.0)
    # Its four cells reach one column further: 5 of that wall's 8 cells are found.
    assert recall == pytest.approx((8 + 5) / 16)


def test_recall_undoes_the_motion_it_is_given():
    motion = np.array([0.3, -0.2, math.radians(4.0)])
    generated = room(0.05, motion)
    _, found = least_dissimilarity(generated, room(0.05))
    precision, recall = obstacle_rates(generated, room(0.05), found)
    assert min(precision, recall) > 0.99
    assert obstacle_rates(generated, room(0.05), STILL)[1] < 0.8


def test_a_map_without_obstacles_has_no_precision():
    score = evaluate_map(grid(np.zeros((5, 5))), grid(np.eye(5)))
    assert math.isnan(score.precision)
    assert score.recall == 0.0
    assert math.isnan(score.f1)


@pytest.fixture
def folder(tmp_path):
    write_npz(tmp_path / "map.npz", room(0.05, (0.1, 0.0, 0.02)))
    write_map_server(tmp_path, room(0.05), stem="ideal")
    return tmp_path


def test_the_command_on_a_run_folder_in_words_and_as_json(folder):
    files = [str(folder), str(folder / "ideal.yaml")]
    words = CliRunner().invoke(evaluate, ["map", *files])
    assert words.exit_code == 0
    assert "F1 1.000" in words.output
    fields = json.loads(CliRunner().invoke(evaluate, ["map", *files, "--json"]).output)
    assert fields["f1"] == pytest.approx(1.0)
    assert fields["alignment"]["x_m"] == pytest.approx(0.1, abs=0.05)
    assert fields["alignment"]["turn_deg"] == pytest.approx(math.degrees(0.02), abs=0.3)
    assert fields["E"] < 0.01 * fields["known_cells"]


def test_an_unknown_map_is_refused(folder):
    write_npz(folder / "empty.npz", grid(np.full((3, 3), NAN)))
    arguments = ["map", str(folder / "empty.npz"), str(folder / "ideal.yaml")]
    error = CliRunner().invoke(evaluate, arguments).exception
    assert isinstance(error, InputError)
    assert "empty.npz: every cell of this map is unknown" in str(error)


def test_a_folder_without_a_map_is_named(tmp_path):
    error = CliRunner().invoke(evaluate, ["map", str(tmp_path), str(tmp_path)]).exception
    assert isinstance(error, InputError)
    assert "map.npz: no such file" in str(error)


def test_numbers_that_do_not_exist_are_null_in_json(tmp_path):
    write_npz(tmp_path / "free.npz", grid(np.zeros((5, 5))))
    arguments = ["map", str(tmp_path / "free.npz"), str(tmp_path / "free.npz"), "--json"]
    fields = json.loads(CliRunner().invoke(evaluate, arguments).output)
    assert fields["f1"] is None
    assert read_map(tmp_path / "free.npz").cell == 0.05
