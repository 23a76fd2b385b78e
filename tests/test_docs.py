"""The pages of docs/ say what works: their commands and their Python are run as printed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import click
import cv2
import pytest

from calibration.rig import load_rig
from pipeline.cli import cli
from pipeline.live.devices import load_live_rig
from pipeline.recordings import open_recording
from tests.calibration_views import board_poses, render
from tests.conftest import Outcome
from tests.doc_pages import LANGUAGES, PAGES, ROOT, blocks
from tests.virtual_rigs import virtual_rig

# Commands that are not run, by how they begin, and why.
NOT_RUN = {
    "beemap calibrate capture": "needs a board in view (tests/test_calibrate_capture.py)",
    "beemap odometry calibrate": "needs minutes of driving (tests/test_wheel_calibration.py)",
    "beemap rig convert intrinsics.yml": "OpenCV's sample files (tests/test_rig_exchange.py)",
    "beemap replay": "ends when somebody stops it (tests/test_web_run.py)",
    "beemap live virtual-rig/rig.yaml -o run --web": "needs a rig (tests/test_live.py)",
    "beemap experiment": "takes hours (tests/test_experiment_command.py)",
    "beemap import drive.bag": "a robot's own bag (tests/test_import_bag.py)",
    "beemap map rec": "of that bag",
    "pip install": "needs a network",
    "beemap batch recordings -o maps --rig": "a rig of your own (tests/test_batch.py)",
    "beemap batch recordings -o maps --scheduler": "needs a cluster (tests/test_tasks_cluster.py)",
    "dask": "runs until it is stopped (tests/test_tasks_cluster.py)",
    "beemap map intel": "not in the repository (python -m benchmarks.logs)",
    "beemap info intel": "not in the repository (python -m benchmarks.logs)",
    "beemap evaluate relations": "not in the repository (python -m benchmarks.logs)",
}
# Others than beemap's own that are run.
HARMLESS = ("cp", "mkdir")
# Commands that run until Ctrl-C, which comes after so many pairs.
UNTIL_INTERRUPTED = ("live", "record")
PAIRS = 6
# doctor may fail the machine that runs the tests.
CODES = {"doctor": (0, 3)}

Run = Callable[..., Outcome]


@pytest.fixture
def place(office_piece, recordings, tmp_path, monkeypatch) -> Path:
    """Where a page is read: a folder with the bundled recording in it, and some more."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "office").symlink_to(office_piece)
    (tmp_path / "RECORDING").symlink_to(office_piece)
    (tmp_path / "recordings").mkdir()
    for name, source in (("2024-05-01", "kitchen"), ("2024-05-02", "hall")):
        (tmp_path / "recordings" / name).symlink_to(recordings / source)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def draw_shots(place: Path) -> None:
    """Six pairs of a board, as the office's cameras would take them."""
    rig = open_recording(place / "data" / "office").rig
    assert rig is not None
    (place / "shots").mkdir()
    for number, pose in enumerate(board_poses(6, seed=11, distance=(0.36, 0.46))):
        for side, image in zip(("left", "right"), render(rig, pose), strict=True):
            for ending in ("png", "jpg"):
                cv2.imwrite(str(place / "shots" / f"{side}{number}.{ending}"), image)


def start(words: list[str], stderr: int | None = None) -> subprocess.Popen[bytes]:
    """The command in a process of its own."""
    command = [sys.executable, "-m", "pipeline.cli", *words[1:]]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stderr=stderr)


def begin(words: list[str], stack: ExitStack) -> None:
    """Start what runs in a terminal of its own, until the page ends: a virtual rig."""
    process = start(words)

    def end() -> None:
        process.send_signal(signal.SIGINT)
        process.wait(30.0)

    stack.callback(end)
    while not Path("virtual-rig/rig.yaml").exists():
        assert process.poll() is None
        time.sleep(0.05)


def follow(words: list[str], beemap: Run, where: str) -> None:
    """Run one command to its end, or to Ctrl-C."""
    if words[0] in HARMLESS:
        subprocess.run(words, check=True)
    elif words[1] in UNTIL_INTERRUPTED and "--duration" not in words:
        process = start(words, stderr=subprocess.PIPE)
        output = Path(words[words.index("-o") + 1])
        while process.poll() is None and pairs_in(output) < PAIRS:
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60.0)
        assert process.returncode == 0, f"{where}: {said.decode()}"
    else:
        assert words[0] == "beemap", where
        done = beemap(*words[1:])
        assert done.code in CODES.get(words[1], (0,)), f"{where}: {done.err}"


def pairs_in(output: Path) -> int:
    """How many pairs lie in a recording, or in that of a live run."""
    return max(0, *(len(p.read_bytes().splitlines()) - 1 for p in output.rglob("cam0/data.csv")), 0)


@pytest.mark.parametrize(
    "page", [page for page in PAGES if any(b.language == "sh" for b in blocks(page))], ids=str
)
def test_commands_run_as_printed(page, place, beemap):
    draw_shots(place)
    with ExitStack() as stack:
        for block in blocks(page):
            if block.language != "sh":
                continue
            for words in block.commands():
                line = " ".join(words)
                if words[0] == "beemap":
                    understood(words[1:])
                if block.background:
                    begin(words, stack)
                elif not any(line.startswith(one) for one in NOT_RUN):
                    follow(words, beemap, f"{page.name}:{block.line}: {line}")


@pytest.mark.parametrize(
    "page", [page for page in PAGES if any(b.language == "python" for b in blocks(page))], ids=str
)
def test_python_runs_as_printed(page, place):
    draw_shots(place)
    names: dict[str, object] = {}
    with virtual_rig(place / "data" / "office", place / "virtual-rig", speed=2.0):
        for block in blocks(page):
            if block.language == "python":
                code = compile("\n" * block.line + block.text, str(page), "exec")
                exec(code, names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_blocks_say_what_they_are(page):
    for block in blocks(page):
        assert block.language in LANGUAGES, f"{page.name}:{block.line}"
        assert block.language == "sh" or "\nbeemap " not in f"\n{block.text}", block


@pytest.mark.parametrize(
    "text",
    [b.text for page in PAGES for b in blocks(page) if b.language == "yaml" and "_rig:" in b.text],
)
def test_rig_files_on_pages_are_rig_files(text, tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(text)
    if "image_size" in text:
        load_rig(file)
    else:
        load_live_rig(file)


def test_the_readme_names_commands_and_options_that_exist():
    commands = [
        words
        for block in blocks(ROOT / "README.md")
        if block.language == "sh"
        for words in block.commands()
        if words[0] == "beemap"
    ]
    assert len(commands) > 10
    for words in commands:
        understood(words[1:])


def understood(words: list[str]) -> None:
    """Parse a command line as click does, without running it."""
    command: click.Command = cli
    context = click.Context(cli, info_name="beemap")
    while isinstance(command, click.Group):
        found = command.get_command(context, words[0])
        assert found is not None, words
        context = click.Context(found, info_name=words[0], parent=context)
        command, words = found, words[1:]
    command.parse_args(context, list(words))
