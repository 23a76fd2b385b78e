"""`beemap stereo model`: the model of cameras whose errors are known, through the command."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pipeline.recordings import open_recording
from pipeline.settings import load_settings
from pipeline.stereo_cells import FALSE_HIT, HIT, TOLD, TOLD_FREE, count_cells
from simulation.true_scans import TrueScans
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan

BEARING = np.radians(np.linspace(-33.0, 33.0, 265))
PAIRS = 12


def scan_of(ranges: np.ndarray, sigma=0.0, max_range=8.0) -> RangeScan:
    doubt = np.where(np.isfinite(ranges), sigma, np.nan)
    return RangeScan(0, (0.0, 0.0, 0.0), BEARING, ranges, doubt, max_range)


def cells(ranges: np.ndarray, truth: np.ndarray, frames: int = 20, **doubt) -> np.ndarray:
    """Counts (4,) over several frames, all ranges together."""
    seen = [count_cells(scan_of(ranges, **doubt), truth, 0.05, True, k) for k in range(frames)]
    return np.sum(seen, axis=(0, 2))


@pytest.fixture
def arc() -> np.ndarray:
    return np.full(BEARING.size, 3.0)


def test_a_perfect_observation_calls_every_cell_what_it_is(arc):
    counts = cells(arc, arc)
    assert counts[HIT] == counts[TOLD] > 500
    assert counts[FALSE_HIT] == 0
    assert counts[TOLD_FREE] > 20_000


def test_an_obstacle_half_looked_through_is_hit_half_the_time(arc):
    half = arc.copy()
    half[: BEARING.size // 2] = np.inf
    counts = cells(half, arc)
    assert counts[HIT] / counts[TOLD] == pytest.approx(0.5, abs=0.03)
    assert counts[FALSE_HIT] == 0


def test_an_unanswered_column_says_nothing(arc):
    silent = np.where(np.arange(arc.size) % 20 < 10, np.nan, arc)
    assert cells(np.full_like(arc, np.nan), arc).tolist() == [0, 0, 0, 0]
    counts, whole = cells(silent, arc), cells(arc, arc)
    assert counts[TOLD] < 0.75 * whole[TOLD]
    # A beam may pass the corner of a cell whose own column is silent.
    assert counts[HIT] > 0.95 * counts[TOLD]


def test_a_false_block_makes_false_cells_by_its_size(arc):
    """A block of a tenth of the view at half the range: its cells over all that are told of."""
    block = arc.copy()
    width = BEARING.size // 10
    block[100 : 100 + width] = 1.5
    counts = cells(block, arc)
    angle = np.radians(0.25 * width)
    # A curve of length L crosses 1 + 4 L / (pi a) cells of side a on average (Crofton).
    expected = 20 * (1 + 4 / np.pi * 1.5 * angle / 0.05)
    assert counts[FALSE_HIT] == pytest.approx(expected, rel=0.15)
    # The free cells are the sector before the wall, without what lies behind the block.
    assert counts[TOLD_FREE] == pytest.approx(
        20 * 0.5 * 3.0**2 * np.radians(66.0) * (1 - 0.1 * 0.75) / 0.05**2, rel=0.05
    )


def test_a_doubtful_hit_is_spread_over_free_cells_before_it(arc):
    sharp, doubtful = cells(arc, arc), cells(arc, arc, sigma=0.1)
    assert sharp[FALSE_HIT] == 0
    assert doubtful[FALSE_HIT] / doubtful[TOLD_FREE] > 0.02
    as_points = count_cells(scan_of(arc, 0.1), arc, 0.05, False, 0)
    assert as_points[FALSE_HIT].sum() == 0


@pytest.fixture
def rendered(office):
    """The office piece with true scans that differ from what is measured as told.

    truth(scan, chance) -> ranges (b,).
    """

    def write(truth) -> None:
        recording = open_recording(office)
        assert recording.rig is not None
        settings = load_settings(None)
        ranger = StereoRanger(recording.rig, settings.stereo)
        chosen = np.linspace(0, len(recording.pairs) - 1, PAIRS).round().astype(int)
        scans = [ranger(recording.pairs[index].load()) for index in chosen]
        chance = np.random.default_rng(1)
        ranges = np.array([truth(scan, chance) for scan in scans])
        stamps = np.array([scan.stamp for scan in scans])
        (office / "truth").mkdir()
        TrueScans(stamps, scans[0].bearing, ranges, np.full_like(ranges, 10.0)).save(
            office / "truth" / "scans.npz"
        )

    return write


def test_known_errors_come_out_of_the_command(rendered, office, beemap, tmp_path):
    """0.2 px of noise, and every fourth answered column unknown to the truth."""

    def truth(scan, chance):
        factor = 246.4 * 0.12
        noise = 0.2 * chance.standard_normal(scan.range.size)
        with np.errstate(divide="ignore", invalid="ignore"):
            d = factor / (scan.range * np.cos(scan.bearing))
            ranges = factor / ((d + noise) * np.cos(scan.bearing))
        return np.where(np.isfinite(scan.range), ranges, scan.range)

    rendered(truth)
    folder = tmp_path / "model"
    outcome = beemap("stereo", "model", office, "--pairs", PAIRS, "-o", folder, "--json")
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)
    assert found["frames"] == PAIRS
    noise = found["disparity_noise"]
    assert noise["low"] < 0.2 < noise["high"]
    assert found["false_hit"]["value"] < 0.05
    assert found["hit"]["value"] > 0.9
    names = {file.name for file in folder.iterdir()}
    assert names == {
        "model.json",
        "settings.yaml",
        "cells.png",
        "noise.png",
        "blocks.png",
        "columns.png",
    }
    pasted = load_settings(folder / "settings.yaml")
    assert pasted.stereo.noise == pytest.approx(noise["value"], abs=1e-3)
    assert pasted.mapping.hit == pytest.approx(found["hit"]["value"], abs=1e-3)


def test_the_words_name_what_is_false(rendered, office, beemap):
    rendered(lambda scan, chance: np.where(np.isfinite(scan.range), scan.range * 2.0, np.inf))
    outcome = beemap("stereo", "model", office, "--pairs", 4, "--quiet")
    assert outcome.out == ""
    lines = beemap("stereo", "model", office, "--pairs", 4).out.splitlines()
    told = {line[:15].strip(): line[15:] for line in lines}
    assert float(told["false ranges"].split()[0]) > 50.0
    assert told["false blocks"].split()[0] != "0.00"
    assert "mapping:" in lines


def test_a_finished_map_serves_as_truth(office, beemap, tmp_path):
    run = tmp_path / "run"
    assert beemap("map", office, "-o", run, "--motion", "poses", "--quiet").code == 0
    outcome = beemap("stereo", "model", office, "--run", run, "--pairs", 8, "--json")
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)
    assert found["frames"] >= 6
    assert found["hit"]["value"] > 5 * found["false_hit"]["value"]
    assert abs(found["disparity_bias"]["value"]) < 0.5


def test_without_truth_the_remedy_is_named(office, refused, rendered):
    line = refused("stereo", "model", office, "--quiet")
    assert "truth/scans.npz" in line
    assert "--run" in line
    rendered(lambda scan, chance: scan.range)
    scans = office / "truth" / "scans.npz"
    scans.write_bytes(scans.read_bytes()[:200])
    assert "scans.npz: not readable" in refused("stereo", "model", office, "--quiet")


def test_true_scans_of_another_rig_are_refused(office, refused, rendered):
    rendered(lambda scan, chance: scan.range)
    scans = office / "truth" / "scans.npz"
    with np.load(scans) as data:
        arrays = dict(data)
    TrueScans(**{**arrays, "bearing": arrays["bearing"] * 0.8}).save(scans)
    assert "bearings are not those of this rig" in refused("stereo", "model", office, "--quiet")
