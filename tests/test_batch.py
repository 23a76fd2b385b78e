"""`beemap batch`: many recordings, resumable, whatever dies; a table and a page."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.batch_runs import QUICK, batch_command, results
from tests.conftest import Outcome

PAIRS = {"kitchen": 13, "hall": 27}


def lines(table: Path) -> dict[str, dict[str, str]]:
    """table.csv by the names of the results."""
    with table.open(newline="") as file:
        return {line["name"]: line for line in csv.DictReader(file)}


@pytest.fixture(scope="module")
def batch(recordings, tmp_path_factory) -> tuple[Path, Outcome]:
    """The folder of the recordings mapped by two processes, and what the command said."""
    folder = tmp_path_factory.mktemp("batch") / "out"
    command = batch_command(recordings, "-o", folder, "--jobs", 2)
    done = subprocess.run(command, capture_output=True, text=True)
    return folder, Outcome(done.returncode, done.stdout, done.stderr)


def test_each_recording_gets_a_result_and_one_that_fails_stops_no_other(recordings, batch):
    folder, outcome = batch
    assert outcome.code == 1, outcome
    assert outcome.out.startswith("3 recordings: 2 mapped, 1 failed\n")
    assert f"note: {recordings}: passed over, no recording: notes.txt\n" in outcome.err
    assert f"beemap: failed: broken: {recordings / 'broken'}" in outcome.err
    assert sorted(entry.name for entry in folder.iterdir()) == [
        "batch.txt", "hall", "index.html", "kitchen", "table.csv", "table.md",
    ]  # fmt: skip
    table = lines(folder / "table.csv")
    assert list(table) == ["broken", "hall", "kitchen"]
    assert table["broken"]["state"] == "failed"
    assert table["broken"]["why"].startswith(f"{recordings / 'broken'}")
    for name, pairs in PAIRS.items():
        run = json.loads((folder / name / "run.json").read_text())
        assert run["threads"] == max(1, len(os.sched_getaffinity(0)) // 2)
        line = table[name]
        assert (line["state"], line["recording"]) == ("mapped", str(recordings / name))
        assert int(line["pairs"]) == run["counts"]["pairs used"] == pairs
        assert float(line["path_m"]) == pytest.approx(run["path_m"])
        assert float(line["free_m2"]) == pytest.approx(run["free_m2"])
        assert float(line["occupied_m2"]) == pytest.approx(run["occupied_m2"])
        assert int(line["local_maps"]) == run["local_maps"] > 1
        assert 0.0 < float(line["ate_m"]) < 0.2


def test_the_bytes_are_those_of_beemap_map_with_any_threads(recordings, batch, beemap, tmp_path):
    folder, _ = batch
    run = tmp_path / "run"
    words = ("map", recordings / "kitchen", "-o", run, "--threads", 2, "--quiet")
    assert beemap(*words, *QUICK).code == 0
    assert results(run) == results(folder / "kitchen")


def test_the_table_and_the_page_show_every_recording(batch):
    folder, _ = batch
    table = (folder / "table.md").read_text()
    assert table.startswith("# 3 recordings: 2 mapped, 1 failed\n")
    assert "| broken | - | - | - | - | - | failed | - | - |" in table
    assert "| hall | 27 | " in table
    assert "- broken: failed: " in table
    page = (folder / "index.html").read_text()
    assert page.count("<article") == 3
    assert page.count('src="data:image/png;base64,') == 2
    assert "http" not in page  # nothing is fetched
    for link in ("hall/map.png", "kitchen/run.json"):
        assert f'href="{link}"' in page
        assert (folder / link).is_file()


def waited_for(process: subprocess.Popen, folder: Path, pattern: str) -> None:
    """Until the folder holds such a file."""
    deadline = time.monotonic() + 60.0
    while not list(folder.glob(pattern)):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)


def children(process: subprocess.Popen) -> list[int]:
    """Its worker processes."""
    import psutil  # comes with distributed; a slim system has no ps

    found = psutil.Process(process.pid).children()
    return [child.pid for child in found if "spawn_main" in " ".join(child.cmdline())]


def test_interrupted_and_with_a_worker_killed_it_ends_with_the_same_bytes(
    recordings, batch, tmp_path
):
    reference, _ = batch
    folder = tmp_path / "out"
    words = (recordings / "kitchen", recordings / "hall", "-o", folder)
    call = batch_command(*words, "--jobs", 1, "--threads", 1)
    # Ctrl-C, as to a program in the background of a shell, and to all its processes.
    first = subprocess.Popen(
        call, start_new_session=True, text=True, stderr=subprocess.PIPE, stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
    waited_for(first, folder, "kitchen.checkpoint")
    os.killpg(first.pid, signal.SIGINT)
    said, errors = first.communicate(timeout=30.0)
    assert first.returncode == 130
    assert said.startswith("2 recordings: ")
    assert errors.endswith("beemap: interrupted: the same command goes on\n")
    left = {entry.name for entry in folder.iterdir()} - {"kitchen", "kitchen.checkpoint"}
    assert left == {"batch.txt", "index.html", "table.csv", "table.md"}
    assert lines(folder / "table.csv")["hall"]["state"] == "not done"

    second = subprocess.Popen(call, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    waited_for(second, folder, "hall.checkpoint")
    (worker,) = children(second)
    os.kill(worker, signal.SIGKILL)
    said, errors = second.communicate(timeout=60.0)
    assert second.returncode == 0, errors
    assert said.startswith("2 recordings: 2 mapped\n")
    assert [e.name for pattern in (".*", "*.checkpoint") for e in folder.glob(pattern)] == []
    for name in PAIRS:
        assert results(folder / name) == results(reference / name)
