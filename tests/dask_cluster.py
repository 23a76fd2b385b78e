"""A Dask scheduler and workers as processes of their own, on loopback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
# A task that kills its worker is given up after the second one.
ALLOWED_FAILURES = 1


@dataclass(frozen=True)
class DaskCluster:
    """A scheduler that listens at `address`."""

    address: str
    scheduler: subprocess.Popen
    place: Path


def _dask(place: Path, *words: str, path: Path = ROOT) -> subprocess.Popen:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(path), str(ROOT)]),
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(ALLOWED_FAILURES),
    }
    with (place / f"{words[0]}.txt").open("a") as said:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--no-dashboard"],
            cwd=place, env=environment, stdout=said, stderr=said,
        )  # fmt: skip


@contextmanager
def scheduler(place: Path) -> Iterator[DaskCluster]:
    """A scheduler without workers."""
    file = place / "scheduler.json"
    process = _dask(
        place, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file)
    )
    try:
        deadline = time.monotonic() + 30.0
        while not file.exists() or not file.read_text():
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield DaskCluster(json.loads(file.read_text())["address"], process, place)
    finally:
        process.kill()
        process.wait()


@contextmanager
def workers(
    cluster: DaskCluster, count: int, path: Path = ROOT, nanny: bool = True
) -> Iterator[None]:
    """Workers that take what is in `path` for beemap; they come within the block.

    nanny: they are started again when they die.
    """
    process = _dask(
        cluster.place, "worker", cluster.address, "--nworkers", str(count), "--nthreads", "1",
        "--host", "127.0.0.1", "--nanny" if nanny else "--no-nanny", path=path,
    )  # fmt: skip
    try:
        yield
    finally:
        process.kill()  # workers end when their nanny is gone
        process.wait()


def wait_for_workers(cluster: DaskCluster, count: int) -> None:
    """Until so many are there, those that are started again included."""
    from distributed import Client

    client: Any
    with Client(cluster.address, set_as_default=False) as client:
        deadline = time.monotonic() + 30.0
        while len(client.nthreads()) != count:
            assert time.monotonic() < deadline
            time.sleep(0.05)
