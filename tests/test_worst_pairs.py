"""The pairs worth a look: few, spread out, the worst first; and where the page puts them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.particle_filter import FilterHealth
from pipeline.map_request import Begin, MapRequest, Ticks
from pipeline.pages.svg import MOST_POINTS, round_steps, thinned
from pipeline.places import Place
from pipeline.recordings.base import Recording
from pipeline.run_report.map_view import map_view
from pipeline.run_report.origin import Origin
from pipeline.run_report.reasons import reason
from pipeline.worst_pairs import FEW_RANGES, MOST_DEFECTS, UNLIKE_MAP, Suspect, WorstPairs
from stereo.scan import RangeScan


def scan(answered: float, stamp: int = 0) -> RangeScan:
    ranges = np.where(np.arange(100) < 100 * answered, 1.0, np.nan)
    return RangeScan(stamp, (0.0, 0.0, 0.0), np.linspace(-0.5, 0.5, 100), ranges, ranges, 5.0)


def step(matched: float, judged: int = 9) -> FilterHealth:
    return FilterHealth(0, 10, 50.0, False, False, 500, matched, judged, 0.9, 9)


def seen(shares, matched, window: int = 10) -> WorstPairs:
    """Pairs with these shares of answers; after each window a step with the next match."""
    worst, matches = WorstPairs(), iter(matched)
    for index, share in enumerate(shares):
        closed = [step(next(matches))] if index % window == window - 1 else []
        worst.observed(index, str(index), scan(share, index), closed)
    return worst


@pytest.mark.parametrize("window", [1, 4, 10])
def test_the_worst_of_different_places_are_kept(window):
    shares = np.full(2000, 0.9)
    shares[[55, 56, 57, 1200, 1800, 333]] = (0.3, 0.31, 0.32, 0.2, 0.4, 0.5)
    matched = np.full(2000 // window, 0.8)
    matched[[100, 150, 180]] = (0.2, 0.1, 0.3)
    chosen = seen(shares, matched, window).chosen()
    few = [(s.index, s.share) for s in chosen if s.kind == FEW_RANGES]
    assert few == [(1200, 0.2), (55, 0.3), (1800, 0.4)]  # none of 55's neighbours
    unlike = [s for s in chosen if s.kind == UNLIKE_MAP]
    assert [s.share for s in unlike] == [0.1, 0.2, 0.3]
    # The pair in the middle of the step.
    middles = [n * window + (window - 1) // 2 for n in (150, 100, 180)]
    assert [s.index for s in unlike] == middles


def test_a_run_that_ended_in_the_first_local_map_shows_its_worst():
    chosen = seen([0.9, 0.5, 0.8], []).chosen()
    assert [(s.index, s.kind) for s in chosen] == [(1, FEW_RANGES)]
    assert WorstPairs().chosen() == []


def test_of_each_defect_the_first_and_the_latest_are_kept():
    worst = WorstPairs()
    for number in range(500):
        worst.skipped(number, number, f"pair{number}", f"defect {number % 9}", "broken")
    chosen = worst.chosen()
    assert len(chosen) == 2 * MOST_DEFECTS
    assert [s.index for s in chosen[:4]] == [0, 495, 1, 496]


def test_where_little_is_wrong_nothing_is_made_of_it():
    grey = np.random.default_rng(1).integers(60, 200, (50, 60)).astype(np.uint8)
    good, bad = (Suspect(0, 0, "", FEW_RANGES, share=share) for share in (0.9, 0.3))
    assert "no cause for worry" in reason(good, None, "columns", grey)[1]
    assert "without texture" in reason(bad, None, "columns", grey)[1]
    assert "dark" in reason(bad, None, "columns", grey // 8)[1]
    assert "overexposed" in reason(bad, None, "columns", np.where(grey > 150, 255, grey))[1]
    assert "contrast" in reason(bad, None, "columns", grey // 16 + 100)[1]
    moved = Suspect(0, 0, "", UNLIKE_MAP, share=0.3)
    assert reason(moved, None, "columns", grey)[0].startswith("30% of the map in view")


# What they are drawn with


def test_marks_lie_where_the_robot_was():
    grid = OccupancyGrid(np.zeros((40, 80), np.float32), (-1.0, -0.5), 0.05)
    path = np.stack([np.linspace(0.0, 2.0, 21), np.zeros(21), np.zeros(21)], axis=1)
    view = map_view(
        grid, path, np.linspace(0.0, 2.0, 21), path[-1:], [-1, 5, 5, 20], [Place("sink", 99)]
    )
    assert (view.width, view.height) == pytest.approx((4.0 * 1.06, 2.0 + 4.0 * 0.06))
    start, end = view.ends
    assert start.left == pytest.approx(100 * (1.0 + 0.12) / view.width, abs=0.01)
    assert start.top == pytest.approx(100 * (1.5 + 0.12) / view.height, abs=0.01)
    assert end.left > start.left
    # A pair without a place is not marked, two at one place are marked together.
    assert [mark.words for mark in view.suspects] == [("2", "3"), ("4",)]
    (place,) = view.places
    assert (place.words, place.left) == (("sink",), end.left)
    assert view.scale == 1


def test_a_huge_map_becomes_a_picture_of_bounded_size_with_its_walls():
    probability = np.full((10, 6000), 0.1, np.float32)
    probability[:, 3001] = 0.9
    view = map_view(
        OccupancyGrid(probability, (0.0, 0.0), 0.05), np.zeros((0, 3)), np.zeros(1),
        np.zeros((1, 3)), [],
    )  # fmt: skip
    assert len(view.picture) < 5000
    assert view.path == ""


def test_round_numbers_and_few_points():
    assert round_steps(0.0, 65.0, 6) == [0, 20, 40, 60]
    assert round_steps(0.0, 0.0, 6) == [0.0]
    assert round_steps(-1.0, 1.0, 5) == [-1.0, -0.5, 0.0, 0.5, 1.0]
    x, _ = thinned(np.arange(5000.0), np.where(np.arange(5000) == 1234, 0.0, 1.0))
    assert len(x) == MOST_POINTS
    assert 1234.0 in x


def test_commands_can_be_pasted():
    request = MapRequest(
        "my rec", "rig 1.yaml", "fused", 10.0, 3, Ticks("t.csv", "1,2,3", "ms", 0.5),
        Begin("old", (1.0, 2.0, np.pi / 2)),
    )  # fmt: skip
    origin = request.origin(Path("out put"), Recording(Path("my rec"), "", []))
    assert origin.fill("{map} --seed 2") == (
        "beemap map 'my rec' --rig 'rig 1.yaml' --motion fused --fps 10.0 --seed 3 --ticks t.csv "
        "--ticks-columns 1,2,3 --ticks-unit ms --ticks-offset 0.5 --continue old --pose 1,2,90 "
        "--settings 'out put/settings.yaml' -o 'out put-again' --seed 2"
    )
    assert origin.fill("x {recording}{rig_option} {new_rig}") == (
        "x 'my rec' --rig 'rig 1.yaml' 'rig 1.yaml'"
    )
    plain = Origin(Path("run"), Path("rec"), MapRequest("rec").arguments())
    assert plain.fill("{rig} {rig_option}{new_rig} {output}") == "rec rig.yaml run"
    assert plain.fill("{map}") == "beemap map rec --settings run/settings.yaml -o run-again"
