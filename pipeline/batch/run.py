"""All recordings of a batch, by several workers, gone on with where an earlier call ended."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.batch.inputs import Input
from pipeline.batch.map_task import MapTask, map_into
from pipeline.batch.rows import Row, mapped_row
from pipeline.map_request import MapRequest
from pipeline.progress import progress_bar
from pipeline.tasks.folder import claimed
from pipeline.tasks.runner import Workers, task_runner
from pipeline.tasks.task import Failure


@dataclass(frozen=True)
class Wanted:
    """How every recording is mapped: options of `beemap map`, with absolute paths."""

    rig: Path | None = None
    motion: str | None = None
    fps: float | None = None
    seed: int = 1
    settings: Path | None = None
    overrides: tuple[str, ...] = ()

    def task(self, given: Input, output: Path, claim: Path) -> MapTask:
        """To map one recording into its folder in `output`."""
        rig = str(self.rig) if self.rig else None
        request = MapRequest(str(given.path), rig, self.motion, self.fps, self.seed)
        return MapTask(request, output / given.name, claim, self.settings, self.overrides)

    @property
    def files(self) -> list[Path]:
        """Files that a worker must see."""
        poses = (self.motion or "").partition(":")[2]
        return [f for f in (self.rig, self.settings, Path(poses) if poses else None) if f]


@dataclass
class Outcome:
    """rows: of all recordings, in their order; reused: results that stood there already."""

    rows: list[Row] = field(default_factory=list)
    reused: int = 0
    interrupted: bool = False


def run_batch(
    inputs: Sequence[Input],
    wanted: Wanted,
    output: Path,
    workers: Workers,
    threads: int | None = None,
    quiet: bool = False,
) -> Outcome:
    """Map all recordings that `output` (absolute) does not hold yet. Ctrl-C ends it early.

    Raises:
        InputError: the workers of a cluster are not fit for it, or were lost.
    """
    results: dict[str, bool | Failure] = {}
    shares = {given.name: 0.0 for given in inputs}
    outcome = Outcome()
    try:
        with claimed(output) as claim:
            tasks = [wanted.task(given, output, claim) for given in inputs]
            must_see = [claim, *wanted.files, *(given.path for given in inputs)]
            with (
                task_runner(workers, must_see) as run_tasks,
                progress_bar("recordings", "recordings", quiet) as progress,
            ):

                def told(task: MapTask, share: float) -> None:
                    # What was told on the way may arrive late.
                    shares[task.output.name] = 1.0 if task.output.name in results else share
                    progress(sum(shares.values()), len(tasks))

                progress(0, len(tasks))
                with closing(run_tasks(tasks, map_into, threads, told)) as done:
                    for task, result in done:
                        results[task.output.name] = result
                        told(task, 1.0)
    except KeyboardInterrupt:
        outcome.interrupted = True
    outcome.reused = sum(result is False for result in results.values())
    outcome.rows = [_row(given, output, results.get(given.name)) for given in inputs]
    return outcome


def _row(given: Input, output: Path, result: bool | Failure | None) -> Row:
    if result is None:
        return Row(str(given.path), given.name, "not done")
    if isinstance(result, Failure):
        return Row(str(given.path), given.name, "failed", result.reason)
    return mapped_row(given, output / given.name)


def failures(rows: Sequence[Row]) -> list[Row]:
    """Those without a map."""
    return [row for row in rows if row.state == "failed"]
