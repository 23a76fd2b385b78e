"""Texture, light and shading kernels against plain twins, and against what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from simulation.lighting import bake
from simulation.materials import MATERIALS
from simulation.raycaster import RayCaster
from simulation.shading import EXPOSURE, STEEPEST, light_at, radiance
from simulation.textures import albedo, fractal, inside, noise, reflectances
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


@pytest.mark.parametrize("material", [m for m in MATERIALS if m != "lamp"])
def test_every_material_is_a_reflectance_with_texture_that_fades_with_distance(material):
    number = MATERIALS.index(material)
    u, v = np.random.default_rng(3).uniform(0.3, 0.7, (2, 4000))

    def look(footprint: float) -> np.ndarray:
        return np.array(
            [albedo(number, a, b, 1.0, 1.0, footprint, 5) for a, b in zip(u, v, strict=True)]
        )

    near, far = look(0.002), look(0.15)
    assert near.min() >= 0.0
    assert near.max() <= 1.0
    assert near.std() / near.mean() > 0.01
    assert far.std() < near.std()


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
    caster = RayCaster(faces)
    light = bake(caster, faces)
    directions = np.random.default_rng(2).uniform(-0.6, 0.6, (60, 4, 3)) + np.array([1.0, 0.0, 0.0])
    origins = np.broadcast_to([1.0, 2.0, 0.5], directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    depth, triangle = caster.cast(rays)
    own = radiance(rays, depth, triangle, faces, light, 0.002)

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
        reflected = albedo(
            faces.material[f[i]], u[i], v[i], width, height, footprint[i], faces.seed[f[i]]
        )
        total[i] = reflected * map_coordinates(grid, at, order=1, mode="nearest")[0]
    twin = EXPOSURE * total.mean(axis=1)
    np.testing.assert_allclose(own, twin, atol=1e-6)


def test_where_nothing_is_hit_it_is_black():
    faces = room().faces()
    light = bake(RayCaster(faces), faces)
    rays = np.ones((3, 4, 6), np.float32)
    nothing = np.full((3, 4), np.uint32(0xFFFFFFFF))
    assert (radiance(rays, np.full((3, 4), np.inf), nothing, faces, light, 0.002) == 0.0).all()
    missed = np.full(2, -1, np.int64)
    zero = np.zeros(2)
    assert (
        reflectances(missed, zero, zero, zero, faces.material, faces.size, faces.seed) == 0.0
    ).all()


def test_it_is_darker_under_a_table_and_in_corners():
    top = {"material": "wood", "at": [3.0, 2.0, 0.7], "size": [1.6, 1.2, 0.03]}
    faces = room(top).faces()
    light = bake(RayCaster(faces), faces)
    floor = int(np.flatnonzero(faces.material == MATERIALS.index("carpet"))[4])
    nv, nu = light.shape[floor]
    grid = light.values[light.first[floor] :][: nv * nu].reshape(nv, nu)
    # Grid points on the rim of the slab lie under the walls.
    assert grid[nv // 2, nu // 2] < 0.6 * grid[nv // 2, nu // 6]
    assert grid[2:4, 2:4].mean() < 0.9 * grid[nv // 2, nu // 6]
