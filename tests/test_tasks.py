"""Tasks in processes of this machine: done once, done again when a process dies, told of."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import Any

import pytest

from pipeline.errors import InputError
from pipeline.tasks import runner
from pipeline.tasks.folder import Watch, claimed
from pipeline.tasks.runner import Workers, shares, task_runner
from pipeline.tasks.task import Failure
from tests.task_work import POISON, mortal, square, telling
from tests.test_structure import ROOT


def test_a_dead_process_s_task_is_done_again_and_one_that_kills_them_all_is_given_up(tmp_path):
    tasks = [(number, str(tmp_path)) for number in (2, POISON, -1, 0, 1, 3)]
    with task_runner(Workers(2)) as run_tasks:
        done: dict[int, Any] = {task[0]: result for task, result in run_tasks(tasks, mortal, 1)}
    assert {number: done[number] for number in (2, 3, -1)} == {2: 2, 3: 3, -1: -1}
    assert len(list(tmp_path.glob("begun--1-*"))) == 2
    assert done[POISON] == Failure("its process was killed by SIGKILL (out of memory?), 3 times")
    assert done[0] == Failure("ZeroDivisionError: no such thing")
    assert done[1] == Failure("one: write two")
    assert len(done) == len(tasks)


def test_processes_share_the_cores_and_each_task_is_done_once(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "_cores", lambda: 6)
    tasks = [(number, str(tmp_path)) for number in range(5)]
    with task_runner(Workers(2)) as run_tasks:
        done: dict[int, Any] = {task[0]: result for task, result in run_tasks(tasks, square)}
    assert [done[n][0] for n in range(5)] == [0, 1, 4, 9, 16]
    assert {threads for _, _, threads in done.values()} == {3}
    processes = {process for _, process, _ in done.values()}
    assert len(processes) <= 2
    assert os.getpid() not in processes
    assert len(list(tmp_path.iterdir())) == len(tasks)


@pytest.mark.parametrize(
    ("jobs", "threads", "tasks", "expected"),
    [
        (None, None, 100, (8, 1)),
        (None, None, 2, (2, 4)),
        (3, None, 100, (3, 2)),
        (None, 3, 100, (2, 3)),
        (4, None, 1, (1, 8)),
        (16, None, 100, (16, 1)),
        (2, 16, 100, (2, 16)),
        (None, None, 0, (1, 8)),
    ],
)
def test_cores_are_shared_out(monkeypatch, jobs, threads, tasks, expected):
    monkeypatch.setattr(runner, "_cores", lambda: 8)
    assert shares(jobs, threads, tasks) == expected


def test_a_task_tells_how_far_it_is(tmp_path):
    told = []
    with task_runner(Workers(1)) as run_tasks:
        results = run_tasks([(7, "")], telling, 1, lambda task, share: told.append((*task, share)))
        assert list(results) == [((7, ""), 7)]
    assert told == [(7, "", 0.25), (7, "", 0.5)]


def test_processes_end_when_the_program_is_killed(tmp_path):
    code = (
        "from pipeline.tasks.runner import Workers, task_runner\n"
        "from tests.task_work import endless\n"
        "if __name__ == '__main__':\n"
        "    with task_runner(Workers(1)) as run_tasks:\n"
        f"        list(run_tasks([(1, {str(tmp_path)!r})], endless, 1))\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, str(script)], cwd=ROOT, env=environment)

    def beats() -> int:
        return len(list(tmp_path.glob("beat-*")))

    deadline = time.monotonic() + 30.0
    while not beats():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.kill()
    process.wait()
    before = 0
    while beats() > before:  # it beats twenty times a second
        assert time.monotonic() < deadline
        before = beats()
        time.sleep(0.6)


def test_signals_are_as_before_when_the_runner_is_closed():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with pytest.raises(InputError), task_runner(Workers(1)):
        raise InputError("anything")
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_later_call_takes_the_folder_over_and_clears_what_was_left(tmp_path):
    (tmp_path / ".kitchen.part-17").mkdir()
    (tmp_path / ".kitchen.part-17" / "map.npz").touch()
    (tmp_path / "kitchen").mkdir()
    with claimed(tmp_path) as claim:
        assert sorted(entry.name for entry in tmp_path.iterdir()) == [claim.name, "kitchen"]
        watch = Watch(claim)
        assert not watch.gone()
        with claimed(tmp_path):
            assert Watch(claim).gone()
            assert not watch.gone()  # it does not look so often
    assert [entry.name for entry in tmp_path.iterdir()] == ["kitchen"]
