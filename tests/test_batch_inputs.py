"""Which recordings `beemap batch` takes, under which names, and what it refuses."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import click
import pytest

from pipeline.batch.inputs import find_recordings, named
from pipeline.cli import cli
from pipeline.errors import InputError
from tests.test_structure import ROOT


def recording(place: Path) -> Path:
    (place / "mav0" / "cam0").mkdir(parents=True)
    return place


@pytest.fixture
def runs(tmp_path) -> Path:
    """A folder of all kinds: recordings, a live run, a log, a video, and what is none."""
    folder = tmp_path / "runs"
    recording(folder / "b")
    recording(folder / "a")
    recording(folder / "monday" / "recording")
    (folder / "laser.log.gz").write_bytes(b"")
    (folder / "side.mp4").write_bytes(b"")
    (folder / "notes.txt").write_text("FLASER is what a scan is called")
    (folder / "scans.dat").write_text("# robot\nFLASER 3 1 1 1 0 0 0 0 0 0 1 here 1\n")
    (folder / ".hidden").mkdir()
    (folder / "empty").mkdir()
    return folder


def found(*given: Path | str, output: Path) -> tuple[list[Path], list[str]]:
    return find_recordings([str(one) for one in given], output)


def test_a_folder_of_recordings_means_each_of_them(runs, tmp_path):
    paths, notes = found(runs, output=tmp_path / "out")
    assert [str(path.relative_to(runs)) for path in paths] == [
        "a", "b", "laser.log.gz", "monday/recording", "scans.dat", "side.mp4",
    ]  # fmt: skip
    assert notes == [f"{runs}: passed over, no recording: empty, notes.txt"]


def test_patterns_and_names_are_taken_once_each_in_their_order(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(runs)
    paths, notes = found("b", "[ab]", runs / "a", output=tmp_path / "out")
    assert paths == [runs / "b", runs / "a"]
    assert notes == []


def test_a_folder_named_that_is_no_recording_is_told_of_in_the_table(runs, tmp_path):
    paths, notes = found(runs / "empty", runs / "a", runs / "notes.txt", output=tmp_path / "out")
    assert paths == [runs / "empty", runs / "a"]
    assert notes == [f"{runs / 'notes.txt'}: passed over, no recording: {runs / 'notes.txt'}"]


def test_the_results_among_the_recordings_are_none(runs):
    recording(runs / "maps" / "old")
    assert runs / "maps" / "old" not in found(runs, output=runs / "maps")[0]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["nowhere"], "nowhere: no such recording, and no pattern that matches one"),
        (["c*"], "c*: no such recording, and no pattern that matches one"),
        (["empty"], "empty: no recording and no folder of recordings: give some, as recordings/*"),
        (["notes.txt", "empty"], "notes.txt, empty: no recording and no folder of recordings"),
    ],
)
def test_nothing_to_map_is_refused(runs, tmp_path, monkeypatch, given, message):
    monkeypatch.chdir(runs)
    with pytest.raises(InputError) as error:
        found(*given, output=tmp_path / "out")
    assert str(error.value).startswith(message)


def test_results_do_not_go_into_a_recording(runs):
    with pytest.raises(InputError, match=r"lies in the recording .*a: choose another folder"):
        found(runs / "a", output=runs / "a" / "maps")


def names(paths: list[Path], output: Path) -> list[str]:
    return [given.name for given in named(paths, output)]


def test_names_are_the_recordings_own_where_they_tell_them_apart(tmp_path):
    paths = ["a/office", "a/hall.log.gz", "a/monday/recording", "b/kitti/mav0", "a/.x", "a/v.1.mp4"]
    (tmp_path / "a").mkdir()
    for log in ("a/hall.log.gz", "a/v.1.mp4"):
        (tmp_path / log).touch()
    assert names([tmp_path / path for path in paths], tmp_path / "out") == [
        "office", "hall", "monday", "kitti", "x", "v.1",
    ]  # fmt: skip


def test_two_of_one_name_get_the_folder_above_or_a_number(tmp_path):
    paths = [tmp_path / path for path in ("a/office", "b/office", "b/Office", "c/b/office")]
    told = names(paths, tmp_path / "out")
    assert told[:3] == ["office", "b-office", f"{tmp_path.name}-b-Office"]
    assert len({name.casefold() for name in told}) == 4
    assert names([Path("/x")] * 3, tmp_path) == ["x", "x-2", "x-3"]


def test_a_recording_keeps_the_name_it_has_in_the_folder(tmp_path):
    out = tmp_path / "out"
    first, second = tmp_path / "b" / "office", tmp_path / "a" / "office"
    assert names([first], out) == ["office"]
    (out / "office").mkdir(parents=True)
    (out / "office" / "run.json").write_text(json.dumps({"input": str(first)}))
    assert names([second, first], out) == ["a-office", "office"]
    # A folder that is nobody's is not written over.
    (out / "hall").mkdir()
    assert names([tmp_path / "a" / "hall"], out) == ["a-hall"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "mapping.partcles=3"], "unknown key 'mapping.partcles'"),
        (["--settings", "none.yaml"], "none.yaml"),
        (["--rig", "none.yaml"], "none.yaml"),
        (
            ["--motion", "wings"],
            "--motion wings: unknown (known: encoders, odometry, poses, poses:FILE.tum",
        ),
        (["--jobs", "0"], "0 is not in the range x>=1"),
        (["--scheduler", "here"], "--scheduler here: not an address: write it as tcp://host:8786"),
    ],
)
def test_mistakes_are_one_line(refused, runs, tmp_path, arguments, message):
    assert message in refused("batch", runs / "a", "-o", tmp_path / "out", *arguments)


def test_a_folder_of_other_things_is_refused(refused, runs, tmp_path):
    line = refused("batch", runs / "a", "-o", runs, "--force")
    assert line.endswith(": holds other things than a batch: choose another folder")
    assert sorted(path.name for path in runs.iterdir())[0] == ".hidden"


def test_the_commands_of_the_page_are_understood():
    page = (ROOT / "docs" / "batch.md").read_text()
    lines = [line for line in page.splitlines() if line.startswith("beemap ")]
    assert len(lines) == 5
    for line in lines:
        command: click.Command | None = cli
        _, *words = shlex.split(line)
        while isinstance(command, click.Group):
            name, *words = words
            command = command.get_command(click.Context(command), name)
        assert command is not None, line
        command.make_context("beemap", words)
