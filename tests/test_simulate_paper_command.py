"""`beemap simulate paper` and `degrade`: logs that say of themselves what they are."""

from __future__ import annotations

import bz2
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.grid import OccupancyGrid
from pipeline.map_files import read_map, write_map_server
from pipeline.recordings.carmen import read_carmen
from pipeline.recordings.carmen_writer import seconds, write_carmen
from pipeline.trajectory import read_tum, seconds_to_ns
from simulation.paper import PaperSettings, floor_plan, seen_plan, simulate
from simulation.world import load_world
from stereo.scan import RangeScan

REAL_DATA = os.environ.get("BEEMAP_REAL_DATA")
WORLD = """\
beemap_world: 1
size: [5, 4]
walls:
  - {from: [0, 0], to: [5, 0]}
  - {from: [5, 0], to: [5, 4]}
  - {from: [5, 4], to: [0, 4]}
  - {from: [0, 4], to: [0, 0]}
furniture: {box: {size: [0.6, 0.6], at: [[3.0, 2.0, 30]]}}
route: {waypoints: [[0.5, 1.0], [4.0, 1.0], [4.0, 3.0], [0.5, 3.0]], fillet: 0.4}
"""
BESIDE = ["paper.log", "paper.pgm", "paper.seen.pgm", "paper.seen.yaml", "paper.tum", "paper.yaml"]


@pytest.fixture
def paper(beemap, tmp_path):
    """Write `paper.log` in the small world; the folder."""
    world = tmp_path / "world.yaml"
    world.write_text(WORLD)

    def run(*arguments: object, folder: str = "out") -> Path:
        log = tmp_path / folder / "paper.log"
        done = beemap("simulate", "paper", "-o", log, "--world", world, *arguments)
        assert done.code == 0, done.err
        return log

    return run


def test_the_log_holds_what_was_simulated(paper, tmp_path):
    log = paper("--seed", "3", "--alpha", "2", "--false-depth", "replace", "--positions", "20")
    assert sorted(path.name for path in log.parent.iterdir()) == BESIDE
    world = load_world(tmp_path / "world.yaml")
    settings = PaperSettings(alpha=2.0, false_depth="replace", positions=20)
    assert world.route is not None
    run = simulate(world, world.route, settings, seed=3)
    read = read_carmen(log)
    assert read.stamps.tolist() == [1_000_000_000_000 + i * 500_000_000 for i in range(20)]
    assert not read.skipped
    assert np.array_equal(read.odometry, run.odometry)
    for found, made in zip(read.scans, run.scans, strict=True):
        np.testing.assert_allclose(found.bearing, made.bearing, atol=1e-12)
        assert np.array_equal(np.isinf(found.range), np.isinf(made.range))
        np.testing.assert_allclose(found.range, made.range, atol=1e-4)
        np.testing.assert_allclose(found.sigma, made.sigma, atol=1e-5)
        assert (found.max_range, found.origin) == (8.0, (0.0, 0.0, 0.0))
    truth = read_tum(log.with_name("paper.tum"))
    assert truth.stamps.tolist() == read.stamps.tolist()
    np.testing.assert_allclose(truth.poses, run.truth, atol=1e-6)
    for name, grid in (
        ("paper.yaml", floor_plan(world, run.poses[0])),
        ("paper.seen.yaml", seen_plan(world, run.poses, settings)),
    ):
        written = read_map(log.with_name(name))
        assert written.origin == pytest.approx(grid.origin)
        assert np.array_equal(written.probability, grid.probability, equal_nan=True)


def test_the_log_says_how_far_to_trust_it(paper):
    suggested = read_carmen(paper("--positions", "2")).suggested
    step = math.sqrt(0.2)
    assert suggested["odometry"] == pytest.approx(
        {"along": 0.02 / step, "across": 0.02 / step, "heading": 0.7 / step, "turn": 0.0}
    )
    assert suggested["laser"] == {
        "noise": 0.02, "floor": 0.0, "maximum": "free", "max_range": 8.0,
    }  # fmt: skip
    perfect = read_carmen(paper("--positions", "2", "--perfect", folder="perfect")).suggested
    assert set(perfect["odometry"].values()) == {0.0}
    assert perfect["laser"]["noise"] == 0.0


def test_a_perfect_log_is_exact(paper):
    log = paper("--perfect")
    read, truth = read_carmen(log), read_tum(log.with_name("paper.tum"))
    np.testing.assert_allclose(read.odometry, truth.poses, atol=2e-6)
    # Straight ahead of (0.5, 1.0) the east wall's face stands at x = 4.925, in the cell of 4.9.
    assert read.scans[0].range[132] == pytest.approx(4.4, abs=1e-4)


def test_same_seed_same_bytes_wherever_it_is_written(paper):
    one, two = paper("--positions", "15"), paper("--positions", "15", folder="other")
    for name in BESIDE:
        assert one.with_name(name).read_bytes() == two.with_name(name).read_bytes()
    three = paper("--positions", "15", "--seed", "2", folder="seed")
    assert one.read_bytes() != three.read_bytes()
    assert one.with_name("paper.tum").read_bytes() == three.with_name("paper.tum").read_bytes()


def test_a_short_route_gives_as_many_positions_as_it_has_room_for(beemap, refused, tmp_path):
    (tmp_path / "world.yaml").write_text(WORLD)
    command = ("simulate", "paper", "-o", tmp_path / "a.log", "--world", tmp_path / "world.yaml")
    out = beemap(*command).out
    # 3.5 + 2 + 3.5 m less two rounded corners.
    assert "44 positions, 8.6 m through world (its route of 8.7 m ends there)" in out
    assert "dead reckoning alone: ATE 0." in out
    told = refused(*command, "--positions", "45", "--force")
    assert "44 positions" in told
    assert "45" in told


def test_a_route_and_a_floor_plan_of_one_s_own(paper, beemap, tmp_path):
    plan = paper("--positions", "2").with_name("paper.yaml")
    (tmp_path / "route.csv").write_text("x,y\n0,0\n2,0\n2,1\n")
    done = beemap(
        *("simulate", "paper", "-o", tmp_path / "own.log", "--world", plan),
        *("--route", tmp_path / "route.csv", "--perfect", "--quiet"),
    )
    assert (done.code, done.out) == (0, "")
    assert read_carmen(tmp_path / "own.log").odometry[5] == pytest.approx([1.0, 0.0, 0.0])


def test_an_existing_file_is_replaced_by_force_alone(paper, refused, tmp_path):
    log = paper("--positions", "2")
    before = log.read_bytes()
    command = ("simulate", "paper", "-o", log, "--positions", "3")
    assert "--force" in refused(*command)
    assert log.read_bytes() == before
    log.unlink()
    # A file of another's beside it is not overwritten either.
    assert "paper.tum: already exists" in refused(*command)
    paper("--positions", "3", "--force")
    assert len(read_carmen(log)) == 3
    assert sorted(path.name for path in log.parent.iterdir()) == BESIDE


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("-o", "out"), ".log"),
        (("-o", "out.log.gz"), ".log"),
        (("-o", "out.log", "--world", "castle"), "flat"),
        (("-o", "out.log", "--world", "gone.yaml"), "gone.yaml"),
        (("-o", "out.log", "--route", "gone.csv"), "gone.csv"),
        (("-o", "out.log", "--world", "plan.yaml"), "--route"),
        (("-o", "folder.log",), "folder"),
        (("-o", "file.txt/out.log",), "file.txt"),
        (("-o", "out.log", "--alpha", "-1"), "--alpha"),
        (("-o", "out.log", "--positions", "0"), "--positions"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_and_leaves_nothing(refused, tmp_path, monkeypatch, arguments, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.log").mkdir()
    (tmp_path / "file.txt").touch()
    write_map_server(tmp_path, OccupancyGrid(np.zeros((9, 9), np.float32), (0, 0), 0.05), "plan")
    before = sorted(tmp_path.rglob("*"))
    assert told in refused("simulate", "paper", *arguments)
    assert sorted(tmp_path.rglob("*")) == before


def scan(stamp: int, ranges: list[float], max_range: float = 8.0) -> RangeScan:
    bearing = np.linspace(-0.5, 0.5, len(ranges)) if len(ranges) > 1 else np.array([0.2])
    unknown = np.full(len(ranges), np.nan)
    return RangeScan(stamp, (0.1, -0.05, 0.3), bearing, np.array(ranges), unknown, max_range)


def test_what_is_written_is_read_back(tmp_path):
    odometry = np.array([[0.1, 1e-9, -3.0], [1 / 3, -2.0, 2.5], [5.0, 6.0, 0.0]])
    scans = [
        scan(5, [1.00004, np.nan, np.inf, 7.99999, 1e-6]),
        scan(-1_500_000_000, [2.0, 3.0, np.inf]),
        scan(976_052_857_337_530_123, [4.5]),
    ]
    own = {"laser": {"maximum": "free", "field_of_view": None}, "odometry": {"noise": [0.1, 2.0]}}
    write_carmen(tmp_path / "a.log", scans, odometry, ["by a test"], own)
    read = read_carmen(tmp_path / "a.log")
    assert (tmp_path / "a.log").read_text().startswith("# by a test\n")
    assert read.suggested == own
    assert not read.skipped
    assert read.stamps.tolist() == [5, -1_500_000_000, 976_052_857_337_530_123]
    assert np.array_equal(read.odometry, odometry)
    for found, made in zip(read.scans, scans, strict=True):
        np.testing.assert_allclose(found.bearing, made.bearing, atol=1e-12)
        np.testing.assert_allclose(found.origin, made.origin, atol=1e-9)
        assert np.array_equal(np.isnan(found.range), np.isnan(made.range))
        np.testing.assert_allclose(found.range, made.range, atol=1.1e-4)


@given(st.integers(-(10**18), 10**18))
def test_times_are_written_exactly(stamp):
    text = seconds(stamp)
    assert seconds_to_ns(text) == stamp
    assert len(text.partition(".")[2]) in (6, 9)


FLASER = " ".join(
    [
        "FLASER",
        "180",
        *(f"{6 + 5 * math.cos(0.05 * (i - 90)):.2f}" for i in range(178)),
        "81.91",
        "81.91",
    ]
)


@pytest.fixture
def laser(tmp_path) -> Path:
    """Three scans of a SICK laser, with a true path and a word on its odometry."""
    lines = ["PARAM robot_frontlaser_offset 0.2 nohost 0", "PARAM beemap_odometry_along 0.05 x 0"]
    lines += [f"{FLASER} 9 9 9 {i} 0.5 0.1 {90 - i}.25 nohost 0" for i in range(3)]
    (tmp_path / "sick.clf").write_text("\n".join(lines) + "\n")
    (tmp_path / "sick.tum").write_text("90.25 0 0 0 0 0 0 1\n")
    return tmp_path / "sick.clf"


def test_a_degraded_log_keeps_times_odometry_and_beams(laser, beemap, tmp_path):
    out = tmp_path / "stereo.log"
    done = beemap("simulate", "degrade", laser, "-o", out, "--blocks", "0")
    assert done.code == 0, done.err
    assert "3 of 3 scans" in done.out
    source, read = read_carmen(laser), read_carmen(out)
    assert read.stamps.tolist() == source.stamps.tolist()
    assert np.array_equal(read.odometry, source.odometry)
    assert read.suggested["odometry"] == {"along": 0.05}
    assert read.suggested["laser"] == {"noise": 0.02, "floor": 0.02, "maximum": "free"}
    assert (tmp_path / "stereo.tum").read_bytes() == (tmp_path / "sick.tum").read_bytes()
    for found, true in zip(read.scans, source.scans, strict=True):
        own = np.abs(true.bearing) <= math.radians(33.0) + 1e-9
        np.testing.assert_allclose(found.bearing, true.bearing[own], atol=1e-12)
        np.testing.assert_allclose(found.origin, (0.2, 0.0, 0.0), atol=1e-9)
        assert found.max_range == 8.0
        near, far = true.range[own] < 7.0, true.range[own] > 9.0
        assert far.any()
        assert np.isinf(found.range[far]).all()
        np.testing.assert_allclose(found.range[near] / true.range[own][near], 1.0, atol=0.1)


def test_a_degraded_log_follows_its_options(laser, beemap, tmp_path):
    logs = {}
    for name, options in {
        "base": (),
        "again": (),
        "seed": ("--seed", "2"),
        "wide": ("--fov", "120", "--max-range", "5"),
        "false": ("--blocks", "9", "--alpha", "9", "--false-depth", "replace"),
        "still": ("--blocks", "0", "--depth-noise", "0"),
    }.items():
        out = tmp_path / f"{name}.log"
        assert beemap("simulate", "degrade", laser, "-o", out, "--quiet", *options).code == 0
        logs[name] = out
    assert logs["base"].read_bytes() == logs["again"].read_bytes()
    assert logs["base"].read_bytes() != logs["seed"].read_bytes()
    first = {name: read_carmen(log).scans[0] for name, log in logs.items()}
    assert first["wide"].bearing.size == 121
    assert first["wide"].max_range == 5.0
    assert np.nanmax(first["wide"].range[np.isfinite(first["wide"].range)]) <= 5.0
    true = read_carmen(laser).scans[0]
    kept = np.isfinite(first["still"].range)
    own = np.abs(true.bearing) <= math.radians(33.0) + 1e-9
    np.testing.assert_allclose(first["still"].range[kept], true.range[own][kept], atol=1e-4)
    # Nine wide blocks cover nearly everything by a few false depths.
    assert np.unique(first["false"].range).size < 0.5 * first["false"].range.size


def test_beams_that_the_laser_did_not_tell_stay_unknown(laser, beemap, tmp_path):
    out = tmp_path / "wide.log"
    beemap("simulate", "degrade", laser, "-o", out, "--fov", "180", "--blocks", "0", "--quiet")
    for found in read_carmen(out).scans:
        assert np.isnan(found.range[-2:]).all()  # 81.91: a SICK's code for "not seen"
        assert not np.isnan(found.range[:-2]).any()


def test_scans_that_look_elsewhere_are_left_out_and_counted(laser, beemap, refused, tmp_path):
    aside = replace(scan(7, [1.0, 2.0]), bearing=np.array([1.5, 1.6]))
    write_carmen(tmp_path / "aside.log", [aside, scan(9, [1.0, 2.0])], np.zeros((2, 3)))
    done = beemap("simulate", "degrade", tmp_path / "aside.log", "-o", tmp_path / "b.log")
    assert "1 of 2 scans (1 have no beam in 66 deg)" in done.out
    assert read_carmen(tmp_path / "b.log").stamps.tolist() == [9]
    write_carmen(tmp_path / "aside.log", [aside], np.zeros((1, 3)))
    command = ("simulate", "degrade", tmp_path / "aside.log", "--quiet", "--force", "-o")
    assert "--fov" in refused(*command, tmp_path / "b.log")
    assert len(read_carmen(tmp_path / "b.log")) == 1  # as it was


@pytest.mark.parametrize("name", ["sick.clf", "gone.log", "empty.log"])
def test_a_log_that_cannot_be_degraded_is_refused(laser, refused, tmp_path, name):
    (tmp_path / "empty.log").write_text("# nothing\n")
    content = laser.read_bytes()
    target = laser if name == laser.name else tmp_path / "out.log"
    told = refused("simulate", "degrade", tmp_path / name, "-o", target, "--force")
    assert name in told
    assert laser.read_bytes() == content
    assert not (tmp_path / "out.log").exists()


@pytest.mark.skipif(not REAL_DATA, reason="BEEMAP_REAL_DATA names no folder with real data")
def test_a_real_log_as_a_stereo_camera_would_see_it(beemap, tmp_path):
    packed = Path(REAL_DATA or "") / "laser" / "aces" / "aces.clf.bz2"
    source = tmp_path / "aces.clf"
    source.write_bytes(b"\n".join(bz2.decompress(packed.read_bytes()).splitlines()[:3000]))
    assert beemap("simulate", "degrade", source, "-o", tmp_path / "a.log", "--quiet").code == 0
    laser, read = read_carmen(source), read_carmen(tmp_path / "a.log")
    assert np.array_equal(read.stamps, laser.stamps)
    assert np.array_equal(read.odometry, laser.odometry)
    assert {scan.bearing.size for scan in read.scans[::500]} == {67}
    changed = []
    for found, true in zip(read.scans[::20], laser.scans[::20], strict=True):
        own = true.range[np.abs(true.bearing) <= math.radians(33.0) + 1e-9]
        both = np.isfinite(found.range) & np.isfinite(own)
        changed.append((np.abs(found.range / own - 1.0) > 0.1)[both].mean())
    assert 0.01 < np.mean(changed) < 0.12  # what a nearer false block covers
