"""Maps as files: round trips, the exact bytes of map_server, and bad files."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mapping.grid import OccupancyGrid
from pipeline.errors import InputError
from pipeline.map_files import read_map, write_map_server, write_npz

NAN = math.nan
ROWS = [[0.0, 0.1, 0.34], [0.35, 0.5, 0.65], [0.66, 1.0, NAN]]
SMALL = OccupancyGrid(np.array(ROWS, np.float32), (-1.25, 0.5), 0.05)

cells = st.one_of(st.just(NAN), st.floats(0.0, 1.0, width=32))
maps = arrays(np.float32, st.tuples(st.integers(1, 8), st.integers(1, 8)), elements=cells)


@given(maps)
def test_npz_round_trip(tmp_path_factory, probability):
    path = tmp_path_factory.getbasetemp() / "round.npz"
    write_npz(path, OccupancyGrid(probability, (0.1, -2.0), 0.05))
    grid = read_map(path)
    assert np.array_equal(grid.probability, probability, equal_nan=True)
    assert grid.probability.dtype == np.float32
    assert grid.origin == (0.1, -2.0)
    assert grid.cell == 0.05


@settings(deadline=None)  # the first example loads OpenCV
@given(maps)
def test_map_server_round_trip_keeps_the_three_classes(tmp_path_factory, probability):
    folder = tmp_path_factory.getbasetemp()
    write_map_server(folder, OccupancyGrid(probability, (0.1, -2.0), 0.05), "round")
    grid = read_map(folder / "round.yaml")
    expected = np.full(probability.shape, NAN)
    expected[probability > 0.65] = 1.0
    expected[probability < 0.35] = 0.0
    assert np.array_equal(grid.probability, expected, equal_nan=True)
    assert grid.origin == (0.1, -2.0)
    assert grid.cell == 0.05


def test_the_files_of_map_server(tmp_path):
    write_map_server(tmp_path, SMALL)
    rows = bytes([0, 0, 205]), bytes([205, 205, 205]), bytes([254, 254, 254])
    assert (tmp_path / "map.pgm").read_bytes() == b"P5\n3 3\n255\n" + b"".join(rows)
    assert yaml.safe_load((tmp_path / "map.yaml").read_text()) == {
        "image": "map.pgm",
        "mode": "trinary",
        "resolution": 0.05,
        "origin": [-1.25, 0.5, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }


def test_the_same_map_is_the_same_bytes(tmp_path):
    for name in ("a.npz", "b.npz"):
        write_npz(tmp_path / name, SMALL)
    content = (tmp_path / "a.npz").read_bytes()
    assert content == (tmp_path / "b.npz").read_bytes()
    # No time of writing: the archive's entries carry the zip format's epoch, 1980-01-01.
    assert content[10:14] == bytes([0, 0, 33, 0])


def test_negate_turns_black_and_white(tmp_path):
    write_map_server(tmp_path, SMALL)
    text = (tmp_path / "map.yaml").read_text()
    (tmp_path / "map.yaml").write_text(text.replace("negate: 0", "negate: 1"))
    assert read_map(tmp_path / "map.yaml").probability[0].tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("resolution: 0.05", "resolution: 0", "resolution is 0"),
        ("resolution: 0.05", "resolution: fine", "resolution: 'fine' is not a number"),
        ("mode: trinary", "mode: scale", "mode is 'scale'"),
        ("image: map.pgm", "image: none.pgm", "none.pgm cannot be read"),
        ("image: map.pgm", "image: map.yaml", "map.yaml is not a readable image"),
        ("image: map.pgm", "image: 3", "image: 3; give the name"),
        ("0.5, 0.0]", "0.5, 0.3]", "the yaw 0.3 must be 0"),
        ("0.5, 0.0]", "0.5]", "origin: [-1.25, 0.5]; give [x, y, yaw]"),
        ("free_thresh: 0.196", "", "free_thresh: None is not a number"),
        ("image: map.pgm", "image: [", "not valid YAML"),
    ],
)
def test_bad_map_server_files(tmp_path, old, new, words):
    write_map_server(tmp_path, SMALL)
    path = tmp_path / "map.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_map(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"probability": np.zeros((2, 2)), "origin": [0, 0]}, "no array 'cell'"),
        ({"probability": np.zeros(4), "origin": [0, 0], "cell": 1}, "probability has shape (4,)"),
        ({"probability": np.zeros((2, 2)), "origin": [0], "cell": 1}, "origin is [0.0]"),
        ({"probability": np.zeros((2, 2)), "origin": [0, 0], "cell": 0}, "cell is 0.0"),
        ({"probability": ["x"], "origin": [0, 0], "cell": 1}, "not a readable map"),
    ],
)
def test_bad_npz_files(tmp_path, fields, words):
    np.savez(tmp_path / "map.npz", **fields)
    with pytest.raises(InputError) as caught:
        read_map(tmp_path)
    assert words in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"no archive at all", b"PK\x03\x04 cut off"])
def test_damaged_npz_files(tmp_path, content):
    (tmp_path / "map.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"map\.npz: not a readable map"):
        read_map(tmp_path / "map.npz")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "map.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"unknown kind of map '\.png'"):
        read_map(tmp_path / "map.png")
