"""Who does the tasks: processes of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from pipeline.extras import need
from pipeline.signals import handled
from pipeline.tasks.processes import run_in_processes
from pipeline.tasks.task import Failure

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Workers:
    """jobs: tasks at once; None: as many as there are cores, or workers of the cluster.
    scheduler: address of a Dask scheduler; None: processes of this machine.

    Raises InputError where a scheduler is named and Dask is not installed.
    """

    jobs: int | None = None
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None:
            need("cluster", "--scheduler")


class Runner(Protocol):
    """Does tasks until there are none left."""

    def __call__(
        self,
        tasks: Sequence[T],
        work: Callable[[T], R],
        threads: int | None = None,
        told: Callable[[T, float], None] = ...,
    ) -> Generator[tuple[T, R | Failure]]:
        """Yield (task, work(task)) as they finish.

        work: a function of a module; tasks and results are pickled. A task whose worker died is
        done again, a few times at most. threads: of each task; None: its share of the cores.
        told(task, share): how far a task is. When the generator is closed, work is given up.

        Raises:
            InputError: the cluster was lost, or a worker of another beemap joined it.
        """
        ...


@contextmanager
def task_runner(workers: Workers, must_see: Sequence[Path] = ()) -> Iterator[Runner]:
    """Yield who does the tasks, found fit for them.

    must_see: files and folders that the tasks name.

    Raises:
        InputError: the scheduler does not answer or has no workers; a worker holds another
            beemap, or does not see one of the files.
    """
    with _signals_end():
        if workers.scheduler is None:
            yield _Local(workers.jobs)
            return
        from pipeline.tasks.cluster import connected

        with connected(workers.scheduler, workers.jobs) as cluster:
            cluster.check(must_see)
            yield cluster


def shares(jobs: int | None, threads: int | None, tasks: int) -> tuple[int, int]:
    """(processes at once, threads of each) such that together they have no more than the cores;
    what was chosen is kept."""
    cores = _cores()
    jobs = jobs or max(1, cores // (threads or 1))
    jobs = max(1, min(jobs, tasks))
    return jobs, threads or max(1, cores // jobs)


@contextmanager
def _signals_end() -> Iterator[None]:
    """Ctrl-C, SIGTERM and a terminal that closes end the program by way of the `finally` that ends
    its workers, even in a program that was started in the background, where a shell has Ctrl-C
    ignored."""

    def leave(number: int, frame: Any) -> None:
        if number == signal.SIGTERM:
            sys.exit(128 + number)
        if number == signal.SIGHUP:  # a second one must not break off the ending
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    with handled(leave):
        yield


def _cores() -> int:
    """That this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class _Local:
    """A `Runner` of processes."""

    jobs: int | None

    def __call__(
        self,
        tasks: Sequence[Any],
        work: Callable[[Any], Any],
        threads: int | None = None,
        told: Callable[[Any, float], None] = lambda task, share: None,
    ) -> Generator[tuple[Any, Any]]:
        jobs, threads = shares(self.jobs, threads, len(tasks))
        return run_in_processes(tasks, work, jobs, threads, told)
