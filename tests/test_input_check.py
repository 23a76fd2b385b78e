"""The first look at a recording: faults made on purpose are named, mended or refused."""

from __future__ import annotations

import itertools
import json
import math
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from calibration.rig import Mount, StereoRig, load_rig, save_rig
from pipeline.errors import InputError
from pipeline.health.finding import Grade
from pipeline.input_check import check_input
from pipeline.recordings import open_recording
from pipeline.recordings.base import Recording
from pipeline.rig import choose_rig
from pipeline.run_report.origin import Origin
from tests.conftest import OFFICE, QUICK

ORIGIN = Origin(Path("run"), OFFICE, [str(OFFICE)])


@pytest.fixture
def office() -> tuple[Recording, StereoRig]:
    recording = open_recording(OFFICE)
    return recording, choose_rig(recording, None)[0]


def rows_apart(rig: StereoRig, pixels: float) -> StereoRig:
    """The rig for which the right images lie `pixels` lower than they should."""
    return replace(rig, right=replace(rig.right, cy=rig.right.cy - pixels))


def tilted(rig: StereoRig, pitch: float = 0.0, roll: float = 0.0) -> StereoRig:
    """The rig whose mount is wrong by so many degrees."""
    mount = rig.mount or Mount()
    angles = {"pitch": math.radians(pitch), "roll": math.radians(roll)}
    return rig.with_mount(replace(mount, **{k: getattr(mount, k) + v for k, v in angles.items()}))


def test_nothing_wrong(office):
    recording, rig = office
    checked = check_input(recording, rig, ORIGIN)
    assert checked.findings == []
    assert checked.rig is rig


@pytest.mark.parametrize("pixels", [1.0, -1.5])
def test_a_constant_row_offset_is_mended(office, pixels):
    recording, rig = office
    checked = check_input(recording, rows_apart(rig, pixels), ORIGIN)
    assert checked.rig.right.cy == pytest.approx(rig.right.cy, abs=0.1)
    assert checked.rig.right.cx == pytest.approx(rig.right.cx, abs=0.1)
    (finding,) = checked.findings
    assert finding.grade == Grade.GOOD
    word = "lower" if pixels > 0 else "higher"
    assert f"{abs(pixels)} px {word} than the left ones: corrected in this run" in finding.line


def test_a_few_pairs_are_judged_by_their_rows_alone(office):
    recording, rig = office
    recording.pairs = recording.pairs[:8]
    assert check_input(recording, tilted(rig, pitch=5.0), ORIGIN).findings == []
    (finding,) = check_input(recording, rows_apart(rig, 1.0), ORIGIN).findings
    assert "corrected in this run" in finding.text
    recording.pairs = []
    assert check_input(recording, rig, ORIGIN).findings == []


def test_rows_far_apart_end_the_run_unless_the_user_insists(office):
    recording, rig = office
    wrong = rows_apart(rig, 5.0)
    with pytest.raises(InputError, match=r"5\.0 px lower .* calibrate .* --unchecked"):
        check_input(recording, wrong, ORIGIN)
    checked = check_input(recording, wrong, ORIGIN, unchecked=True)
    assert checked.rig is wrong
    assert [f.grade for f in checked.findings] == [Grade.DOUBTFUL]


@pytest.mark.parametrize(("frames", "word"), [(1, "1 frame late"), (-2, "early"), (5, "late")])
def test_right_images_of_another_time_end_the_run(office, frames, word):
    recording, rig = office
    recording.shift_right(-frames)  # the right image belongs to the left one `frames` before
    with pytest.raises(InputError, match=rf"{word}.* --right-late {frames} "):
        check_input(recording, rig, ORIGIN)
    recording.shift_right(frames)
    assert check_input(recording, rig, ORIGIN).findings == []


@pytest.mark.parametrize("wrong", [{"pitch": 2.0}, {"pitch": -5.0}, {"roll": 2.0}])
def test_a_tilted_mount_is_mended_by_the_floor(office, wrong):
    recording, rig = office
    checked = check_input(recording, tilted(rig, **wrong), ORIGIN)
    mount = checked.rig.mount
    assert mount is not None
    assert math.degrees(mount.pitch) == pytest.approx(0.0, abs=0.2)
    assert math.degrees(mount.roll) == pytest.approx(0.0, abs=0.2)
    (finding,) = checked.findings
    assert f"its {next(iter(wrong))} is" in finding.text
    assert "corrected in this run" in finding.text


def test_the_command_named_for_a_wrong_mount_mends_it(office, tmp_path, monkeypatch, beemap):
    recording, rig = office
    file = tmp_path / "rig.yaml"
    save_rig(tilted(rig, pitch=10.0), file)
    monkeypatch.chdir(tmp_path)
    done = beemap("map", OFFICE, "--rig", file, "-o", "run", *QUICK)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "its pitch is 0.0 deg, not 10.0" in done.err
    command = re.search(r"'beemap (calibrate mount .*?)'", done.err)
    assert command is not None
    assert beemap(*shlex.split(command[1]), "--quiet").code == 0
    mended = load_rig("mounted.yaml")
    assert check_input(recording, mended, ORIGIN).findings == []


def test_a_map_of_late_right_images_and_rows_apart(office_piece, tmp_path, beemap):
    late = Path(shutil.copytree(office_piece, tmp_path / "late"))
    images = sorted((late / "mav0/cam1/data").iterdir())
    for before, after in reversed(list(itertools.pairwise(images))):
        shutil.copy(before, after)
    rig = choose_rig(open_recording(late), None)[0]
    save_rig(rows_apart(rig, 1.0), tmp_path / "rig.yaml")
    run = ("map", late, "--rig", tmp_path / "rig.yaml", "-o", tmp_path / "run", *QUICK)
    done = beemap(*run)
    assert done.code == 2
    assert "1 frame late" in done.err
    assert done.err.count("\n") == 1
    done = beemap(*run, "--right-late", "1")
    assert done.code == 0, done
    facts = json.loads((tmp_path / "run/run.json").read_text())
    assert facts["counts"]["pairs used"] == len(images) - 1
    assert any("1.0 px lower" in line and "corrected" in line for line in facts["health"])
    assert facts["request"]["right_late"] == 1
