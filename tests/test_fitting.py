"""What the input decides where the user does not: the cells by camera and speed, the body."""

from __future__ import annotations

import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from calibration.rig import CameraModel, StereoRig, minibee
from mapping.settings import MappingSettings
from pipeline.fitting import CELLS, fitting_cell, travel_between_pairs
from pipeline.recordings import open_recording
from pipeline.rig import choose_rig
from pipeline.settings import Settings, defaults_as_yaml, load_settings
from stereo.ranger import StereoRanger

CAR = StereoRig(
    (1226, 370),
    CameraModel(707.0, 707.0, 601.0, 183.0),
    CameraModel(707.0, 707.0, 601.0, 183.0),
    np.eye(3),
    np.array([-0.54, 0.0, 0.0]),
    rectified=True,
)


@pytest.mark.parametrize("rig", [minibee(), minibee().scaled(0.5), minibee().scaled(0.25), CAR])
@pytest.mark.parametrize("travel", [None, 0.0, 0.05, 0.17])
def test_a_robot_at_the_pace_of_the_map_has_the_usual_cells(rig, travel):
    assert fitting_cell(rig, Settings(), travel)[0] == 0.05


def test_faster_ones_get_cells_with_which_the_camera_sees_far_enough():
    cells = [fitting_cell(CAR, Settings(), travel)[0] for travel in np.arange(0.2, 6.0, 0.2)]
    assert cells == sorted(cells)
    assert cells[0] == 0.05
    assert set(cells) > {0.05, 0.1, 0.2}
    for travel in (0.8, 1.2, 1.6, 2.4):
        cell, why = fitting_cell(CAR, Settings(), travel)
        # As far as the stage of stereo looks with such cells.
        far = StereoRanger(CAR, usable_sigma=2.0 * cell).max_range
        assert far > 10 * travel
        assert f"{travel:.2f} m from pair to pair" in why
        smaller = CELLS[max(0, CELLS.index(cell) - 1)]
        if smaller < cell:
            near = CAR.left.fx * CAR.baseline / 256
            assert StereoRanger(CAR, usable_sigma=2.0 * smaller).max_range - near < 10 * travel


def test_a_range_that_is_set_is_not_widened_by_larger_cells():
    settings = Settings(mapping=MappingSettings(max_range=6.0))
    assert fitting_cell(CAR, settings, 1.2)[0] == 0.05


def test_the_way_between_pairs_is_measured_by_wheels_and_images_alike(office_piece):
    recording = open_recording(office_piece)
    rig, _ = choose_rig(recording, None)
    wheels, images = recording, replace(recording, ticks=None)
    found = [
        travel_between_pairs(given, rig, motion, Settings(), 1)
        for given, motion in ((wheels, "fused"), (images, "visual"), (images, "poses"))
    ]
    assert found == pytest.approx([found[2]] * 3, rel=0.15)
    one = replace(recording, pairs=recording.pairs[:1])
    assert travel_between_pairs(one, rig, None, Settings(), 1) is None


def test_null_leaves_the_choice_to_the_input_and_a_run_says_what_it_was(
    beemap, office_piece, office_run, tmp_path
):
    facts = json.loads((office_run / "run.json").read_text())
    assert facts["request"]["chosen"]["mapping.cell"].startswith("0.05 m: ")
    settings = load_settings(office_run / "settings.yaml").mapping
    assert (settings.cell, settings.footprint) == (0.05, 0.15)
    assert facts["request"]["chosen"]["mapping.cell"] in (office_run / "report.html").read_text()

    (tmp_path / "all.yaml").write_text(defaults_as_yaml())
    assert load_settings(tmp_path / "all.yaml") == Settings()
    words = ("--settings", tmp_path / "all.yaml", "--set", "mapping.particles=1")
    run = beemap("map", office_piece, "-o", tmp_path / "run", *words)
    assert "mapping.cell: 0.05 m: " in run.err
    run = beemap("map", office_piece, "-o", tmp_path / "b", *words, "--set", "mapping.cell=0.1")
    assert "mapping.cell" not in run.err
    assert load_settings(tmp_path / "b" / "settings.yaml").mapping.cell == 0.1
    # A run that begins in that map takes its cells.
    words = (*words, "--continue", tmp_path / "b", "--pose", "0,0,0")
    run = beemap("map", office_piece, "-o", tmp_path / "c", *words)
    assert "mapping.cell: 0.1 m: the cells of the map" in run.err


def test_what_was_mapped_while_it_was_recorded_is_mapped_so_again(office_piece, tmp_path):
    import shutil

    folder = tmp_path / "again"
    shutil.copytree(office_piece, folder)
    for text, cell in (('{"cell": 0.1}', 0.1), ('{"cell": -1}', None), ("{", None), ("[]", None)):
        (folder / "meta.json").write_text(text)
        assert open_recording(folder).cell == cell
    assert msgspec.structs.replace(MappingSettings(), cell=0.1).cell == 0.1
