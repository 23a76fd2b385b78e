"""Worlds and routes from files, and exact rays through their cells."""

from __future__ import annotations

import math
from contextlib import suppress
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from mapping.grid import OccupancyGrid
from pipeline.map_files import write_map_server
from simulation.grid_caster import cast
from simulation.paper import PaperSettings, route_poses
from simulation.world import World, load_route, load_world, world_names
from simulation.world_sheet import WorldError

SHEET = """\
beemap_world: 1
size: [4, 3]
walls:
  - {from: [0, 1], to: [4, 1], thickness: 0.1, doors: [[2.5, 0.8]]}
furniture:
  desk: {size: [1.0, 0.5], at: [[1.0, 2.0], [3.0, 2.0, 90]]}
route: {waypoints: [[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]], fillet: 0.3}
"""


def rays(solid, pose, bearing, reach=100.0, cell=1.0):
    """Ranges (m,) of one pose, and what the rays crossed, in a grid that begins at (0, 0)."""
    ranges, crossed = cast(
        np.asarray(solid, bool), 0.0, 0.0, cell, np.atleast_2d(pose), np.atleast_1d(bearing), reach
    )
    return ranges[0], crossed


def plain_ray(solid: np.ndarray, u: float, v: float, angle: float, reach: float):
    """The twin: every crossing of a grid line in order; the cell between two of them is told by
    the middle of that piece."""
    rows, columns = solid.shape
    du, dv = math.cos(angle), math.sin(angle)
    lines = [(k - u) / du for k in range(columns + 1)] + [(k - v) / dv for k in range(rows + 1)]
    crossings = sorted([0.0, *(t for t in lines if t > 0.0)])
    cells = set()
    for begin, end in pairwise(crossings):
        middle = 0.5 * (begin + end)
        column, row = math.floor(u + middle * du), math.floor(v + middle * dv)
        if begin > reach or not (0 <= row < rows and 0 <= column < columns):
            break
        cells.add((row, column))
        if solid[row, column]:
            return begin, cells
    return math.inf, cells


@given(st.integers(0, 10**6))
def test_the_caster_equals_its_plain_twin(seed):
    chance = np.random.default_rng(seed)
    solid = chance.random((9, 13)) < 0.15
    u, v = chance.uniform((0.0, 0.0), (13.0, 9.0))
    reach = chance.uniform(1.0, 20.0)
    angles = chance.uniform(-np.pi, np.pi, 7)
    ranges, crossed = rays(solid, (u, v, 0.0), angles, reach)
    twins = [plain_ray(solid, u, v, angle, reach) for angle in angles]
    np.testing.assert_allclose(ranges, [twin[0] for twin in twins], atol=1e-9)
    assert set(zip(*map(np.ndarray.tolist, np.nonzero(crossed)), strict=True)) == set.union(
        *(twin[1] for twin in twins)
    )


def test_a_range_ends_at_the_face_of_the_cell():
    solid = np.zeros((4, 6), bool)
    solid[:, 5] = True
    wall_ahead, crossed = rays(solid, (0.1, 0.1, 0.0), [0.0, math.atan2(1.0, 2.0)], cell=0.05)
    np.testing.assert_allclose(wall_ahead, [0.15, math.hypot(0.15, 0.075)], atol=1e-12)
    assert crossed[2].tolist() == [False, False, True, True, True, True]


def test_what_is_out_of_reach_or_out_of_the_world_gives_no_range():
    solid = np.zeros((4, 6), bool)
    solid[2, 5] = True
    assert rays(solid, (0.5, 2.5, 0.0), 0.0, reach=4.4)[0] == np.inf
    assert rays(solid, (0.5, 2.5, 0.0), 0.0, reach=4.6)[0] == 4.5
    assert rays(solid, (0.5, 2.5, 0.0), np.pi)[0] == np.inf
    assert rays(solid, (-3.0, 2.5, 0.0), 0.0)[0] == np.inf


def test_rays_do_not_slip_between_cells_that_touch_at_a_corner():
    solid = np.zeros((4, 4), bool)
    solid[1, 2] = solid[2, 1] = True
    diagonal, _ = rays(solid, (1.0, 1.0, np.pi / 4.0), 0.0)
    assert diagonal[0] == pytest.approx(math.sqrt(2.0))


def test_a_mirrored_world_gives_mirrored_ranges():
    chance = np.random.default_rng(4)
    solid = chance.random((20, 20)) < 0.1
    bearing = np.linspace(-1.0, 1.0, 41)
    there, _ = rays(solid, (10.3, 8.7, 0.4), bearing)
    mirrored, _ = rays(solid[::-1], (10.3, 20.0 - 8.7, -0.4), bearing)
    np.testing.assert_allclose(mirrored[::-1], there, atol=1e-9)


@pytest.fixture
def sheet(tmp_path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SHEET)
    return path


def is_solid(world: World, x: float, y: float) -> bool:
    row, column, inside = world.index(np.array([x, y]))
    assert inside
    return bool(world.solid[row, column])


def test_walls_doors_and_furniture_stand_where_the_file_says(sheet):
    world = load_world(sheet)
    assert world.name == "small"
    assert world.solid.shape == (60, 80)
    assert [is_solid(world, x, 1.0) for x in (0.1, 2.05, 2.15, 2.85, 2.95)] == [
        True, True, False, False, True,
    ]  # fmt: skip
    assert [is_solid(world, 0.1, y) for y in (0.93, 0.97, 1.03, 1.07)] == [
        False, True, True, False,
    ]  # fmt: skip
    assert is_solid(world, 1.45, 2.0)
    assert not is_solid(world, 1.0, 2.3)
    assert not is_solid(world, 3.45, 2.0)
    assert is_solid(world, 3.0, 2.45)
    desks = world.solid[30:].sum() * world.cell**2
    assert desks == pytest.approx(2 * 1.0 * 0.5, rel=0.01)


@pytest.mark.parametrize("degrees", [0, 17, 45, 90, 133])
def test_thin_walls_have_no_gaps(tmp_path, degrees):
    end = [2 + 1.5 * math.cos(math.radians(degrees)), 2 + 1.5 * math.sin(math.radians(degrees))]
    path = tmp_path / "thin.yaml"
    path.write_text(
        "beemap_world: 1\nsize: [4, 4]\n"
        f"walls: [{{from: [2, 2], to: [{end[0]}, {end[1]}], thickness: 0.01}}]"
    )
    world = load_world(path)
    _, pieces = ndimage.label(world.solid)  # type: ignore[misc]
    assert pieces == 1
    for share in np.linspace(0.02, 0.98, 60):
        assert is_solid(world, *(np.array([2.0, 2.0]) * (1.0 - share) + np.array(end) * share))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("beemap_world: 1", "beemap_world: 2", "beemap_world"),
        ("size: [4, 3]", "size: [4]", "size"),
        ("size: [4, 3]", "size: [4, -3]", "size"),
        ("size: [4, 3]", "size: [400, 300]", "too many cells"),
        ("size: [4, 3]", "colour: red", "colour"),
        ("to: [4, 1]", "to: [4, .nan]", "nan"),
        ("to: [4, 1]", "to: [4, .inf]", "walls[0].to"),
        ("doors: [[2.5, 0.8]]", "doors: [2.5]", "walls[0].doors"),
        ("thickness: 0.1", "thickness: thick", "walls[0].thickness"),
        ("[[1.0, 2.0],", "[[1.0],", "furniture"),
        ("fillet: 0.3", "fillet: 3", "too close"),
        ("waypoints: [[0.5, 0.5], ", "waypoints: [[2.5, 0.5], ", "waypoints"),
    ],
)
def test_a_mistake_in_a_world_is_named(sheet, old, new, told):
    assert old in SHEET
    sheet.write_text(SHEET.replace(old, new))
    with pytest.raises(WorldError) as error:
        load_world(sheet)
    assert str(sheet) in str(error.value)
    assert told in str(error.value)


@pytest.mark.parametrize("content", ["", "[1, 2]", "walls: [", "5"])
def test_what_is_no_world_is_refused(sheet, content):
    sheet.write_text(content)
    with pytest.raises(WorldError, match=r"small\.yaml"):
        load_world(sheet)


def test_an_unknown_name_lists_the_worlds():
    with pytest.raises(WorldError, match="corridors, flat, hall"):
        load_world("castle")


def test_any_floor_plan_can_be_a_world(sheet, tmp_path):
    world = load_world(sheet)
    plan = np.where(world.solid, 1.0, 0.0).astype(np.float32)
    plan[-1] = np.nan
    write_map_server(tmp_path, OccupancyGrid(plan, (-1.5, 2.0), 0.05), "plan")
    read = load_world(tmp_path / "plan.yaml")
    assert np.array_equal(read.solid[:-1], world.solid[:-1])
    assert not read.solid[-1].any()  # unknown is no obstacle
    assert (read.origin, read.cell, read.route) == ((-1.5, 2.0), 0.05, None)
    text = (tmp_path / "plan.yaml").read_text()
    for old, new, told in (
        ("negate: 0", "mode: raw", "mode"),
        ("plan.pgm", "gone.pgm", "gone.pgm"),
        ("plan.pgm", "plan.yaml", "not a readable image"),
        ("2.0, 0.0]", "2.0, 0.5]", "yaw"),
        ("resolution: 0.05", "resolution: 0", "resolution"),
    ):
        (tmp_path / "bad.yaml").write_text(text.replace(old, new).replace("mode: trinary\n", ""))
        with pytest.raises(WorldError, match=told):
            load_world(tmp_path / "bad.yaml")


def test_routes_are_read_from_waypoints_and_from_points(tmp_path):
    waypoints = [[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]]
    (tmp_path / "r.yaml").write_text(f"{{waypoints: {waypoints}, fillet: 0.5}}")
    (tmp_path / "r.csv").write_text("x,y\n0,0\n2,0\n2.0,3\n")
    (tmp_path / "r.txt").write_text("# by hand\n0 0 0\n0.001 0 0\n2 0 1.57 # corner\n\n2 3 1.57\n")
    tum = "".join(f"{i} {x} {y} 0 0 0 0 1\n" for i, (x, y) in enumerate(waypoints))
    (tmp_path / "r.tum").write_text(tum)
    routes = [load_route(tmp_path / f"r.{end}") for end in ("yaml", "csv", "txt", "tum")]
    times = np.linspace(0.0, 4.7, 40)
    for route in routes:
        assert route.distance == pytest.approx(5.0 - 1.0 + math.pi / 4.0)
        np.testing.assert_allclose(route.poses(times), routes[0].poses(times), atol=1e-9)


def test_a_dense_path_is_followed_though_its_corners_are_narrow(tmp_path):
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = np.stack([2.0 * np.cos(angle), 2.0 * np.sin(angle)], axis=1)
    np.savetxt(tmp_path / "circle.txt", circle)
    poses = load_route(tmp_path / "circle.txt").poses(np.arange(0.0, 12.0, 0.1))
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 2.0, atol=0.01)
    tangent = np.arctan2(poses[:, 1], poses[:, 0]) + np.pi / 2.0
    assert np.abs(np.exp(1j * (poses[:, 2] - tangent)) - 1.0).max() < 0.05


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("0 0\n1 x\n", "line 2"),
        ("0 0\n1 2 3 4\n", "line 2"),
        ("0 0\n1 nan\n", "line 2"),
        ("0 0\n", "two different points"),
        ("", "two different points"),
        ("0 0\n2 0\n0 0\n", "forward"),
    ],
)
def test_a_mistake_in_a_route_is_named(tmp_path, content, told):
    (tmp_path / "route.csv").write_text(content)
    with pytest.raises(WorldError, match=told) as error:
        load_route(tmp_path / "route.csv")
    assert "route.csv" in str(error.value)


@given(st.text(alphabet="0123456789 .,-#enaxy\n", max_size=60))
def test_any_text_is_a_route_or_a_world_error(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_text(text)
    with suppress(WorldError):  # and no other error
        assert load_route(path).distance > 0.0


@pytest.mark.parametrize("name", world_names())
def test_shipped_worlds_have_room_for_the_paper_s_run(name):
    world = load_world(name)
    assert world.solid.shape == (360, 360)
    assert world.cell == 0.05
    assert world.route is not None
    poses = route_poses(world, world.route, PaperSettings())
    assert len(poses) == 785
    np.testing.assert_allclose(np.hypot(*np.diff(poses[:, :2], axis=0).T), 0.2, atol=0.004)
    row, column, _ = world.index(poses[:, :2])
    assert ndimage.distance_transform_edt(~world.solid)[row, column].min() * world.cell >= 0.25  # type: ignore[index]
    # The border is closed, and the first pose stands on a corner of cells along their axes.
    for side in (world.solid[0], world.solid[-1], world.solid[:, 0], world.solid[:, -1]):
        assert side.all()
    np.testing.assert_allclose(poses[0, :2] / 0.05, np.round(poses[0, :2] / 0.05), atol=1e-9)
    assert poses[0, 2] % (np.pi / 2.0) == 0.0


@pytest.mark.parametrize("name", world_names())
def test_shipped_routes_come_back_to_where_they_were(name):
    world = load_world(name)
    assert world.route is not None
    places = route_poses(world, world.route, PaperSettings())[:, :2]
    gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    later = np.arange(785)[:, None] - np.arange(785)[None] > 100  # 20 m of driving between
    again = (later & (gaps < 0.3)).any(axis=1)
    assert 0.15 < again.mean() < 0.8


def test_shipped_worlds_differ():
    assert len(world_names()) >= 3
    for one, other in combinations(map(load_world, world_names()), 2):
        # The closed border is the same in all.
        a, b = one.solid[3:-3, 3:-3], other.solid[3:-3, 3:-3]
        assert (a & b).sum() < 0.25 * (a | b).sum()
