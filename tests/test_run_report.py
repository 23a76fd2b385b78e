"""report.html of a run: whole, self-contained, with the numbers of the other result files."""

from __future__ import annotations

import base64
import csv
import json
import re
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from mapping.mapper import HierarchicalMapper
from mapping.settings import MappingSettings
from odometry.motion import Motion, compose, inverse
from pipeline.checkpoint import NOTHING, Checkpoint, Observations
from pipeline.cli import cli
from pipeline.job import recording_job
from pipeline.recordings import open_recording
from pipeline.results import write_results
from pipeline.run import MapRun
from pipeline.run_report import report as report_module
from pipeline.run_report.origin import Origin
from pipeline.settings import Settings, load_settings
from tests.browsers import PHONE, chromium
from tests.html_page import Page
from tests.test_odometry_witness import drive as drive_of_witness

drive = drive_of_witness  # a fixture that is made once
NAME = '<script>"it\'s" & co'
BLACK_PAIRS, COVERED, TORN = (10, 11, 12), 20, 25
pytestmark = pytest.mark.usefixtures("one_thread")
SET = ("mapping.particles=20", "stereo.noise=0.3", "mapping.cell=0.05")
MEGABYTE = 1 << 20


@pytest.fixture(scope="module")
def spoilt(office_piece, tmp_path_factory) -> Path:
    """The piece with black images, a covered right camera and a torn file, in an awkward folder."""
    place = Path(shutil.copytree(office_piece, tmp_path_factory.mktemp("spoilt") / NAME))
    images = [sorted((place / "mav0" / cam / "data").iterdir()) for cam in ("cam0", "cam1")]
    flat = np.random.default_rng(1).integers(0, 5, (240, 320)).astype(np.uint8)
    for number in BLACK_PAIRS:
        for side in (0, 1):
            cv2.imwrite(str(images[side][number]), flat)
    cv2.imwrite(str(images[1][COVERED]), flat + 60)
    torn = images[0][TORN]
    torn.write_bytes(torn.read_bytes()[:2000])
    return place


@pytest.fixture(scope="module")
def run(spoilt, one_thread) -> Path:
    """The results of `beemap map`."""
    output = spoilt.parent / "run <b>"
    words = ["map", str(spoilt), "-o", str(output), "--quiet", "--threads", "1"]
    words += ["--motion", "encoders"]
    done = CliRunner().invoke(cli, [*words, *(w for s in SET for w in ("--set", s))])
    assert done.exit_code == 0, done.output
    return output


@pytest.fixture(scope="module")
def text(run) -> str:
    return (run / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text) -> Page:
    return Page(text)


@pytest.fixture(scope="module")
def facts(run) -> dict[str, Any]:
    return json.loads((run / "run.json").read_text())


def figures(text: str) -> Iterator[tuple[str, np.ndarray | None]]:
    """The words under each thumbnail, and the picture."""
    for part in re.findall(r"<figure.*?</figure>", text, re.S):
        data = re.search(r'src="data:image/jpeg;base64,([^"]+)"', part)
        picture = None
        if data:
            picture = cv2.imdecode(np.frombuffer(base64.b64decode(data[1]), np.uint8), 0)
        yield Page(part).text, picture


def test_the_report_is_one_small_file_that_needs_no_other(run, page, text):
    page.assert_self_contained()
    assert "http" not in re.sub(r'"data:[^"]*"', "", text)
    assert (run / "report.html").stat().st_size < 3 * MEGABYTE
    assert "prefers-color-scheme: dark" in text
    assert "@media print" in text


def test_names_are_escaped(page, text):
    assert "<script" not in text
    assert f"Map of {NAME}" in page.text
    assert f"{NAME} (EuRoC/ASL folder)" in page.text


def test_it_can_be_read_without_seeing_it(page):
    for tag in ("img", "svg"):
        assert all(a.get("alt") or a.get("aria-label") for a in page.attributes(tag))
    assert all(attributes.get("scope") in ("col", "row") for attributes in page.attributes("th"))
    assert page.count["h1"] == 1


def test_its_numbers_are_those_of_the_other_files(run, page, facts):
    rows = list(csv.DictReader((run / "health.csv").open()))
    n_eff = np.array([float(row["n_eff"]) for row in rows]) / 20
    assert facts["local_maps"] == len(rows) >= 3
    labels = [attributes.get("aria-label", "") for attributes in page.attributes("svg")]
    least = f"{np.median(n_eff):.0%} in the median, {n_eff.min():.0%} at least"
    assert f"N_eff along the run: {least}" in labels
    weights = [int(row["observations"]) for row in rows]
    answered = np.average([float(row["columns_answered"]) for row in rows], weights=weights)
    assert f"columns that answered along the run: {answered:.0%} on average" in labels
    judged = [float(row["matched_share"]) for row in rows if int(row["particles_judged"])]
    assert page.count["circle"] == len(judged)
    for told in (
        f"{facts['path_m']:.1f} m of path",
        f"mapped: {facts['free_m2']:.1f} m² free, {facts['occupied_m2']:.1f} m² occupied",
        f"{facts['counts']['pairs used']} pairs",
        facts["verdict"]["word"],
        facts["verdict"]["why"][1:],
    ):
        assert told in page.text
    for stage, name in (("reading", "reading images"), ("stereo", "stereo matching")):
        seconds = facts["seconds"][stage]
        each = 1000 * seconds / facts["counts"]["pairs used"]
        assert f"{name} {seconds:.1f} {each:.1f}" in page.text


def test_pairs_of_no_use_are_shown_with_the_reason(text, spoilt):
    shown = list(figures(text))
    assert len(shown) <= 18
    black = [picture for words, picture in shown if "black images" in words]
    # The first and the last of the three.
    assert len(black) == 2
    assert all(picture is not None and picture.mean() < 20 for picture in black)
    assert any("Take off the lens caps" in words for words, _ in shown)
    ((words, covered),) = [one for one in shown if "right camera covered" in one[0]]
    assert covered is not None
    left, right = covered[:, :200], covered[:, 204:]
    assert left.std() > 20 > right.std()
    ((words, torn),) = [one for one in shown if "unreadable pair" in one[0]]
    assert "cut short" in words
    assert torn is not None


def test_the_worst_of_the_others_are_shown_with_their_shares(text, run):
    shown = [words for words, _ in figures(text)]
    few = [int(found[1]) for w in shown if (found := re.search(r"(\d+)% of the columns", w))]
    assert 1 <= len(few) <= 3
    assert few == sorted(few)
    rows = list(csv.DictReader((run / "health.csv").open()))
    matched = [float(row["matched_share"]) for row in rows if int(row["particles_judged"])]
    worst = [int(found[1]) for w in shown if (found := re.search(r"(\d+)% of the map in view", w))]
    assert worst == sorted(round(100 * share) for share in matched)[: len(worst)]


def test_settings_that_differ_are_listed_and_no_others(page):
    (start,) = [m.end() for m in re.finditer("Settings that differ from the defaults", page.text)]
    listed = page.text[start : page.text.index("What to do next", start)]
    assert "mapping.particles 20 300" in listed
    assert re.search(r"stereo.noise 0.3 (px )?0.25", listed)
    assert "mapping.cell" not in listed


def test_what_to_do_next_names_what_was_found(page, facts):
    end = page.text[page.text.rindex("What to do next") :]
    assert "Take off the lens caps" in end
    assert any(line.startswith("black images in 3 pairs") for line in facts["to_do"])
    assert "beemap evaluate path '" in end  # the recording holds the truth
    assert "'run <b>" not in end  # whole paths


# Runs that ended early, or found the recording gone


def mapped(
    recording: Path, output: Path, pairs: int = 1000, known: Observations = NOTHING
) -> tuple[MapRun, dict[str, Any]]:
    """Map until so many pairs are done, and write the results."""
    settings = load_settings(None, SET)
    opened = open_recording(recording)
    job = recording_job(opened, None, None, settings, 1, 1)
    stop = threading.Event()

    def progress(done: int, total: int) -> None:
        if done >= pairs:
            stop.set()

    if pairs == 0:
        stop.set()
    run = job.run(progress, stop.is_set, known)
    output.mkdir()
    origin = Origin(output, recording, [str(recording)], pairs=lambda: opened.pairs)
    facts = {"input": str(recording), **job.facts()}
    return run, write_results(output, run, settings, None, facts, origin)


@pytest.mark.parametrize("pairs", [0, 1, 25])
def test_an_interrupted_run_has_a_report(office_piece, tmp_path, pairs):
    run, summary = mapped(office_piece, tmp_path / "run", pairs)
    page = Page((tmp_path / "run" / "report.html").read_text(encoding="utf-8"))
    page.assert_self_contained()
    assert summary["verdict"]["why"].endswith(
        "interrupted: this is the first part of the recording"
    )
    assert run.used == pairs
    assert "Next: Go on with the run." in page.text
    assert f"beemap map --resume {tmp_path / 'run'}" in page.text
    if pairs == 0:
        assert summary["verdict"]["word"] == "broken"
        assert "Nothing was mapped" in page.text


def test_a_resumed_run_shows_the_same_pairs(spoilt, tmp_path):
    with Checkpoint.start(tmp_path / "log", {}) as checkpoint:
        first, _ = mapped(spoilt, tmp_path / "a", known=checkpoint)
    with Checkpoint.resume(tmp_path / "log") as checkpoint:
        assert len(checkpoint) > 30
        again, _ = mapped(spoilt, tmp_path / "b", known=checkpoint)
    chosen, other = (
        [(s.index, s.stamp, s.kind, s.why, s.share) for s in run.worst.chosen()]
        for run in (first, again)
    )
    assert chosen == other
    assert len(chosen) >= 6


def test_a_recording_that_has_gone_costs_the_pictures_alone(office_piece, tmp_path, monkeypatch):
    run, _ = mapped(office_piece, tmp_path / "whole", 25)

    def gone():
        raise OSError("the stick was pulled")

    (tmp_path / "less").mkdir()
    origin = Origin(tmp_path / "less", office_piece, [], pairs=gone)
    summary = write_results(tmp_path / "less", run, Settings(), None, {}, origin)
    assert "could not be read again: the stick was pulled" in summary["health"][-1]
    page = (tmp_path / "less" / "report.html").read_text(encoding="utf-8")
    assert "the stick was pulled" in page
    assert "data:image/jpeg" not in page

    def broken(*_arguments, **_values):
        raise ValueError("a mistake in the report")

    monkeypatch.setattr(report_module, "render", broken)
    (tmp_path / "none").mkdir()
    summary = write_results(tmp_path / "none", run, Settings(), None, {}, origin)
    assert summary["health"][-1] == "report.html could not be written: a mistake in the report"
    names = {file.name for file in (tmp_path / "none").iterdir()}
    assert names == {file.name for file in (tmp_path / "whole").iterdir()} - {"report.html"}


def test_a_wheel_taken_for_too_large_is_named_with_its_bias(drive, tmp_path):
    poses, scans = drive
    settings = MappingSettings(particles=2, smoothing=False)
    run = MapRun(HierarchicalMapper(settings, 1))
    run.move(Motion.none(0))
    run.observe(scans[0], "0")
    bias, rng = 0.04, np.random.default_rng(3)
    for step, scan in zip(compose(inverse(poses[:-1]), poses[1:]), scans[1:], strict=True):
        told = step * (1.0 + bias) + rng.normal(0.0, 1.0, 3) * (0.001, 0.0003, 0.003)
        variances = [1e-5, 1e-6, 1e-5]
        run.move(Motion(told, np.diag(variances)))
        run.observe(scan, "next")
    run.mapper.finish()
    facts = {"input": "REC", "motion": "encoders"}
    origin = Origin(tmp_path, Path("REC"), ["REC"], Path("my rig.yaml"))
    write_results(tmp_path, run, Settings(mapping=settings), None, facts, origin)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    found = re.search(r"distance \+([\d.]+) ± ([\d.]+) % certain", page.text)
    assert found
    value, error = float(found[1]), float(found[2])
    assert abs(value - 100 * bias) < 2.0 * error
    assert error < 1.0
    assert f"odometry overestimates distance by {value:.1f} ± {error:.1f} %" in page.text.lower()
    calibrate = "beemap odometry calibrate REC --rig 'my rig.yaml' -o 'my rig.yaml' --force"
    assert calibrate in page.text
    factor = re.search(r"radius of the encoders by (0\.\d+)", page.text)
    assert factor
    assert float(factor[1]) == pytest.approx(1.0 / (1.0 + bias), abs=0.02)


def test_it_fits_a_phone_and_fetches_nothing(run, tmp_path):
    asked: list[str] = []
    with chromium(tmp_path / "profile") as browser:
        page = browser.new_page()
        page.set_viewport_size(PHONE)
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: asked.append(message.text))
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            page.goto((run / "report.html").as_uri())
            assert page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
        style = "getComputedStyle(document.body)"
        ink, paper = page.evaluate(f"[{style}.color, {style}.backgroundColor]")
    assert all(url.startswith(("file:", "data:")) for url in asked), asked
    assert ink == "rgb(236, 236, 242)"
    assert paper == "rgb(23, 23, 28)"
