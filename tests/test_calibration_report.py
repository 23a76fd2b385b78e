"""report.html and its figures: whole, self-contained, the same bytes every time."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from pipeline.calibration_report.files import FIGURES, PAGE
from pipeline.cli import cli
from tests.calibration_views import SMALL_RIG, board_poses, render
from tests.html_page import Page


@pytest.fixture(scope="module")
def shots(tmp_path_factory) -> Path:
    """Six drawn pairs, one image shifted, one that cannot be read and has an awkward name."""
    folder = tmp_path_factory.mktemp("shots")
    for number, pose in enumerate(board_poses(6, seed=11, distance=(0.36, 0.46))):
        for side, image in zip(("left", "right"), render(SMALL_RIG, pose), strict=True):
            (folder / side).mkdir(exist_ok=True)
            if number == 4 and side == "right":
                image = np.roll(image, 3, axis=0)
            cv2.imwrite(str(folder / side / f"{number}.png"), image)
    (folder / "left" / "<i>&6.png").write_bytes(b"torn")
    shutil.copy(folder / "right" / "5.png", folder / "right" / "<i>&6.png")
    return folder


@pytest.fixture
def calibrated(shots, beemap, tmp_path, monkeypatch):
    """Run the command; the rig file and the report go to `tmp_path`."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(shots.parent / "cache"))
    return lambda *options: beemap(*words(shots, tmp_path), *options)


def words(shots: Path, folder: Path) -> list[str]:
    board = ["--board", "chessboard:9x6", "--square", "25mm", "--lens", "radtan4"]
    images = [str(shots / "left"), str(shots / "right")]
    return ["calibrate", "cameras", *images, *board, "-o", str(folder / "rig.yaml")]


@pytest.fixture(scope="module")
def report(shots, tmp_path_factory) -> tuple[str, Path]:
    """What the command printed, and the folder of its report."""
    folder = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(shots.parent / "cache"))
        result = CliRunner().invoke(cli, words(shots, folder))
    assert result.exit_code == 0, result.output
    return result.stdout, folder / "rig-report"


def test_the_report_tells_all_in_one_file(report):
    printed, folder = report
    assert printed.splitlines()[-1] == f"report: {folder / PAGE}"
    text = (folder / PAGE).read_text(encoding="utf-8")
    page = Page(text)
    page.assert_self_contained()
    assert page.count["svg"] == len(FIGURES) - 1
    assert page.count["img"] == 1
    # The same words as on the screen, those of the verdict and the action first.
    (verdict,) = re.findall(r"^verdict: (\w+), held-out rows ([0-9.]+) px", printed, re.M)
    assert f"Pairs left out of the solve come to lie on one row within {verdict[1]} px" in page.text
    (action,) = re.findall(r"^next: (.*)$", printed, re.M)
    assert action.startswith("drop pair 4: its images miss each other")
    assert f"Next: {action}" in page.text
    assert "not used: <i>&6.png cannot be read" in page.text
    assert "left.fx" in page.text


def test_figures_are_drawn_for_light_and_dark(report):
    _, folder = report
    text = (folder / PAGE).read_text(encoding="utf-8")
    assert "prefers-color-scheme: dark" in text
    svgs = re.findall(r"<svg.*?</svg>", text, re.S)
    assert all("var(--ink)" in svg for svg in svgs)
    assert not any("#2b2b34" in svg for svg in svgs)
    for name in FIGURES:
        image = cv2.imread(str(folder / f"{name}.png"))
        assert image is not None, name
        assert min(image.shape[:2]) >= 300
        # Something is drawn, on white or a photograph.
        assert image.std() > 5


def test_the_same_images_give_the_same_report(report, calibrated, tmp_path):
    _, folder = report
    assert calibrated("--quiet", "--report", tmp_path / "again").code == 0
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted([PAGE, *(f"{name}.png" for name in FIGURES)])
    for name in names:
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_a_report_is_replaced_only_when_told_to(calibrated, tmp_path):
    folder = tmp_path / "rig-report"
    folder.mkdir()
    (folder / PAGE).write_text("mine")
    (folder / "notes.txt").write_text("mine too")
    outcome = calibrated("--quiet")
    assert outcome.code == 2
    assert f"{folder / PAGE}: already exists: give --force to replace it" in outcome.err
    assert not (tmp_path / "rig.yaml").exists()
    assert calibrated("--quiet", "--force").code == 0
    assert (folder / PAGE).read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert (folder / "notes.txt").read_text() == "mine too"


def test_a_file_in_the_place_of_the_report_is_refused_early(calibrated, tmp_path):
    (tmp_path / "file").touch()
    outcome = calibrated("--report", tmp_path / "file")
    assert outcome.code == 2
    assert outcome.err.splitlines() == [
        f"beemap: {tmp_path / 'file'}: is a file, not a folder: give another --report"
    ]
    assert not (tmp_path / "rig.yaml").exists()


def test_no_report_is_written_when_none_is_wanted(calibrated, tmp_path):
    assert calibrated("--quiet", "--no-report").code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.yaml"]
