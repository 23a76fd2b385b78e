"""`beemap calibrate cameras`, from image files to rig.yaml, with good and bad input."""

import json
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from calibration.rig import Mount, load_rig, save_rig
from pipeline.cli import main
from pipeline.commands.calibrate import calibrate
from tests.calibration_views import SMALL_RIG, board_poses, render

REAL_DATA = os.environ.get("BEEMAP_REAL_DATA")


@pytest.fixture(scope="module")
def shots(tmp_path_factory) -> Path:
    """Folders left and right with six drawn views of the board."""
    folder = tmp_path_factory.mktemp("shots")
    for number, pose in enumerate(board_poses(6, seed=11, distance=(0.45, 0.6))):
        for side, image in zip(("left", "right"), render(SMALL_RIG, pose), strict=True):
            (folder / side).mkdir(exist_ok=True)
            cv2.imwrite(str(folder / side / f"{number}.png"), image)
    return folder


@pytest.fixture
def copy(shots, tmp_path) -> Path:
    """A copy of the shots that a test may spoil."""
    for path in shots.glob("*/*.png"):
        target = tmp_path / "copy" / path.parent.name / path.name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(path.read_bytes())
    return tmp_path / "copy"


def run(left, right, output, *options, board="chessboard:9x6", square="25mm"):
    arguments = [str(left), str(right), "--board", board, "--square", square, "-o", str(output)]
    return CliRunner().invoke(calibrate, ["cameras", *arguments, *options])


def test_a_mistake_is_one_line_and_exit_code_2(tmp_path, monkeypatch, capsys):
    words = ["cameras", str(tmp_path), "right", "--board", "chessboard:9x6", "--square", "25mm"]
    monkeypatch.setattr("sys.argv", ["beemap", "calibrate", *words, "-o", str(tmp_path / "r.yaml")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{tmp_path}: no image in this folder" in line


def refusal(result) -> str:
    """The one line that a user sees in place of a result."""
    assert isinstance(result.exception, ValueError), result.output
    (line,) = str(result.exception).splitlines()
    return line


def test_drawn_boards_give_back_the_rig_that_saw_them(shots, tmp_path):
    result = run(shots / "left", shots / "right", tmp_path / "new" / "rig.yaml")
    assert result.exit_code == 0, result.output
    rig = load_rig(tmp_path / "new" / "rig.yaml")
    assert rig.baseline == pytest.approx(0.12, rel=0.01)
    assert rig.left.fx == pytest.approx(246.4, rel=0.01)
    assert rig.sections["calibration"].pop("stereo_rms_px") < 0.15
    assert rig.sections["calibration"].pop("row_rms_px") < 0.1
    expected = {"pairs_used": 6, "pairs_given": 6, "board": "chessboard:9x6", "square_m": 0.025}
    assert rig.sections["calibration"] == expected
    assert "6 of 6" in result.output
    last = result.output.splitlines()[-1]
    assert "mount is not known yet" in last
    assert "beemap map RECORDING" in last


def test_the_same_images_give_the_same_bytes(shots, tmp_path):
    for name in ("a.yaml", "b.yaml"):
        assert run(shots / "left", shots / "right", tmp_path / name, "--quiet").output == ""
    assert (tmp_path / "a.yaml").read_bytes() == (tmp_path / "b.yaml").read_bytes()


def test_json_tells_of_every_pair(copy, tmp_path):
    (copy / "left" / "2.png").write_bytes(b"torn")
    cv2.imwrite(str(copy / "right" / "4.png"), np.full((240, 320), 90, np.uint8))
    (copy / "right" / "5.png").unlink()
    result = run(copy / "left", copy / "right", tmp_path / "rig.yaml", "--json")
    told = json.loads(result.stdout)
    assert (told["pairs_used"], told["pairs_given"]) == (3, 5)
    assert told["baseline_m"] == pytest.approx(0.12, rel=0.02)
    assert 0 < told["row_rms_px"] < told["stereo_rms_px"] < 0.2
    reasons = [pair["reason"] for pair in told["pairs"]]
    assert reasons == [None, None, "2.png cannot be read", None, "no whole board in 4.png"]
    assert [pair["left_rms_px"] is None for pair in told["pairs"]] == [bool(r) for r in reasons]
    assert [Path(path).name for path in told["unmatched"]] == ["5.png"]


def test_the_table_names_what_was_left_out(copy, tmp_path):
    (copy / "left" / "2.png").write_bytes(b"torn")
    (copy / "right" / "5.png").unlink()
    output = run(copy / "left", copy / "right", tmp_path / "rig.yaml").output
    assert "not used: 2.png cannot be read" in output
    assert f"no partner: {copy / 'left' / '5.png'}" in output


def test_a_replaced_rig_leaves_its_mount_and_encoders(shots, tmp_path):
    path = tmp_path / "rig.yaml"
    old = SMALL_RIG.with_mount(Mount(0.25, 0.1))
    save_rig(replace(old, sections={"encoders": {"track": 0.3}, "calibration": {"x": 1}}), path)
    assert "already exists: give --force" in refusal(run(shots / "left", shots / "right", path))
    result = run(shots / "left", shots / "right", path, "--force")
    assert "kept from the replaced file: mount, encoders" in result.output
    rig = load_rig(path)
    assert rig.mount is not None
    assert rig.mount.height == 0.25
    assert rig.sections["encoders"] == {"track": 0.3}
    assert "x" not in rig.sections["calibration"]


def test_a_broken_rig_is_not_replaced(shots, tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("beemap_rig: 1\nmount: {height: 0.2}\nlfet: 1\n")
    line = refusal(run(shots / "left", shots / "right", path, "--force"))
    assert "unknown field 'lfet'" in line
    assert "its mount would be lost" in line
    assert "lfet" in path.read_text()


def test_squares_given_for_corners_are_recognised(shots, tmp_path):
    result = run(shots / "left", shots / "right", tmp_path / "r.yaml", board="chessboard:10x7")
    assert "no chessboard:10x7 in any of 12 images" in refusal(result)
    assert "give --board chessboard:9x6" in refusal(result)
    assert not (tmp_path / "r.yaml").exists()


def test_no_board_at_all_says_what_was_tried(copy, tmp_path):
    for path in copy.glob("*/*.png"):
        cv2.imwrite(str(path), np.full((240, 320), 90, np.uint8))
    line = refusal(run(copy / "left", copy / "right", tmp_path / "r.yaml"))
    assert "no chessboard:9x6 in any of 12 images" in line
    assert "the whole board must be seen" in line


def test_two_pairs_are_too_few(copy, tmp_path):
    for number in range(4):
        (copy / "left" / f"{number}.png").write_bytes(b"torn")
    line = refusal(run(copy / "left", copy / "right", tmp_path / "r.yaml"))
    assert "only 2 of 6 pairs" in line
    assert "0.png cannot be read" in line


def test_no_readable_image(copy, tmp_path):
    for path in copy.glob("*/*.png"):
        path.write_bytes(b"torn")
    line = refusal(run(copy / "left", copy / "right", tmp_path / "r.yaml"))
    assert "none of the 12 images can be read" in line


def test_an_image_of_another_size_is_named(copy, tmp_path):
    path = copy / "right" / "3.png"
    image = cv2.imread(str(path))
    assert image is not None
    cv2.imwrite(str(path), cv2.resize(image, (640, 480)))
    line = refusal(run(copy / "left", copy / "right", tmp_path / "r.yaml"))
    assert line.startswith(f"{path}: 640x480 pixels, unlike the 320x240 of 11 others")


def test_swapped_folders_are_recognised(shots, tmp_path):
    line = refusal(run(shots / "right", shots / "left", tmp_path / "r.yaml"))
    assert "LEFT and RIGHT are swapped" in line


def test_a_folder_for_an_output_and_a_bare_number_for_a_length_are_refused(shots, tmp_path):
    left, right = shots / "left", shots / "right"
    assert "is a folder" in refusal(run(left, right, tmp_path))
    bare = run(left, right, tmp_path / "r.yaml", square="25")
    assert "give the unit, as in 25mm" in refusal(bare)
    (tmp_path / "file").touch()
    assert "cannot be made" in refusal(run(left, right, tmp_path / "file" / "r.yaml"))


@pytest.mark.skipif(not REAL_DATA, reason="BEEMAP_REAL_DATA is not set")
@pytest.mark.parametrize(
    ("name", "board", "square", "pairs", "rms", "baseline"),
    [
        ("opencv-sample", "chessboard:9x6", "25mm", 13, 0.196, (0.0829, 0.0839)),
        ("bumblebee2-chess", "chessboard:4x6", "30mm", 11, 0.09, (0.11965, 0.12045)),
        ("bumblebee2-chess", "chessboard:6x4", "3cm", 11, 0.09, (0.11965, 0.12045)),
    ],
)
def test_real_pairs(name, board, square, pairs, rms, baseline, tmp_path):
    folder = Path(REAL_DATA or "") / "calibration" / name
    result = run(
        folder / "left*",
        folder / "right*",
        tmp_path / "rig.yaml",
        "--json",
        board=board,
        square=square,
    )
    told = json.loads(result.stdout)
    assert told["pairs_used"] == told["pairs_given"] == pairs
    assert told["stereo_rms_px"] <= rms
    low, high = baseline
    assert low <= told["baseline_m"] <= high
