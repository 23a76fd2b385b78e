"""Tasks on the workers of a Dask cluster that is there already.

Dask says which task runs where, and runs it again when its worker is lost (a few times:
`distributed.scheduler.allowed-failures`). A worker process does one task at a time, however many
threads it has: those are the task's. No more tasks are sent than there are workers.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.tasks.fitness import judge, misfit, own_identity
from pipeline.tasks.scheduler_address import ANSWER, is_scheduler
from pipeline.tasks.task import Failure, Place, perform

LOOK_EVERY = 1.0  # for workers that come and go [s]
# So long all workers may be gone before the run is given up [s].
PATIENCE = 30.0


@dataclass(frozen=True)
class _Misfit:
    """In place of a result: what is wrong with the worker that should have done the task."""

    reason: str


@contextmanager
def connected(address: str, jobs: int | None) -> Iterator[Cluster]:
    """Yield the cluster of the scheduler at `address`; at most `jobs` tasks at once.

    Raises:
        InputError: no scheduler answers there.
    """
    import distributed

    # What they have to say is said here, in one line; each has its own handler.
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)
    if not is_scheduler(address):
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there: look at the address, or "
            "start one with 'dask scheduler'"
        )
    client = distributed.Client(address, timeout=ANSWER, set_as_default=False)
    try:
        yield Cluster(client, address, jobs)
    finally:
        with suppress(OSError):
            client.close(timeout=ANSWER)


class Cluster:
    """A `Runner` (`pipeline.tasks.runner`) of the workers of a cluster."""

    def __init__(self, client: Any, address: str, jobs: int | None) -> None:
        self._client = client
        self._address = address
        self._jobs = jobs
        self._must_see: Sequence[Path] = ()
        self._fit: set[str] = set()

    def check(self, must_see: Sequence[Path]) -> None:
        """Look whether the workers are fit for tasks that name these files.

        Raises:
            InputError: there is none; one holds another beemap, or does not see a file.
        """
        self._must_see = must_see
        self._look_at_workers()
        if not self._fit:
            raise InputError(
                f"--scheduler {self._address}: has no workers: start some with "
                f"'dask worker {self._address}'"
            )

    def __call__(
        self,
        tasks: Sequence[Any],
        work: Callable[[Any], Any],
        threads: int | None = None,
        told: Callable[[Any, float], None] = lambda task, share: None,
    ) -> Generator[tuple[Any, Any]]:
        waiting = deque(enumerate(tasks))
        running: dict[Any, Any] = {}  # future -> task
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        topic = f"beemap-{uuid.uuid4()}"
        ours = own_identity()

        def hear(event: tuple[float, tuple[int, float]]) -> None:
            number, share = event[1]
            told(tasks[number], share)

        self._client.subscribe_topic(topic, hear)
        lonely = time.monotonic()
        try:
            while waiting or running:
                workers = self._workers()
                if not self._fit.issuperset(workers):
                    self._look_at_workers()  # some came later
                # Dask gives a task to the worker with the fewest: to one that does nothing.
                while waiting and len(running) < min(self._jobs or len(workers), len(workers)):
                    number, task = waiting.popleft()
                    hearer = (topic, number)
                    future = self._client.submit(_do, work, task, threads, ours, hearer, pure=False)
                    running[future] = task
                    future.add_done_callback(ended.put)
                if workers:
                    lonely = time.monotonic()
                elif time.monotonic() - lonely > PATIENCE:
                    raise InputError(
                        f"--scheduler {self._address}: has no workers any more: start some and "
                        "give the same command again, it goes on"
                    )
                with suppress(queue.Empty):
                    future = ended.get(timeout=LOOK_EVERY)
                    yield running.pop(future), self._outcome(future)
        finally:
            with suppress(OSError):
                self._client.cancel(list(running))
                self._client.unsubscribe_topic(topic)

    def _look_at_workers(self) -> None:
        """Remember those that are fit. Raises InputError naming one that is not."""
        faults, self._fit = judge(self._client, self._must_see)
        if faults:
            worker, fault = min(faults.items())
            others = f" ({len(faults) - 1} other workers, too)" if len(faults) > 1 else ""
            raise InputError(f"worker {worker}{others}: {fault}")

    def _workers(self) -> dict[str, int]:
        """Address -> threads of every worker there is now."""
        try:
            return self._client.nthreads()
        except (OSError, RuntimeError, ValueError):
            raise self._lost() from None

    def _outcome(self, future: Any) -> Any:
        """The result of a future that has ended, or why there is none."""
        if future.status not in ("finished", "error"):
            raise self._lost()
        error = future.exception()
        if error is None:
            result = future.result()
            if isinstance(result, _Misfit):
                raise InputError(result.reason)
            return result
        if type(error).__name__ == "KilledWorker":
            tries = error.allowed_failures + 1
            return Failure(f"its worker died, {tries} times (out of memory?)")
        return Failure(" ".join(f"{type(error).__name__}: {error}".split()))

    def _lost(self) -> InputError:
        return InputError(
            f"--scheduler {self._address}: does not answer any more: start it and its workers "
            "and give the same command again, it goes on"
        )


_ONE = threading.Lock()


def _do(
    work: Callable[[Any], Any],
    task: Any,
    threads: int | None,
    theirs: dict[str, str],
    hearer: tuple[str, int],
) -> Any:
    """Do a task in a worker of the cluster, when it does no other.

    theirs: the identity of who sent it; hearer: the topic and the number under which it is told
    how far the task is.
    """
    from distributed import get_worker

    from pipeline.commands.libraries import use_threads

    worker = get_worker()
    topic, number = hearer
    with _ONE:
        # What it has loaded may be older than what was looked at.
        if (fault := misfit(own_identity(), theirs)) is not None:
            return _Misfit(f"worker {worker.address}: {fault}")
        threads = threads or worker.state.nthreads
        use_threads(threads)
        where = Place(threads, lambda share: worker.log_event(topic, (number, share)))
        result = perform(work, task, where)
    if isinstance(result, Failure):
        return Failure(f"{result.reason} (worker {worker.address})")
    return result
