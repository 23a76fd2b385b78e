"""Scenes and routes: geometry, the office that ships, and what a wrong file is told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from odometry.motion import wrap_angle
from simulation.boxes import Box, box_faces
from simulation.route import Route
from simulation.scene import SceneError, load_scene, scene_from_dict, scene_names
from simulation.world import load_world
from tests.simulation_rooms import room, room_sheet

ROBOT_TOP = 1.2


def distances(points: np.ndarray, box: Box) -> np.ndarray:
    """(n,) horizontal distance of `points` (n, 2) to the box, 0 inside."""
    c, s = math.cos(box.turn), math.sin(box.turn)
    local = (points - box.centre) @ np.array([[c, -s], [s, c]])
    return np.hypot(*np.maximum(np.abs(local) - np.array(box.size[:2]) / 2.0, 0.0).T)


# The floor plan of the paper's world has its own route, which passes some things closer.
@pytest.mark.parametrize(
    ("preset", "clearance", "shortest"),
    [
        ("office", 0.45, 60.0),
        ("corridor", 0.6, 60.0),
        ("glass", 0.6, 60.0),
        ("clutter", 0.45, 60.0),
        ("paper", 0.26, 150.0),
    ],
)
def test_routes_keep_clear_of_everything(preset, clearance, shortest):
    scene = load_scene(preset)
    assert preset in scene_names()
    assert scene.route.distance > shortest
    times = np.arange(0.0, scene.route.duration, 0.1)
    path = scene.route.poses(times)[:, :2]
    nearest = min(
        distances(path, box).min()
        for box in scene.boxes
        if box.top > 0.02 and box.bottom < ROBOT_TOP
    )
    assert nearest >= clearance
    for mover in scene.movers:
        walked = np.array([mover.pose(time)[:2] for time in times])
        assert np.hypot(*(walked - path).T).min() > 0.7
        assert all(
            distances(walked, box).min() > 0.3
            for box in scene.boxes
            if box.top > 0.02 and box.bottom < 1.8
        )


@pytest.mark.parametrize("preset", ["office", "corridor", "glass", "clutter", "paper"])
def test_routes_come_back_to_places_they_have_seen(preset):
    route = load_scene(preset).route
    poses = route.poses(np.arange(0.0, route.duration, 0.5))
    apart = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    later = np.arange(len(poses))[None, :] > np.arange(len(poses))[:, None] + 60
    turn = np.abs(wrap_angle(poses[:, None, 2] - poses[None, :, 2]))
    assert ((apart < 0.5) & later & (turn < 0.5)).any(axis=0).sum() > 30


def test_the_papers_preset_stands_on_the_floor_plan_of_its_world():
    scene, world = load_scene("paper"), load_world("flat")
    rows, columns = world.solid.shape
    assert scene.size[:2] == (columns * world.cell, rows * world.cell)
    x, y = np.meshgrid((np.arange(columns) + 0.5) * 0.05, (np.arange(rows) + 0.5) * 0.05)
    cells = np.stack([x, y], axis=-1).reshape(-1, 2)
    solid = np.zeros(len(cells), bool)
    for box in scene.boxes:
        if box.bottom < 1.2 and box.top > 0.1:
            solid |= distances(cells, box) <= 1e-9
    np.testing.assert_array_equal(solid.reshape(rows, columns), world.solid)
    assert world.route is not None
    assert scene.route.distance == pytest.approx(world.route.distance)


def test_movers_of_the_clutter_come_into_view():
    scene = load_scene("clutter")
    assert len(scene.movers) == 2
    times = np.arange(0.0, scene.route.duration, 0.5)
    poses = scene.route.poses(times)
    for mover in scene.movers:
        way = np.array([mover.pose(time)[:2] for time in times]) - poses[:, :2]
        bearing = wrap_angle(np.arctan2(way[:, 1], way[:, 0]) - poses[:, 2])
        assert ((np.abs(bearing) < 0.5) & (np.hypot(*way.T) < 4.0)).sum() > 20


def test_walls_leave_their_doors_open_and_close_above_them():
    entry = {"from": [0, 1], "to": [4, 1], "material": "white", "doors": [[1.0, 0.9]]}
    pieces = scene_from_dict({**room_sheet(), "walls": [entry]}, "room").boxes[6:-1]
    assert [box.material for box in pieces] == ["white"] * 3
    low = [box for box in pieces if box.bottom == 0.0]
    inside = np.array([[1.0, 1.0]])
    assert min(distances(inside, box)[0] for box in low) == pytest.approx(0.45)
    (lintel,) = (box for box in pieces if box.bottom > 0.0)
    assert lintel.bottom == pytest.approx(2.06)
    assert lintel.top == pytest.approx(2.5)
    assert distances(inside, lintel)[0] == 0.0


def test_glazing_has_posts_every_pane_and_a_gap_for_the_door():
    entry = {"from": [1, 0], "to": [1, 4], "pane": 0.8, "height": 2.2, "doors": [[3.5, 0.9]]}
    boxes = scene_from_dict({**room_sheet(), "glazing": [entry]}, "room").boxes[6:-1]
    panes = [box for box in boxes if box.material == "glass"]
    posts = [box for box in boxes if box.size[2] == 2.2]
    # 3.05 m to the door in four panes; what is left behind it is too narrow for one.
    assert len(panes) == 4
    assert sorted(round(float(post.centre[1]), 4) for post in posts) == pytest.approx(
        [0.0, 0.7625, 1.525, 2.2875, 3.05]
    )
    for pane in panes:
        np.testing.assert_allclose(np.ptp(pane.corners, axis=0), [0.012, 0.7625], atol=1e-9)
    door = np.array([[1.0, 3.5]])
    assert min(distances(door, box)[0] for box in boxes if box.bottom < 2.0) > 0.4


def test_repeated_objects_stand_in_a_row():
    chair = {"material": "wood", "at": [1, 1, 0], "size": [0.4, 0.4, 0.8], "repeat": [3, 1.5, 0.2]}
    boxes = scene_from_dict(room_sheet(chair), "room").boxes[-3:]
    np.testing.assert_allclose([box.centre for box in boxes], [[1, 1], [2.5, 1.2], [4.0, 1.4]])


def test_office_is_the_papers_room_with_a_route_that_revisits():
    scene = load_scene("office")
    assert scene.size == (12.0, 7.5, 2.5)
    assert 60.0 <= scene.route.distance <= 66.0
    poses = scene.route.poses(np.arange(0.0, scene.route.duration, 0.5))
    apart = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    turn = np.abs(wrap_angle(poses[:, None, 2] - poses[None, :, 2]))
    later = np.arange(len(poses))[None, :] > np.arange(len(poses))[:, None] + 40
    again = (apart < 0.5) & later
    assert (again & (turn < 0.5)).any(axis=0).sum() > 30  # the same way once more
    assert (again & (turn > 2.6)).any(axis=0).sum() > 30  # and the other way round


def test_route_drives_forward_at_its_speed_and_never_turns_faster_than_allowed():
    route = load_scene("office").route
    step = 0.01
    poses = route.poses(np.arange(0.0, route.duration, step))
    moves = np.diff(poses[:, :2], axis=0)
    speed = np.hypot(*moves.T) / step
    assert speed.max() <= 0.34 + 1e-6
    assert np.median(speed) == pytest.approx(0.34, abs=1e-6)
    assert np.abs(np.diff(poses[:, 2])).max() / step <= 0.5
    middle = 0.5 * (poses[1:, 2] + poses[:-1, 2])
    ahead = np.stack([np.cos(middle), np.sin(middle)], axis=1)
    np.testing.assert_allclose((moves * ahead).sum(axis=1), speed * step, atol=1e-5)


@settings(max_examples=50, deadline=None)
@given(
    turns=st.lists(st.floats(-2.5, 2.5), min_size=1, max_size=6),
    fillet=st.floats(0.05, 0.6),
)
def test_route_is_continuous_and_ends_at_its_last_waypoint(turns, fillet):
    headings = np.concatenate([[0.0], np.cumsum(turns)])
    legs = 5.0 * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(legs, axis=0)])
    route = Route.through(points, fillet, 0.34, 0.5)
    times = np.linspace(0.0, route.duration, 2000)
    poses = route.poses(times)
    np.testing.assert_allclose(poses[0, :2], points[0], atol=1e-9)
    np.testing.assert_allclose(poses[-1, :2], points[-1], atol=1e-6)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert steps.max() <= 0.34 * (times[1] - times[0]) + 1e-9
    assert poses[-1, 2] == pytest.approx(headings[-1], abs=1e-9)


def test_route_stands_before_and_after():
    route = Route.through(np.array([[0.0, 0.0], [1.0, 0.0]]), 0.3, 0.5, 0.5)
    np.testing.assert_allclose(route.poses(np.array([-1.0, 9.0])), [[0, 0, 0], [1, 0, 0]])


def test_faces_of_a_turned_box_point_outward_and_enclose_it():
    box = Box("wood", (1.0, 2.0), 0.5, (0.4, 0.6, 0.8), turn=0.3)
    faces = box_faces((box,))
    middle = np.array([1.0, 2.0, 0.9])
    centres = (
        faces.origin
        + 0.5 * faces.size[:, :1] * faces.u_axis
        + 0.5 * faces.size[:, 1:] * faces.v_axis
    )
    reach = ((centres - middle) * faces.normal).sum(axis=1)
    np.testing.assert_allclose(reach, [0.2, 0.3, 0.2, 0.3, 0.4, 0.4], atol=1e-12)
    vertices, triangles = faces.mesh()
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert areas.sum() == pytest.approx(2 * (0.4 * 0.6 + 0.4 * 0.8 + 0.6 * 0.8), rel=1e-5)


def test_models_are_placed_and_turned():
    sheet = room_sheet({"model": "post", "at": [2.0, 1.0], "turn": 90})
    sheet["models"] = {"post": [{"material": "wood", "at": [0.5, 0, 0], "size": [0.2, 0.4, 1.0]}]}
    post = scene_from_dict(sheet, "room").boxes[-1]
    np.testing.assert_allclose(post.centre, (2.0, 1.5))
    np.testing.assert_allclose(np.ptp(post.corners, axis=0), (0.4, 0.2))


def test_scene_file_is_read_from_a_path(tmp_path):
    path = tmp_path / "den.yaml"
    path.write_text(
        "beemap_scene: 1\n"
        "room: {size: [6, 4, 2.5], floor: carpet, walls: plaster, ceiling: ceiling}\n"
        "objects: [{material: wood, at: [3, 3, 0], size: [1, 1, 5e-1]}]\n"
        "route: {waypoints: [[1, 1], [4, 1]], fillet: 0.5, speed: 0.34, turn_rate: 27}\n"
    )
    scene = load_scene(path)
    assert scene.name == "den"
    assert scene.boxes[-1].size == (1.0, 1.0, 0.5)


def _broken(change) -> dict:
    sheet = room_sheet({"material": "wood", "at": [2, 1, 0], "size": [1, 1, 1]})
    change(sheet)
    return sheet


def _wall(**changed) -> dict:
    return {"from": [0, 1], "to": [4, 1], "material": "white", **changed}


def _pane(**changed) -> dict:
    return {"from": [0, 1], "to": [4, 1], **changed}


def _mover() -> dict:
    return {"model": "cat", "path": [[1, 1], [2, 1]], "speed": 1}


def _flat() -> dict:
    surfaces = {"floor": "carpet", "walls": "plaster", "ceiling": "ceiling"}
    return {"world": "flat", "height": 2.5, **surfaces}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.pop("beemap_scene"), "not a scene file"),
        (lambda s: s.pop("route"), "field 'route' is missing"),
        (lambda s: s.update(sofa=1), "unknown field 'sofa'"),
        (lambda s: s["room"].update(size=[6, 4]), r"room\.size: expected 3"),
        (lambda s: s["room"].update(walls="marble"), r"room\.walls: 'marble' unknown"),
        (lambda s: s["objects"][1].update(size=[1, 0, 1]), r"objects\[1\]\.size: .* positive"),
        (lambda s: s["objects"][1].update(at=[1, "x", 0]), r"objects\[1\]\.at: expected 3"),
        (lambda s: s["objects"].append({"model": "sofa", "at": [1, 1]}), r"objects\[2\]\.model"),
        (lambda s: s["route"].update(fillet=-1), r"route\.fillet"),
        (lambda s: s["route"].update(waypoints=[[1, 1], [9, 1]]), r"waypoints\[1\]: .* outside"),
        (lambda s: s["route"].update(waypoints=[[1, 1], [3, 1], [1, 1]]), "turns back"),
        (lambda s: s["route"].update(waypoints=[[1, 1], [1.2, 1], [1.2, 3]]), "too close"),
        (lambda s: s.update(models=3), "models"),
        (lambda s: s.update(light="soft"), "light: 'soft' unknown: give smooth or coarse"),
        (lambda s: s["objects"][1].update(repeat=[0.5, 1, 0]), r"objects\[1\]\.repeat: 0.5"),
        (
            lambda s: s.update(walls=[{"from": [0, 1], "to": [4, 1]}]),
            r"walls\[0\]: field 'material'",
        ),
        (lambda s: s.update(walls=[_wall(to=[0, 1])]), r"walls\[0\]\.to: .* another end"),
        (lambda s: s.update(walls=[_wall(doors=[[5, 1]])]), r"walls\[0\]\.doors\[0\]: .* 4.00 m"),
        (
            lambda s: s.update(glazing=[_pane(glass="ice")]),
            r"glazing\[0\]\.glass: 'ice' .* clear",
        ),
        (lambda s: s.update(movers=[_mover()]), r"movers\[0\]\.model: 'cat' is not under models"),
        (lambda s: s.update(furniture={}), "furniture: belongs to a room of a world"),
        (
            lambda s: s.update(room={**_flat(), "world": "moon"}),
            r"room\.world: moon: no such",
        ),
        (lambda s: s.update(room=_flat()), "furniture: field 'cabinet' is missing"),
    ],
)
def test_a_wrong_scene_names_file_and_field(change, message):
    with pytest.raises(SceneError, match=message) as caught:
        scene_from_dict(_broken(change), "den.yaml")
    assert str(caught.value).startswith("den.yaml")
    assert "\n" not in str(caught.value)


def test_no_such_scene():
    with pytest.raises(SceneError, match="no such file"):
        load_scene("attic")


def test_every_face_carries_its_boxs_number():
    scene = room()
    assert np.bincount(scene.faces().seed).tolist() == [6] * len(scene.boxes)
