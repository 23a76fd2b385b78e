"""`beemap calibrate cameras`, from image files to rig.yaml, with good and bad input."""

import json
import os
import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from calibration.rig import Mount, load_rig, save_rig
from pipeline.cli import main
from pipeline.commands.calibrate import calibrate
from tests.calibration_views import BOARD, SMALL_RIG, board_poses, render

REAL_DATA = os.environ.get("BEEMAP_REAL_DATA")
needs_real_data = pytest.mark.skipif(not REAL_DATA, reason="BEEMAP_REAL_DATA is not set")


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    """What was found in images is kept for this file's tests alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def shots(tmp_path_factory) -> Path:
    """Folders left and right with six drawn views of the board."""
    folder = tmp_path_factory.mktemp("shots")
    for number, pose in enumerate(board_poses(6, seed=11, distance=(0.36, 0.46))):
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


def run(
    left, right, output, *options, board="chessboard:9x6", square="25mm", lens="radtan4"
) -> Result:
    """Calibrate, with the lens given for speed and without a report."""
    images = [str(left)] if right is None else [str(left), str(right)]
    given = ["--board", board, "--square", square, "-o", str(output), "--lens", lens]
    return CliRunner().invoke(calibrate, ["cameras", *images, *given, "--no-report", *options])


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
    result = run(shots / "left", shots / "right", tmp_path / "new" / "rig.yaml", lens="auto")
    assert result.exit_code == 0, result.output
    rig = load_rig(tmp_path / "new" / "rig.yaml")
    assert rig.baseline == pytest.approx(0.12, rel=0.01)
    assert rig.left.fx == pytest.approx(246.4, rel=0.01)
    told = rig.sections["calibration"]
    assert told.pop("stereo_rms_px") < 0.15
    assert told.pop("heldout_row_rms_px") < 0.15
    assert 0 < told.pop("sigma")["translation.x"] < 1e-3
    newest = max(path.stat().st_mtime for path in shots.glob("*/*.png"))
    assert told.pop("date") == datetime.fromtimestamp(newest, UTC).date().isoformat()
    assert told.pop("corners_rejected") <= 2
    assert told == {
        "verdict": "excellent",
        "pairs_used": 6,
        "pairs_given": 6,
        "lens": "radtan4",
        "board": "chessboard:9x6",
        "square_m": 0.025,
    }
    lines = result.output.splitlines()
    assert any("6 of 6" in line for line in lines)
    (verdict,) = [line for line in lines if line.startswith("verdict: ")]
    assert verdict.startswith("verdict: excellent, held-out rows 0.")
    (action,) = [line for line in lines if line.startswith("next: ")]
    assert action.startswith("next: take at least 4 more pairs: tilted views")


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
    assert 0 < told["heldout_row_rms_px"] < 0.5
    assert 0 < told["stereo_rms_px"] < 0.2
    assert told["verdict"] in ("excellent", "good", "usable")
    assert told["next_action"].startswith("take at least 7 more pairs")
    assert told["corners"] == 3 * 2 * 54
    assert 0 <= told["corners_rejected"] <= 6
    assert [row["distance_m"] for row in told["depth"]] == [0.5, 1, 2, 3, 5, 8]
    assert len(told["sigma"]) == 22
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
    assert "mount, encoders of the replaced file" in result.output
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


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--baseline", "12", "--baseline '12': give the unit, as in 12mm"),
        ("--baseline", "12km", "--baseline '12km': unknown unit 'km'"),
        ("--marker", "20mm", "--marker: chessboard:9x6 has no markers"),
    ],
)
def test_options_that_make_no_sense_are_refused(option, value, told, shots, tmp_path):
    line = refusal(run(shots / "left", shots / "right", tmp_path / "r.yaml", option, value))
    assert line.startswith(told)


def test_a_ruler_checks_the_squares(shots, tmp_path):
    told = json.loads(
        run(
            shots / "left", shots / "right", tmp_path / "a.yaml", "--json", "--baseline", "121mm"
        ).stdout
    )
    assert told["ruler"]["agrees"]
    result = run(shots / "left", shots / "right", tmp_path / "b.yaml", "--baseline", "100mm")
    (action,) = [line for line in result.output.splitlines() if line.startswith("next: ")]
    assert "the squares are probably 20." in action
    assert "measure the board again" in action


def test_a_wrong_unit_is_pointed_out(shots, tmp_path):
    result = run(shots / "left", shots / "right", tmp_path / "r.yaml", square="25cm")
    assert "next: check the unit of --square: with 250 mm the board is larger" in result.output


def test_a_calibration_to_make_again_is_written_and_ends_with_code_3(copy, tmp_path):
    # Pairs whose right images are shifted by a few rows, each otherwise: no rig fits them.
    for number, rows in enumerate((4, -4, 3, -3, 5, -5)):
        path = copy / "right" / f"{number}.png"
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        cv2.imwrite(str(path), np.roll(image, rows, axis=0))
    result = run(copy / "left", copy / "right", tmp_path / "rig.yaml", "--json")
    assert result.exit_code == 3
    told = json.loads(result.stdout)
    assert told["verdict"] == "redo"
    assert told["heldout_row_rms_px"] > 0.5
    assert told["next_action"].startswith("synchronise the cameras")
    assert load_rig(tmp_path / "rig.yaml").sections["calibration"]["verdict"] == "redo"


def test_a_shifted_image_is_named_and_left_out(copy, tmp_path):
    path = copy / "left" / "3.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(path), np.roll(image, (3, 2), axis=(0, 1)))
    result = run(copy / "left", copy / "right", tmp_path / "rig.yaml", "--json")
    told = json.loads(result.stdout)
    assert told["next_action"].startswith("drop pair 3: its images miss each other by")
    assert (told["pairs_used"], told["pairs_given"]) == (5, 6)
    (bad,) = [pair for pair in told["pairs"] if not pair["used"]]
    assert bad["name"] == "3"
    assert bad["reason"] is None
    assert "miss each other" in bad["fault"]
    text = run(copy / "left", copy / "right", tmp_path / "again.yaml").output
    assert "not used: its images miss each other" in text


def test_blurred_images_and_small_boards_are_remarked(copy, tmp_path):
    path = copy / "right" / "1.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(path), cv2.GaussianBlur(image, (0, 0), 2.0))
    result = run(copy / "left", copy / "right", tmp_path / "rig.yaml", "--json")
    remarks = [pair["remarks"] for pair in json.loads(result.stdout)["pairs"]]
    assert any("right image blurred" in remark for remark in remarks[1])
    assert not any("blurred" in remark for said in remarks[2:] for remark in said)


def test_parallel_boards_are_refused(tmp_path):
    straight = np.eye(3)
    for number, z in enumerate((0.36, 0.4, 0.44, 0.48)):
        t = np.array([0.06, 0.01 * number, z]) - BOARD.points.mean(axis=0)
        for side, image in zip(("left", "right"), render(SMALL_RIG, (straight, t)), strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), image)
    line = refusal(run(tmp_path / "left", tmp_path / "right", tmp_path / "r.yaml"))
    assert "do not determine the cameras (all boards stand parallel" in line
    assert not (tmp_path / "r.yaml").exists()


def test_one_argument_may_be_the_folder_of_both_sides_or_side_by_side_images(shots, tmp_path):
    beside = tmp_path / "beside"
    beside.mkdir()
    for left in sorted((shots / "left").iterdir()):
        both = [cv2.imread(str(p)) for p in (left, shots / "right" / left.name)]
        cv2.imwrite(
            str(beside / left.name), np.hstack([image for image in both if image is not None])
        )
    rigs = []
    for number, source in enumerate((shots, beside)):
        result = run(source, None, tmp_path / f"{number}.yaml", "--quiet")
        assert result.exit_code == 0, result.output
        rigs.append(load_rig(tmp_path / f"{number}.yaml"))
    assert rigs[0].T.tolist() == rigs[1].T.tolist()
    assert rigs[0].left == rigs[1].left


def test_a_chosen_lens_is_used(shots, tmp_path):
    result = run(shots / "left", shots / "right", tmp_path / "r.yaml", lens="radtan5")
    assert "radtan5" in result.output
    assert len(load_rig(tmp_path / "r.yaml").left.distortion) == 5


# --- real pairs


@needs_real_data
@pytest.mark.parametrize(
    ("name", "board", "square", "pairs", "rms", "rows", "baseline"),
    [
        ("opencv-sample", "chessboard:9x6", "25mm", 13, 0.196, 0.142, (0.0829, 0.0839)),
        ("bumblebee2-chess", "chessboard:4x6", "30mm", 11, 0.09, 0.07, (0.11965, 0.12045)),
        ("bumblebee2-chess", "chessboard:6x4", "3cm", 11, 0.09, 0.07, (0.11965, 0.12045)),
    ],
)
def test_real_pairs(name, board, square, pairs, rms, rows, baseline, tmp_path):
    folder = Path(REAL_DATA or "") / "calibration" / name
    result = run(
        folder / "left*",
        folder / "right*",
        tmp_path / "rig.yaml",
        "--json",
        board=board,
        square=square,
        lens="auto",
    )
    told = json.loads(result.stdout)
    assert told["pairs_used"] == told["pairs_given"] == pairs
    assert told["stereo_rms_px"] <= rms
    assert told["heldout_row_rms_px"] <= rows
    assert told["verdict"] == "excellent"
    assert not any(pair["fault"] for pair in told["pairs"])
    low, high = baseline
    assert low <= told["baseline_m"] <= high
    (rational,) = [trial for trial in told["lens_trials"] if trial["lens"] == "rational"]
    assert not rational["chosen"]
    assert rational["stereo_rms_px"] < told["stereo_rms_px"]
    assert rational["heldout_row_rms_px"] > told["heldout_row_rms_px"]
    assert "over-fitting" in rational["remark"]


@needs_real_data
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_real_image_shifted_on_purpose_is_named(side, tmp_path):
    folder = Path(REAL_DATA or "") / "calibration" / "opencv-sample"
    for path in folder.glob("*t[01]?.jpg"):
        shutil.copy(path, tmp_path)
    path = tmp_path / f"{side}05.jpg"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(path.with_suffix(".png")), np.roll(image, (2, -3), axis=(0, 1)))
    path.unlink()
    told = json.loads(
        run(tmp_path / "left*", tmp_path / "right*", tmp_path / "rig.yaml", "--json").stdout
    )
    assert told["pairs_given"] == 13
    assert told["next_action"].startswith("drop pair 05: ")
    assert told["verdict"] == "excellent"
