"""The live page: processor time of its server, age of the pictures, and whether the run is harmed.

`beemap live --web` on the virtual rig, with nobody, one and five looking. `python -m benchmarks.web
--quick` takes a recording of the repository in place of the rendered one.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from benchmarks.live import PARTICLES, RENDER, RESULTS, command, rig, same_offline
from benchmarks.rendered import cache, rendered
from benchmarks.report import OFFICE
from pipeline.experiments.report import machine, markdown_table

VIEWERS = (0, 1, 5)
SECONDS = 30.0
SETTLED = 3.0  # s after the first picture
WATCH = "--watch"  # this module runs `beemap` and writes down what its threads use


def watched(file: str, words: list[str]) -> None:
    """Run `beemap` with these words; write the processor time of the page's thread and of the
    whole process to `file`, a line every 0.2 s."""
    from pipeline.cli import main

    def look() -> None:
        with open(file, "w", encoding="ascii", buffering=1) as lines:
            while True:
                for thread in threading.enumerate():
                    if thread.name == "web" and thread.native_id:
                        used = _thread_seconds(thread.native_id)
                        lines.write(f"{time.monotonic()} {used} {time.process_time()}\n")
                time.sleep(0.2)

    threading.Thread(target=look, daemon=True).start()
    sys.argv = ["beemap", *words]
    main()


def _thread_seconds(thread: int) -> float:
    stat = Path(f"/proc/self/task/{thread}/schedstat").read_text(encoding="ascii")
    return int(stat.split()[0]) / 1e9


class Viewer(threading.Thread):
    """Looks at the page as its script does; ages: of the pictures as they came [s]."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self.url = url
        self.ages: list[float] = []
        self.sizes: Counter[str] = Counter()
        self.first = self.last = 0.0

    def run(self) -> None:
        """Until the run ends."""
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.client import connect

        from pipeline.web.messages import unpacked

        place = urlsplit(self.url).netloc
        address, origin = f"ws://{place}/live", f"http://{place}"
        with connect(address, origin=origin, max_size=None, compression=None) as socket:  # type: ignore[arg-type]
            try:
                while True:
                    data = socket.recv()
                    now = time.monotonic_ns()
                    socket.send('{"do":"seen"}')
                    for message in unpacked(bytes(data)):  # type: ignore[arg-type]
                        self.sizes[message.topic] += len(message.packed())
                        if message.topic == "picture" and message.values["columns"]:
                            self.first = self.first or now / 1e9
                            self.last = now / 1e9
                            self.ages.append((now - message.values["stamp"]) / 1e9)
            except ConnectionClosed:
                return


def live(place: Path, file: Path, viewers: int, seconds: float) -> dict[str, Any]:
    """A live run with so many viewers: run.json, and what was measured beside it."""
    output, used = place / f"web-{viewers}", place / f"used-{viewers}"
    words = command(
        "live", file, "-o", output, "--force", "--quiet", "--duration", seconds,
        "--set", PARTICLES, "--web", "--port", 0,
    )  # fmt: skip
    words = [sys.executable, "-m", "benchmarks.web", WATCH, str(used), *words[3:]]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    found = next(m for line in process.stderr if (m := re.match(r"page: (\S+)", line)))
    watching = [Viewer(found[1]) for _ in range(viewers)]
    for viewer in watching:
        viewer.start()
    if process.wait():
        raise RuntimeError(process.stderr.read())
    for viewer in watching:
        viewer.join()
    run = json.loads((output / "run.json").read_text(encoding="utf-8"))
    table = np.loadtxt(used)
    begin = max((v.first for v in watching), default=table[0, 0] + 5.0) + SETTLED
    end = min((v.last for v in watching), default=table[-1, 0])
    within = table[(table[:, 0] >= begin) & (table[:, 0] <= end)]
    wall, server, whole = within[-1] - within[0]
    return {
        **run,
        "output": output,
        "server": server / wall,
        "process": whole / wall,
        "ages": [age for viewer in watching for age in viewer.ages],
        "rate": np.mean([len(v.ages) / (v.last - v.first) for v in watching]) if viewers else 0,
        "bytes": np.mean([v.sizes.total() / (v.last - v.first) for v in watching])
        if viewers
        else 0,
    }


def table(runs: dict[int, dict[str, Any]]) -> str:
    """One line for each number of viewers."""
    rows = []
    for viewers, run in runs.items():
        ages, poses = run["ages"], run["pair_to_pose_s"]
        middle, most = np.quantile(ages, [0.5, 0.95]) if ages else (0.0, 0.0)
        rows.append(
            [
                str(viewers),
                f"{100 * run['server']:.1f} %",
                f"{run['process']:.2f}",
                f"{run['rate']:.1f}" if ages else "-",
                f"{middle:.2f}, {most:.2f}, {max(ages):.2f}" if ages else "-",
                f"{run['bytes'] / 1e3:.0f}" if ages else "-",
                str(run["pairs_skipped"]),
                f"{1000 * poses['p95']:.0f}",
            ]
        )
    head = ["viewers", "server, of one core", "cores of the run", "pictures/s"]
    head += ["age of a picture as it comes: median, 95 %, most [s]", "kB/s each"]
    return markdown_table([*head, "pairs skipped", "pair to pose 95 % [ms]"], rows)


def main(quick: bool = False) -> str:
    """Measure; the section as Markdown."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        recording = OFFICE if quick else rendered(cache() or place, "office", RENDER).path
        runs = {}
        for viewers in VIEWERS:
            # A new rig each: its robot stands at the start.
            with rig(place / f"rig-{viewers}", recording, 1.0) as file:
                runs[viewers] = live(place, file, viewers, 15.0 if quick else SECONDS)
        alike = [same_offline(run) for run in runs.values()]
    return "\n\n".join(
        [
            "## The live page: `python -m benchmarks.web`",
            f"{machine()}. `beemap live --web` on the virtual rig, 10 pairs of 640x480 a second, "
            "100 particles, with so many viewers on the same machine. The server's share is the "
            "processor time of its thread, encoding included.",
            table(runs),
            f"Mapping the recordings offline, without a page, gave the same bytes "
            f"({', '.join(RESULTS)}) in {sum(alike)} of {len(alike)} runs.",
        ]
    )


if __name__ == "__main__":
    if WATCH in sys.argv:
        watched(sys.argv[2], sys.argv[3:])
    else:
        print(main("--quick" in sys.argv))
