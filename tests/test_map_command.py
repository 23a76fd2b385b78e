"""`beemap map`: a complete result folder, the same bytes again, and what happens to bad input."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.commands.info import describe
from pipeline.map_files import read_map
from pipeline.recordings import open_recording
from pipeline.recordings.base import read_image
from pipeline.trajectory import read_tum

# Little work: few particles are enough to run every line of the filter.
QUICK = ("--quiet", "--set", "mapping.particles=20")
FILES = {
    "map.pgm", "map.yaml", "map.npz", "map.png", "map.ply", "cloud.ply", "trajectory.tum",
    "online.tum", "odometry.tum", "truth.tum", "health.csv", "settings.yaml", "run.json",
    "report.html",
}  # fmt: skip
TIMED = ("run.json", "report.html")  # they tell how long it took


def contents(run: Path) -> dict[str, bytes]:
    """What must be the same for the same input, settings and seed."""
    return {f.name: f.read_bytes() for f in run.iterdir() if f.name not in TIMED}


def report(run: Path) -> dict:
    return json.loads((run / "run.json").read_text())


def edit(table: Path, change) -> None:
    table.write_text("\n".join(change(table.read_text().splitlines())) + "\n")


def assert_complete(run: Path, pairs: int) -> None:
    assert {file.name for file in run.iterdir()} == FILES
    grid = read_map(run)
    assert np.isfinite(grid.probability).sum() > 100
    by_map_server = read_map(run / "map.yaml")
    assert by_map_server.probability.shape == grid.probability.shape
    assert by_map_server.origin == pytest.approx(grid.origin)
    assert np.array_equal(by_map_server.probability == 1.0, grid.probability > 0.65)
    for name in ("trajectory.tum", "online.tum", "odometry.tum"):
        assert len(read_tum(run / name)) == pairs
    picture = cv2.imread(str(run / "map.png"))
    assert picture is not None
    assert min(picture.shape[:2]) > 100
    for cloud in ("map.ply", "cloud.ply"):
        assert (run / cloud).read_bytes().startswith(b"ply\nformat binary_little_endian")
    assert report(run)["counts"]["pairs used"] == pairs


def test_a_run_leaves_a_complete_folder(beemap, office_piece, tmp_path):
    outcome = beemap("map", office_piece, "-o", tmp_path / "new" / "run", *QUICK[1:])
    assert outcome.code == 0
    run = tmp_path / "new" / "run"
    assert_complete(run, pairs=40)
    assert "40 pairs" in outcome.out
    assert f"results: {run}" in outcome.out
    assert [entry.name for entry in run.parent.iterdir()] == ["run"]

    facts = report(run)
    assert facts["seed"] == 1
    assert facts["motion"] == "fused"
    assert facts["partial"] is False
    assert facts["input"] == str(office_piece)
    assert facts["peak_memory_mb"] > 10
    assert {"reading", "stereo", "mapping", "total"} <= facts["seconds"].keys()
    assert "numpy" in facts["versions"]
    assert "particles: 20" in (run / "settings.yaml").read_text()
    rows = (run / "health.csv").read_text().splitlines()
    assert len(rows) == 1 + facts["local_maps"]
    truth = read_tum(run / "truth.tum")
    assert truth.stamps.tolist() == read_tum(run / "trajectory.tum").stamps.tolist()

    again = beemap("evaluate", "path", run / "trajectory.tum", run / "truth.tum", "--json")
    assert json.loads(again.out)["ate_rmse_m"] < 0.3


def test_the_settings_of_a_run_repeat_it(beemap, office_piece, tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    assert beemap("map", office_piece, "-o", first, *QUICK, "--threads", 2).code == 0
    settings = first / "settings.yaml"
    arguments = ("--settings", settings, "--threads", 1, "--quiet")
    assert beemap("map", office_piece, "-o", second, *arguments).code == 0
    assert contents(first) == contents(second)
    third = tmp_path / "c"
    assert beemap("map", office_piece, "-o", third, *arguments, "--seed", 2).code == 0
    # Another seed is another filter; the odometry of images and wheels may be the same.
    assert contents(third)["health.csv"] != contents(first)["health.csv"]


def test_quiet_says_nothing(beemap, office_piece, tmp_path):
    outcome = beemap("map", office_piece, "-o", tmp_path / "run", *QUICK)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")


def test_poses_with_noise_and_bias_are_worse_than_without(beemap, office_piece, tmp_path):
    lengths = {}
    for name, extra in (
        ("exact", ()),
        ("noisy", ("--set", "odometry.noise=[0.02, 0.5]", "--set", "odometry.bias=0.5")),
    ):
        run = tmp_path / name
        assert beemap("map", office_piece, "-o", run, "--motion", "poses", *QUICK, *extra).code == 0
        score = beemap("evaluate", "path", run / "odometry.tum", run / "truth.tum", "--json")
        lengths[name] = json.loads(score.out)["ate_rmse_m"]
    assert lengths["exact"] < 1e-4
    assert lengths["noisy"] > 0.01


def test_poses_may_come_from_a_file(beemap, refused, office_piece, tmp_path):
    run = tmp_path / "run"
    assert beemap("map", office_piece, "-o", run, "--motion", "poses", *QUICK).code == 0
    again = tmp_path / "again"
    motion = f"poses:{run / 'truth.tum'}"
    assert beemap("map", office_piece, "-o", again, "--motion", motion, *QUICK).code == 0
    assert contents(again)["odometry.tum"] == contents(run)["odometry.tum"]
    line = refused("map", office_piece, "-o", tmp_path / "x", "--motion", "poses:gone.tum")
    assert line == "beemap: gone.tum: no such file"


# The result folder


def test_an_existing_folder_needs_force(beemap, refused, office_piece, tmp_path):
    run = tmp_path / "run"
    run.mkdir()
    (run / "run.json").write_text("{}")
    line = refused("map", office_piece, "-o", run)
    assert line == f"beemap: {run}: already exists: give --force to replace it"
    assert beemap("map", office_piece, "-o", run, "--force", *QUICK).code == 0
    assert_complete(run, pairs=40)


def test_force_does_not_delete_what_is_no_result(refused, office, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    (home / "thesis.tex").write_text("years of work")
    line = refused("map", office, "-o", home, "--force")
    assert "holds other things than a result" in line
    assert (home / "thesis.tex").read_text() == "years of work"
    for target in (office, office / "mav0"):
        line = refused("map", office / "mav0", "-o", target, "--force")
        assert len(open_recording(office).pairs) == 40
    assert refused("map", office, "-o", office, "--force").endswith(
        "holds the recording: choose another folder for the results"
    )


def test_a_link_to_a_result_stays_a_link(beemap, office_piece, tmp_path):
    run, link = tmp_path / "run", tmp_path / "latest"
    run.mkdir()
    (run / "run.json").write_text("{}")
    link.symlink_to(run)
    assert beemap("map", office_piece, "-o", link, "--force", *QUICK).code == 0
    assert link.is_symlink()
    assert_complete(run, pairs=40)


def test_a_result_may_replace_the_folder_one_stands_in(beemap, office_piece, tmp_path, monkeypatch):
    run = tmp_path / "run"
    run.mkdir()
    monkeypatch.chdir(run)
    assert beemap("map", office_piece, "-o", ".", *QUICK).code == 0
    assert_complete(run, pairs=40)


def test_targets_that_cannot_be_folders_are_refused(refused, office_piece, tmp_path):
    file = tmp_path / "file"
    file.write_text("x")
    assert refused("map", office_piece, "-o", file).endswith(
        "is a file, not a folder: choose another name"
    )
    assert "cannot be" in refused("map", office_piece, "-o", file / "run", "--quiet")
    assert "cannot be" in refused("map", office_piece, "-o", "/proc/run", "--quiet")
    assert "File name too long" in refused("map", office_piece, "-o", tmp_path / ("x" * 300))


# The recording and the rig


def test_there_is_nothing_at_the_path(refused, tmp_path):
    assert refused("map", tmp_path / "gone", "-o", tmp_path / "run") == (
        f"beemap: {tmp_path / 'gone'}: no such folder"
    )
    line = refused("map", tmp_path, "-o", tmp_path / "run")
    assert "not a recording I know (looked for mav0/cam0/data.csv" in line


def test_images_unlike_the_rig_are_refused(refused, office, tmp_path):
    from calibration.rig import minibee, save_rig

    save_rig(minibee(), tmp_path / "rig.yaml")
    line = refused("map", office, "-o", tmp_path / "run", "--rig", tmp_path / "rig.yaml", "--quiet")
    assert "image is 320x240, the rig is calibrated for 640x480" in line
    assert not (tmp_path / "run").exists()


def test_a_rig_without_a_mount_is_warned_of(beemap, office_piece, tmp_path):
    from calibration.rig import save_rig

    rig = open_recording(office_piece).rig
    assert rig is not None
    save_rig(rig.with_mount(None), tmp_path / "rig.yaml")  # type: ignore[arg-type]
    run = tmp_path / "run"
    outcome = beemap("map", office_piece, "-o", run, "--rig", tmp_path / "rig.yaml", *QUICK[1:])
    assert outcome.code == 0
    assert "rig.yaml is used instead of the recording's sensor.yaml" in outcome.err
    assert "the rig has no mount: the camera is taken as level" in outcome.err
    assert "beemap calibrate" in outcome.err
    assert len(report(run)["notes"]) == 2


def test_exchanged_images_are_noticed(refused, office, tmp_path):
    cameras = office / "mav0"
    (cameras / "cam0" / "data").rename(cameras / "moved")
    (cameras / "cam1" / "data").rename(cameras / "cam0" / "data")
    (cameras / "moved").rename(cameras / "cam1" / "data")
    line = refused("map", office, "-o", tmp_path / "run", "--quiet")
    assert "left and right images are exchanged (the disparities are negative)" in line


def test_no_calibration_at_all(refused, office, tmp_path):
    (office / "mav0" / "cam1" / "sensor.yaml").unlink()
    line = refused("map", office, "-o", tmp_path / "run")
    assert "holds no calibration: give --rig rig.yaml" in line


# Damage in the images


def test_damaged_images_are_counted_and_named(beemap, office, tmp_path):
    data = office / "mav0" / "cam0" / "data"
    names = sorted(file.name for file in data.iterdir())
    image = read_image(data / names[20])
    good, png = cv2.imencode(".png", image)
    assert good
    (data / names[20]).write_bytes(png.tobytes()[: len(png) // 2])
    (data / names[25]).write_bytes(b"")
    (office / "mav0" / "cam1" / "data" / names[30]).unlink()
    run = tmp_path / "run"
    outcome = beemap("map", office, "-o", run, *QUICK[1:])
    assert outcome.code == 0
    assert_complete(run, pairs=39)
    facts = report(run)
    assert facts["counts"]["unreadable pairs"] == 2
    for name, why in ((names[20], "cut short"), (names[25], "not a readable image")):
        assert any(name in told and why in told for told in facts["skipped"]["unreadable pair"])
    assert facts["recording"]["listed image is missing"] == [f"cam1/data/{names[30]}"]
    assert facts["recording"]["left image without a right one"] == [names[30]]
    assert "skipped: unreadable pair: 2" in outcome.out
    assert f"skipped: left image without a right one: 1 ({names[30]})" in outcome.out

    told = describe(open_recording(office))["skipped"]
    assert told["image cut short"] == [f"mav0/cam0/data/{names[i]}" for i in (20, 25)]


def test_no_image_can_be_read(refused, office, tmp_path):
    for file in (office / "mav0" / "cam0" / "data").iterdir():
        file.write_bytes(b"\xff\xd8")
    line = refused("map", office, "-o", tmp_path / "run", "--quiet")
    assert line.endswith("none of 40 images can be read")
    assert not (tmp_path / "run").exists()


def test_no_right_image_can_be_read(refused, office, tmp_path):
    for file in (office / "mav0" / "cam1" / "data").iterdir():
        file.write_bytes(b"\xff\xd8")
    line = refused("map", office, "-o", tmp_path / "run", "--quiet")
    assert "none of 40 pairs could be used: " in line
    assert "unreadable, e.g. " in line


# Damage in the motion


def test_damaged_ticks_are_counted(beemap, office, tmp_path):
    def damage(lines: list[str]) -> list[str]:
        gap = lines[:100] + lines[140:]
        stamp, _, counts = gap[20].partition(",")
        back_in_time = f"{int(stamp) + 1},{counts}"
        return [*gap[:50], "10x0,4,5", "1001000,7", back_in_time, *gap[50:]]

    edit(office / "mav0" / "odom0" / "data.csv", damage)
    run = tmp_path / "run"
    outcome = beemap("map", office, "-o", run, *QUICK[1:])
    assert outcome.code == 0
    assert_complete(run, pairs=40)
    odometry = report(run)["odometry"]
    assert odometry["ticks_garbled"] == 1
    assert odometry["ticks_fields"] == 1
    assert odometry["ticks_backwards"] == 1
    assert odometry["tick_gaps"] == 1
    assert odometry["longest_tick_gap_s"] > 1.9
    for told in ("ticks garbled: 1", "ticks backwards: 1", "tick gaps: 1", "longest tick gap s: 2"):
        assert f"odometry: {told}" in outcome.out


def test_pairs_after_the_last_tick_are_counted(beemap, office, tmp_path):
    edit(office / "mav0" / "odom0" / "data.csv", lambda lines: lines[:300])
    run = tmp_path / "run"
    outcome = beemap("map", office, "-o", run, "--motion", "encoders", *QUICK[1:])
    assert outcome.code == 0
    counts = report(run)["counts"]
    assert counts["pairs without motion"] >= 5
    assert counts["pairs used"] + counts["pairs without motion"] == 40
    assert f"pair without motion: {counts['pairs without motion']}" in outcome.out


def test_ticks_of_another_time_are_refused(refused, office, tmp_path):
    table = office / "mav0" / "odom0" / "data.csv"
    edit(table, lambda lines: [lines[0], *("1" + line for line in lines[1:])])
    line = refused("map", office, "-o", tmp_path / "run", "--motion", "encoders", "--quiet")
    assert "the motion source knows nothing about the time of the images" in line


def test_no_ticks_where_encoders_are_asked_for(refused, office, tmp_path):
    shutil.rmtree(office / "mav0" / "odom0")
    line = refused("map", office, "-o", tmp_path / "run", "--motion", "encoders")
    assert "holds no wheel ticks (odom0/data.csv): give --motion visual or poses" in line
    line = refused("map", office, "-o", tmp_path / "run", "--motion", "fused")
    assert "holds no wheel ticks (odom0/data.csv) to fuse with: give --motion visual" in line
    line = refused("map", office, "-o", tmp_path / "run", "--motion", "telepathy")
    assert (
        "--motion telepathy: unknown (known: encoders, odometry, poses, poses:FILE.tum, visual"
        in line
    )
    shutil.rmtree(office / "mav0" / "state_groundtruth_estimate0")
    line = refused("map", office, "-o", tmp_path / "run", "--motion", "poses")
    assert "holds no poses: give --motion poses:FILE.tum" in line
