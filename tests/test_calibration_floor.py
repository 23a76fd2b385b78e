"""The floor as a plane in disparity space, found among other things and aligned to a hundredth."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.errors import CalibrationError
from calibration.floor import RectifiedView, find_floor, possible
from calibration.floor_alignment import FloorFrame, align_floor, floor_pixels
from calibration.mount import mount_from_floor
from calibration.rig import Mount
from stereo.rectify import Rectifier
from tests.stereo_rigs import crooked_rig, project, texture

SHAPE = (240, 320)
STRAIGHT = RectifiedView(246.4, 159.5, 119.5, 0.12, np.eye(3))


def turned_view() -> RectifiedView:
    """A view whose rectification turned the raw camera by some degrees."""
    R, _ = cv2.Rodrigues(np.radians([3.0, -2.0, 4.0]))
    return RectifiedView(250.0, 155.0, 125.0, 0.1, R)


@given(st.floats(0.05, 3.0), st.floats(-20.0, 60.0), st.floats(-20.0, 20.0), st.booleans())
def test_plane_and_mount_tell_the_same(height, pitch, roll, turned):
    view = turned_view() if turned else STRAIGHT
    mount = np.array([height, math.radians(pitch), math.radians(roll)])
    assert np.allclose(view.mount(view.plane(*mount)), mount, atol=1e-9)


@pytest.mark.parametrize("pitch", [-5.0, 10.0, 25.0])
def test_the_plane_is_that_of_the_raw_camera(pitch):
    rig = crooked_rig(pitch)
    assert rig.mount is not None
    rectify = Rectifier(rig.with_mount(Mount()), (-1e3, 1e3), 0.1)
    camera = rectify.camera
    view = RectifiedView(
        camera.f, camera.cx, camera.cy, camera.baseline, Mount().rotation.T @ camera.rotation
    )
    plane = view.plane(rig.mount.height, rig.mount.pitch, rig.mount.roll)
    for x, y in ((1.2, 0.0), (1.5, 0.4), (2.5, -0.3)):
        point = np.array([x, y, 0.0])
        assert all((at > 0).all() for at in project(rig, point))
        in_raw = rig.mount.rotation.T @ (point - rig.mount.position)
        X, Y, Z = view.raw_from_rectified.T @ in_raw
        u, v = camera.cx + camera.f * X / Z, camera.cy + camera.f * Y / Z
        assert view.disparity(plane, u, v) == pytest.approx(camera.depth_factor / Z)


def room_samples(
    view: RectifiedView, mount: tuple[float, float, float], table: float | None = None
) -> np.ndarray:
    """Disparities of a floor, of a wall at 3 m and of a table that high, from 0.8 m on; a third of
    them false matches."""
    chance = np.random.default_rng(5)
    u, v = chance.uniform((0, 0), (320, 240), (6000, 2)).T
    wall = np.full(len(u), view.f * view.baseline / 3.0)
    d = np.maximum(view.disparity(view.plane(*mount), u, v), wall)
    if table is not None:
        above = view.disparity(view.plane(mount[0] - table, *mount[1:]), u, v)
        d = np.where(
            (abs(u - 120) < 80) & (above > wall) & (above < view.f * view.baseline / 0.8), above, d
        )
    d += chance.normal(0.0, 0.25, len(d))
    false = chance.random(len(d)) < 0.33
    d[false] = chance.uniform(0.5, 60.0, false.sum())
    return np.column_stack([u, v, d])


@pytest.mark.parametrize("table", [None, 0.12])
@pytest.mark.parametrize(("height", "pitch"), [(0.3, 0.0), (0.4, 12.0), (0.6, 25.0)])
def test_the_floor_is_found_among_other_things(height, pitch, table):
    view = turned_view()
    true = (height, math.radians(pitch), math.radians(-2.0))
    found = view.mount(find_floor(room_samples(view, true, table), view))
    assert found[0] == pytest.approx(height, rel=0.02)
    assert np.degrees(found[1:]) == pytest.approx(np.degrees(true[1:]), abs=0.5)


def test_a_wall_a_ceiling_and_noise_are_no_floor():
    chance = np.random.default_rng(1)
    u, v = chance.uniform((0, 0), (320, 240), (5000, 2)).T
    ceiling = np.maximum(STRAIGHT.disparity(-STRAIGHT.plane(0.5, 0.1, 0.0), u, v), 2.0)
    for d in (np.full(5000, 20.0), ceiling, chance.uniform(1.0, 60.0, 5000)):
        noisy = d + chance.normal(0.0, 0.1, 5000)
        with pytest.raises(CalibrationError, match="no floor in view"):
            find_floor(np.column_stack([u, v, noisy]), STRAIGHT)
    with pytest.raises(CalibrationError, match="no floor in view"):
        find_floor(np.zeros((0, 3)), STRAIGHT)


def test_mounts_out_of_reach_are_not_possible():
    mounts = np.array([[0.3, 0.1, 0.1], [0.01, 0.1, 0.1], [0.3, 1.2, 0.1], [0.3, 0.1, 0.5]])
    assert possible(mounts).tolist() == [True, False, False, False]


def floor_frames(view: RectifiedView, plane: np.ndarray, count: int) -> list[FloorFrame]:
    """Pairs of a floor under a wall at 3 m whose disparities err by a fifth of a pixel, as those
    of block matching do; the cameras differ in brightness."""
    v, u = np.indices(SHAPE).astype(np.float32)
    wall = view.f * view.baseline / 3.0
    floor = view.disparity(plane, u, v)
    disparity = np.maximum(floor, wall)
    frames = []
    for seed in range(count):
        # The texture lies in the right image; the left one looks it up through the plane.
        right = texture(SHAPE, seed).astype(np.float32)
        left = cv2.remap(right, (u - disparity).astype(np.float32), v, cv2.INTER_CUBIC)
        noise = np.random.default_rng((seed, 1)).normal(0.0, 2.0, (2, *SHAPE))
        left, right = 0.9 * left + 10.0 + noise[0], right + noise[1]
        left, right = (np.clip(np.rint(i), 0, 255).astype(np.uint8) for i in (left, right))
        seen = np.where(u > disparity + 1, disparity - 0.2, -1.0)
        frames.append(FloorFrame(left, right, seen.astype(np.float32)))
    return frames


@pytest.mark.parametrize(("height", "pitch"), [(0.2, -3.0), (0.6, 20.0)])
def test_alignment_takes_out_the_bias_of_block_matching(height, pitch):
    true = (height, math.radians(pitch), math.radians(1.0))
    plane = STRAIGHT.plane(*true)
    frames = floor_frames(STRAIGHT, plane, 8)
    aligned = align_floor(frames, STRAIGHT, plane - (0.0, 0.0, 0.2))
    mask = floor_pixels(frames[0].disparity, STRAIGHT, plane)
    v, u = np.nonzero(mask)
    assert abs(STRAIGHT.disparity(aligned.plane - plane, u, v)).max() < 0.03
    mount = mount_from_floor(frames, STRAIGHT)
    assert mount.frames == 8
    assert mount.height == pytest.approx(height, rel=0.004)
    assert math.degrees(mount.pitch) == pytest.approx(pitch, abs=0.08)
    assert math.degrees(mount.roll) == pytest.approx(1.0, abs=0.08)
    found = np.array([mount.height, mount.pitch, mount.roll])
    assert (abs(found - true) < 4.0 * np.array(mount.sigma)).all()


def test_floor_in_too_few_frames_is_refused():
    plane = STRAIGHT.plane(0.3, 0.1, 0.0)
    frames = floor_frames(STRAIGHT, plane, 3)
    blank = FloorFrame(frames[2].left, frames[2].right, np.full(SHAPE, -1.0, np.float32))
    with pytest.raises(CalibrationError, match="in 2 of 3 pairs"):
        align_floor([*frames[:2], blank], STRAIGHT, plane)


def test_the_border_of_the_floor_is_left_out():
    plane = STRAIGHT.plane(0.3, 0.1, 0.0)
    (frame,) = floor_frames(STRAIGHT, plane, 1)
    v, u = np.indices(SHAPE)
    expected = STRAIGHT.disparity(plane, u, v)
    covered = np.where((abs(u - 200) < 20), np.float32(40.0), frame.disparity)
    mask = floor_pixels(covered, STRAIGHT, plane)
    assert mask.any()
    assert not mask[:, 177:223].any()
    assert (expected[mask] > 3.0).all()
