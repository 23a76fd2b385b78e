"""A folder of runs that a killed experiment goes on with.

`rows.csv` gets one line per finished run, at once. A line is used again when its key, a digest of
all that decides the run, is wanted again; lines of other settings or of other source are kept
and not used.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from pipeline.experiments.spec import Result, RunSpec
from pipeline.new_files import new_files
from pipeline.progress import progress_bar
from pipeline.tasks.runner import Workers, task_runner
from pipeline.tasks.task import Failure

ROWS = "rows.csv"
# What a run was; `mapping`: all settings of the mapper in one text.
SPEC_COLUMNS = (
    "key",
    "preset",
    "varied",
    "method",
    "world",
    "route",
    "seed",
    "alpha",
    "blocks",
    "false_depth",
    "positions",
    "particles",
    "sigma",
    "threads",
    "mapping",
)
COLUMNS = (*SPEC_COLUMNS, *Result.__struct_fields__)


@dataclass(frozen=True)
class Run:
    """A run that was wanted and its result."""

    spec: RunSpec
    result: Result


@dataclass
class Batch:
    """runs: in the plan's order, without those that failed; failures: one line each; notes: what
    a user should know of the folder, one line each."""

    runs: list[Run] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


class InterruptedBatchError(Exception):
    """Ctrl-C: `done` of `total` runs are in the folder."""

    def __init__(self, done: int, total: int):
        super().__init__(f"{done} of {total} runs")
        self.done, self.total = done, total


def run_batch(
    plan: Sequence[RunSpec],
    folder: Path,
    work: Callable[[tuple[RunSpec, Path]], Result],
    workers: Workers,
    quiet: bool = False,
) -> Batch:
    """Do all runs of the plan that `folder` does not hold yet.

    Runs that differ in name only are done once.

    Raises:
        InputError: the workers of a cluster are not fit for it, or were lost.
        InterruptedBatchError: Ctrl-C; what was done is kept.
    """
    wanted: dict[str, RunSpec] = {}
    for spec in plan:
        wanted.setdefault(spec.key, spec)
    file = folder / ROWS
    lines, damaged = _read(file)
    foreign = {key: line for key, line in lines.items() if key not in wanted}
    done = {key: _result(line) for key, line in lines.items() if key in wanted}
    batch = Batch(notes=_notes(len(done), damaged, len(foreign)))
    # Also mends a last line that was cut short: the next one must not be joined to it.
    _rewrite(file, list(lines.values()))

    missing = [
        (_anywhere(spec), folder.resolve()) for key, spec in wanted.items() if key not in done
    ]
    threads = max((spec.threads for spec, _ in missing), default=1)
    try:
        with (
            task_runner(workers, _files(folder, missing)) as run_tasks,
            progress_bar("runs", "runs", quiet) as progress,
            file.open("a", encoding="utf-8", newline="") as rows,
            closing(run_tasks(missing, work, threads)) as results,
        ):
            progress(len(done), len(wanted))
            for (sent, _), result in results:
                spec = wanted[sent.key]
                if isinstance(result, Failure):
                    batch.failures.append(f"{spec}: {result.reason}")
                else:
                    line = _line(spec, result)
                    rows.write(_csv([line]))
                    rows.flush()
                    lines[spec.key] = line
                    done[spec.key] = _result(line)
                progress(len(done) + len(batch.failures), len(wanted))
    except KeyboardInterrupt:
        raise InterruptedBatchError(len(done), len(wanted)) from None
    _rewrite(file, [lines[key] for key in (*wanted, *foreign) if key in lines])
    batch.runs = [Run(spec, done[spec.key]) for spec in plan if spec.key in done]
    return batch


def _anywhere(spec: RunSpec) -> RunSpec:
    """The run with paths that hold in any working directory; its key stays the same."""
    paths = {
        name: str(Path(value).resolve())
        for name in ("world", "route")
        if (value := getattr(spec, name)) is not None and Path(value).is_file()
    }
    return msgspec.structs.replace(spec, **paths)


def _files(folder: Path, tasks: Sequence[tuple[RunSpec, Path]]) -> list[Path]:
    """What a worker must see to do the tasks."""
    named = {Path(name) for spec, _ in tasks for name in (spec.world, spec.route) if name}
    return [folder.resolve(), *sorted(file for file in named if file.is_file())]


def _notes(reused: int, damaged: int, foreign: int) -> list[str]:
    """What was found in a folder that was begun."""
    return [
        text
        for number, text in (
            (reused, f"{reused} runs were done already"),
            (damaged, f"{ROWS}: {damaged} damaged lines are measured again"),
            (foreign, f"{ROWS}: {foreign} lines of other settings or another beemap are not used"),
        )
        if number
    ]


def _line(spec: RunSpec, result: Result) -> dict[str, str]:
    """A run as text; numbers with six digits."""
    mapping = msgspec.to_builtins(spec.mapping)
    facts: dict[str, Any] = {
        **{name: getattr(spec, name) for name in SPEC_COLUMNS if hasattr(spec, name)},
        "particles": spec.mapping.particles,
        "mapping": "; ".join(f"{name}={value}" for name, value in mapping.items()),
        **msgspec.to_builtins(result),
    }
    return {name: _text(facts[name]) for name in COLUMNS}


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)


def _result(line: dict[str, str]) -> Result:
    """Raises ValueError when a field is no number."""
    types = {field.name: field.type for field in msgspec.structs.fields(Result)}
    return Result(**{name: types[name](line[name]) for name in types})


def _read(file: Path) -> tuple[dict[str, dict[str, str]], int]:
    """The lines of an earlier call by their keys, and how many were damaged."""
    if not file.exists():
        return {}, 0
    # What follows the last line end was cut short.
    text, _, rest = file.read_text(encoding="utf-8", errors="replace").rpartition("\n")
    lines: dict[str, dict[str, str]] = {}
    damaged = int(bool(rest))
    for line in csv.DictReader(text.splitlines()):
        try:
            _result(line)
            whole = None not in line and set(line) == set(COLUMNS)
        except (KeyError, TypeError, ValueError):
            whole = False
        if whole:
            lines[line["key"]] = line
        else:
            damaged += 1
    return lines, damaged


def _rewrite(file: Path, lines: list[dict[str, str]]) -> None:
    with new_files([file], force=True) as partial:
        text = ",".join(COLUMNS) + "\n" + _csv(lines)
        (partial / file.name).write_text(text, encoding="utf-8", newline="")


def _csv(lines: list[dict[str, str]]) -> str:
    text = io.StringIO()
    csv.DictWriter(text, COLUMNS, lineterminator="\n").writerows(lines)
    return text.getvalue()
