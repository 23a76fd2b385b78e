"""map.yaml and map.pgm by nav2's rules are the map of map.npz."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mapping.grid import FREE_BELOW, OCCUPIED_ABOVE, OccupancyGrid
from pipeline.map_files import read_map, write_map_server
from pipeline.picture import LONG_SIDE, MARGIN, PAPER, UNKNOWN, WALL, draw_map
from pipeline.run_report.map_view import _picture
from pipeline.trajectory import read_tum
from tests import nav2_map


def expected(probability: np.ndarray) -> np.ndarray:
    """What a cell of that probability is for a planner; what nobody knows stays unknown."""
    cells = np.full(probability.shape, -1)
    cells[probability > OCCUPIED_ABOVE] = 100
    cells[probability < FREE_BELOW] = 0
    return cells


def check(file: Path, probability: np.ndarray, origin: tuple[float, float], cell: float) -> None:
    found = nav2_map.load(file)
    assert (found.height, found.width) == probability.shape
    assert found.resolution == pytest.approx(cell)
    assert found.origin == pytest.approx((*origin, 0.0))
    data = np.array(found.data).reshape(probability.shape)
    np.testing.assert_array_equal(data, expected(probability))


def test_the_map_of_a_run(office_run):
    kept = np.load(office_run / "map.npz")
    probability = kept["probability"]
    for value in (100, 0, -1):
        assert (expected(probability) == value).any()
    x, y = kept["origin"].tolist()
    check(office_run / "map.yaml", probability, (x, y), float(kept["cell"]))


def test_a_planner_can_start_from_every_pose_of_the_run(office_run):
    """The track of the office's wheels is 0.3 m: so wide the way that was driven is free."""
    found = nav2_map.load(office_run / "map.yaml")
    data = np.array(found.data).reshape(found.height, found.width)
    poses = read_tum(office_run / "trajectory.tum").poses
    for aside in (-0.11, 0.0, 0.11):
        to_left = np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
        x, y = ((poses[:, :2] + aside * to_left - found.origin[:2]) / found.resolution).T
        assert (data[np.floor(y).astype(int), np.floor(x).astype(int)] == 0).all()


def test_the_picture_shows_the_classes_of_the_planner(office_run):
    grid = read_map(office_run)
    nobody = np.empty((0, 3))
    picture = draw_map(grid, nobody, nobody, "")
    found = nav2_map.load(office_run / "map.yaml")
    data = np.array(found.data).reshape(found.height, found.width)[::-1]
    zoom = max(1, min(16, LONG_SIDE // max(data.shape)))
    left = (picture.shape[1] - zoom * data.shape[1]) // 2
    rows = MARGIN + zoom // 2 + zoom * np.arange(data.shape[0])
    columns = left + zoom // 2 + zoom * np.arange(data.shape[1])
    shown = picture[rows[:, None], columns]
    report = _picture(grid)
    for value, colour in ((0, PAPER), (100, WALL), (-1, UNKNOWN)):
        assert ((shown == colour).all(axis=2) == (data == value)).all()
        if value >= 0:
            assert ((report == (*colour, 255)).all(axis=2) == (data == value)).all()
    summary = json.loads((office_run / "run.json").read_text())
    area = found.resolution**2
    assert summary["free_m2"] == pytest.approx((data == 0).sum() * area, abs=0.01)
    assert summary["occupied_m2"] == pytest.approx((data == 100).sum() * area, abs=0.01)


@settings(max_examples=40)
@given(
    probability=arrays.arrays(
        np.float32, arrays.array_shapes(min_dims=2, max_dims=2, max_side=7),
        elements=st.floats(0.0, 1.0, width=32) | st.just(float("nan")),
    ),
    origin=st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
    cell=st.sampled_from([0.02, 0.05, 0.1]),
)  # fmt: skip
def test_any_map(tmp_path_factory, probability, origin, cell):
    folder = tmp_path_factory.mktemp("map")
    write_map_server(folder, OccupancyGrid(probability, origin, cell), "other")
    check(folder / "other.yaml", probability, origin, cell)


@pytest.mark.parametrize("threshold", [0.25, 0.196])
def test_nav2s_usual_threshold_would_make_the_unknown_free(tmp_path, threshold):
    """Why free_thresh is 0.196: grey 205 is an occupancy of 0.19608."""
    grid = OccupancyGrid(np.full((2, 3), np.nan, np.float32), (0.0, 0.0), 0.05)
    write_map_server(tmp_path, grid)
    file = tmp_path / "map.yaml"
    file.write_text(file.read_text().replace("free_thresh: 0.196", f"free_thresh: {threshold}"))
    assert set(nav2_map.load(file).data) == {0 if threshold == 0.25 else -1}


def test_by_scale_our_greys_mean_the_same_for_what_is_decided(office_run, tmp_path):
    """`mode: scale` reads the same image; only the unknown has a value there."""
    text = (office_run / "map.yaml").read_text().replace("trinary", "scale")
    (tmp_path / "map.yaml").write_text(text)
    (tmp_path / "map.pgm").write_bytes((office_run / "map.pgm").read_bytes())
    scaled = np.array(nav2_map.load(tmp_path / "map.yaml").data)
    decided = np.array(nav2_map.load(office_run / "map.yaml").data)
    assert (scaled[decided >= 0] == decided[decided >= 0]).all()
