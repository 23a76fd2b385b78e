"""Live runs on the virtual rig: latencies, drops, the highest rate, and runs that are killed.

The rig runs in a process of its own beside `beemap live`, its pairs rendered beforehand. `python
-m benchmarks.live --quick` takes a recording of the repository in place of the rendered one.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rendered import cache, rendered
from benchmarks.report import OFFICE
from pipeline.experiments.report import machine, markdown_table
from pipeline.recordings import open_recording

PARTICLES = "mapping.particles=100"
RATE, SECONDS = 10.0, 60.0  # pairs a second, so many seconds of driving
RENDER = ("--size", "640x480", "--rate", f"{RATE:g}", "--duration", f"{SECONDS:g}")
SPEEDS = (1.0, 2.0, 3.0, 4.0, 6.0)
KILLS = 50
HOME = 1.5  # s after which the rig has put its robot back
RESULTS = ("map.npz", "map.pgm", "trajectory.tum", "health.csv")


def command(*words: object) -> list[str]:
    """`beemap` with these arguments as a process."""
    return [sys.executable, "-m", "pipeline.cli", *map(str, words)]


@contextmanager
def rig(folder: Path, recording: Path, speed: float) -> Iterator[Path]:
    """A virtual rig in a process of its own; its rig file."""
    process = subprocess.Popen(
        command("simulate", "rig", recording, "-o", folder, "--speed", speed),
        stdout=subprocess.DEVNULL,
    )
    file = folder / "rig.yaml"
    try:
        while not file.exists():
            if process.poll() is not None:
                raise RuntimeError("the virtual rig ended")
            time.sleep(0.05)
        yield file
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def live(place: Path, recording: Path, speed: float, seconds: float) -> dict[str, Any]:
    """A live run of so many seconds; run.json and the share of the processor used."""
    output = place / f"live-{speed:g}"
    believed = f"odometry.max_speed={1.5 * max(1.0, speed):g}"
    with rig(place / "rig", recording, speed) as file:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.monotonic()
        subprocess.run(
            command(
                "live", file, "-o", output, "--force", "--quiet", "--duration", seconds,
                "--set", PARTICLES, "--set", believed,
            ),
            check=True,
        )  # fmt: skip
        wall = time.monotonic() - begin
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = json.loads((output / "run.json").read_text(encoding="utf-8"))
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**run, "cpu": cpu / wall, "output": output}


def rate_table(runs: dict[float, dict[str, Any]], fps: float) -> str:
    """One line a speed."""
    rows = []
    for speed, run in runs.items():
        lost = sum(run["cameras"][side]["dropped"] for side in ("left", "right"))
        poses, maps = run["pair_to_pose_s"], run["map_to_file_s"]
        pairs = max(1, run["counts"].get("pairs used", 0))
        rows.append(
            [
                f"{fps * speed:g}",
                str(run["recorded"]["pairs"]),
                str(lost + run["cameras"]["lonely"] + run["recorded"]["dropped"]),
                str(run["pairs_skipped"]),
                f"{1000 * poses.get('p95', 0):.0f}",
                f"{1000 * maps.get('p95', 0):.0f}",
                f"{run['cpu']:.2f}",
                *(f"{1000 * run['seconds'].get(s, 0) / pairs:.1f}" for s in STAGES),
            ]
        )
    head = ["pairs/s", "pairs", "lost", "skipped", "pair to pose 95 % [ms]"]
    head += ["local map to file 95 % [ms]", "cores used", *(f"{s} [ms a pair]" for s in STAGES)]
    return markdown_table(head, rows)


STAGES = ("reading", "stereo", "mapping")


def same_offline(run: dict[str, Any]) -> bool:
    """Whether mapping the run's recording gives the same bytes."""
    output: Path = run["output"]
    again = output.with_name(f"{output.name}-offline")
    settings = ("--settings", output / "settings.yaml")
    subprocess.run(
        command("map", output / "recording", "-o", again, "--force", "--quiet", *settings),
        check=True,
    )
    return all((output / n).read_bytes() == (again / n).read_bytes() for n in RESULTS)


def killed(words: Sequence[object], recording: Path, seconds: float) -> float:
    """Kill `beemap words` so many seconds after its first pair; the recording's last seconds that
    are lost. The recording must open."""
    process = subprocess.Popen(command(*words, "--quiet"))
    listed = recording / "mav0" / "cam0" / "data.csv"
    while not listed.exists() or listed.stat().st_size < 100:
        if process.poll() is not None:
            raise RuntimeError(f"beemap {words[0]} ended by itself")
        time.sleep(0.01)
    time.sleep(seconds)
    moment = time.monotonic_ns()
    process.kill()
    process.wait()
    return (moment - open_recording(recording).pairs[-1].stamp) / 1e9


def kills(place: Path, recording: Path, count: int) -> tuple[list[float], list[float], int]:
    """Kill `record`, then `live`, at random moments: the seconds lost in each, and how many
    resumed runs ended with the bytes of an unbroken one."""
    rng = np.random.default_rng(1)
    settings = ("--set", PARTICLES, "--set", "odometry.max_speed=3")
    recorded, mapped, same = [], [], 0
    with rig(place / "rig", recording, 2.0) as file:
        for number in range(count):
            folder = place / f"recorded-{number}"
            seconds = rng.uniform(0.0, 6.0)
            recorded.append(killed(("record", file, "-o", folder), folder, seconds))
            time.sleep(HOME)
        for number in range(count):
            output = place / f"killed-{number}"
            words = ("live", file, "-o", output, *settings)
            seconds = rng.uniform(0.0, 12.0)
            mapped.append(killed(words, output / "recording", seconds))
            whole = place / "whole"
            words = ("map", output / "recording", "-o", whole, "--force", "--quiet")
            subprocess.run(command(*words, *settings), check=True)
            subprocess.run(command("map", "--resume", output, "--quiet"), check=True)
            same += all((output / n).read_bytes() == (whole / n).read_bytes() for n in RESULTS)
            time.sleep(HOME)
    return recorded, mapped, same


def main(quick: bool = False) -> str:
    """Measure; the section as Markdown."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        recording, fps, seconds = OFFICE, 2.0, 12.0
        if not quick:
            fps, seconds = RATE, SECONDS
            recording = rendered(cache() or place, "office", RENDER).path
        speeds = SPEEDS[:2] if quick else SPEEDS
        runs = {s: live(place, recording, s, seconds / s) for s in speeds}
        first = runs[1.0]
        alike = same_offline(first)
        count = 2 if quick else KILLS
        recorded, mapped, same = kills(place, recording, count)
    return "\n\n".join(
        [
            "## Live: `python -m benchmarks.live`",
            f"{machine()}. The virtual rig beside `beemap live` on {os.cpu_count()} cores, 100 "
            "particles; recording, mapping and saving at once. Higher rates are the same drive, "
            "driven faster: more observations are due, too.",
            rate_table(runs, fps),
            f"At {fps:g} pairs a second mapping the recording offline gave "
            f"{'the same bytes' if alike else 'other bytes'} "
            f"({first['pairs_skipped']} pairs were skipped live).",
            f"Killed with `kill -9` at {count} random moments of `record` and {count} of `live`, "
            f"{2 * fps:g} pairs a second: every recording opened, at most "
            f"{max(recorded):.2f} and {max(mapped):.2f} s were lost (median "
            f"{np.median(recorded):.2f}, {np.median(mapped):.2f}); `map --resume` ended with the "
            f"bytes of an unbroken run in {same} of {count}.",
        ]
    )


if __name__ == "__main__":
    print(main("--quick" in sys.argv))
