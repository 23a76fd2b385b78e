"""Tasks on a real Dask scheduler with two worker processes; and schedulers that are none."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import InputError
from pipeline.tasks import cluster as cluster_module
from pipeline.tasks import scheduler_address
from pipeline.tasks.cluster import connected
from pipeline.tasks.fitness import misfit
from pipeline.tasks.identity import SOURCE, identity
from pipeline.tasks.runner import Workers, task_runner
from pipeline.tasks.task import Failure
from tests.batch_runs import QUICK, results
from tests.dask_cluster import ALLOWED_FAILURES, DaskCluster, scheduler, wait_for_workers, workers
from tests.experiment_runs import noted, spec, tiny_world
from tests.task_work import POISON, mortal, square, telling

ONE_WORKER = r"worker tcp://127\.0\.0\.1:\d+"


@pytest.fixture(scope="module")
def lonely(tmp_path_factory) -> Iterator[DaskCluster]:
    """A scheduler without workers."""
    with scheduler(tmp_path_factory.mktemp("dask")) as found:
        yield found


@pytest.fixture(scope="module")
def dask(lonely) -> Iterator[DaskCluster]:
    """The scheduler with two workers of one thread each."""
    with workers(lonely, 2):
        wait_for_workers(lonely, 2)
        yield lonely


def refusal(address: str, must_see: tuple[Path, ...] = ()) -> str:
    with pytest.raises(InputError) as error, task_runner(Workers(None, address), must_see):
        pass
    return str(error.value)


def test_a_scheduler_without_workers_says_how_to_start_one(lonely):
    line = f"--scheduler {lonely.address}: has no workers: start some with 'dask worker "
    assert refusal(lonely.address) == f"{line}{lonely.address}'"


def test_tasks_are_done_by_both_workers_one_at_a_time_each(dask, tmp_path):
    tasks = [(number, str(tmp_path)) for number in range(6)]
    told = []
    with task_runner(Workers(None, dask.address), [tmp_path]) as run_tasks:
        done: dict[int, Any] = {task[0]: result for task, result in run_tasks(tasks, square)}
        later = run_tasks(
            [(7, ""), (8, "")], telling, 1, lambda task, share: told.append((task[0], share))
        )
        assert sorted(later) == [((7, ""), 7), ((8, ""), 8)]
    assert [done[n][0] for n in range(6)] == [0, 1, 4, 9, 16, 25]
    assert {threads for _, _, threads in done.values()} == {1}
    assert len(list(tmp_path.iterdir())) == len(tasks)
    assert sorted(told) == [(7, 0.25), (7, 0.5), (8, 0.25), (8, 0.5)]


def test_a_batch_on_the_cluster_gives_the_bytes_of_beemap_map(dask, recordings, beemap, tmp_path):
    out = tmp_path / "out"
    words = (recordings / "kitchen", recordings / "hall", "-o", out, "--scheduler", dask.address)
    done = beemap("batch", *words, *QUICK)
    assert (done.code, done.out.splitlines()[0]) == (0, "2 recordings: 2 mapped"), done.err
    for name in ("kitchen", "hall"):
        assert beemap("map", recordings / name, "-o", tmp_path / name, *QUICK).code == 0
        assert results(out / name) == results(tmp_path / name)
    assert [entry.name for entry in out.glob(".*")] == []


def test_an_experiment_runs_on_the_cluster(dask, tmp_path, monkeypatch):
    from pipeline.experiments.batch import run_batch

    monkeypatch.chdir(tmp_path)
    tiny_world(tmp_path)
    plan = [spec(Path("tiny.yaml"), seed) for seed in (1, 2)]
    out = Path("out")
    out.mkdir()
    done = run_batch(plan, out, noted, Workers(None, dask.address), quiet=True)
    assert [run.result.ate for run in done.runs] == pytest.approx([0.1, 0.2])
    assert [run.spec for run in done.runs] == plan
    again = run_batch(plan, out, noted, Workers(1), quiet=True)
    assert again.notes == ["2 runs were done already"]
    assert len(list(out.glob("did-*"))) == 2


def test_a_worker_that_does_not_see_a_file_is_named_with_it(dask, tmp_path):
    line = refusal(dask.address, (tmp_path, tmp_path / "recs"))
    assert f"(1 other workers, too): does not see {tmp_path / 'recs'}: its paths must be" in line


def test_a_lost_worker_s_task_is_done_again_and_one_that_kills_them_all_is_given_up(dask, tmp_path):
    # Dask blames a dead worker's other tasks, too: one death at a time.
    done: dict[int, Any] = {}
    for numbers in ((-1, 0, 1, 2), (POISON, 3)):
        tasks = [(number, str(tmp_path)) for number in numbers]
        with task_runner(Workers(None, dask.address)) as run_tasks:
            done |= {task[0]: result for task, result in run_tasks(tasks, mortal, 1)}
    assert (done[-1], done[2], done[3], len(done)) == (-1, 2, 3, 6)
    assert len(list(tmp_path.glob("begun--1-*"))) == 2
    tries = ALLOWED_FAILURES + 1
    assert done[POISON] == Failure(f"its worker died, {tries} times (out of memory?)")
    assert done[0].reason.startswith("ZeroDivisionError: no such thing (worker tcp://127.0.0.1:")
    assert done[1].reason.startswith("one: write two (worker tcp://127.0.0.1:")


def test_a_worker_of_another_beemap_is_named_before_any_task_is_sent(dask, tmp_path):
    (tmp_path / "pipeline").mkdir()
    (tmp_path / "pipeline" / "__init__.py").write_text("")
    (tmp_path / "beemap-9.9.dist-info").mkdir()
    (tmp_path / "beemap-9.9.dist-info" / "METADATA").write_text("Name: beemap\nVersion: 9.9\n")
    done = tmp_path / "done"
    done.mkdir()
    ours = identity()["beemap"]
    wait_for_workers(dask, 2)
    with workers(dask, 1, tmp_path, nanny=False):
        wait_for_workers(dask, 3)
        with pytest.raises(InputError, match=f"{ONE_WORKER}: has beemap 9.9, here {ours}: install"):
            refusal_of_late(dask, done)
        assert f": has beemap 9.9, here {ours}: install the same there" in refusal(dask.address)
    wait_for_workers(dask, 2)
    assert not list(done.iterdir())


def refusal_of_late(dask: DaskCluster, folder: Path) -> None:
    """Give tasks to workers that were not looked at before, as one that comes later."""
    with connected(dask.address, None) as cluster:
        list(cluster([(1, str(folder))], square))


def test_another_source_of_the_same_version_is_another_beemap():
    ours = identity()
    assert misfit(ours, dict(ours)) is None
    line = misfit({**ours, SOURCE: "0123456789ab"}, ours)
    assert line is not None
    assert line.startswith(f"has source of beemap 0123456789ab, here {ours[SOURCE]}: install")
    assert len(ours[SOURCE]) == 12


@pytest.mark.parametrize(
    "address", ["nonsense", "tcp://", "http://127.0.0.1:8786", "tcp://h:99999"]
)
def test_what_is_no_address_is_refused(address):
    assert refusal(address) == (
        f"--scheduler {address}: not an address: write it as tcp://host:8786"
    )


@pytest.mark.parametrize("listens", [False, True])
def test_nothing_or_something_else_at_the_address_is_one_line(monkeypatch, listens):
    monkeypatch.setattr(scheduler_address, "ANSWER", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        if listens:
            silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        assert refusal(address) == (
            f"--scheduler {address}: no Dask scheduler answers there: look at the address, or "
            "start one with 'dask scheduler'"
        )


def test_a_worker_that_ends_while_it_is_looked_at_ends_nothing(dask, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster_module, "judge", lambda client, must_see: ({}, set()))
    with connected(dask.address, None) as cluster:
        done = list(cluster([(3, str(tmp_path))], square))
        assert [result[0] for _, result in done] == [9]
        with pytest.raises(InputError, match="has no workers: start some with"):
            cluster.check([])


def test_workers_that_are_gone_for_good_end_the_run(lonely, monkeypatch):
    monkeypatch.setattr(cluster_module, "PATIENCE", 0.1)
    monkeypatch.setattr(cluster_module, "LOOK_EVERY", 0.1)
    with connected(lonely.address, 1) as cluster:
        monkeypatch.setattr(cluster, "_workers", dict)
        with pytest.raises(InputError, match="has no workers any more: start some and give"):
            list(cluster([(1, "")], square))


def test_a_scheduler_that_dies_ends_the_run(tmp_path, dask):
    """The last of this file: the scheduler is gone afterwards."""
    tasks = [(number, str(tmp_path)) for number in range(4)]
    with task_runner(Workers(1, dask.address)) as run_tasks:
        results = run_tasks(tasks, square)
        next(results)
        dask.scheduler.kill()
        with pytest.raises(InputError, match="does not answer any more: start it and its workers"):
            list(results)
