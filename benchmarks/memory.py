"""Peak memory of `beemap map` over a long run, all results written.

`python -m benchmarks.memory [METRES]` drives the route of a rendered recording (640x480) again and
again, each time from where it ended, until the path has that length (1000 m). The images are those
of the one drive; the ticks count on. What is written is a recording like any other, whose lists
name each image many times.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rendered import cache, missing, rendered
from benchmarks.report import map_recording
from pipeline.experiments.report import machine, markdown_table
from pipeline.recordings.base import Recording
from pipeline.trajectory import distance_travelled

TITLE = "## Memory of a long run"
METRES = 1000.0
DRIVE = ("--duration", "180", "--rate", "2", "--seed", "1")
MOTION = ("--motion", "encoders")
LIMIT_MB = 700


def lengthened(recording: Recording, target: Path, metres: float) -> float:
    """Write `recording` (EuRoC/ASL, rendered) driven again and again; the metres of its path."""
    assert recording.poses is not None
    once = float(distance_travelled(recording.poses.poses)[-1])
    times = max(1, round(metres / once))
    source = recording.path / "mav0"
    for camera in ("cam0", "cam1"):
        folder = target / "mav0" / camera
        folder.mkdir(parents=True)
        (folder / "data").symlink_to((source / camera / "data").resolve())
        (folder / "sensor.yaml").symlink_to((source / camera / "sensor.yaml").resolve())
        rows = _rows(source / camera / "data.csv")
        period = rows[-1][0] - rows[0][0] + (rows[1][0] - rows[0][0])
        _write(
            folder / "data.csv",
            [(stamp + k * period, *rest) for k in range(times) for stamp, *rest in rows],
        )
    wheels = target / "mav0" / "odom0"
    wheels.mkdir()
    (wheels / "sensor.yaml").symlink_to((source / "odom0" / "sensor.yaml").resolve())
    ticks = np.array([[int(v) for v in row] for row in _rows(source / "odom0" / "data.csv")])
    ticks = ticks[ticks[:, 0] < ticks[0, 0] + period]
    assert recording.encoders is not None
    modulus = 2**recording.encoders.counter_bits
    steps = np.vstack([[0, 0], np.diff(ticks[:, 1:], axis=0)])
    steps = (steps + modulus // 2) % modulus - modulus // 2
    counts = ticks[0, 1:] + np.cumsum(np.tile(steps, (times, 1)), axis=0)
    stamps = (ticks[:, 0] + period * np.arange(times)[:, None]).ravel()
    _write(wheels / "data.csv", np.column_stack([stamps, counts % modulus]).tolist())
    return times * once


def measure(metres: float) -> dict[str, Any]:
    """run.json of a run over about so many metres, with `metres` and `result_mb` added."""
    folder = cache()
    assert folder is not None
    recording = rendered(folder, "office", DRIVE)
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        driven = lengthened(recording, place / "rec", metres)
        run = map_recording(place / "rec", place / "run", *MOTION)
        size = sum(f.stat().st_size for f in (place / "run").iterdir())
    return {**run, "metres": driven, "result_mb": size / 1e6}


def main(metres: float = METRES) -> str:
    """The section of the report."""
    if cache() is None:
        return missing(TITLE)
    runs = [measure(length) for length in (0.1 * metres, metres)]
    rows = [
        [
            f"{run['metres']:.0f}",
            str(run["counts"]["pairs used"]),
            str(run["local_maps"]),
            f"{run['known_m2']:.0f}",
            f"{run['result_mb']:.0f}",
            f"{run['peak_memory_mb']:.0f}",
        ]
        for run in runs
    ]
    header = ["path [m]", "pairs", "local maps", "mapped [m2]", "results [MB]", "peak [MB]"]
    return "\n\n".join(
        [
            TITLE,
            f"`python -m benchmarks.memory {metres:g}`; {machine()}. The route of the rendered "
            "office at 640x480, two pairs a second, driven again from where it ended; "
            f"`beemap map {' '.join(MOTION)}`, all results written. The limit is {LIMIT_MB} MB "
            "for a kilometre.",
            markdown_table(header, rows),
        ]
    )


def _rows(file: Path) -> list[list[Any]]:
    with file.open(encoding="ascii") as opened:
        rows = [row for row in csv.reader(opened) if row and not row[0].startswith("#")]
    return [[int(row[0]), *row[1:]] for row in rows]


def _write(file: Path, rows: list[Any]) -> None:
    text = "".join(",".join(map(str, row)) + "\n" for row in rows)
    file.write_text("#timestamp [ns],...\n" + text, encoding="ascii")


if __name__ == "__main__":
    print(main(*(float(word) for word in sys.argv[1:])))
