"""Glass, polish and movers against physics and geometry that can be told without the tracer."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from simulation.boxes import Faces
from simulation.materials import GLOSS, MATERIALS
from simulation.scene import Scene, load_scene, scene_from_dict
from simulation.shading import LEAST, LIFT, PASSES, scatter
from simulation.tracer import EXPOSURE, Tracer, mirrors, to_grey
from tests.conftest import OFFICE
from tests.simulation_rooms import room_sheet

LAMP = 8.0  # reflectance by which a lamp shines
NARROW = 1e-4


def scene(*objects, floor: str = "carpet", walls: str = "plaster", **more) -> Scene:
    sheet = room_sheet(*objects, walls=walls)
    sheet["room"]["floor"] = floor
    return scene_from_dict({**sheet, **more}, "room")


def ray(origin, target, k: int = 4) -> np.ndarray:
    """One pixel whose k samples all look from `origin` at `target`, direction of unit length."""
    way = np.subtract(target, origin) / np.linalg.norm(np.subtract(target, origin))
    return np.tile(np.concatenate([origin, way]), (1, k, 1)).astype(np.float32)


def seen(traced: Tracer, origin, target, time: float = 0.0) -> float:
    return float(traced.linear(ray(origin, target), NARROW, time)[0])


def schlick(cosine: float, material: str) -> float:
    facing, grazing, _ = GLOSS[material]
    return facing + (grazing - facing) * (1.0 - cosine) ** 5


PANE = {"material": "clear_glass", "at": [3.0, 2.0, 0.0], "size": [0.012, 4.0, 2.3]}


@pytest.mark.parametrize("across", [0.0, 1.0, 1.9])
def test_glass_lets_through_and_mirrors_as_fresnel_says(across):
    """Behind the pane a board of known light, before it a wall; both seen without the pane too."""
    board = {"material": "matte_black", "at": [5.9, 2.0, 0.0], "size": [0.02, 4.0, 2.4]}
    bare, glazed = Tracer(scene(board)), Tracer(scene(board, PANE))
    eye = np.array([2.0, 2.0, 1.0])
    far = np.array([5.89, 2.0 + across, 1.0])
    hit = eye + (far - eye) * (3.0 - 2.0) / (5.89 - 2.0)
    way = (far - eye) / np.linalg.norm(far - eye)
    mirrored = hit + 2.9 * (way * (-1.0, 1.0, 1.0)) / abs(way[0])
    share = schlick(way[0], "clear_glass")
    expected = (1.0 - share) * PASSES * seen(bare, eye, far) + share * seen(bare, hit, mirrored)
    assert seen(glazed, eye, far) == pytest.approx(expected, rel=0.02)
    if across == 0.0:
        assert (1.0 - share) * PASSES == pytest.approx(0.90, abs=0.005)


def test_glass_at_a_grazing_angle_is_a_mirror():
    glazed, bare = Tracer(scene(PANE)), Tracer(scene())
    eye = np.array([2.9, 0.2, 1.0])
    far = np.array([3.1, 3.9, 1.0])  # meets the pane halfway, under 3 degrees
    there = np.array([2.9, 3.9, 1.0])
    assert schlick(0.054, "clear_glass") > 0.7
    grazing = seen(glazed, eye, far)
    assert grazing == pytest.approx(seen(bare, [3.0, 2.05, 1.0], there), rel=0.1)


def test_depth_takes_glass_and_polish_for_solid():
    traced = Tracer(scene(PANE, floor="vinyl"))
    looks = np.concatenate([ray([1, 2, 1], [6, 2, 1], 1), ray([1, 2, 1], [1, 2.5, 0], 1)])
    np.testing.assert_allclose(traced.depth(looks)[:, 0], [2.0, math.hypot(1, 0.5)], atol=1e-5)


def test_panes_throw_no_shadow():
    with_pane, without = (
        Tracer(scene(*parts)).linear(ray([1, 2, 1], [1.5, 2, 0]), NARROW) for parts in ((PANE,), ())
    )
    np.testing.assert_allclose(with_pane, without, rtol=1e-6)


@pytest.mark.parametrize("k", [1, 4, 9])
def test_a_polished_floor_mirrors_a_lamp_where_geometry_puts_it(k):
    """A small lamp at (4, 2), 1.0 m up: its image stands as far below the floor."""
    lamp = {"material": "lamp", "at": [4.0, 2.0, 0.9], "size": [0.2, 0.2, 0.2]}
    polished = Tracer(scene(lamp, floor="vinyl"))
    dull = Tracer(scene(lamp, floor="white"))
    eye = np.array([2.0, 2.0, 0.3])

    def at(traced: Tracer, x: float) -> float:
        return float(traced.linear(ray(eye, [x, 2.0, 0.0], k), NARROW)[0])

    xs = np.linspace(2.1, 3.2, 111)
    glint = np.array([at(polished, x) for x in xs])
    bright = xs[glint > 0.5 * (glint.max() + np.median(glint))]
    # The floor point divides the way to the lamp's image as the heights 0.3 : 1.0 do.
    assert bright.mean() == pytest.approx(2.0 + 2.0 * 0.3 / (0.3 + 1.0), abs=0.04)
    width = 0.2 * 0.3 / 1.3
    assert width < np.ptp(bright) + 0.01 < 3.5 * width + 0.05
    middle, aside = bright.mean(), (bright.mean() - 0.3, bright.mean() + 0.3)
    for traced, gleams in ((polished, True), (dull, False)):
        excess = at(traced, middle) / np.mean([at(traced, x) for x in aside]) - 1.0
        assert (excess > 0.5) == gleams


def test_the_mirrored_samples_of_a_pixel_stand_for_all():
    np.testing.assert_allclose(mirrors(4)[:, 0], [2, 0, 0, 2])
    for k in (1, 4, 9, 16):
        assert mirrors(k)[:, 0].mean() == pytest.approx(1.0)
        assert np.hypot(*mirrors(k)[:, 1:].T).max() < 1.0


def test_scatter_equals_its_plain_twin():
    chance = np.random.default_rng(8)
    m, names = 200, ("plaster", "vinyl", "glass", "gloss_black")
    gloss = np.array([GLOSS.get(name, (0.0, 0.0, 0.0)) for name in names])
    frames = np.linalg.qr(chance.normal(size=(4, 3, 3)))[0]
    surface = frames.reshape(4, 9)
    face = chance.integers(-1, 4, m)
    rays = chance.normal(size=(m, 6)).astype(np.float32)
    share, width, spread, depth, own = chance.uniform(0.02, 1.0, (5, m))
    cover = np.where(face == 2, chance.uniform(0.0, 1.0, m), 1.0)
    kept, sums, twin = mirrors(4), np.zeros(m), np.zeros(m)
    new, sample, values = scatter(
        rays,
        np.arange(m),
        share,
        width,
        spread,
        depth,
        face,
        own,
        cover,
        surface,
        gloss,
        kept,
        sums,
    )
    expected: list[tuple[int, np.ndarray, np.ndarray, float, float]] = []
    for i in range(m):
        if face[i] < 0:
            continue
        origin, way = rays[i, :3].astype(float), rays[i, 3:].astype(float)
        length, (ex, ey, normal) = np.linalg.norm(way), frames[face[i]]
        facing, grazing, blur = gloss[face[i]]
        slope = way @ normal / length
        mirrored = facing + (grazing - facing) * (1.0 - abs(slope)) ** 5
        twin[i] = share[i] * (1.0 - mirrored) * cover[i] * own[i]
        hit = origin + depth[i] * way
        through = share[i] * (1.0 - mirrored) * PASSES * (1.0 - cover[i])
        if grazing and through > LEAST:
            expected.append((i, hit + LIFT * way / length, way, through, spread[i]))
        counts, a, b = kept[i % 4] * (1.0, blur, blur)
        if share[i] * mirrored * counts > LEAST:
            tilted = normal + a * ex + b * ey
            tilted /= np.linalg.norm(tilted)
            if (way @ tilted) * slope <= 0 or abs(way @ tilted) < 0.5 * abs(slope) * length:
                tilted = normal
            start = hit - math.copysign(LIFT, slope) * normal
            out = way - 2.0 * (way @ tilted) * tilted
            expected.append(
                (i, start, out, share[i] * mirrored * counts, spread[i] + blur * length)
            )
    np.testing.assert_allclose(sums, twin, rtol=1e-5)
    assert len(expected) > 60
    assert sample.tolist() == [e[0] for e in expected]
    np.testing.assert_allclose(new[:, :3], [e[1] for e in expected], atol=1e-5)
    np.testing.assert_allclose(new[:, 3:], [e[2] for e in expected], atol=1e-5)
    np.testing.assert_allclose(values[0], [e[3] for e in expected], rtol=1e-5)
    np.testing.assert_allclose(values[1], (width + depth * spread)[sample], rtol=1e-6)
    np.testing.assert_allclose(values[2], [e[4] for e in expected], rtol=1e-5)


POST = [{"material": "shirt", "at": [0.0, 0.0, 0.0], "size": [0.4, 0.4, 1.7]}]
WALK = {"model": "post", "path": [[4.0, 1.0], [4.0, 3.0], [5.0, 3.0]], "speed": 0.5}


@pytest.mark.parametrize(
    ("time", "x", "y"), [(0, 4, 1), (2, 4, 2), (5, 4.5, 3), (6, 5, 3), (8, 4, 3), (12, 4, 1)]
)
def test_movers_stand_where_time_says(time, x, y):
    place = scene(models={"post": POST}, movers=[WALK])
    assert place.movers[0].pose(time)[:2] == pytest.approx((x, y))
    assert place.movers[0].pose(time + 12.0)[:2] == pytest.approx((x, y))
    traced = Tracer(place)
    reach = float(traced.depth(ray([1.0, y, 1.0], [6.0, y, 1.0], 1), float(time))[0, 0])
    assert reach == pytest.approx(x - 0.2 - 1.0, abs=1e-4)


def test_movers_are_lit_and_turn_about_at_the_end_of_their_path():
    place = scene(models={"post": POST}, movers=[WALK])
    traced = Tracer(place)
    before = seen(traced, [1.0, 2.0, 1.0], [6.0, 2.0, 1.0], 2.0)
    after = seen(traced, [1.0, 2.0, 1.0], [6.0, 2.0, 1.0], 0.0)
    assert before != after
    assert 0.005 < before < 0.5
    mover = place.movers[0]
    assert mover.pose(3.0)[2] == pytest.approx(math.pi / 2)
    assert math.cos(mover.pose(11.0)[2] + math.pi / 2) == pytest.approx(1.0)


def test_faces_move_as_boxes_do():
    place = scene(models={"post": POST}, movers=[WALK])
    moved = place.mover_faces()[0].placed(1.0, 2.0, 0.7)
    box = place.movers[0].boxes[0].placed(1.0, 2.0, 0.7)
    low, high = (getattr(moved.mesh()[0], way)(axis=0) for way in ("min", "max"))
    np.testing.assert_allclose(low[:2], box.corners.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(high[:2], box.corners.max(axis=0), atol=1e-6)
    joined = Faces.joined([place.faces(), moved])
    assert len(np.unique(joined.seed)) == len(place.boxes) + 1


def test_a_pane_is_one_sheet_amid_its_box():
    faces = scene(PANE).faces()
    sheet = faces.chosen(faces.material == MATERIALS.index("clear_glass"))
    assert len(sheet.seed) == 1
    np.testing.assert_allclose(np.abs(sheet.normal), [[1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(sheet.mesh()[0][:, 0], 3.0, atol=1e-6)


def test_grey_is_the_gamma_of_the_light():
    traced = Tracer(scene())
    look = ray([1, 2, 1], [6, 2.5, 1])
    light = traced.linear(look, NARROW)
    np.testing.assert_allclose(traced.grey(look, NARROW), 255.0 * light ** (1 / 1.9), rtol=1e-6)
    assert to_grey(np.array([0.0, 1.0, 9.0])).tolist() == [0.0, 255.0, 255.0]
    lamp = traced.linear(ray([3, 2, 1], [3, 2, 2.4]), NARROW)
    assert lamp > 1.0  # saturates
    assert EXPOSURE < lamp < LAMP * EXPOSURE * 4


def test_the_office_looks_as_in_the_recording_that_ships():
    """The images are drawn again and compressed alike: the same but for the noise, which had one
    deviation for all greys when the recording was made; the same numbers draw it."""
    from simulation.renderer import StereoRenderer
    from simulation.rigs import bent_minibee

    office = load_scene("office")
    pair = StereoRenderer(office, bent_minibee(0.5), seed=1).render(
        office.route.poses(np.zeros(1))[0], 0
    )
    for camera, own in (("cam0", pair.left), ("cam1", pair.right)):
        stored = np.fromfile(OFFICE / "mav0" / camera / "data" / "1000000000000.jpg", np.uint8)
        packed = cv2.imencode(".jpg", own, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
        again, shipped = (
            np.asarray(cv2.imdecode(content, cv2.IMREAD_GRAYSCALE), float)
            for content in (packed, stored)
        )
        assert np.abs(again - shipped).mean() < 0.5


def test_a_white_wall_stays_below_a_grey_level_of_texture():
    """Seen from 2 m by pixels of 1/493 rad, as the minibee's: no step from one to the next."""
    u, v = np.meshgrid(np.arange(-150, 150) / 493.0, np.arange(-60, 61, 30) / 493.0)
    rays = np.zeros((u.size, 1, 6), np.float32)
    rays[:, 0, :3] = (4.0, 2.0, 1.2)
    rays[:, 0, 3:] = np.stack([np.ones_like(u), u, v], axis=-1).reshape(-1, 3)
    white, painted = (
        Tracer(scene(walls=walls)).grey(rays, 1.0 / 493.0).reshape(u.shape)
        for walls in ("white", "plaster")
    )
    assert 80.0 < white.mean() < 230.0
    # What lies between a pixel and the mean of those 10 beside it is texture, not shade.
    texture = [grey[:, 10:-10] - 0.5 * (grey[:, 20:] + grey[:, :-20]) for grey in (white, painted)]
    assert np.abs(texture[0]).max() < 1.0
    assert np.abs(np.diff(white, axis=1)).max() < 0.5
    assert texture[1].std() > 1.0
