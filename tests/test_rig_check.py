"""`beemap rig check`: rows of ordinary scenes tell whether a calibration has drifted."""

from __future__ import annotations

import json
import math
import os
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.rig import Mount, StereoRig, load_rig, save_rig
from pipeline.pair_sources import open_pairs
from pipeline.recordings import open_recording
from pipeline.recordings.base import read_image
from pipeline.rig_check import check_rig
from pipeline.whole_images import whole_rectifier
from stereo.errors import StereoError
from stereo.row_check import RowMatches, check_rows, match_points
from tests.stereo_rigs import straight_rig, texture, wall_pair

REAL = os.environ.get("BEEMAP_REAL_DATA")


def turned(rig: StereoRig, pitch: float, yaw: float, roll: float) -> StereoRig:
    """The rig as it would have been calibrated had its right camera not yet turned so [deg].

    The images then show a right camera that has turned by these angles since.
    """
    level = Mount().rotation
    now = Mount(pitch=math.radians(pitch), yaw=math.radians(yaw), roll=math.radians(roll)).rotation
    back = level.T @ now  # from the turned camera's axes to those it had before
    return replace(rig, R=back @ rig.R, T=back @ rig.T)


def rig_of(recording: Path) -> StereoRig:
    rig = open_recording(recording).rig
    assert rig is not None
    return rig


def nothing(done: int, total: int) -> None:
    pass


def test_a_good_rig_is_fine(office_piece):
    found = check_rig(rig_of(office_piece), open_recording(office_piece), 10, nothing)
    assert not found.drifted
    assert found.pairs == 10
    assert found.rows.matches > 2000
    assert found.rows.rms < 0.15
    assert found.rows.systematic < 0.05
    assert abs(np.degrees(found.rows.turned[[0, 2]])).max() < 0.02


@pytest.mark.parametrize(
    "angles", [(0.1, 0.0, 0.0), (-0.3, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, 1.5, 0.0), (0.5, 0.5, 0.5)]
)
def test_a_turned_camera_is_found_and_by_how_much(office_piece, angles):
    rig = turned(rig_of(office_piece), *angles)
    found = check_rig(rig, open_recording(office_piece), 10, nothing)
    assert found.drifted
    pitch, yaw, roll = np.degrees(found.rows.turned)
    assert pitch == pytest.approx(angles[0], abs=0.02)
    assert roll == pytest.approx(angles[2], abs=0.03)
    assert yaw == pytest.approx(
        angles[1], abs=max(0.1, 5.0 * math.degrees(found.rows.turned_sigma[1]))
    )
    f = rig.left.fx
    if angles[1:] == (0.0, 0.0):  # pitch moves all rows alike
        assert found.rows.bias == pytest.approx(-f * math.radians(angles[0]), rel=0.15)


def test_a_small_turn_moves_rows_by_less_than_matching_minds(office_piece):
    rig = turned(rig_of(office_piece), 0.02, 0.0, 0.05)
    found = check_rig(rig, open_recording(office_piece), 10, nothing)
    assert not found.drifted
    assert math.degrees(found.rows.turned[2]) == pytest.approx(0.05, abs=0.02)


def test_points_are_placed_to_a_few_hundredths_of_a_pixel():
    left, right = wall_pair(1.0)
    lift = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -0.37]])
    lifted = cv2.warpAffine(right, lift, (320, 240), flags=cv2.INTER_CUBIC)
    matches = match_points(left, lifted)
    assert len(matches.left) > 200
    assert np.median(matches.differences) == pytest.approx(-0.37, abs=0.04)
    assert np.std(matches.differences) < 0.05
    disparity = matches.left[:, 0] - matches.right[:, 0]
    assert np.median(disparity) == pytest.approx(246.4 * 0.12, abs=0.02)


def test_false_matches_are_left_out_and_counted():
    camera = whole_rectifier(straight_rig()).camera
    chance = np.random.default_rng(0)
    left = chance.uniform((0, 0), (320, 240), (400, 2))
    right = left - (12.0, 0.0) + chance.normal(0.0, 0.1, (400, 2))
    right[:100, 1] += chance.uniform(1.0, 9.0, 100)
    found = check_rows([RowMatches(left, right)], camera)
    assert found.false_matches == pytest.approx(100, abs=5)
    assert found.rms == pytest.approx(0.1, abs=0.02)
    assert abs(found.bias) < 0.02


def test_cameras_that_do_not_expose_at_once_are_told():
    camera = whole_rectifier(straight_rig()).camera
    chance = np.random.default_rng(0)
    pairs = []
    for shift in chance.normal(0.0, 0.3, 20):
        left = chance.uniform((0, 0), (320, 240), (100, 2))
        right = left + np.array([-12.0, shift]) + chance.normal(0.0, 0.1, (100, 2))
        pairs.append(RowMatches(left, right))
    together = [RowMatches(m.left, m.left - (12.0, 0.0)) for m in pairs]
    assert check_rows(pairs, camera).scatter == pytest.approx(0.3, abs=0.12)
    assert check_rows(together, camera).scatter < 1e-9


def test_blank_images_do_not_match():
    blank = np.full((240, 320), 128, np.uint8)
    assert len(match_points(blank, blank).left) == 0
    with pytest.raises(StereoError, match="only 0 points match"):
        check_rows([match_points(blank, blank)], whole_rectifier(straight_rig()).camera)


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.4, 0.0, 0.0)])
def test_the_command_tells_by_its_exit_code(beemap, office_piece, tmp_path, angles):
    file = tmp_path / "rig.yaml"
    save_rig(turned(rig_of(office_piece), *angles), file)
    told = beemap("rig", "check", file, office_piece, "--pairs", 5, "--json")
    facts = json.loads(told.out)
    drifted = any(angles)
    assert told.code == (3 if drifted else 0)
    assert facts["verdict"] == ("drifted" if drifted else "fine")
    assert facts["pairs_used"] == 5
    assert facts["row_rms_px"] >= facts["row_systematic_px"]
    assert facts["turned_deg"]["pitch"] == pytest.approx(angles[0], abs=0.03)
    printed = beemap("rig", "check", file, office_piece, "--pairs", 5)
    assert printed.out.splitlines()[-1].startswith(f"verdict: {facts['verdict']}")
    assert beemap("rig", "check", file, office_piece, "--pairs", 5, "--quiet").out == ""


def test_a_rig_that_was_never_better_is_not_blamed(office_piece):
    rig = turned(rig_of(office_piece), 0.1, 0.0, 0.0)
    old = replace(rig, sections={"calibration": {"heldout_row_rms_px": 0.45}})
    recording = open_recording(office_piece)
    assert check_rig(rig, recording, 5, nothing).drifted
    assert not check_rig(old, recording, 5, nothing).drifted


@pytest.fixture
def shots(office_piece, tmp_path) -> Path:
    """Some pairs of the office as plain images: a_left.jpg, a_right.jpg, ..."""
    folder = tmp_path / "shots"
    folder.mkdir()
    for number, pair in enumerate(open_recording(office_piece).pairs[::10]):
        shutil.copy(pair.files[0], folder / f"room{number}_left.jpg")
        shutil.copy(pair.files[1], folder / f"room{number}_right.jpg")
    return folder


def test_pairs_come_in_many_ways(shots, tmp_path):
    by_name = open_pairs([str(shots)])
    two = open_pairs([f"{shots}/*_left.jpg", f"{shots}/*_right.jpg"])
    assert [p.files for p in by_name.pairs] == [p.files for p in two.pairs]
    assert len(two.pairs) == 4
    wide = tmp_path / "wide"
    wide.mkdir()
    for pair in two.pairs:
        both = np.hstack([read_image(pair.files[0]), read_image(pair.files[1])])
        cv2.imwrite(str(wide / pair.files[0].name.replace("_left.jpg", ".png")), both)
    for halved, pair in zip(open_pairs([str(wide)]).pairs, two.pairs, strict=True):
        loaded = halved.load()
        assert np.array_equal(loaded.left, read_image(pair.files[0]))
        assert np.array_equal(loaded.right, read_image(pair.files[1]))


def test_pictures_are_drawn_once(beemap, refused, shots, office_piece, tmp_path):
    file, pictures = tmp_path / "rig.yaml", tmp_path / "pictures"
    save_rig(rig_of(office_piece), file)
    arguments = ("rig", "check", file, shots, "--quiet", "--pictures", pictures)
    assert beemap(*arguments).code == 0
    names = sorted(path.name for path in pictures.iterdir())
    assert names == [f"room{n}_left.png" for n in range(4)]
    picture = cv2.imread(str(pictures / names[0]))
    assert picture is not None
    width = picture.shape[1] // 3
    assert width == 320
    left, disparity = picture[:200, :width], picture[:200, 2 * width :]
    assert left.std() > 10
    assert (np.ptp(disparity.astype(int), axis=2) > 60).mean() > 0.3  # mostly in colour
    assert "already exists: give --force" in refused(*arguments)
    assert beemap(*arguments, "--force").code == 0


def test_a_damaged_pair_is_passed_over(beemap, shots, office_piece, tmp_path):
    file = tmp_path / "rig.yaml"
    save_rig(rig_of(office_piece), file)
    (shots / "room1_right.jpg").write_bytes(b"no image")
    small = texture((60, 80))
    cv2.imwrite(str(shots / "room2_left.jpg"), small)
    facts = json.loads(beemap("rig", "check", file, shots, "--json").out)
    assert facts["pairs_used"] == 2
    assert facts["pairs_given"] == 4
    assert len(facts["skipped"]["damaged or unfit image"]) == 2


def test_mistakes_are_one_line(refused, shots, office_piece, tmp_path):
    file = tmp_path / "rig.yaml"
    save_rig(rig_of(office_piece), file)
    lefts, rights = f"{shots}/*_left.jpg", f"{shots}/*_right.jpg"
    assert "look exchanged" in refused("rig", "check", file, rights, lefts, "--quiet")
    assert "two folders" in refused("rig", "check", file, "a", "b", "c")
    assert "no such" in refused("rig", "check", file, tmp_path / "none")
    assert "no such" in refused("rig", "check", tmp_path / "none.yaml", shots)
    save_rig(rig_of(office_piece).scaled(2.0), file)
    assert "calibrated for 640x480" in refused("rig", "check", file, shots, "--quiet")
    save_rig(rig_of(office_piece), file)
    for image in shots.iterdir():
        cv2.imwrite(str(image), np.full((240, 320), 90, np.uint8))
    assert "only 0 points match" in refused("rig", "check", file, shots, "--quiet")


@pytest.mark.skipif(REAL is None, reason="BEEMAP_REAL_DATA is not set")
def test_a_real_rig_fits_its_scenes(beemap, tmp_path):
    assert REAL is not None
    chess, file = Path(REAL) / "calibration" / "bumblebee2-chess", tmp_path / "rig.yaml"
    sides = [f"{chess}/{side}*.jpg" for side in ("left", "right")]
    board = ("--board", "chessboard:4x6", "--square", "30mm")
    assert beemap("calibrate", "cameras", *sides, *board, "-o", file, "--quiet").code == 0
    scenes = Path(REAL) / "stereo" / "bumblebee2-scenes"
    told = beemap("rig", "check", file, scenes, "--json")
    facts = json.loads(told.out)
    assert told.code == 0, told
    assert facts["pairs_used"] == 8
    assert facts["row_rms_px"] < 0.3
    save_rig(turned(load_rig(file), 0.1, 0.0, 0.0), file)
    assert beemap("rig", "check", file, scenes, "--quiet").code == 3
