"""Many runs in several processes: nothing done twice, nothing lost, failures counted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.experiments.batch import ROWS, run_batch
from pipeline.tasks.folder import open_folder
from pipeline.tasks.runner import Workers
from tests.experiment_runs import failing, noted, spec, tiny_world

ROOT = Path(__file__).parent.parent


@pytest.fixture
def world(tmp_path) -> Path:
    return tiny_world(tmp_path)


@pytest.fixture
def folder(tmp_path) -> Path:
    place = tmp_path / "out"
    open_folder(place, "experiment", "particles", False)
    return place


def done(folder: Path) -> list[int]:
    """Seeds of the runs that were really done, in any order."""
    return sorted(int(file.name.split("-")[1]) for file in folder.glob("did-*"))


def test_runs_come_in_the_order_of_the_plan_with_their_numbers(world, folder):
    plan = [spec(world, seed) for seed in (3, 1, 2)]
    batch = run_batch(plan, folder, noted, Workers(2), quiet=True)
    assert [run.spec for run in batch.runs] == plan
    assert [run.result.ate for run in batch.runs] == pytest.approx([0.3, 0.1, 0.2])
    assert batch.runs[0].result.nees_series.tolist() == [1.0, 2.5, float("inf")]
    assert batch.failures == batch.notes == []


def test_what_was_done_is_not_done_again_and_reads_the_same(world, folder):
    plan = [spec(world, seed) for seed in (1, 2)]
    first = run_batch(plan, folder, noted, Workers(1), quiet=True)
    rows = (folder / ROWS).read_bytes()
    second = run_batch([*plan, spec(world, 3)], folder, noted, Workers(1), quiet=True)
    assert done(folder) == [1, 2, 3]
    assert (folder / ROWS).read_bytes().startswith(rows)
    assert repr(second.runs[:2]) == repr(first.runs)
    assert second.notes == ["2 runs were done already"]


def test_every_setting_is_part_of_the_key(world):
    runs = [
        spec(world),
        spec(world, 2),
        spec(world, 1, "mapping.match_tolerance=0"),
        spec(world, 1, alpha=0.5),
        spec(world, 1, blocks=2),
        spec(world, 1, false_depth="replace"),
        spec(world, 1, positions=20),
        spec(world, 1, sigma=True),
        spec(world, 1, threads=2),
        spec(world, 1, keep_map=True),
    ]
    assert len({run.key for run in runs}) == len(runs)
    assert spec(world).key == runs[0].key


def test_a_run_of_other_settings_does_not_pass_for_this_one(world, folder):
    run_batch([spec(world)], folder, noted, Workers(1), quiet=True)
    batch = run_batch([spec(world, alpha=0.5)], folder, noted, Workers(1), quiet=True)
    assert done(folder) == [1, 1]
    assert len(batch.runs) == 1
    assert batch.notes == [f"{ROWS}: 1 lines of other settings or another beemap are not used"]
    assert len((folder / ROWS).read_text().splitlines()) == 3  # it is kept


def test_the_key_follows_the_cells_of_the_world_and_not_its_name(tmp_path, world):
    place = tmp_path / "elsewhere"
    place.mkdir()
    copy = tiny_world(place)
    assert spec(copy).key == spec(world).key
    moved = place / "moved.yaml"
    moved.write_text(world.read_text().replace("[2.4, 2.0]", "[2.5, 2.0]"))
    assert spec(moved).key != spec(world).key


def test_names_decide_nothing_and_equal_runs_are_done_once(world, folder):
    plan = [spec(world, varied="this"), spec(world, varied="that")]
    batch = run_batch(plan, folder, noted, Workers(1), quiet=True)
    assert done(folder) == [1]
    assert [run.spec.varied for run in batch.runs] == ["this", "that"]


def test_a_damaged_line_is_measured_again_and_reported(world, folder):
    plan = [spec(world, seed) for seed in (1, 2)]
    run_batch(plan, folder, noted, Workers(1), quiet=True)
    rows = folder / ROWS
    lines = rows.read_text().splitlines()
    lines[1] = lines[1].replace("0.333333", "fast")
    rows.write_text("\n".join(lines)[:-2])  # and the last one was cut short
    batch = run_batch(plan, folder, noted, Workers(1), quiet=True)
    assert done(folder) == [1, 1, 2, 2]
    assert batch.notes == [f"{ROWS}: 2 damaged lines are measured again"]
    assert len(rows.read_text().splitlines()) == 3


def test_a_failing_run_and_a_dying_process_leave_the_others_alone(world, folder):
    plan = [spec(world, seed) for seed in (1, 2, 3, 4)]
    batch = run_batch(plan, folder, failing, Workers(1), quiet=True)
    assert [run.spec.seed for run in batch.runs] == [1, 4]
    bug, killed = batch.failures
    assert bug.startswith("paper hierarchical, ")
    assert bug.endswith("N 3, seed 2: ZeroDivisionError: no such thing")
    assert killed.endswith(
        "N 3, seed 3: its process was killed by SIGKILL (out of memory?), 3 times"
    )
    again = run_batch(plan, folder, noted, Workers(1), quiet=True)
    assert (done(folder), again.failures) == ([1, 2, 3, 4], [])


def group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_keeps_what_is_done_and_ends_its_processes(world, folder, ended_by):
    code = (
        "from pathlib import Path\n"
        "from pipeline.experiments.batch import InterruptedBatchError, run_batch\n"
        "from pipeline.tasks.runner import Workers\n"
        "from tests.experiment_runs import slow, spec\n"
        "if __name__ == '__main__':\n"
        f"    plan = [spec(Path({str(world)!r}), seed) for seed in (1, 2, 3, 4)]\n"
        "    try:\n"
        f"        run_batch(plan, Path({str(folder)!r}), slow, Workers(2), quiet=True)\n"
        "    except InterruptedBatchError as error:\n"
        "        print(error)\n"
    )
    script = folder.parent / "script.py"
    script.write_text(code)
    process = subprocess.Popen(
        [sys.executable, str(script)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    rows, deadline = folder / ROWS, time.monotonic() + 30.0
    while not (rows.exists() and rows.read_text().count("\n") == 3):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    if ended_by == signal.SIGINT:  # as Ctrl-C does: to all processes of the group
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.terminate()
    out, _ = process.communicate(timeout=10.0)
    assert out == ("2 of 4 runs\n" if ended_by == signal.SIGINT else "")
    while group_lives(process.pid):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    run_batch([spec(world, seed) for seed in (1, 2, 3, 4)], folder, noted, Workers(1), quiet=True)
    assert done(folder) == [1, 2, 3, 4]


def test_only_its_own_folder_is_used(tmp_path, folder):
    open_folder(folder, "experiment", "particles", False)
    with pytest.raises(InputError, match="holds experiment particles: choose another folder"):
        open_folder(folder, "experiment", "quality", False)
    with pytest.raises(InputError, match="holds other things than an experiment"):
        open_folder(tmp_path, "experiment", "quality", True)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="is a file, not a folder"):
        open_folder(tmp_path / "file", "experiment", "quality", False)


def test_force_starts_over(folder):
    (folder / ROWS).write_text("anything\n")
    open_folder(folder, "experiment", "particles", False)
    assert (folder / ROWS).exists()
    open_folder(folder, "experiment", "particles", True)
    assert not (folder / ROWS).exists()
