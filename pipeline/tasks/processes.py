"""Many tasks in several processes; one that fails or dies takes only its own task with it.

Processes are spawned: numba's OpenMP layer aborts after a fork.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection
from typing import Any, TypeVar

from pipeline.tasks.task import Failure, Place, perform

T = TypeVar("T")
R = TypeVar("R")

# A task whose process died is begun again; one that ends every process is given up.
TRIES = 3


@dataclass
class _Try:
    """A task on its way: how many processes it was given to."""

    task: Any
    count: int = 0


def run_in_processes(
    tasks: Sequence[T],
    work: Callable[[T], R],
    jobs: int,
    threads: int,
    told: Callable[[T, float], None],
) -> Generator[tuple[T, R | Failure]]:
    """Yield (task, work(task)) as they finish, from `jobs` processes of `threads` threads each.

    work: a function of a module; tasks and results are pickled. told(task, share): how far a task
    is. When the generator is closed, or the program interrupted, the processes are ended at once.
    """
    waiting = deque(_Try(task) for task in tasks)
    workers: list[_Worker] = []
    busy: dict[connection.Connection, tuple[_Worker, _Try]] = {}

    def give(worker: _Worker) -> None:
        if waiting:
            given = waiting.popleft()
            given.count += 1
            busy[worker.pipe] = (worker, given)
            # One that has died meanwhile is noticed by the end of its pipe.
            with suppress(OSError):
                worker.pipe.send(given.task)

    try:
        with _limited(threads):
            workers.extend(_Worker(work, threads) for _ in range(min(jobs, len(tasks))))
            for worker in workers:
                give(worker)
            while busy:
                for pipe in connection.wait(list(busy)):
                    worker, given = busy[pipe]  # type: ignore[index]
                    value: Any = None
                    try:
                        kind, value = worker.pipe.recv()
                    except (EOFError, OSError):
                        kind = "died"
                    if kind == "told":
                        told(given.task, value)
                        continue
                    del busy[worker.pipe]
                    if kind == "died":
                        how = worker.end()
                        workers.remove(worker)
                        worker = _Worker(work, threads)
                        workers.append(worker)
                        if given.count < TRIES:
                            waiting.appendleft(given)
                        else:
                            kind, value = "done", Failure(f"its process {how}, {TRIES} times")
                    give(worker)
                    if kind == "done":
                        yield given.task, value
    finally:
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.process.join()


class _Worker:
    """A process that takes tasks from a pipe until it is ended."""

    def __init__(self, work: Callable[[Any], Any], threads: int):
        context = multiprocessing.get_context("spawn")
        self.pipe, its_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(its_end, work, threads), daemon=True)
        # Such signals reach the whole group of processes; the parent decides what becomes of it.
        with _without_interrupts():
            self.process.start()
        its_end.close()

    def end(self) -> str:
        """How it ended, after it has died."""
        self.process.join()
        code = self.process.exitcode or 0
        if code < 0:
            return f"was killed by {signal.Signals(-code).name} (out of memory?)"
        return f"ended with code {code}"


def _serve(pipe: connection.Connection, work: Callable[[Any], Any], threads: int) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)

    def say(kind: str, value: Any) -> None:
        try:
            pipe.send((kind, value))
        except BrokenPipeError:
            # Whoever wanted it was killed: as if this process had been, too.
            os._exit(1)

    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        say("done", perform(work, task, Place(threads, lambda share: say("told", share))))


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """What is started within never hears of Ctrl-C or of a terminal that closes; here one is late
    by that long."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGHUP])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _limited(threads: int) -> Iterator[None]:
    """An environment in which each process uses so many threads, set before numpy is loaded."""
    limits = {
        "NUMBA_NUM_THREADS": str(threads),
        "OMP_NUM_THREADS": str(threads),
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_WAIT_POLICY": "PASSIVE",
    }
    # As in `beemap map`: on Linux GNU OpenMP is always there.
    if hasattr(os, "sched_getaffinity"):
        limits["NUMBA_THREADING_LAYER"] = "omp"
    before = {name: os.environ.get(name) for name in limits}
    os.environ.update(limits)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
