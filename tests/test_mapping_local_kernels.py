"""The inner loops of stage 1 equal their twins in plain numpy."""

import math
from dataclasses import dataclass

import numpy as np

from mapping.local_kernels import (
    FREE_BEFORE,
    HIT_WITHIN,
    ONE_SURFACE,
    THIN_REACH,
    WITHIN_CELL,
    add_observations,
    thin,
)
from mapping.sensor_model import CLAMP, SensorModel
from mapping.settings import MappingSettings
from stereo.scan import RangeScan
from tests.mapping_data import CELL, scan

MODEL = SensorModel.of(MappingSettings())


@dataclass(frozen=True)
class Beam:
    """A beam that ends at `end`, at an obstacle or not, and is free up to `clear` [cells]."""

    angle: float
    start: float
    end: float
    clear: float
    hit: bool
    doubt: float


def beams_of(s: RangeScan) -> list[Beam]:
    """The scan's beams, and those that fill the space between two of them."""
    beams = []
    before = None
    for bearing, z, sigma in zip(s.bearing, s.range / CELL, s.sigma / CELL, strict=True):
        if np.isnan(z):
            before = None
            continue
        if np.isinf(z):
            end = s.max_range / CELL
            beam = Beam(bearing, 0.0, end, end, False, 0.0)
        else:
            beam = Beam(bearing, 0.0, z, z - max(FREE_BEFORE * sigma, 0.5), True, sigma)
        beams.append(beam)
        if before is not None:
            beams += between(before, beam)
        before = beam
    return beams


def between(a: Beam, b: Beam) -> list[Beam]:
    """A wall between neighbouring hits, else what is free before the nearer of both."""
    gap = b.angle - a.angle
    start = 0.9 / gap
    ends = [beam.end * np.exp(1j * beam.angle) for beam in (a, b)]
    apart = abs(ends[1] - ends[0])
    if a.hit and b.hit and apart * CELL < ONE_SURFACE:
        on_wall = ends[0] + np.linspace(0.0, 1.0, math.ceil(apart) + 1)[1:-1] * (ends[1] - ends[0])
        margin = max(FREE_BEFORE * b.doubt, 0.5)
        return [
            Beam(float(np.angle(p)), start, abs(p), abs(p) - margin, True, b.doubt) for p in on_wall
        ]
    clear = min(a.clear, b.clear)
    angles = np.linspace(a.angle, b.angle, max(math.ceil(gap * clear), 1) + 1)[1:-1]
    return [Beam(angle, start, clear, clear, False, 0.0) for angle in angles]


def crossed(shape, u0, v0, angle, start, far):
    """Where a beam enters and leaves every cell (H, W), by its slabs; NaN where it misses it."""
    rows, columns = np.indices(shape)
    enter, leave = np.full(shape, start), np.full(shape, np.inf)
    for low, begin, slope in ((columns, u0, math.cos(angle)), (rows, v0, math.sin(angle))):
        a, b = (low - begin) / slope, (low + 1 - begin) / slope
        enter, leave = np.maximum(enter, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
    met = (enter < leave) & (enter < far)
    return np.where(met, enter, np.nan), np.where(met, leave, np.nan)


def observation_twin(shape, u0, v0, heading, s):
    """One observation beam by beam over all cells: hit and free (H, W) bool, mean density."""
    hit, free = np.zeros(shape, bool), np.zeros(shape, bool)
    density, count = np.zeros(shape), np.zeros(shape, int)
    for beam in beams_of(s):
        spread = math.hypot(beam.doubt, WITHIN_CELL)
        far = beam.end + (max(HIT_WITHIN * beam.doubt, 3.0 * spread) if beam.hit else 0.0)
        enter, leave = crossed(shape, u0, v0, heading + beam.angle, beam.start, far)
        middle = 0.5 * (enter + np.minimum(leave, far))
        free |= middle < beam.clear
        if beam.hit:
            off = middle - beam.end
            here = (enter <= beam.end) & (beam.end < leave)
            here |= np.abs(off) < HIT_WITHIN * beam.doubt
            hit |= here
            near = here | (np.abs(off) < 3.0 * spread)
            bump = np.exp(-0.5 * (off / spread) ** 2) / (spread * CELL)
            density += np.where(near, bump, 0.0)
            count += near
    return hit, free & ~hit, density / np.maximum(count, 1)


def random_scan(rng, n, fov):
    """Ranges of all kinds: some lie on one surface, others far apart."""
    ranges = np.where(
        rng.random(n) < 0.7, 0.9 + 0.03 * np.cumsum(rng.normal(0, 1, n)), rng.uniform(0.3, 1.6, n)
    )
    ranges[rng.random(n) < 0.15] = np.nan
    ranges[rng.random(n) < 0.15] = np.inf
    return scan(ranges, sigma=rng.choice([0.0, 0.01, 0.12]), fov=fov, max_range=1.5)


def test_the_beams_walk_equals_its_numpy_twin():
    rng = np.random.default_rng(1)
    x0, y0 = -2.0, -1.9
    for fov in (66.0, 120.0, 270.0, 330.0):
        scans = [random_scan(rng, n, fov) for n in (40, 25)]
        sensors = rng.uniform([-0.3, -0.3, -3.0], [0.3, 0.3, 3.0], (2, 3))
        grid = np.where(rng.random((80, 84)) < 0.5, np.nan, rng.normal(0, 3, (80, 84)))
        grid = grid.astype(np.float32)
        likely = rng.random(grid.shape).astype(np.float32)
        expected, dense = grid.copy(), likely.copy()
        for sensor, s in zip(sensors, scans, strict=True):
            at_x, at_y = (sensor[0] - x0) / CELL, (sensor[1] - y0) / CELL
            hit, free, density = observation_twin(grid.shape, at_x, at_y, sensor[2], s)
            assert hit.sum() > 10
            assert free.sum() > 50
            step = np.where(hit, MODEL.occupied_step, MODEL.free_step)
            after = np.clip(np.nan_to_num(expected, nan=0.0) + step, -CLAMP, CLAMP)
            expected = np.where(hit | free, after, expected)
            dense += density
        bearing, ranges, sigma = (
            np.concatenate([getattr(s, name) for s in scans])
            for name in ("bearing", "range", "sigma")
        )
        add_observations(
            grid,
            likely,
            x0,
            y0,
            CELL,
            sensors,
            np.array([0, 40, 65]),
            bearing,
            ranges,
            sigma,
            np.array([s.max_range for s in scans]),
            MODEL.occupied_step,
            MODEL.free_step,
            CLAMP,
        )
        np.testing.assert_allclose(grid, expected, 1e-5, 1e-6)
        np.testing.assert_allclose(likely, dense, 1e-4, 1e-5)


def thin_twin(grid, likely, low, cell, eye, above):
    """`thin` cell by cell, in plain numpy."""
    out = grid.copy()
    for row, column in np.argwhere(grid > above):
        d = np.array([low[0] + (column + 0.5) * cell, low[1] + (row + 0.5) * cell]) - eye
        d = d / max(np.hypot(*d), cell)
        steps = np.arange(-THIN_REACH, THIN_REACH + 1)
        i, j = np.round(row + steps * d[1]).astype(int), np.round(column + steps * d[0]).astype(int)
        inside = (i >= 0) & (i < grid.shape[0]) & (j >= 0) & (j < grid.shape[1])
        if (likely[i[inside], j[inside]] > likely[row, column]).any():
            out[row, column] = 0.0
    return out


def test_thinning_equals_its_numpy_twin():
    rng = np.random.default_rng(9)
    grid = rng.normal(0, 3, (40, 50)).astype(np.float32)
    grid[rng.random(grid.shape) < 0.3] = np.nan
    likely = rng.random(grid.shape).astype(np.float32)
    low, eye, above = np.array([-1.0, -1.0]), np.array([-0.3, 0.2]), MODEL.local_occupied_above
    expected = thin_twin(grid, likely, low, CELL, eye, above)
    got = thin(grid, likely, -1.0, -1.0, CELL, -0.3, 0.2, above)
    np.testing.assert_array_equal(got, expected)
    assert 0.1 < (expected > above).sum() / (grid > above).sum() < 0.5
