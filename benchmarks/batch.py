"""Many recordings at once: `beemap batch` by two processes and by two Dask workers against one by
one, and with a worker killed in the middle.

`python -m benchmarks.batch --quick` takes shorter recordings, once.
"""

from __future__ import annotations

import csv
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from benchmarks.report import OFFICE
from pipeline.experiments.report import machine, markdown_table

RECORDINGS = 8
PAIRS = 160
QUICK_PAIRS = 40
REPEATS = 2  # the better of
# Files that tell of time and place, too.
TELLING = {"run.json", "report.html"}
ASKED = 1.7


@dataclass(frozen=True)
class Cost:
    """Seconds of the clock, and of the processors."""

    wall: float
    cpu: float


def cut(target: Path, first: int, pairs: int) -> None:
    """A recording of so many pairs of data/office."""
    for camera in ("cam0", "cam1"):
        source, place = OFFICE / "mav0" / camera, target / "mav0" / camera
        (place / "data").mkdir(parents=True)
        shutil.copy(source / "sensor.yaml", place)
        head, *lines = (source / "data.csv").read_text(encoding="utf-8").splitlines()
        lines = lines[first : first + pairs]
        (place / "data.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        for line in lines:
            shutil.copy(source / "data" / line.partition(",")[2], place / "data")
    for name in ("odom0", "state_groundtruth_estimate0"):
        shutil.copytree(OFFICE / "mav0" / name, target / "mav0" / name)


def command(*words: object) -> list[str]:
    """`beemap` with these arguments as a process."""
    return [sys.executable, "-m", "pipeline.cli", *map(str, words), "--quiet"]


def timed(work: Callable[[], object]) -> Cost:
    """What it costs, processes that it starts included."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    work()
    wall = time.monotonic() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(wall, spent)


def one_by_one(recordings: Path, output: Path, *options: object) -> None:
    """`beemap map` for each of them."""
    for recording in sorted(recordings.iterdir()):
        words = ("map", recording, "-o", output / recording.name, *options)
        subprocess.run(command(*words), check=True)


def batch(recordings: Path, output: Path, *options: object) -> None:
    """`beemap batch` for all of them."""
    subprocess.run(command("batch", recordings, "-o", output, *options), check=True)


def same(one: Path, other: Path) -> int:
    """How many results are there in both folders, with the same bytes."""
    return sum(_contents(one / f"{n}") == _contents(other / f"{n}") for n in range(RECORDINGS))


def _contents(folder: Path) -> dict[str, bytes]:
    return {f.name: f.read_bytes() for f in folder.iterdir() if f.name not in TELLING}


def with_a_killed_worker(recordings: Path, output: Path) -> None:
    """Two at once; the process that maps the fourth is killed with SIGKILL."""
    words = command("batch", recordings, "-o", output, "--jobs", 2)
    with subprocess.Popen(words) as process:
        while not (output / "3.checkpoint").exists():
            time.sleep(0.02)
            assert process.poll() is None
        time.sleep(0.3)
        listed = subprocess.run(
            ["ps", "ww", "-o", "pid=", "-o", "args=", "--ppid", str(process.pid)],
            capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
        workers = [int(line.split()[0]) for line in listed.splitlines() if "spawn_main" in line]
        os.kill(workers[-1], signal.SIGKILL)
    assert process.returncode == 0


def on_a_cluster(recordings: Path, output: Path, place: Path) -> float:
    """On a scheduler and two workers on loopback; seconds, without their start."""
    told = place / "scheduler.json"
    with (place / "dask.txt").open("w") as said:
        started = [
            subprocess.Popen(
                [sys.executable, "-m", "dask", *words, "--no-dashboard", "--scheduler-file", told],
                stdout=said, stderr=said,
            )
            for words in (
                ("scheduler", "--host", "127.0.0.1", "--port", "0"),
                ("worker", "--nworkers", "2", "--nthreads", "1"),
            )
        ]  # fmt: skip
        try:
            while (place / "dask.txt").read_text().count("Registered to") < 2:
                time.sleep(0.1)
            address = json.loads(told.read_text())["address"]
            begin = time.monotonic()
            batch(recordings, output, "--scheduler", address)
            return time.monotonic() - begin
        finally:
            for process in reversed(started):
                process.terminate()
                process.wait()


def main(quick: bool = False) -> str:
    """Measure; the section as Markdown."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        recordings, pairs = place / "recordings", QUICK_PAIRS if quick else PAIRS
        for number in range(RECORDINGS):
            cut(recordings / f"{number}", number * (400 - pairs) // (RECORDINGS - 1), pairs)
        ways: dict[str, tuple[Callable[..., None], tuple[object, ...]]] = {
            "`beemap map` for each, `--threads 1`": (one_by_one, ("--threads", 1)),
            "`beemap map` for each, all cores": (one_by_one, ()),
            "`beemap batch --jobs 1 --threads 1`": (batch, ("--jobs", 1, "--threads", 1)),
            "`beemap batch --jobs 1`, all cores": (batch, ("--jobs", 1)),
            "`beemap batch --jobs 2`": (batch, ("--jobs", 2)),
        }
        costs: dict[str, list[Cost]] = {name: [] for name in ways}
        outputs = {name: place / f"way-{n}" for n, name in enumerate(ways)}
        for _ in range(1 if quick else REPEATS):
            for name, (work, options) in ways.items():
                shutil.rmtree(outputs[name], ignore_errors=True)
                out = outputs[name]
                costs[name].append(timed(lambda w=work, o=out, a=options: w(recordings, o, *a)))
        single, _, base, _, two = outputs
        killed, cluster = place / "killed", place / "cluster"
        with_a_killed_worker(recordings, killed)
        seconds = on_a_cluster(recordings, cluster, place)
        equal = [same(outputs[single], found) for found in (outputs[two], killed, cluster)]
        first, later = _seconds(outputs[base])
    best = {name: min(found, key=lambda cost: cost.wall) for name, found in costs.items()}
    rows = [
        [name, f"{cost.wall:.1f}", f"{cost.cpu:.1f}", f"{best[base].wall / cost.wall:.2f}"]
        for name, cost in best.items()
    ]
    rows.append(
        ["`--scheduler`, two workers", f"{seconds:.1f}", "-", f"{best[base].wall / seconds:.2f}"]
    )
    header = ["eight recordings", "wall [s]", "CPU [s]", "times as fast"]
    return "\n\n".join(
        [
            "## Many recordings: `python -m benchmarks.batch`",
            f"{machine()}. {RECORDINGS} pieces of data/office, {pairs} pairs each.",
            markdown_table(header, rows),
            f"Asked for: `--jobs 2` at least {ASKED} times as fast as one by one. Processor time "
            f"of two at once: {best[two].cpu / best[base].cpu:.2f} times that of one by one; the "
            f"first recording of a process takes {first:.1f} s, the others {later:.1f} s (median): "
            "libraries and kernels are loaded once.",
            f"With the bytes of `beemap map --threads 1`: {equal[0]} of {RECORDINGS} by `--jobs "
            f"2`, {equal[1]} with a worker killed with SIGKILL in the middle, {equal[2]} on the "
            "cluster.",
        ]
    )


def _seconds(output: Path) -> tuple[float, float]:
    """Of the first recording that one process mapped, and the median of those after it."""
    with (output / "table.csv").open(newline="", encoding="utf-8") as file:
        first, *others = [float(row["seconds"]) for row in csv.DictReader(file)]
    return first, median(others)


if __name__ == "__main__":
    print(main("--quick" in sys.argv))
