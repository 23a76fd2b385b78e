"""`beemap map LOG`: a result folder from a scan log, every scan with a pose, and bad input."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from odometry.motion import compose, inverse
from pipeline.evaluate_path import evaluate_path
from pipeline.map_files import read_map
from pipeline.recordings.carmen import read_carmen
from pipeline.run_log import map_log
from pipeline.settings import load_settings
from pipeline.trajectory import Trajectory, read_tum, write_tum
from tests.scan_logs import Drive, drive, write_log

FILES = {
    "map.pgm", "map.yaml", "map.npz", "map.png", "map.ply", "trajectory.tum", "online.tum",
    "odometry.tum", "health.csv", "settings.yaml", "run.json", "report.html",
}  # fmt: skip
TIMED = ("run.json", "report.html")  # they tell how long it took
SCANS = 80
# A small room, driven in steps of 0.12 m: what is usual for a laser is too coarse for it.
QUICK = (
    "--quiet",
    *("--set", "mapping.particles=20"),
    *("--set", "mapping.min_overlap=10"),
    *("--set", "mapping.spacing=0.17"),
    *("--set", "mapping.spacing_angle=10"),
    *("--set", "mapping.window=10"),
)


@pytest.fixture(scope="module")
def driven() -> Drive:
    return drive()


@pytest.fixture
def log(driven, tmp_path) -> Path:
    """A log with its truth beside it."""
    return written(driven, tmp_path / "room.log")


def written(d: Drive, path: Path, kind: str = "flaser") -> Path:
    stamps = np.array([int(s.replace(".", "")) * 1000 for s in d.stamps])
    write_tum(path.with_suffix(".tum"), Trajectory(stamps, d.truth))
    return write_log(path, [getattr(d, kind)(i) for i in range(len(d.stamps))])


def report(run: Path) -> dict:
    return json.loads((run / "run.json").read_text())


def contents(run: Path) -> dict[str, bytes]:
    return {f.name: f.read_bytes() for f in run.iterdir() if f.name not in TIMED}


def test_a_log_becomes_a_complete_folder(beemap, log, driven, tmp_path):
    outcome = beemap("map", log, "-o", tmp_path / "run", *QUICK[1:])
    assert outcome.code == 0
    run = tmp_path / "run"
    assert {file.name for file in run.iterdir()} == FILES | {"truth.tum"}
    assert f"{SCANS} scans, " in outcome.out
    assert "ms a scan)" in outcome.out
    assert "health: N_eff " in outcome.out
    assert "% of the beams had no answer" in outcome.out

    facts = report(run)
    assert facts["counts"]["scans used"] == SCANS
    # The gate thins 0.12 m steps to observations 0.17 m apart.
    assert 35 <= facts["counts"]["observations"] <= 55
    assert facts["log"]["FLASER"] == facts["log"]["scans"] == SCANS
    assert facts["health"]
    assert facts["truth"] == str(log.with_suffix(".tum"))
    found, truth = read_tum(run / "trajectory.tum"), read_tum(run / "truth.tum")
    assert found.stamps.tolist() == read_carmen(log).stamps.tolist()
    raw = evaluate_path(read_tum(run / "odometry.tum"), truth)
    mapped = evaluate_path(found, truth)
    assert mapped.ate_rmse < 0.5 * raw.ate_rmse
    assert mapped.ate_rmse < 0.08
    grid = read_map(run)
    known = ~np.isnan(grid.probability)
    assert known.sum() * grid.cell**2 == pytest.approx(6 * 4, rel=0.15)


def test_the_odometry_is_that_of_the_log_from_its_first_scan(beemap, log, driven, tmp_path):
    assert beemap("map", log, "-o", tmp_path / "run", *QUICK).code == 0
    told = read_tum(tmp_path / "run" / "odometry.tum").poses
    expected = compose(inverse(driven.odometry[0]), driven.odometry)
    assert told[:, :2] == pytest.approx(expected[:, :2], abs=1e-4)


@pytest.mark.parametrize("method", ["hierarchical", "per-scan"])
def test_the_method_is_a_setting(beemap, log, tmp_path, method):
    for name, arguments in (
        ("a", ("--method", method)),
        ("b", ("--set", f"mapping.method={method}")),
    ):
        assert beemap("map", log, "-o", tmp_path / name, *QUICK, *arguments).code == 0
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert f"method: {method}" in (tmp_path / "a" / "settings.yaml").read_text()
    score = evaluate_path(*(read_tum(tmp_path / "a" / f) for f in ("trajectory.tum", "truth.tum")))
    assert score.ate_rmse < 0.1


def test_threads_and_a_second_run_change_no_byte(beemap, log, tmp_path):
    for name, threads in (("a", 1), ("b", 2), ("c", 2)):
        assert beemap("map", log, "-o", tmp_path / name, *QUICK, "--threads", threads).code == 0
    assert contents(tmp_path / "a") == contents(tmp_path / "b") == contents(tmp_path / "c")
    arguments = ("--settings", tmp_path / "a" / "settings.yaml", "--quiet")
    assert beemap("map", log, "-o", tmp_path / "d", *arguments).code == 0
    assert contents(tmp_path / "a") == contents(tmp_path / "d")


def test_both_forms_of_a_log_give_the_same_map(beemap, driven, tmp_path):
    for kind in ("flaser", "robotlaser"):
        log = written(driven, tmp_path / f"{kind}.log", kind)
        assert beemap("map", log, "-o", tmp_path / kind, *QUICK).code == 0
    a, b = (read_tum(tmp_path / kind / "trajectory.tum") for kind in ("flaser", "robotlaser"))
    assert a.poses == pytest.approx(b.poses, abs=0.05)


def test_what_a_log_says_of_itself_is_used_and_shown(beemap, driven, tmp_path):
    lines = [
        "PARAM beemap_laser_noise 0.015 nohost 0",
        "PARAM beemap_odometry_along 0.07 nohost 0",
        "PARAM beemap_laser_floor nonsense nohost 0",
        *(driven.flaser(i) for i in range(SCANS)),
    ]
    log = write_log(tmp_path / "a.log", lines)
    chosen = ("--set", "odometry.along=0.05", *QUICK[1:])
    outcome = beemap("map", log, "-o", tmp_path / "run", *chosen)
    assert "note: the log says of itself: laser.noise 0.015, odometry.along 0.07" in outcome.err
    assert "skipped: parameter not understood: 1 (line 5: " in outcome.out
    used = load_settings(tmp_path / "run" / "settings.yaml")
    assert (used.laser.noise, used.laser.floor) == (0.015, load_settings(None).laser.floor)
    assert used.odometry.along == 0.05
    assert not (tmp_path / "run" / "truth.tum").exists()


def test_times_that_step_backwards_are_kept(beemap, driven, tmp_path):
    stamps = driven.stamps.copy()
    stamps[20], stamps[21] = stamps[21], stamps[20]
    stamps[40] = stamps[39]
    shuffled = Drive(driven.truth, driven.odometry, stamps, driven.ranges)
    log = write_log(tmp_path / "a.log", [shuffled.flaser(i) for i in range(SCANS)])
    outcome = beemap("map", log, "-o", tmp_path / "run", *QUICK[1:])
    told = "note: 1 times stepping backwards, 1 times repeated: scans are taken as they stand"
    assert told in outcome.err
    found = read_tum(tmp_path / "run" / "trajectory.tum")
    assert found.stamps.tolist() == [int(s.replace(".", "")) * 1000 for s in stamps]
    facts = report(tmp_path / "run")
    assert facts["log"]["times stepping backwards"] == 1
    assert facts["log"]["times repeated"] == 1


def test_damage_is_skipped_counted_and_told(beemap, driven, tmp_path):
    lines = [driven.flaser(i) for i in range(SCANS)]
    lines[10] = lines[10][:200]
    lines[20] = "WHAT 1 2 3"
    lines[30] = lines[30].replace(" ", " nan ", 1).replace("FLASER nan 90 ", "FLASER 91 nan ")
    lines[40] = "RLASER" + lines[40].removeprefix("FLASER")
    outcome = beemap(
        "map", write_log(tmp_path / "a.log", lines), "-o", tmp_path / "run", *QUICK[1:]
    )
    assert outcome.code == 0
    assert f"{SCANS - 3} scans" in outcome.out
    assert "skipped: damaged line: 1 (line 13)" in outcome.out
    assert "skipped: unknown message type: 1 (WHAT, line 23)" in outcome.out
    facts = report(tmp_path / "run")
    assert facts["recording"]["damaged line"] == ["line 13"]
    assert "note: 2 changes of the beam count, 1 beams without a number: scans" in outcome.err
    assert facts["log"]["changes of the beam count"] == 2
    assert facts["log"]["beams without a number"] == 1
    assert facts["log"]["RLASER"] == 1
    assert np.isfinite(read_tum(tmp_path / "run" / "trajectory.tum").poses).all()


@pytest.mark.parametrize(
    "lines",
    [
        ["FLASER 3 1 2 3 0 0 0 0 0 0 1.0 host 0"],
        ["FLASER 1 2 0 0 0 0 0 0 1.0 host 0", "FLASER 1 2 0 0 0 1 0 0 2.0 host 0"],
        [f"FLASER 2 nan 0 0 0 0 {x / 4} 0 0 {x}.0 host 0" for x in range(20)],
        [f"FLASER 2 1 2 0 0 0 0 0 0 {x}.0 host 0" for x in range(20)],
        [f"FLASER 2 1 2 0 0 0 {x * 1e5} 0 0 {x}.0 host 0" for x in range(12)],
    ],
    ids=["one scan", "one beam", "no answers", "at rest", "leaps"],
)
def test_poor_logs_give_a_path_all_the_same(beemap, tmp_path, lines):
    log = write_log(tmp_path / "a.log", lines)
    assert beemap("map", log, "-o", tmp_path / "run", *QUICK).code == 0
    found = read_tum(tmp_path / "run" / "trajectory.tum")
    assert len(found) == len(lines)
    assert np.isfinite(found.poses).all()
    assert report(tmp_path / "run")["health"]


def test_an_interrupted_run_keeps_what_it_has(log):
    seen = []
    run = map_log(
        read_carmen(log),
        load_settings(None, ("mapping.particles=5",)),
        progress=lambda done, total: seen.append((done, total)),
        interrupted=lambda: len(seen) == 25,
    )
    assert run.partial
    assert seen[-1] == (25, SCANS)
    assert len(run.mapper.path()) == run.used == 25


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--rig", "rig.yaml"], "is a scan log, which holds its own odometry and needs no --rig"),
        (["--motion", "encoders"], "needs no --motion: leave it out"),
        (["--fps", "10"], "needs no --fps: leave it out"),
        (["--method", "slam"], "Invalid value for '--method': 'slam' is not one of"),
        (["--set", "laser.maximum=far"], "laser.maximum is 'far'"),
        (["--set", "laser.max_range=-1"], "laser.max_range is -1"),
        (["--set", "laser.beams=9"], "unknown key 'laser.beams' (known: field_of_view, floor,"),
    ],
)
def test_wrong_arguments_are_one_line(refused, log, tmp_path, arguments, told):
    assert told in refused("map", log, "-o", tmp_path / "run", "--quiet", *arguments)
    assert not (tmp_path / "run").exists()


def test_files_that_are_no_logs_are_refused(refused, tmp_path):
    picture = tmp_path / "a.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 9)
    for command in (("map", picture, "-o", tmp_path / "run"), ("info", picture)):
        assert "a.png: holds no laser scan" in refused(*command)
    assert refused("map", tmp_path / "gone.clf.gz", "-o", tmp_path / "run").endswith("no such file")


def test_a_truth_that_cannot_be_read_is_refused(refused, log, tmp_path):
    log.with_suffix(".tum").write_text("1 2 3\n")
    line = refused("map", log, "-o", tmp_path / "run")
    assert "room.tum, line 1: expected 8 numbers" in line


def test_the_folder_that_holds_the_log_is_not_replaced(refused, log):
    (log.parent / "run.json").write_text("{}")
    line = refused("map", log, "-o", log.parent, "--force")
    assert "holds the recording" in line
    assert log.exists()


def test_info_tells_what_a_log_holds(beemap, log):
    outcome = beemap("info", log)
    assert outcome.code == 0
    for told in (
        "CARMEN log", f"FLASER: {SCANS}", "2.00 scans/s", "90 from -90.0 to 88.0 deg",
        "0 step backwards, 0 repeat", "room.tum", "found in the readings",
    ):  # fmt: skip
        assert told in outcome.out
    facts = json.loads(beemap("info", log, "--json").out)
    assert facts["scans"] == SCANS
    assert facts["skipped"] == {}
    length = float(facts["motion"].split()[2])
    assert length == pytest.approx(2 * math.pi * 1.5, rel=0.1)
