"""The true range vector against rooms whose distances can be told by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibration.rig import Mount, RigError, StereoRig
from simulation.camera_rays import distort
from simulation.renderer import StereoRenderer
from simulation.tracer import Tracer
from simulation.true_ranges import TrueRanger, nearest_in_band
from simulation.true_scans import TrueScans, load_true_scans
from stereo.pair import StereoPair
from stereo.ranger import StereoRanger
from tests.simulation_rooms import room, small_rig

BLACK = np.zeros((120, 160), np.float32)
# x0, y0, x1, y1 of what stands in the room of 6 x 4 m.
CRATE = (2.8, 2.2, 3.4, 3.0)
MOUNTS = [
    Mount(height=0.5, x=0.1, y=0.06),
    Mount(height=0.5, pitch=math.radians(12.0), x=0.1, y=0.06),
    Mount(height=0.4, pitch=math.radians(-6.0), roll=math.radians(20.0), x=0.2),
    Mount(height=0.3, yaw=0.3, roll=math.radians(-15.0)),
]


@pytest.fixture(scope="module")
def tracer() -> Tracer:
    """A room with one crate, and a picture on its west wall."""
    x0, y0, x1, y1 = CRATE
    middle = [(x0 + x1) / 2, (y0 + y1) / 2, 0.0]
    crate = {"material": "wood", "at": middle, "size": [x1 - x0, y1 - y0, 1.0]}
    poster = {"material": "poster", "at": [0.005, 2.0, 0.1], "size": [0.01, 4.0, 1.0]}
    return Tracer(room(crate, poster))


def rig(mount: Mount) -> StereoRig:
    return small_rig().with_mount(mount)


def slab(eye: np.ndarray, beam: np.ndarray, box: tuple) -> np.ndarray:
    """Distances (b,) at which beams (b, 2) from `eye` enter and leave a rectangle."""
    with np.errstate(divide="ignore"):
        ends = (np.reshape(box, (2, 2))[:, None, :] - eye) / beam
    return np.stack([ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)])


def by_hand(mount: Mount, yaw: float, bearing: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Ranges to the crate, or to the walls, from the left camera's place."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    eye = pose[:2] + np.array([[c, -s], [s, c]]) @ (mount.x, mount.y)
    angle = pose[2] + yaw + bearing
    beam = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    walls = slab(eye, beam, (0.01, 0.0, 6.0, 4.0))[1]
    enter, leave = slab(eye, beam, CRATE)
    return np.where((enter > 0) & (enter < leave), enter, walls)


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("pose", [(1.0, 2.0, 0.0), (1.2, 1.0, 0.75), (4.5, 2.6, 2.9)])
def test_walls_and_corners_stand_where_they_are(tracer, mount, pose):
    ranger = TrueRanger(tracer, rig(mount))
    ranges, _ = ranger(np.array(pose), BLACK)
    yaw = StereoRanger(rig(mount)).camera.yaw
    expected = by_hand(mount, yaw, ranger.bearing, np.array(pose))
    seen = np.isfinite(ranges)
    assert seen.mean() > 0.7
    np.testing.assert_allclose(ranges[seen], expected[seen], atol=2e-3)
    edges = np.abs(np.diff(expected)) > 0.3
    assert edges.any()  # a corner of the crate is in view


@pytest.mark.parametrize("mount", MOUNTS)
def test_bearings_are_those_of_the_scans(tracer, mount):
    image = np.zeros((120, 160), np.uint8)
    scan = StereoRanger(rig(mount))(StereoPair(0, image, image))
    assert (TrueRanger(tracer, rig(mount)).bearing == scan.bearing).all()


def test_a_wrongly_stated_mount_does_not_move_the_world(tracer):
    true = Mount(height=0.5, pitch=0.1, x=0.1, y=0.06)
    stated = Mount(height=0.5, pitch=0.15, x=0.1, y=0.06)
    ranger = TrueRanger(tracer, rig(true), rig(stated))
    camera = StereoRanger(rig(stated)).camera
    ranges, _ = ranger(np.array([1.0, 2.0, 0.0]), BLACK)
    expected = by_hand(true, camera.yaw, ranger.bearing, np.array([1.0, 2.0, 0.0]))
    seen = np.isfinite(ranges)
    assert seen.mean() > 0.9
    np.testing.assert_allclose(ranges[seen], expected[seen], atol=2e-3)


def test_looking_at_the_floor_there_is_nothing_in_the_band(tracer):
    steep = rig(Mount(height=0.5, pitch=math.radians(45.0), x=0.1, y=0.06))
    ranges, texture = TrueRanger(tracer, steep)(np.array([4.0, 1.0, -0.2]), BLACK)
    assert np.isinf(ranges).mean() > 0.6
    assert np.isnan(texture).all()


def test_what_hides_the_band_makes_it_unknown():
    # A board before a camera that looks over the band hides all of it.
    board = {"material": "wood", "at": [1.6, 2.0, 1.21], "size": [0.02, 3.0, 1.2]}
    high = rig(Mount(height=1.6, pitch=0.0))
    ranger = TrueRanger(Tracer(room(board)), high)
    hidden, _ = ranger(np.array([1.0, 2.0, 0.0]), BLACK)
    assert np.isnan(hidden).mean() > 0.9
    ahead, _ = ranger(np.array([2.0, 2.0, 0.0]), BLACK)
    assert np.isfinite(ahead).mean() > 0.9


def test_what_the_image_does_not_show_is_unknown(tracer):
    rolled = rig(Mount(height=0.5, roll=math.radians(40.0), pitch=math.radians(-22.0)))
    ranger = TrueRanger(tracer, rolled)
    ranges, _ = ranger(np.array([1.0, 2.0, 0.0]), BLACK)
    assert rolled.mount is not None
    yaw = StereoRanger(rolled).camera.yaw
    slope = np.tan(np.linspace(-1.4, 1.4, 4000))
    for bearing, reach in zip(ranger.bearing[::8], ranges[::8], strict=True):
        a = yaw + bearing
        beams = np.stack([np.cos(a) + 0 * slope, np.sin(a) + 0 * slope, slope], axis=1)
        local = beams @ rolled.mount.rotation
        local = local[local[:, 2] > 0.5]
        u, v = distort(rolled.left, local[:, :2] / local[:, 2:]).T
        beyond = np.maximum(np.abs(u - 79.5) - 80.0, np.abs(v - 59.5) - 60.0)
        if np.isnan(reach):
            assert (beyond < -1.0).sum() < 20
        else:
            assert beyond.min() < 0.0
    assert np.isnan(ranges).any()


def test_texture_is_the_gradient_of_the_pixels_that_show_the_surface(tracer):
    ranger = TrueRanger(tracer, rig(MOUNTS[0]))
    pose = np.array([1.0, 2.0, 0.0])
    ramp = np.tile(3.0 * np.arange(160, dtype=np.float32), (120, 1))
    ranges, texture = ranger(pose, ramp)
    inner = np.isfinite(ranges)
    inner[:3] = inner[-3:] = False
    np.testing.assert_allclose(texture[inner], 3.0, rtol=1e-5)
    assert (np.isnan(texture) == ~np.isfinite(ranges)).all()
    flat = ranger(pose, np.full((120, 160), 90.0, np.float32))[1]
    assert (flat[np.isfinite(ranges)] == 0).all()


def test_a_picture_has_texture_and_a_bare_wall_hardly_any(tracer):
    renderer = StereoRenderer(tracer, rig(MOUNTS[0]))
    ranger = TrueRanger(tracer, renderer.rig)
    told = []
    for pose in ((2.2, 2.0, math.pi), (2.0, 2.0, -math.pi / 2)):  # the picture, the south wall
        light = renderer.light(lambda times, at=pose: np.tile(at, (np.size(times), 1)))
        grey = renderer.sensor.noise_free(light.left, 0)
        told.append(np.nanmedian(ranger(np.array(pose), grey)[1]))
    assert told[0] > 10.0
    assert told[1] < 3.0


def test_stereo_measures_the_true_ranges(tracer):
    renderer = StereoRenderer(tracer, rig(MOUNTS[0]))
    pose = np.array([2.2, 2.0, math.pi])
    pair = renderer.render(pose, 0)
    measured = StereoRanger(renderer.rig)(StereoPair(0, pair.left, pair.right)).range
    truth, _ = TrueRanger(tracer, renderer.rig)(pose, BLACK)
    both = np.isfinite(measured) & np.isfinite(truth)
    assert both.mean() > 0.4
    assert np.median(np.abs(measured[both] / truth[both] - 1.0)) < 0.03


def test_the_kernel_is_its_plain_twin():
    chance = np.random.default_rng(5)
    first = np.concatenate([[0], np.cumsum(chance.integers(0, 9, 40))])
    n = first[-1]
    reach = np.where(chance.uniform(size=n) < 0.2, np.inf, chance.uniform(0.2, 6.0, n))
    reach, slope = reach.astype(np.float32), chance.uniform(-0.6, 0.6, n)
    steep = chance.uniform(0.0, 9.0, n).astype(np.float32)
    for height in (0.05, 0.3, 1.5):
        ranges, texture = nearest_in_band(first, reach, slope, steep, height, 0.1, 1.2)
        for b in range(40):
            part = slice(first[b], first[b + 1])
            r, up = reach[part].astype(float), slope[part]
            z = height + np.where(np.isfinite(r), r, 0.0) * up
            hit = np.isfinite(r) & (z >= 0.1) & (z <= 1.2)
            with np.errstate(divide="ignore", invalid="ignore"):
                edge = np.where(height > 1.2, 1.2 - height, max(0.1 - height, 0.0)) / up
            reached = (0.1 <= height <= 1.2) | ((edge > 0) & (r > edge))
            if hit.any():
                near = hit & (r <= np.float32(r[hit].min()) + 0.05)
                assert ranges[b] == pytest.approx(r[hit].min())
                assert texture[b] == pytest.approx(math.sqrt(steep[part][near].mean()), rel=1e-5)
            else:
                assert np.isinf(ranges[b]) if reached.any() else np.isnan(ranges[b])
                assert np.isnan(texture[b])


def test_true_scans_are_read_back(tmp_path):
    scans = TrueScans(
        np.array([5, 6]),
        np.array([-0.1, 0.0, 0.2]),
        np.array([[1.0, np.inf, np.nan], [2.0, 3.0, 4.0]], np.float32),
        np.array([[3.0, np.nan, np.nan], [0.0, 1.0, 2.0]], np.float32),
    )
    scans.save(tmp_path / "scans.npz")
    read = load_true_scans(tmp_path / "scans.npz")
    for name in ("stamp", "bearing", "range", "texture"):
        np.testing.assert_array_equal(getattr(read, name), getattr(scans, name))


def test_a_rig_without_a_mount_is_refused(tracer):
    from dataclasses import replace

    with pytest.raises(RigError, match="mount"):
        TrueRanger(tracer, replace(small_rig(), mount=None))
