"""`beemap map` when the disk is full, on Ctrl-C, and in careless hands."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import pipeline.recordings
import pipeline.results
from odometry.source import EncoderOdometry
from pipeline.recordings import open_recording
from pipeline.results import write_results
from pipeline.run import map_recording
from pipeline.settings import Settings
from pipeline.trajectory import read_tum
from tests.conftest import OFFICE
from tests.test_map_command import FILES, QUICK, report

FULL = "no space left on the disk"


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "pipeline.cli", *map(str, arguments)]


def existing(run: Path) -> dict[str, bytes]:
    """An earlier result at `run`, and what it holds."""
    run.mkdir()
    (run / "run.json").write_text('{"seed": 7}')
    (run / "map.png").write_bytes(b"the map of yesterday")
    return {file.name: file.read_bytes() for file in run.iterdir()}


# No space left


@pytest.mark.parametrize("writer", ["write_npz", "write_tum", "write_ply", "_write_picture"])
def test_a_full_disk_leaves_the_earlier_result(
    refused, office_piece, tmp_path, monkeypatch, writer
):
    def fail(file: Path, *arguments: object, **options: object) -> None:
        Path(file).write_bytes(b"half of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))

    monkeypatch.setattr(pipeline.results, writer, fail)
    parent = tmp_path / "results"
    parent.mkdir()
    before = existing(parent / "run")
    line = refused("map", office_piece, "-o", parent / "run", "--force", *QUICK)
    assert line.startswith(f"beemap: {parent / 'run'}: {FULL}: free some or choose another folder")
    assert {f.name: f.read_bytes() for f in (parent / "run").iterdir()} == before
    assert [entry.name for entry in parent.iterdir()] == ["run"]
    refused("map", office_piece, "-o", parent / "other", *QUICK)
    assert [entry.name for entry in parent.iterdir()] == ["run"]


@pytest.fixture(params=["40k", "250k", "400k"])
def small_disk(request, tmp_path):
    """A disk on which a result does not fit: it fails at another file for each size."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={request.param}", "tmpfs", disk]
    try:
        done = subprocess.run(mount, capture_output=True, text=True)
    except OSError as error:
        pytest.skip(f"no mount command: {error}")
    if done.returncode:
        pytest.skip(f"a tmpfs cannot be mounted here: {done.stderr.strip()}")
    yield disk
    subprocess.run(["umount", disk], check=True)


def test_a_small_disk_is_full_in_one_line(refused, small_disk, office_piece):
    before = existing(small_disk / "run")
    line = refused("map", office_piece, "-o", small_disk / "run", "--force", *QUICK)
    assert FULL in line
    assert {f.name: f.read_bytes() for f in (small_disk / "run").iterdir()} == before
    assert [entry.name for entry in small_disk.iterdir()] == ["run"]


# Ctrl-C


def test_ctrl_c_ends_with_the_results_so_far(tmp_path):
    run = tmp_path / "run"
    arguments = ("map", OFFICE, "-o", run, "--set", "mapping.particles=50", "--threads", 1)
    with subprocess.Popen(command(*arguments), stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        while not list(tmp_path.iterdir()):
            assert process.poll() is None
            time.sleep(0.05)
        time.sleep(3.0)
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        code = process.wait(timeout=30)
        seconds = time.monotonic() - begin
        errors = process.stderr.read()
    assert code == 130, errors
    # Two seconds on a machine that has its cores for this.
    assert seconds < 2.0 * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    assert f"interrupted: {run} holds the results so far" in errors
    assert {file.name for file in run.iterdir()} == FILES
    facts = report(run)
    assert facts["partial"] is True
    pairs = facts["counts"].get("pairs used", 0)
    assert pairs < len(open_recording(OFFICE).pairs)
    assert len((run / "trajectory.tum").read_text().splitlines()) == pairs


@pytest.mark.parametrize("pairs", [0, 1, 12])
def test_a_run_may_end_after_any_pair(office_piece, tmp_path, pairs):
    recording = open_recording(office_piece)
    assert recording.rig is not None
    assert recording.ticks is not None
    assert recording.encoders is not None
    settings = Settings()
    source = EncoderOdometry(recording.ticks, recording.encoders, settings.odometry)
    asked = iter(range(100))
    run = map_recording(
        recording, recording.rig, source, settings, interrupted=lambda: next(asked) == pairs
    )
    assert run.partial
    assert run.counts["pairs used"] == pairs
    summary = write_results(tmp_path, run, settings, recording.poses, {})
    assert {file.name for file in tmp_path.iterdir()} == FILES
    assert summary["partial"] is True
    assert json.loads((tmp_path / "run.json").read_text()) == summary
    if pairs:
        assert len(read_tum(tmp_path / "trajectory.tum")) == pairs


# Settings and arguments


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--set", "mapping.particels=5"], "unknown key 'mapping.particels' (known: cell,"),
        (
            ["--set", "maping.cell=5"],
            "unknown stage 'maping' (known: stereo, laser, odometry, visual, mapping)",
        ),
        (["--set", "mapping.cell"], "--set mapping.cell: write it as stage.key=value"),
        (["--set", "mapping.cell=small"], "mapping.cell is 'small': Expected `float`, got `str`"),
        (["--set", "mapping.cell=-1"], "mapping.cell is -1: Expected `float` > 0"),
        (["--set", "mapping.cell=.nan"], "mapping.cell is nan: expected a number"),
        (["--set", "mapping.cell=[1"], "--set mapping.cell=[1, line 1: not valid YAML"),
        (["--set", "odometry.noise=[1]"], "odometry.noise is [1]: "),
        (["--set", "odometry.noise=[.inf, 1]"], "odometry.noise is [inf, 1]: expected a number"),
        (["--set", "stereo.disparities=40"], "stereo.disparities is 40: must be a multiple of 16"),
        (["--settings", "gone.yaml"], "gone.yaml: no such file"),
        (["--seed", "-1"], "Invalid value for '--seed': -1 is not in the range x>=0"),
        (["--seed", "one"], "'one' is not a valid integer range"),
        (["--threads", "0"], "Invalid value for '--threads'"),
        (["--sead", "1"], "No such option '--sead'"),
        (["--rig", "gone.yaml"], "gone.yaml: no such file"),
        (["--motion", "poses:"], "--motion poses:: unknown"),
    ],
)
def test_wrong_arguments_are_one_line(refused, office_piece, tmp_path, arguments, told):
    assert told in refused("map", office_piece, "-o", tmp_path / "run", "--quiet", *arguments)
    assert not (tmp_path / "run").exists()


def test_an_early_refusal_ends_the_process_cleanly(office, tmp_path):
    """Open3D is loaded beside the run: the process must not end in the middle of that."""
    (office / "mav0" / "cam0" / "data" / "1000000000000.jpg").write_bytes(b"")
    for file in (office / "mav0" / "cam1" / "data").iterdir():
        file.write_bytes(b"")
    done = subprocess.run(
        command("map", office, "-o", tmp_path / "run", *QUICK), capture_output=True, text=True
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "could be used" in done.stderr


def test_a_settings_file_is_named_with_its_key(refused, office_piece, tmp_path):
    file = tmp_path / "settings.yaml"
    for text, told in (
        ("mapping: {partikel: 3}", "unknown key 'mapping.partikel'"),
        ("mapping: {particles: many}", "mapping.particles is 'many'"),
        ("mapping: 3", "mapping: expected key: value lines, got 3"),
        ("- 3", "expected the stages stereo, laser, odometry, visual, mapping"),
        ("mapping: {", "settings.yaml, line 1: not valid YAML"),
    ):
        file.write_text(text)
        line = refused("map", office_piece, "-o", tmp_path / "run", "--settings", file)
        assert str(file) in line
        assert told in line


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["map"], "Missing argument 'INPUT' (see 'beemap map --help')"),
        (["map", "here"], "Missing option '-o'"),
        (["mop"], "No such command 'mop'"),
        (["info"], "Missing argument"),
        (["info", "gone"], "gone: no such folder"),
    ],
)
def test_missing_arguments_are_one_line(refused, arguments, told):
    assert told in refused(*arguments)


def test_no_arguments_show_the_help(beemap):
    outcome = beemap()
    assert outcome.code == 2
    assert "Commands:" in outcome.err
    assert "Traceback" not in outcome.err


def test_a_bug_keeps_its_traceback(office_piece, tmp_path, monkeypatch, beemap):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(pipeline.results, "map_points", fail)
    with pytest.raises(ZeroDivisionError):
        beemap("map", office_piece, "-o", tmp_path / "run", *QUICK)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError(), "beemap: out of memory: give larger mapping.cell, fewer particles"),
        (
            PermissionError(errno.EACCES, "Permission denied", "secret"),
            "beemap: secret: Permission",
        ),
    ],
)
def test_what_the_machine_refuses_is_one_line(refused, monkeypatch, error, told):
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(pipeline.recordings, "open_recording", fail)
    assert refused("info", "anywhere").startswith(told)


def test_info_tells_what_is_there(beemap, office_piece):
    outcome = beemap("info", office_piece)
    assert outcome.code == 0
    for told in ("EuRoC/ASL", "40", "2.00 pairs/s", "19.50 s", "320x240", "120.0 mm", "encoders"):
        assert told in outcome.out
    facts = json.loads(beemap("info", office_piece, "--json").out)
    assert facts["pairs"] == 40
    assert facts["skipped"] == {}


def test_info_tells_of_gaps(beemap, office):
    for camera in ("cam0", "cam1"):
        table = office / "mav0" / camera / "data.csv"
        lines = table.read_text().splitlines()
        table.write_text("\n".join(lines[:10] + lines[15:]) + "\n")
    assert "1, the longest 3.00 s" in beemap("info", office).out


def test_paths_with_blanks_and_accents(beemap, office, tmp_path):
    strange = office.rename(tmp_path / "Büro, 2. Stock (neu)")
    run = tmp_path / "a b" / "läuft"
    assert beemap("map", strange, "-o", run, *QUICK).code == 0
    assert report(run)["input"] == str(strange)
    assert np.isfinite(read_tum(run / "trajectory.tum").poses).all()


LOADED_BESIDE_ANOTHER_IMPORT = """
import sys

from mapping.clouds import import_open3d

met = []

def trace(frame, event, argument):
    if frame.f_code.co_name == "_insert_pybind_names" and not met:
        met.append(frame)
        raise RuntimeError("dictionary changed size during iteration")

sys.settrace(trace)
open3d = import_open3d()
sys.settrace(None)
assert met
print(len(open3d.geometry.PointCloud().points))
"""


def test_open3d_loads_while_another_thread_imports():
    command = [sys.executable, "-c", LOADED_BESIDE_ANOTHER_IMPORT]
    done = subprocess.run(command, capture_output=True, text=True, cwd=OFFICE.parent.parent)
    assert done.stdout == "0\n", done.stderr
