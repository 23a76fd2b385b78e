"""`beemap stereo show`: pictures and films that say what is in the scan."""

from __future__ import annotations

import re

import cv2
import numpy as np

from pipeline.recordings import open_recording
from pipeline.stereo_picture import belonging, in_words
from simulation.true_scans import TrueScans
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan


def read(file) -> np.ndarray:
    image = cv2.imread(str(file))
    assert image is not None
    return image


def test_the_picture_says_what_the_scan_says(office, beemap, tmp_path):
    picture = tmp_path / "pair.png"
    outcome = beemap("stereo", "show", office, "--frame", 7, "-o", picture)
    assert outcome.code == 0, outcome.err
    image = read(picture)
    assert image.shape[0] > 700
    assert image.shape[1] > 1000
    assert image.std() > 30
    recording = open_recording(office)
    assert recording.rig is not None
    scan = StereoRanger(recording.rig)(recording.pairs[7].load())
    numbers = [int(n) for n in re.findall(r"(\d+) (?:with|free|unknown)", outcome.out)]
    assert sum(numbers) == scan.range.size
    assert outcome.out.startswith("pair 7: 320 columns")


def test_the_orange_pixels_are_those_of_the_ranges(office):
    recording = open_recording(office)
    assert recording.rig is not None
    ranger = StereoRanger(recording.rig)
    pair = recording.pairs[7].load()
    frame = ranger.frame(pair)
    marked = belonging(frame, ranger)
    with_range = np.isfinite(frame.scan.range[::-1])
    # The camera is level: a pixel's column is its direction.
    columns = np.any(marked, axis=0)
    assert np.mean(columns[with_range]) > 0.9
    assert not np.any(columns[~with_range])


def test_the_truth_is_drawn_and_told_where_it_is_known(office, beemap, tmp_path):
    picture = tmp_path / "pair.png"
    plain = beemap("stereo", "show", office, "--frame", 7, "-o", picture)
    before = read(picture)
    assert "truth" not in plain.out
    recording = open_recording(office)
    assert recording.rig is not None
    scan = StereoRanger(recording.rig)(recording.pairs[7].load())
    (office / "truth").mkdir()
    TrueScans(np.array([scan.stamp]), scan.bearing, 2.0 * scan.range[None], scan.range[None]).save(
        office / "truth" / "scans.npz"
    )
    told = beemap("stereo", "show", office, "--frame", 7, "-o", picture, "--force").out
    wrong = re.search(r"truth: (\d+) ranges wrong", told)
    assert wrong
    assert int(wrong[1]) == np.isfinite(scan.range).sum()
    assert not np.array_equal(before, read(picture))


def test_words_by_hand():
    ranges = np.array([2.0, np.nan, np.inf, 3.0])
    sigma = np.where(np.isfinite(ranges), 0.05, np.nan)
    scan = RangeScan(0, (0.0, 0.0, 0.0), np.arange(4) * 0.1, ranges, sigma, 5.0)
    assert in_words(scan, None) == (
        "4 columns: 2 with an obstacle, 1 free up to 5.0 m, 1 unknown; median sigma 5.0 cm"
    )
    words = in_words(scan, np.array([2.1, 1.0, 3.0, np.inf]))
    assert "1 ranges wrong by more than 10 %, 1 free in spite of an obstacle" in words


def test_a_film_has_a_frame_for_every_readable_pair(office, beemap, tmp_path):
    for name in ("cam0", "cam1"):
        table = office / "mav0" / name / "data.csv"
        table.write_text("\n".join(table.read_text().splitlines()[:6]) + "\n")
    broken = sorted((office / "mav0" / "cam0" / "data").iterdir())[2]
    broken.write_bytes(b"no image")
    for ending in (".mp4", ".avi"):
        film = tmp_path / f"film{ending}"
        outcome = beemap("stereo", "show", office, "--video", film)
        assert outcome.code == 0, outcome.err
        assert "skipped: unreadable pair: 1" in outcome.out
        video = cv2.VideoCapture(str(film))
        frames = 0
        while video.read()[0]:
            frames += 1
        assert frames == 4
        assert 1.0 <= video.get(cv2.CAP_PROP_FPS) <= 30.0


def test_mistakes_are_named_before_any_work(office, refused, beemap, tmp_path):
    assert "give -o PNG" in refused("stereo", "show", office)
    assert "is a .png file" in refused("stereo", "show", office, "-o", tmp_path / "a.jpg")
    assert ".mp4 or .avi" in refused("stereo", "show", office, "--video", tmp_path / "a.webm")
    line = refused("stereo", "show", office, "--frame", 40, "-o", tmp_path / "a.png")
    assert "holds pairs 0 to 39" in line
    (tmp_path / "a.png").write_text("mine")
    assert "--force" in refused("stereo", "show", office, "-o", tmp_path / "a.png")
    assert (tmp_path / "a.png").read_text() == "mine"
