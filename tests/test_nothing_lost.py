"""No option, signal, crash or second run costs a recording, a result or a file of the user's."""

from __future__ import annotations

import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import pipeline.recordings
from pipeline.errors import InputError
from pipeline.folders import EARLIER, RENDERED, check_target, new_folder
from pipeline.output_lock import locked
from pipeline.places import read_places
from pipeline.trajectory import read_tum
from tests.conftest import OFFICE
from tests.virtual_rigs import virtual_rig

QUICK = ("--set", "mapping.particles=20", "--threads", "1")
HOLDER = (
    "import sys, time\n"
    "from pipeline.output_lock import locked\n"
    "with locked(sys.argv[1]):\n"
    "    print('held', flush=True)\n"
    "    time.sleep(60)\n"
)


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "pipeline.cli", *map(str, arguments)]


def tree(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


# --force


def test_force_replaces_results_and_keeps_all_else(beemap, office_run, office_piece, tmp_path):
    outside = tmp_path / "outside.txt"
    outside.write_text("mine")
    run = Path(shutil.copytree(office_run, tmp_path / "run"))
    shutil.copytree(office_piece / "mav0" / "odom0", run / "recording" / "mav0" / "odom0")
    (run / "notes.txt").write_text("doors were open")
    (run / "map.png").unlink()
    (run / "map.png").symlink_to(outside)
    (run / "truth.tum").write_text("of yesterday")
    kept = {**tree(run / "recording"), "notes.txt": b"doors were open"}
    done = beemap("map", office_piece, "-o", run, "--force", "--quiet", *QUICK, "--seed", 3)
    assert done.code == 0, done.err
    assert {**tree(run / "recording"), "notes.txt": (run / "notes.txt").read_bytes()} == kept
    assert outside.read_text() == "mine"
    assert not (run / "map.png").is_symlink()
    assert json.loads((run / "run.json").read_text())["seed"] == 3
    assert (run / "truth.tum").read_text() != "of yesterday"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["outside.txt", "run"]
    assert not [entry.name for entry in run.iterdir() if entry.name.startswith(".")]


def test_only_a_rendered_recording_is_rendered_again(office_piece, tmp_path):
    """What beemap recorded, or a user put among the images, is refused before any work."""
    rec = Path(shutil.copytree(office_piece, tmp_path / "rec"))
    with pytest.raises(InputError, match="holds other things than a rendered recording"):
        check_target(rec, True, RENDERED)
    (rec / "truth").mkdir()
    (rec / "truth" / "command.txt").write_text("beemap simulate office\n")
    (rec / "notes.txt").write_text("mine")
    (rec / "mav0" / "cam0" / "labels.json").write_text("{}")
    with pytest.raises(InputError, match=r"labels\.json: is not beemap's and would be lost"):
        check_target(rec, True, RENDERED)
    (rec / "mav0" / "cam0" / "labels.json").unlink()
    with new_folder(rec, True, RENDERED) as folder:
        (folder / "mav0" / "cam0").mkdir(parents=True)
    assert (rec / "notes.txt").read_text() == "mine"
    assert not any((rec / "mav0" / "cam0").iterdir())


def test_a_batch_started_over_keeps_a_users_own_run(beemap, recordings, tmp_path):
    out = tmp_path / "out"
    (out / "mine").mkdir(parents=True)
    (out / "batch.txt").write_text("recordings\n")
    (out / "mine" / "run.json").write_text("{}")
    (out / "kitchen").mkdir()
    (out / "kitchen" / "run.json").write_text('{"key": "0", "partial": false}')
    (out / "kitchen" / "notes.txt").write_text("mine")
    done = beemap(
        "batch", recordings / "kitchen", "-o", out, "--force", "--quiet", "--jobs", 1,
        "--set", "mapping.particles=20",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert (out / "mine" / "run.json").read_text() == "{}"
    assert (out / "kitchen" / "notes.txt").read_text() == "mine"
    assert not (out / "kitchen" / "run.json").exists()
    assert (out / f"{recordings.name}-kitchen" / "map.png").is_file()


# Places


def test_marked_places_survive_mapping_again(beemap, office_run, office_piece, tmp_path):
    run = Path(shutil.copytree(office_run, tmp_path / "run"))
    path = read_tum(run / "trajectory.tum")
    door = {"name": "door", "stamp": int(path.stamps[20]), "x": 9.0, "y": 9.0, "theta": 0.0}
    other = {"name": "elsewhere", "stamp": 5, "x": 1.0, "y": 2.0, "theta": 0.5}
    (run / "places.json").write_text(json.dumps({"places": [door, other]}))
    words = ("map", office_piece, "--quiet", *QUICK)
    assert beemap(*words, "-o", run, "--force", "--seed", 2).code == 0
    found = read_places(run)
    again = read_tum(run / "trajectory.tum").poses[20]
    assert [place["name"] for place in found] == ["door", "elsewhere"]
    np.testing.assert_allclose([found[0][k] for k in ("x", "y", "theta")], again, atol=1e-3)
    assert found[1] == other
    begun = ("--continue", run, "--pose", "0,0,0")
    assert beemap(*words, "-o", tmp_path / "next", *begun).code == 0
    assert [place["name"] for place in read_places(tmp_path / "next")] == ["door", "elsewhere"]


# Two runs into one output


def test_a_second_run_into_an_output_is_refused_and_a_dead_one_blocks_nobody(
    refused, beemap, office_piece, recordings, tmp_path
):
    run = tmp_path / "deep" / "run"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(run)], stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        words = f"{run}: another run (process {holder.pid}) is writing there"
        (run.parent / "run.checkpoint").write_text("its own")
        assert words in refused("map", office_piece, "-o", run, *QUICK)
        assert words in refused("map", "--resume", run)
        assert words in refused("batch", recordings, "-o", run)
        assert (run.parent / "run.checkpoint").read_text() == "its own"
        holder.kill()
    (run.parent / ".run.part-1").mkdir()
    assert beemap("map", office_piece, "-o", run, "--quiet", *QUICK).code == 0
    assert [entry.name for entry in run.parent.iterdir()] == ["run"]


def test_a_lock_leaves_nothing_behind(tmp_path):
    with locked(tmp_path / "a" / "b" / "run"), locked(tmp_path / "a" / "b" / "run"):
        assert [f.name for f in (tmp_path / "a" / "b").iterdir()] == [".run.lock"]
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="no place for an output"), locked("/"):
        pass


# Signals and terminals


@pytest.fixture
def hangups():
    """SIGHUP is not ignored, as it is where the tests run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hangups")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_map_with_the_results_so_far(tmp_path, number):
    """SIGHUP comes as it does when a terminal closes: twice, and nobody reads any more."""
    run = tmp_path / "run"
    words = command("map", OFFICE, "-o", run, "--set", "mapping.particles=50", "--threads", 1)
    ours, theirs = pty.openpty()
    process = subprocess.Popen(words, stdout=theirs, stderr=theirs)
    os.close(theirs)
    checkpoint = tmp_path / "run.checkpoint"
    while not checkpoint.is_file() or checkpoint.stat().st_size < 20_000:
        assert process.poll() is None
        time.sleep(0.02)
    if number == signal.SIGHUP:
        os.close(ours)
        process.send_signal(number)
        time.sleep(0.05)
    process.send_signal(number)
    assert process.wait(timeout=60) == 130
    assert json.loads((run / "run.json").read_text())["partial"] is True
    assert (run / "report.html").is_file()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["run", "run.checkpoint"]
    if number == signal.SIGTERM:
        os.close(ours)


@pytest.mark.usefixtures("hangups")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_elsewhere_removes_what_was_made_for_the_time_being(
    beemap, tmp_path, monkeypatch, number
):
    def interrupted(*_: object) -> None:
        with new_folder(tmp_path / "rec"):
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(1.0)

    monkeypatch.setattr(pipeline.recordings, "open_recording", interrupted)
    before = signal.getsignal(number)
    outcome = beemap("info", "anything")
    assert (outcome.code, outcome.err.strip()) == (130, "beemap: interrupted")
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(number) == before


def test_a_run_outlives_who_reads_its_output(office_piece, tmp_path):
    process = subprocess.Popen(
        command("map", office_piece, "-o", tmp_path / "run", *QUICK),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    process.stderr.close()
    assert process.wait(timeout=60) == 0
    assert (tmp_path / "run" / "report.html").is_file()


# Live


def test_live_keeps_what_was_there_until_it_has_something_better(
    office_piece, office_run, tmp_path, refused, beemap
):
    """A device that is missing costs nothing; then the same command works."""
    run = tmp_path / "run"
    fast = ("--set", "odometry.max_speed=100", "--set", "mapping.particles=20", "--quiet")
    with virtual_rig(office_piece, tmp_path / "rig", speed=10.0):
        rig = tmp_path / "rig" / "rig.yaml"
        text = rig.read_text()
        rig.write_text(text.replace("/left.mjpg", "/nothing"))
        for words in (("live", rig, "-o", run), ("record", rig, "-o", tmp_path / "rec")):
            assert "answers 404" in refused(*words, "--quiet")
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["rig"]
        shutil.copytree(office_run, run)
        (run / "recording").mkdir()
        (run / "recording" / "log.txt").write_text("precious")
        before = tree(run)
        assert "answers 404" in refused("live", rig, "-o", run, "--force", "--quiet")
        assert tree(run) == before
        rig.write_text(text)
        done = beemap("live", rig, "-o", run, "--force", "--duration", 3, *fast)
    assert done.code == 0, done.err
    assert (run / "recording" / "log.txt").read_text() == "precious"
    assert (run / "recording-2" / "mav0" / "cam0" / "data.csv").is_file()
    assert json.loads((run / "run.json").read_text())["recording"] == str(run / "recording-2")
    assert not (run / EARLIER).exists()
