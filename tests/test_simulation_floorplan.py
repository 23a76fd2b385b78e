"""Truth maps: furniture where it stands, and nothing seen that is not there."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.rig import Mount
from simulation.floorplan import cell_index, floor_plan, seen_plan
from simulation.scene import load_scene
from tests.simulation_rooms import room, small_rig

CRATE = {"material": "cardboard", "at": [3.0, 2.6, 0.0], "size": [0.5, 0.4, 0.6], "turn": 30}
SHELF_ABOVE = {"material": "wood", "at": [4.0, 1.0, 1.5], "size": [0.5, 0.4, 0.1]}
MAT = {"material": "fabric", "at": [2.0, 1.0, 0.0], "size": [0.5, 0.4, 0.05]}
START = np.array([1.0, 2.0, 0.0])


def value(grid, x: float, y: float) -> float:
    """The grid's value at a point of the scene, seen from START."""
    return float(grid.probability[cell_index(grid, np.array([x, y]) - START[:2])])


def test_floor_plan_holds_what_stands_in_the_band():
    plan = floor_plan(room(CRATE, SHELF_ABOVE, MAT), START)
    assert value(plan, 3.0, 2.6) == 1.0
    assert value(plan, 6.02, 2.0) == 1.0  # the east wall
    assert value(plan, 4.0, 1.0) == 0.0  # too high to matter
    assert value(plan, 2.0, 1.0) == 0.0  # too low
    assert np.isnan(value(plan, 6.3, 2.0))  # behind the wall
    area = 0.05**2 * np.count_nonzero(
        plan.probability[cell_rows(plan, 2.0, 3.2), cell_columns(plan, 2.5, 3.5)] == 1.0
    )
    assert 0.5 * 0.4 <= area <= 0.7 * 0.6


def cell_rows(grid, low: float, high: float) -> slice:
    return slice(*(int(cell_index(grid, np.array([0.0, y - START[1]]))[0]) for y in (low, high)))


def cell_columns(grid, low: float, high: float) -> slice:
    return slice(*(int(cell_index(grid, np.array([x - START[0], 0.0]))[1]) for x in (low, high)))


def test_thin_panels_leave_no_gap():
    panel = {"material": "wood", "at": [3.0, 2.6, 0.0], "size": [1.0, 0.01, 1.0], "turn": 17}
    plan = floor_plan(room(panel), START)
    ends = np.array([3.0, 2.6]) + np.outer([-0.49, 0.49], (0.956305, 0.292372))
    for x, y in np.linspace(ends[0], ends[1], 200):
        assert value(plan, x, y) == 1.0


def test_the_plan_turns_with_the_first_pose():
    turned = np.array([1.0, 2.0, np.pi / 2.0])
    plan = floor_plan(room(CRATE), turned)
    # 2 m ahead and 0.6 m to the left of START; from the turned robot 0.6 m ahead, 2 m right.
    assert plan.probability[cell_index(plan, np.array([0.6, -2.0]))] == 1.0
    straight = floor_plan(room(CRATE), START)
    assert (plan.probability == 1.0).sum() == pytest.approx(
        (straight.probability == 1.0).sum(), rel=0.02
    )


def test_seen_is_a_part_of_the_plan():
    scene = room(CRATE)
    poses = np.array([START, [1.5, 2.0, 0.3], [2.0, 2.1, -0.4]])
    plan, seen = floor_plan(scene, START), seen_plan(scene, small_rig(), poses)
    assert seen.origin == plan.origin
    hit = seen.probability == 1.0
    assert hit.sum() > 50
    assert (plan.probability[hit] == 1.0).all()
    free = seen.probability == 0.0
    assert free.sum() > 1000
    # A beam may cross the rim of a cell that an obstacle only touches.
    assert (plan.probability[free] == 1.0).mean() < 0.02
    assert value(seen, 2.4, 2.1) == 0.0
    assert np.isnan(value(seen, 3.5, 2.76))  # in the crate's shadow
    assert np.isnan(value(seen, 0.5, 2.0))  # behind the robot


def test_a_camera_above_the_band_claims_nothing_it_cannot_see():
    high = small_rig().with_mount(Mount(height=2.0, x=0.1))
    seen = seen_plan(room(), high, np.array([[4.9, 2.0, 0.0]]))
    # The wall is 1 m ahead: the band lies below the picture, nothing is known.
    assert np.isnan(seen.probability[cell_index(seen, np.array([0.8, 0.0]))])


def test_office_plan_holds_a_known_desk_and_free_aisles():
    scene = load_scene("office")
    start = scene.route.poses(np.zeros(1))[0]
    plan = floor_plan(scene, start)
    assert plan.probability[cell_index(plan, np.array([3.35, 4.10]) - start[:2])] == 1.0
    along = scene.route.poses(np.arange(0.0, scene.route.duration, 0.5))[:, :2] - start[:2]
    assert (plan.probability[cell_index(plan, along)] == 0.0).all()
