"""Images that cannot be stereo: named in words, skipped, and fatal only when nothing is left."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from pipeline.health.image_findings import image_findings
from stereo.pair_check import (
    BLACK,
    LEFT_COVERED,
    RIGHT_COVERED,
    SAME,
    SATURATED,
    check_pair,
)

# Every pair an observation, and little else to do.
EVERY_PAIR = ("mapping.spacing=0", "mapping.spacing_angle=0", "mapping.particles=10")
SETTINGS = [part for setting in EVERY_PAIR for part in ("--set", setting)]


@pytest.fixture
def scene() -> np.ndarray:
    """Something to see, (120, 160) grey levels about 120."""
    chance = np.random.default_rng(1)
    rough = chance.integers(40, 200, (15, 20)).astype(np.uint8)
    return cv2.resize(rough, (160, 120), interpolation=cv2.INTER_CUBIC)


def noisy(image: np.ndarray, seed: int) -> np.ndarray:
    chance = np.random.default_rng(seed)
    return np.clip(image + chance.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8)


def dark(shape, seed: int) -> np.ndarray:
    return noisy(np.full(shape, 2.0), seed)


def test_each_defect_is_recognised(scene):
    left, right = noisy(scene, 1), noisy(np.roll(scene, -4, axis=1), 2)
    white = np.full_like(scene, 255)
    finger = noisy(np.full(scene.shape, 70.0), 3)
    cases = {
        "": [(left, right), (noisy(scene, 1), noisy(scene, 2))],
        BLACK: [(dark(scene.shape, 3), dark(scene.shape, 4)), (0 * scene, 0 * scene)],
        SATURATED: [(white, white), (left, white), (white, right)],
        LEFT_COVERED: [(finger, right), (dark(scene.shape, 3), right)],
        RIGHT_COVERED: [(left, finger), (left, dark(scene.shape, 3))],
        SAME: [(left, left), (right, right.copy())],
    }
    for defect, pairs in cases.items():
        for number, (a, b) in enumerate(pairs):
            assert check_pair(a, b).defect == defect, (defect, number)
            colour = [cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in (a, b)]
            assert check_pair(*colour).defect == defect, (defect, number)


def test_twelve_bits_in_sixteen_are_as_bright_as_eight(scene):
    left, right = noisy(scene, 1), noisy(np.roll(scene, -4, axis=1), 2)
    eight = check_pair(left, right)
    twelve = check_pair(left.astype(np.uint16) * 16, right.astype(np.uint16) * 16)
    assert twelve.defect == eight.defect == ""
    assert twelve.brightness == pytest.approx(eight.brightness, abs=0.01)


def test_a_blank_wall_before_both_cameras_is_no_defect():
    wall = np.full((120, 160), 180.0)
    assert check_pair(noisy(wall, 1), noisy(wall, 2)).defect == ""


def test_unlike_exposure_is_told():
    assert image_findings({}, [1.0, 1.1, 0.9]) == []
    (found,) = image_findings({}, [0.5, 0.4, 0.45])
    assert "right images are 2.2 times as bright" in found.text
    assert "same exposure" in found.remedy


def images(recording) -> list[tuple]:
    """Files (left, right) of each pair."""
    folders = [sorted((recording / "mav0" / cam / "data").iterdir()) for cam in ("cam0", "cam1")]
    return list(zip(*folders, strict=True))


def write(file, image: np.ndarray) -> None:
    assert cv2.imwrite(str(file), image, [cv2.IMWRITE_JPEG_QUALITY, 95])


def read(file) -> np.ndarray:
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return image


def spoil(pair, kind: str) -> None:
    left, right = pair
    shape = read(left).shape
    if kind == SAME:
        right.write_bytes(left.read_bytes())
    elif kind == LEFT_COVERED:
        write(left, dark(shape, 5))
    elif kind == RIGHT_COVERED:
        write(right, noisy(np.full(shape, 60.0), 5))
    else:
        for side, file in enumerate(pair):
            write(file, np.full(shape, 255, np.uint8) if kind == SATURATED else dark(shape, side))


def test_spoilt_pairs_are_skipped_counted_and_told(office, beemap, tmp_path):
    pairs = images(office)
    kinds = (BLACK, SATURATED, LEFT_COVERED, RIGHT_COVERED, SAME)
    for number, kind in enumerate(kinds):
        for pair in pairs[10 + 4 * number : 12 + 4 * number]:
            spoil(pair, kind)
    write(pairs[35][0], read(pairs[35][0])[::2, ::2].copy())
    run = tmp_path / "run"
    outcome = beemap("map", office, "-o", run, "--motion", "poses", *SETTINGS)
    assert outcome.code == 0, outcome.err
    facts = json.loads((run / "run.json").read_text())
    assert facts["counts"]["useless pairs"] == 2 * len(kinds)
    assert facts["counts"]["observations"] == len(pairs) - 2 * len(kinds) - 1
    for kind in kinds:
        assert len(facts["skipped"][kind]) == 2
        (line,) = [line for line in facts["health"] if line.startswith(f"{kind} in 2 pairs")]
        assert f"health: {line}" in outcome.out
        side = pairs[10 + 4 * kinds.index(kind)][kind == RIGHT_COVERED]
        assert side.name in line
    (line,) = [line for line in facts["health"] if "could not be used" in line]
    assert line.startswith("1 pair could not be used")
    assert "160x120, the rig is calibrated for 320x240" in line


@pytest.mark.parametrize("kind", [BLACK, SAME])
def test_nothing_left_to_work_on_is_an_error_in_words(kind, office, refused, tmp_path):
    for pair in images(office):
        spoil(pair, kind)
    line = refused("map", office, "-o", tmp_path / "run", "--motion", "poses", "--quiet")
    assert f"none of 40 pairs could be used: {kind}" in line
    assert ("lens caps" if kind == BLACK else "recorded twice") in line
    assert not (tmp_path / "run").exists()


def test_cameras_that_were_never_calibrated_together_are_refused(office, refused, tmp_path):
    rig = tmp_path / "rig.yaml"
    rig.write_text(
        "beemap_rig: 1\nimage_size: [320, 240]\n"
        "left: {fx: 246.4, fy: 246.4, cx: 159.5, cy: 119.5}\n"
        "right: {fx: 246.4, fy: 246.4, cx: 159.5, cy: 119.5}\n"
    )
    line = refused("map", office, "-o", tmp_path / "run", "--rig", rig, "--quiet")
    assert "rig.yaml" in line
    assert "'R'" in line or "R" in line.split()
