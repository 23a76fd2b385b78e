"""What several test files share: a short piece of the shipped recording, a browser, commands."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import settings

from pipeline.cli import cli, main
from tests.batch_runs import cut
from tests.browsers import chromium
from tests.scan_logs import drive, write_log

OFFICE = Path(__file__).parent.parent / "data" / "office"
PAIRS = 40
QUICK = ("--set", "mapping.particles=20", "--quiet")  # of `office_run`

# No deadline: the first example of a test may load OpenCV or compile a kernel. The examples are the
# same in every run; those of `make fuzz` are new in each, and it replays what failed before.
settings.register_profile("beemap", deadline=None, derandomize=True, database=None)
settings.register_profile("fuzz", deadline=None)
settings.load_profile("beemap")


@dataclass(frozen=True)
class Outcome:
    """What a command did."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def office_piece(tmp_path_factory) -> Path:
    """The first pairs of data/office with their ticks and truth; not to be changed."""
    piece = tmp_path_factory.mktemp("piece") / "office"
    for camera in ("cam0", "cam1"):
        source, target = OFFICE / "mav0" / camera, piece / "mav0" / camera
        (target / "data").mkdir(parents=True)
        shutil.copy(source / "sensor.yaml", target)
        lines = (source / "data.csv").read_text().splitlines()[: PAIRS + 1]
        (target / "data.csv").write_text("\n".join(lines) + "\n")
        for line in lines[1:]:
            shutil.copy(source / "data" / line.partition(",")[2], target / "data")
    last = int(lines[-1].partition(",")[0])
    for name in ("odom0", "state_groundtruth_estimate0"):
        source, target = OFFICE / "mav0" / name, piece / "mav0" / name
        target.mkdir()
        header, *lines = (source / "data.csv").read_text().splitlines()
        early = [line for line in lines if int(line.partition(",")[0]) < last + 200_000_000]
        (target / "data.csv").write_text("\n".join([header, *early]) + "\n")
    shutil.copy(OFFICE / "mav0" / "odom0" / "sensor.yaml", piece / "mav0" / "odom0")
    return piece


@pytest.fixture(scope="session")
def office_run(office_piece, tmp_path_factory) -> Path:
    """The result folder of that piece, with few particles; not to be changed."""
    run = tmp_path_factory.mktemp("run") / "run"
    done = CliRunner().invoke(cli, ["map", str(office_piece), "-o", str(run), *QUICK])
    assert done.exit_code == 0, done
    return run


@pytest.fixture(scope="session")
def recordings(office_piece, tmp_path_factory) -> Path:
    """A folder of three: two short pieces of the office and one without images."""
    folder = tmp_path_factory.mktemp("recordings")
    cut(office_piece, folder / "kitchen", 0, 13)
    cut(office_piece, folder / "hall", 13, 27)
    (folder / "broken" / "mav0" / "cam0").mkdir(parents=True)
    (folder / "notes.txt").write_text("not to be mapped\n")
    return folder


@pytest.fixture
def moved_run(office_run, office_piece, tmp_path) -> Path:
    """A copy of that run whose recording is not where it was; now it is `office_piece`."""
    run = Path(shutil.copytree(office_run, tmp_path / "moved-run"))
    facts = json.loads((run / "run.json").read_text())
    facts["request"]["input"] = str(tmp_path / "gone")
    (run / "run.json").write_text(json.dumps(facts))
    return run


@pytest.fixture(scope="session")
def log_run(tmp_path_factory) -> Path:
    """The result folder of a scan log of 40 scans; not to be changed."""
    folder = tmp_path_factory.mktemp("log")
    room = drive(40)
    log = write_log(folder / "room.log", [room.flaser(i) for i in range(40)])
    done = CliRunner().invoke(cli, ["map", str(log), "-o", str(folder / "run"), *QUICK])
    assert done.exit_code == 0, done
    return folder / "run"


@pytest.fixture
def office(office_piece, tmp_path) -> Path:
    """A copy of the piece that a test may damage."""
    return Path(shutil.copytree(office_piece, tmp_path / "office"))


@pytest.fixture(scope="module")
def one_thread():
    """The kernels run in one thread: two of them that wait for each other, with the machine busy,
    take ten times as long."""
    import numba

    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Any]:
    """Headless Chromium."""
    with chromium(tmp_path_factory.mktemp("profile")) as context:
        yield context


@pytest.fixture
def tab(browser) -> Iterator[tuple[Any, list[str]]]:
    """A page in the browser, and what it complained about."""
    complaints: list[str] = []
    page = browser.new_page()
    page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page, complaints
    page.close()


@pytest.fixture
def beemap(monkeypatch, capfd) -> Callable[..., Outcome]:
    """Run `beemap` with these arguments in this process; an error that is a bug stays one."""

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["beemap", *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        code = end.value.code
        assert isinstance(code, int)
        return Outcome(code, *capfd.readouterr())

    return run


@pytest.fixture
def refused(beemap) -> Callable[..., str]:
    """The one line on stderr with which `beemap` refuses these arguments."""

    def run(*arguments: object) -> str:
        outcome = beemap(*arguments)
        assert outcome.code == 2, outcome
        lines = outcome.err.splitlines()
        assert len(lines) == 1, outcome.err
        assert lines[0].startswith("beemap: ")
        return lines[0]

    return run
