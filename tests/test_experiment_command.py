"""`beemap experiment`: tables and figures of every experiment, on a tiny world."""

from __future__ import annotations

import csv
import importlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.experiments import office
from pipeline.experiments.batch import Batch, Run
from pipeline.experiments.spec import Result
from pipeline.map_files import read_map
from tests.experiment_runs import options, result, tiny_world
from tests.test_structure import loaded_by

FIGURES = {
    "quality": [
        "quality-ours-alpha.png",
        "quality-ours-blocks.png",
        "quality-paper-alpha.png",
        "quality-paper-blocks.png",
    ],
    "readings": ["readings.png"],
    "cost": ["cost.png"],
}


@pytest.fixture
def world(tmp_path) -> Path:
    return tiny_world(tmp_path)


def figures(folder: Path) -> list[str]:
    """Names of the figures, which must be readable and not blank."""
    for file in folder.glob("*.png"):
        image = cv2.imread(str(file))
        assert image is not None
        assert image.std() > 5.0, file
    return sorted(file.name for file in folder.glob("*.png"))


def test_real_runs_from_the_command_line_are_gone_on_with(beemap, world, tmp_path):
    out = tmp_path / "out"
    arguments = ["experiment", "particles", "-o", out, "--seeds", 1, "--world", world]
    # All N are set to 3: the plan's 20 runs are four different ones.
    arguments += ["--set", "mapping.particles=3"]
    first = beemap(*arguments)
    assert first.code == 0, first.err
    assert first.out == f"results: {out}/ (table.md, particles-ours.png, particles-paper.png)\n"
    with (out / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["preset"], row["method"]) for row in rows] == [
        ("paper", "hierarchical"),
        ("paper", "per-scan"),
        ("ours", "hierarchical"),
        ("ours", "per-scan"),
    ]
    for row in rows:
        assert row["particles"] == "3"
        assert 0.0 < float(row["ate"]) < 1.0
        assert float(row["E_own"]) > 0.0
        assert float(row["cpu_s"]) > 0.0
    assert figures(out) == ["particles-ours.png", "particles-paper.png"]
    table = (out / "table.md").read_text()
    assert f"`beemap experiment particles -o {out} --seeds 1 --world {world}" in table
    assert "| previous method, N = 3 | 5 |" in table

    again = beemap(*arguments)
    assert "note: 4 runs were done already" in again.err
    assert (out / "table.md").read_text() == table


def test_failed_runs_are_named_and_counted(beemap, world, tmp_path, monkeypatch):
    from pipeline.experiments import particles

    def one_failed(plan, *_):
        return Batch([Run(spec, made_up(spec)) for spec in plan[1:]], [f"{plan[0]}: it broke"])

    monkeypatch.setattr(particles, "run_batch", one_failed)
    out = tmp_path / "out"
    done = beemap("experiment", "particles", "-o", out, "--seeds", 2, "--world", world, "--quiet")
    assert done.code == 1
    assert done.err.startswith("beemap: failed: paper hierarchical, N=10, ")
    table = (out / "table.md").read_text()
    assert "**1 runs failed**" in table
    assert "| hierarchical, N = 10 | 1 |" in table  # the other seed
    assert "| hierarchical, N = 30 | 2 |" in table


def made_up(spec) -> Result:
    """A result that tells where it belongs: ATE by the method and the seed."""
    ate = (0.1 if spec.method == "hierarchical" else 1.1) + 0.01 * spec.seed
    return result(
        ate=ate,
        lost=int(ate > 1.0),
        E=1000.0 + spec.alpha,
        cpu_s=0.5 if spec.method == "hierarchical" else 2.0,
        wall_s=1.0 / spec.threads,
        maps_mb=0.01 * spec.mapping.particles,
        known_m2=100.0,
        travelled_m=0.2 * spec.positions,
        nees=" ".join(["2.0"] * 6 + ["50"] * 2),
    )


@pytest.mark.parametrize("name", FIGURES)
def test_every_experiment_reports_its_runs(name, world, tmp_path, monkeypatch):
    module = importlib.import_module(f"pipeline.experiments.{name}")
    monkeypatch.setattr(
        module, "run_batch", lambda plan, *_: Batch([Run(spec, made_up(spec)) for spec in plan])
    )
    if name == "quality":
        monkeypatch.setattr(module, "PANELS", module.PANELS[:2])  # the others are alike
    module.run(options(tmp_path, world, 3))
    assert figures(tmp_path) == FIGURES[name]
    table = (tmp_path / "table.md").read_text()
    if name == "cost":
        assert "| hierarchical, raw ego-motion, N = 1000: maps <= 40 MB | 10.00 |" in table
        assert "hierarchical 2.00 times, previous method 2.00 times." in table
        assert "| paper, hierarchical, N = 10000 | 3 | 0.50 | 1.00 | 100.0 | 100 | 8 |" in table
        assert "| paper, hierarchical, N = 100, 3140 positions |" in table
    else:
        assert "| 3 | 0.120 | 0.120 | 0.13 | 0 (0.0 to 56.1 %) |" in table
        assert "| 3 | 1.120 | 1.120 | 1.13 | 3 (43.9 to 100.0 %) |" in table


def test_the_table_says_how_the_methods_compare(world, tmp_path, monkeypatch):
    from pipeline.experiments import table

    plan = table.plan(options(tmp_path, world, 500))
    runs = {case.name: 0 for case in table.CASES}
    for spec in plan:
        runs[spec.varied.partition(":")[0]] += spec.method == "hierarchical"
    assert list(runs.values()) == [200, 48, 48, 48, 48, 24]
    assert sum("matched proposal" in spec.varied for spec in plan) == 3 * 3
    monkeypatch.setattr(
        table, "run_batch", lambda plan, *_: Batch([Run(spec, made_up(spec)) for spec in plan])
    )
    table.run(options(tmp_path, world, 30))
    assert figures(tmp_path) == ["consistency.png", "path-error.png"]
    text = (tmp_path / "table.md").read_text()
    assert "CPU time of the previous method: 4.0 times as much." in text
    assert "Hierarchical, loss rate: at most 11.4 % (95 %)." in text
    # Six of eight closings at NEES 2, two at 50: for the mean of 24 or 30 runs 2 is too little.
    assert "| 24 | 2.0 | 75 % | 75 % | 0 % | 75 % |" in text


def test_maps_are_drawn_beside_the_ideal_ones(world, tmp_path, monkeypatch):
    from pipeline.experiments import maps

    monkeypatch.setattr(maps, "PRESETS", maps.PRESETS[:1])
    monkeypatch.setattr(maps, "ALPHAS", (0.0,))
    monkeypatch.setattr(maps, "FALSE_DEPTHS", ("nearest",))
    batch = maps.run(options(tmp_path, world, 1, "mapping.particles=2"))
    assert len(batch.runs) == 2
    assert figures(tmp_path) == ["maps-paper-nearest-1.png"]
    for run in batch.runs:
        known = ~np.isnan(read_map(tmp_path / "maps" / f"{run.spec.key}.npz").probability)
        assert known.sum() * 0.05**2 == pytest.approx(run.result.known_m2, rel=1e-4)


def test_a_false_obstacle_is_erased(beemap, tmp_path):
    world, out = tiny_world(tmp_path, wall=9), tmp_path / "out"
    done = beemap("experiment", "localmaps", "-o", out, "--world", world, "--first-seed", 4)
    assert done.code == 0, done.err
    assert figures(out) == ["localmaps.png"]
    with (out / "false_cells.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 10
    cells = {int(row["cells"]) for row in rows}
    assert len(cells) == 1
    for row in rows:
        assert sum(int(row[name]) for name in ("occupied", "undecided", "free")) in cells
    # It appears by eq (1) and goes by eq (2): ln(.54 / .1), then ln(.46 / .9) a look.
    course = [float(row["log_odds_mean"]) for row in rows]
    assert course[:3] == pytest.approx([1.6864, 1.0152, 0.3441], abs=1e-4)
    assert (rows[0]["occupied"], rows[0]["free"]) == (rows[0]["cells"], "0")
    assert (rows[-1]["occupied"], rows[-1]["free"]) == ("0", "9")


def test_a_recording_is_mapped_by_both_methods(beemap, office_piece, tmp_path, monkeypatch):
    monkeypatch.setattr(office, "VARIANTS", office.VARIANTS[:2])
    out = tmp_path / "out"
    arguments = ["experiment", "office", office_piece, "-o", out, "--set", "mapping.particles=5"]
    done = beemap(*arguments)
    assert done.code == 0, done.err
    assert figures(out) == ["office-1.png"]
    table = (out / "table.md").read_text()
    assert "| hierarchical | 1 | 0." in table
    assert "| previous method | 1 | 0." in table
    stamps = {file: file.stat().st_mtime_ns for file in out.glob("*/map.npz")}
    first, second = stamps
    # A map that was interrupted is no map; the other one is not made again.
    summary = first.parent / "run.json"
    summary.write_text(summary.read_text().replace('"partial": false', '"partial": true'))
    assert beemap(*arguments).code == 0
    assert first.stat().st_mtime_ns > stamps[first]
    assert second.stat().st_mtime_ns == stamps[second]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["particles", "--world", "moon"], "moon: no such world"),
        (["particles", "--set", "stereo.block=5"], "only mapping.* decides a simulated run"),
        (["particles", "--set", "mapping.particles=-1"], "mapping.particles is -1"),
        (["table", "--seeds", "0"], "0 is not in the range x>=1"),
        (["office", "nowhere"], "nowhere: no such folder: give a recording, as data/office"),
        (["table", "--route", "none.yaml"], "none.yaml"),
    ],
)
def test_mistakes_are_one_line(refused, tmp_path, arguments, message):
    assert message in refused("experiment", *arguments, "-o", tmp_path / "out")


def test_a_folder_of_other_things_is_refused(refused, world, tmp_path):
    (tmp_path / "thesis.tex").touch()
    line = refused("experiment", "particles", "--world", world, "--force", "-o", tmp_path)
    assert line.endswith(": holds other things than an experiment: choose another folder")


@pytest.mark.parametrize("arguments", [["--help"], ["particles", "--help"]])
def test_help_loads_nothing_heavy(arguments):
    code = (
        "import sys\nfrom pipeline.cli import main\n"
        f"sys.argv = ['beemap', 'experiment', *{arguments!r}]\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code\n"
        "assert 'matplotlib' not in sys.modules and 'numpy' not in sys.modules"
    )
    assert loaded_by(code) == []


def test_a_series_of_nees_survives_the_rows():
    assert np.array_equal(result(nees="1 2.5 inf").nees_series, [1.0, 2.5, np.inf])
    assert result(nees="").nees_series.size == 0
