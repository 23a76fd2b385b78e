"""Pairs of a board taken by themselves: still, sharp, new ones; until there are enough."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.board_capture import BoardCapture
from stereo.pair import StereoPair
from tests.calibration_views import (
    BOARD,
    SMALL_RIG,
    Photograph,
    board_poses,
    poses_in_view,
    render,
)

BLANK = np.full((240, 320), 120, np.uint8)


def pair(pose, blur: float = 0.6) -> StereoPair:
    return StereoPair(0, *render(SMALL_RIG, pose, how=Photograph(blur=blur)))


@pytest.fixture(scope="module")
def views() -> list[StereoPair]:
    return [pair(pose) for pose in poses_in_view(SMALL_RIG, 24, 5)]


def test_a_view_is_kept_once_and_only_when_it_stands_still(views):
    watching = BoardCapture(BOARD)
    looks = [watching.look(view).why for view in (views[0], views[0], views[0], views[1])]
    assert looks == ["hold it still", "kept", "seen already", "hold it still"]
    assert watching.look(views[1]).kept
    assert len(watching.kept) == 2


def test_images_without_a_board_and_blurred_ones_are_named(views):
    watching = BoardCapture(BOARD)
    lonely = StereoPair(0, views[0].left, BLANK)
    assert watching.look(lonely).why == "no board in the right image"
    assert watching.look(StereoPair(0, BLANK, BLANK)).why == (
        "no board in the left and the right image"
    )
    soft = pair(board_poses(1, 3)[0], blur=3.0)
    whys = [watching.look(soft).why for _ in range(2)]
    assert whys[1].startswith("blurred")
    assert not watching.kept


def test_what_is_missing_shrinks_until_it_is_enough(views):
    watching = BoardCapture(BOARD)
    assert watching.wanted() == ["show the board to both cameras"]
    first = None
    for view in views:
        watching.look(view)
        watching.look(view)
        first = first or watching.bars()
        if not watching.wanted():
            break
    last = watching.bars()
    assert first is not None
    assert all(last[name] >= first[name] for name in first)
    assert last["pairs"] == 1.0
    assert last["tilt"] >= 0.75
    assert len(watching.kept) >= 12


def test_one_place_alone_is_not_enough():
    watching = BoardCapture(BOARD)
    pose = board_poses(1, 3)[0]
    for _ in range(4):
        watching.look(pair(pose))
    assert len(watching.kept) == 1
    (first, *_) = watching.wanted()
    assert "nearer" in first or "upper" in first or "lower" in first
    assert watching.bars()["tilt"] < 1.0


def test_a_folder_in_use_and_a_rig_without_cameras_are_refused(tmp_path, refused):
    board = ("--board", BOARD.name, "--square", "25mm")
    rig = tmp_path / "rig.yaml"
    rig.write_text("beemap_rig: 1\ndevices: {encoders: /dev/ttyUSB0}\n")
    assert "names no camera" in refused("calibrate", "capture", rig, "-o", tmp_path / "x", *board)
    rig.write_text("beemap_rig: 1\ndevices: {left: /dev/video70, right: /dev/video71}\n")
    assert "/dev/video70: no such camera" in refused(
        "calibrate", "capture", rig, "-o", tmp_path / "y", *board
    )
    assert "already exists" in refused("calibrate", "capture", rig, "-o", tmp_path, *board)
    # What could not begin leaves nothing that is in the way.
    assert "/dev/video70" in refused("calibrate", "capture", rig, "-o", tmp_path / "y", *board)


def test_options_are_checked_before_anybody_holds_a_board(tmp_path, refused):
    rig = tmp_path / "rig.yaml"
    rig.write_text("beemap_rig: 1\ndevices: {left: /dev/video70, right: /dev/video71}\n")
    words = ("calibrate", "capture", rig, "-o", tmp_path / "x", "--board", BOARD.name)
    words += ("--square", "25mm")
    assert "--port: belongs to --web" in refused(*words, "--port", "8000")
    assert "--baseline '84'" in refused(*words, "--baseline", "84")
