"""Texture, light and shading kernels against plain twins, and against what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from simulation.lighting import FAINTEST, LAMP, bake, shares
from simulation.materials import MATERIALS, PANES
from simulation.patterns import fractal, inside, noise
from simulation.raycaster import RayCaster
from simulation.shading import EXPOSURE, STEEPEST, light_at
from simulation.textures import reflectances
from simulation.tracer import Tracer
from tests.simulation_rooms import room


def plain_hash(ix: np.ndarray, iy: np.ndarray, seed: int) -> np.ndarray:
    mask = 0xFFFFFFFF
    h = (ix * 374761393 + iy * 668265263 + seed * 1274126177) & mask
    h = ((h ^ (h >> 15)) * 739982445) & mask
    h = ((h ^ (h >> 12)) * 695872825) & mask
    return (h ^ (h >> 15)) / 2.0**32


def plain_noise(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    ix, iy = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    sx, sy = ((3.0 - 2.0 * f) * f * f for f in (x - ix, y - iy))
    rows = [
        plain_hash(ix, iy + d, seed) * (1.0 - sx) + plain_hash(ix + 1, iy + d, seed) * sx
        for d in (0, 1)
    ]
    return 2.0 * (rows[0] * (1.0 - sy) + rows[1] * sy) - 1.0


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.integers(0, 500))
def test_noise_equals_its_plain_twin(x, y, seed):
    twin = plain_noise(np.array([x]), np.array([y]), seed)[0]
    assert noise(x, y, seed) == pytest.approx(twin, abs=1e-12)
    assert -1.0 <= noise(x, y, seed) <= 1.0


@given(st.floats(-5.0, 5.0), st.floats(0.0, 0.2), st.integers(0, 500))
def test_fractal_equals_its_plain_twin(u, footprint, seed):
    twin = sum(
        0.5**i
        * np.clip(2.0 - 2.0 * 4.0 * 2**i * footprint, 0.0, 1.0)
        * plain_noise(np.array([u * 4.0 * 2**i]), np.array([0.7 * 4.0 * 2**i]), seed + i)[0]
        for i in range(4)
    )
    assert fractal(u, 0.7, 4.0, 4, 0.5, footprint, seed) == pytest.approx(twin, abs=1e-12)


def test_edges_keep_their_area_whatever_the_footprint():
    x = np.linspace(-3.0, 3.0, 6001)
    for footprint in (0.0, 0.01, 0.1, 0.4):
        area = np.mean([inside(v, -0.5, 0.5, footprint) for v in x]) * 6.0
        assert area == pytest.approx(1.0, abs=0.01)


def look(material: str, u, v, footprint, size=(1.0, 1.0), seed=5) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and cover of a material at the places (u, v) of a face of `size`."""
    u, v, footprint = (np.array(a, float) for a in np.broadcast_arrays(u, v, footprint))
    number, sizes = np.array([MATERIALS.index(material)]), np.array([size])
    face = np.zeros(u.size, np.int64)
    tone, cover = reflectances(
        face, u.ravel(), v.ravel(), footprint.ravel(), number, sizes, np.array([seed])
    )
    return tone.reshape(u.shape), cover.reshape(u.shape)


# One tone all over, or nothing but what shines through.
PLAIN = ("lamp", "white", "matte_black", "gloss_black", *PANES)


@pytest.mark.parametrize("material", [m for m in MATERIALS if m not in PLAIN])
def test_every_material_is_a_reflectance_with_texture_that_fades_with_distance(material):
    u, v = np.random.default_rng(3).uniform(0.3, 0.7, (2, 4000))

    near, far = (look(material, u, v, footprint)[0] for footprint in (0.002, 0.15))
    assert near.min() >= 0.0
    assert near.max() <= 1.0
    assert near.std() / near.mean() > 0.003
    assert far.std() < near.std()


@pytest.mark.parametrize("material", ["white", "matte_black", "gloss_black"])
def test_blank_is_blank(material):
    u, v = np.random.default_rng(3).uniform(0.0, 6.0, (2, 4000))
    tone = look(material, u, v, 0.002, (6.0, 6.0))[0]
    # A grey level of 180 is a change of light by 1 %.
    assert np.ptp(tone) / tone.mean() < 0.01
    assert tone.max() < 0.03 if "black" in material else tone.min() > 0.5


def test_blinds_and_tiles_repeat_exactly_with_their_period():
    u, v = np.random.default_rng(3).uniform(0.0, 0.6, (2, 500))
    for footprint in (0.001, 0.01):
        blinds = [look("blinds", u + shift, v, footprint, (3.0, 2.0))[0] for shift in (0, 0.089)]
        np.testing.assert_allclose(blinds[1], blinds[0], atol=1e-9)
        tiles = [
            look("tiles", u + a, v + b, footprint, (3.0, 2.0))[0]
            for a, b in ((0, 0), (0.15, 0), (0, 0.15), (0.3, 0.45))
        ]
        np.testing.assert_allclose(tiles[1:], [tiles[0]] * 3, atol=1e-9)
    # And not with half of it.
    assert (
        np.abs(look("blinds", u + 0.0445, v, 0.001)[0] - look("blinds", u, v, 0.001)[0]).max() > 0.1
    )


def test_panes_are_clear_but_for_their_marks():
    u = np.linspace(0.0, 1.0, 400)
    size = (1.0, 2.2)
    assert (look("clear_glass", u, 0.85, 0.002, size)[1] == 0.0).all()
    for v, marked in ((0.1, False), (0.25, True), (0.6, False), (0.85, True), (1.5, False)):
        cover = look("glass", u, v, 0.002, size)[1]
        assert (cover.max() > 0.9) == marked
        assert cover.min() == pytest.approx(0.0, abs=0.1)
    assert look("frosted_glass", u, 0.8, 0.002, size)[1].min() > 0.9
    assert look("frosted_glass", u, 2.0, 0.002, size)[1].max() == 0.0


def test_light_is_bilinear():
    chance = np.random.default_rng(1)
    grid = chance.uniform(size=(5, 7))
    values = np.concatenate([[9.0, 9.0], grid.ravel()])
    u, v = chance.uniform(-0.1, 1.1, (2, 200))
    face = np.ones(200, np.int64)
    face[7] = -1
    at = [np.clip(v, 0, 1) * 4, np.clip(u, 0, 1) * 6]
    twin = np.where(face < 0, 0.0, map_coordinates(grid, at, order=1))
    size, first = np.array([[9.0, 9.0], [2.0, 3.0]]), np.array([0, 2])
    own = light_at(face, 2.0 * u, 3.0 * v, size, values, first, np.array([[1, 2], [5, 7]]))
    np.testing.assert_allclose(own, twin, atol=1e-12)


def test_shading_equals_its_plain_twin():
    scene = room({"material": "wood", "at": [3.0, 2.2, 0.0], "size": [0.5, 0.5, 0.7], "turn": 25})
    faces = scene.faces()
    caster, light = RayCaster(faces), bake(faces)
    directions = np.random.default_rng(2).uniform(-0.6, 0.6, (60, 4, 3)) + np.array([1.0, 0.0, 0.0])
    origins = np.broadcast_to([1.0, 2.0, 0.5], directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    depth, triangle = caster.cast(rays)
    own = Tracer(scene).linear(rays, 0.002)

    f = triangle.astype(np.int64) // 2
    origin, direction, depth = (a.astype(float) for a in (rays[..., :3], rays[..., 3:], depth))
    offset = origin + depth[..., None] * direction - faces.origin[f]
    u = (offset * faces.u_axis[f]).sum(axis=-1)
    v = (offset * faces.v_axis[f]).sum(axis=-1)
    cosine = np.abs((direction * faces.normal[f]).sum(axis=-1)) / np.linalg.norm(direction, axis=-1)
    footprint = depth * 0.002 / np.sqrt(np.maximum(cosine, STEEPEST))
    total = np.empty(depth.shape)
    for i in np.ndindex(*depth.shape):
        width, height = faces.size[f[i]]
        nv, nu = light.shape[f[i]]
        grid = light.values[light.first[f[i]] :][: nv * nu].reshape(nv, nu).astype(float)
        at = [[v[i] / height * (nv - 1)], [u[i] / width * (nu - 1)]]
        material = MATERIALS[faces.material[f[i]]]
        size = (width, height)
        reflected = look(material, u[i], v[i], footprint[i], size, int(faces.seed[f[i]]))[0]
        total[i] = reflected * map_coordinates(grid, at, order=1, mode="nearest")[0]
    twin = EXPOSURE * total.mean(axis=1)
    np.testing.assert_allclose(own, twin, atol=1e-6)


def test_where_nothing_is_hit_it_is_black():
    scene = room()
    rays = np.zeros((3, 4, 6), np.float32)
    rays[..., :3], rays[..., 3:] = (0.0, 0.0, 20.0), (0.1, 0.2, 1.0)
    tracer = Tracer(scene)
    assert (tracer.grey(rays, 0.002) == 0.0).all()
    assert np.isinf(tracer.depth(rays)).all()
    faces, missed, zero = scene.faces(), np.full(2, -1, np.int64), np.zeros(2)
    for part in reflectances(missed, zero, zero, zero, faces.material, faces.size, faces.seed):
        assert (part == 0.0).all()


@pytest.mark.parametrize("coarse", [False, True])
def test_it_is_darker_under_a_table_and_in_corners(coarse):
    top = {"material": "wood", "at": [3.0, 2.0, 0.7], "size": [1.6, 1.2, 0.03]}
    faces = room(top).faces()
    light = bake(faces, coarse)
    floor = int(np.flatnonzero(faces.material == MATERIALS.index("carpet"))[4])
    nv, nu = light.shape[floor]
    grid = light.values[light.first[floor] :][: nv * nu].reshape(nv, nu)
    # Grid points on the rim of the slab lie under the walls.
    assert grid[nv // 2, nu // 2] < 0.6 * grid[nv // 2, nu // 6]
    assert grid[2:4, 2:4].mean() < 0.9 * grid[nv // 2, nu // 6]


def test_lamps_light_a_blank_wall_without_clouds():
    faces = room(walls="white").faces()
    wall = int(np.flatnonzero(faces.material == MATERIALS.index("white"))[1])

    def bends(coarse: bool) -> float:
        """How far a texel is off the mean of its neighbours in the row, relative to its light."""
        light = bake(faces, coarse)
        nv, nu = light.shape[wall]
        grid = light.values[light.first[wall] :][: nv * nu].reshape(nv, nu)[3:-3, 3:-3]
        return float(np.abs(grid[:, 1:-1] - 0.5 * (grid[:, :-2] + grid[:, 2:])).max() / grid.mean())

    assert bends(coarse=False) < 0.02
    assert bends(coarse=False) < 0.3 * bends(coarse=True)


def test_shares_of_lamp_light_equal_their_plain_twin():
    chance = np.random.default_rng(4)
    at, points = chance.uniform(0, 3, (40, 3)), chance.uniform(0, 3, (6, 3))
    normal, shines = (a / np.linalg.norm(a, axis=1)[:, None] for a in (1.5 - at, 1.5 - points))
    area = chance.uniform(0.01, 0.1, 6)
    way = points[None] - at[:, None]
    far2 = (way**2).sum(axis=2)
    cosines = np.maximum(np.einsum("npk,nk->np", way, normal), 0) * np.maximum(
        -np.einsum("npk,pk->np", way, shines), 0
    )
    twin = np.maximum(LAMP * area * cosines / (np.pi * far2 * (far2 + area)) - FAINTEST, 0.0)
    place, point, share = shares(at, normal, points, shines, area)
    own = np.zeros_like(twin)
    own[place, point] = share
    assert (twin > 0).sum() > 20
    np.testing.assert_allclose(own, twin, atol=1e-12)
