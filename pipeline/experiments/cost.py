"""How cost grows: time and memory against N, the map's area and the length of the run; threads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calibration.yamlfile import dump_yaml
from pipeline.experiments import style
from pipeline.experiments.batch import Batch, Run, run_batch
from pipeline.experiments.measure import measure
from pipeline.experiments.options import POSITIONS, SPACING, Options
from pipeline.experiments.presets import HIERARCHICAL, METHOD_NAMES, METHODS, OURS, PAPER, Preset
from pipeline.experiments.report import markdown_table, number_of, write_table
from pipeline.experiments.spec import RunSpec
from pipeline.experiments.summary import grouped, of

SEEDS = 3
NUMBERS = (10, 30, 100, 300, 1000, 3000, 10_000)
MOST_PER_SCAN = 1000  # particles of the previous method
PARTICLES = 100
# Square halls of pillars for area and length: sides [m], positions.
SIDES = (6, 9, 12, 18, 27, 36)
LENGTHS = (100, 200, 400, POSITIONS, 1570, 3140)
LENGTH_SIDE = 18
FILLET = 0.5
THREADS_AT = 1000

# What is asked for: in words, settings and N of the hierarchical method, the result.
TARGETS = (
    ("raw ego-motion, N = 100: CPU <= 0.30 s", PAPER, 100, "cpu_s"),
    ("raw ego-motion, N = 1000: CPU <= 2.5 s", PAPER, 1000, "cpu_s"),
    ("matched ego-motion, N = 30: CPU <= 0.35 s", OURS, 30, "cpu_s"),
    ("raw ego-motion, N = 1000: maps <= 40 MB", PAPER, 1000, "maps_mb"),
    ("matched ego-motion, N = 1000: maps <= 40 MB", OURS, 1000, "maps_mb"),
)
HEADER = ("run", "runs", "CPU [s]", "wall [s]", "maps [MB]", "known [m2]", "path [m]")


def plan(options: Options) -> list[RunSpec]:
    """Maps are not compared: only cost counts."""
    longest = {LENGTH_SIDE: LENGTHS[-1]}
    halls = {
        side: str(hall_file(options.folder, side, longest.get(side, POSITIONS))) for side in SIDES
    }
    kinds: list[tuple[str, int, Preset, dict[str, Any]]] = [
        *(("N", N, preset, {}) for preset in (PAPER, OURS) for N in NUMBERS),
        *(
            (f"side {side} m", PARTICLES, PAPER, {"world": hall, "route": None})
            for side, hall in halls.items()
        ),
        *(
            (
                f"{positions} positions",
                PARTICLES,
                PAPER,
                {"world": halls[LENGTH_SIDE], "route": None, "positions": positions},
            )
            for positions in LENGTHS
        ),
        *((f"{n} threads", THREADS_AT, PAPER, {"threads": n}) for n in (1, 2)),
    ]
    return [
        options.spec(
            preset,
            seed,
            *method,
            f"mapping.particles={N}",
            varied=varied,
            score_map=False,
            **simulated,
        )
        for seed in options.seed_range()
        for varied, N, preset, simulated in kinds
        for method in METHODS
        if method == HIERARCHICAL or N <= MOST_PER_SCAN
    ]


def run(options: Options) -> Batch:
    """Do the runs, draw `cost.png`, write `table.md`."""
    batch = run_batch(plan(options), options.folder, measure, options.workers, options.quiet)
    groups = grouped(
        batch.runs,
        lambda spec: (spec.varied, spec.preset, spec.method, spec.mapping.particles),
    )
    _draw(groups, options)
    rows = [
        _row(
            f"{preset}, {METHOD_NAMES[method]}, N = {N}" + (f", {varied}" if varied != "N" else ""),
            runs,
        )
        for (varied, preset, method, N), runs in groups.items()
    ]
    text = (
        "Medians over the runs; time of mapping alone, one thread unless the line says otherwise; "
        "maps: the most memory of all particles' maps together. Area and length: halls of "
        f"pillars, N = {PARTICLES}, the paper's settings.\n\n"
        f"{_targets(groups)}\n\n{_threads(groups)}\n\n{markdown_table(HEADER, rows)}\n\n"
        "![Cost](cost.png)"
    )
    write_table(options.folder, "How cost grows", text, batch.failures, legend=False)
    return batch


def hall_file(folder: Path, side: int, positions: int) -> Path:
    """A world file of a square hall of `side` m with pillars every 3 m, and a route that goes
    round it 1.5 m from the walls until there is room for so many positions of 200 mm."""
    far = side - 1.5
    shortest_lap = 4.0 * (side - 3.0) - 4.0 * FILLET
    rounds = math.ceil(SPACING * positions / shortest_lap) + 1
    corners = [[1.5, 1.5], [far, 1.5], [far, far], [1.5, far]]
    walls = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side], [0.0, 0.0]]
    pillars = [[x, y] for x in range(3, side - 2, 3) for y in range(3, side - 2, 3)]
    sheet = {
        "beemap_world": 1,
        "size": [float(side), float(side)],
        "walls": [{"from": a, "to": b, "thickness": 0.3} for a, b in itertools.pairwise(walls)],
        "furniture": {"pillar": {"size": [0.5, 0.5], "at": pillars}},
        "route": {"waypoints": corners * rounds, "fillet": FILLET},
    }
    place = folder / "worlds"
    place.mkdir(exist_ok=True)
    file = place / f"hall-{side}m.yaml"
    file.write_text(dump_yaml(sheet), encoding="utf-8")
    return file


def _row(name: str, runs: Sequence[Run]) -> list[str]:
    digits = {"cpu_s": 2, "wall_s": 2, "maps_mb": 1, "known_m2": 0, "travelled_m": 0}
    medians = [number_of(of(runs, field).median, n) for field, n in digits.items()]
    return [name, str(len(runs)), *medians]


def _targets(groups: dict) -> str:
    """What is asked for, and what was found."""
    lines = []
    for text, preset, N, field in TARGETS:
        runs = groups.get(("N", preset.name, "hierarchical", N), [])
        lines.append([f"hierarchical, {text}", number_of(of(runs, field).median, 2)])
    return markdown_table(("to reach", "found"), lines)


def _threads(groups: dict) -> str:
    """How much faster two threads are."""
    facts = []
    for method, name in METHOD_NAMES.items():
        one, two = (groups.get((f"{n} threads", PAPER.name, method, THREADS_AT)) for n in (1, 2))
        if one and two:
            gain = of(one, "wall_s").median / of(two, "wall_s").median
            facts.append(f"{name} {gain:.2f} times")
    return (
        f"Two threads against one at N = {THREADS_AT}, wall time (to reach: 1.7 times): "
        f"{', '.join(facts)}."
    )


def _draw(groups: dict, options: Options) -> None:
    """Time above, memory below; against N, area and length."""
    drawn, axes = style.figure(2, 3, (14.0, 8.0), sharex="col")
    for column, x_name in enumerate(("N", "area", "length")):
        for preset in (PAPER, OURS) if x_name == "N" else (PAPER,):
            for method in METHOD_NAMES:
                points = _points(groups, x_name, preset.name, method)
                look = {"linestyle": "-" if preset is PAPER else "--"}
                for row, field in enumerate(("cpu_s", "maps_mb")):
                    style.curve(axes[row, column], method, *points, field, **look)
                    if preset is not PAPER:
                        line = axes[row, column].lines[-1]
                        line.set_label(f"{line.get_label()}, matched ego-motion")
    for panel, title in zip(axes[0], ("particles", "area", "length of the run"), strict=True):
        panel.set_title(f"against {title}")
    for panel in axes[:, 0]:
        style.logarithmic(panel, "x")
        style.logarithmic(panel, "y")
    for panel, label in zip(
        axes[1], ("particles N", f"known area [m2], N = {PARTICLES}", f"path [m], N = {PARTICLES}"),
        strict=True,
    ):  # fmt: skip
        panel.set_xlabel(label)
    axes[0, 0].set_ylabel("CPU time of mapping [s]")
    axes[1, 0].set_ylabel("memory of all maps [MB]")
    style.finish(drawn, axes[:, 1:].flat, axes[0, 0])
    drawn.suptitle("How cost grows: one thread, median and quartiles")
    style.save(drawn, options.folder / "cost.png")


def _points(
    groups: dict, x_name: str, preset: str, method: str
) -> tuple[list[float], list[list[Run]]]:
    """x and the runs there of one curve."""
    if x_name == "N":
        found = [(float(N), groups.get(("N", preset, method, N))) for N in NUMBERS]
    else:
        field = "known_m2" if x_name == "area" else "travelled_m"
        names = (
            [f"side {side} m" for side in SIDES]
            if x_name == "area"
            else [f"{positions} positions" for positions in LENGTHS]
        )
        sets = [groups.get((name, preset, method, PARTICLES)) for name in names]
        found = [(of(runs, field).median, runs) for runs in sets if runs]
    known = sorted(((x, runs) for x, runs in found if runs), key=lambda point: point[0])
    return [x for x, _ in known], [runs for _, runs in known]
