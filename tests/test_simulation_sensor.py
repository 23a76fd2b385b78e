"""Each fault of the sensors, switched on alone, against its own law."""

from __future__ import annotations

import math

import cv2
import msgspec
import numpy as np
import pytest

from calibration.rig import minibee
from simulation.faults import CAMERAS, CameraFaults, FaultError, with_faults
from simulation.rigs import bent_minibee
from simulation.sensor import LightPair, Sensor
from simulation.shading import GAMMA

RIG = minibee().scaled(0.25)
SHAPE = (120, 160)
QUIET = CameraFaults(noise=0.0)


def flat(value: float) -> LightPair:
    return LightPair(np.full(SHAPE, value, np.float32), np.full(SHAPE, value, np.float32))


def linear(grey: np.ndarray) -> np.ndarray:
    """Light of grey levels: the tone curve undone."""
    return (np.asarray(grey, float) / 255.0) ** GAMMA


def exposed(light: LightPair, faults: CameraFaults, seed: int = 1, frame: int = 0):
    return Sensor(RIG, faults).expose(light, seed, frame)


def test_without_faults_the_images_are_the_light():
    left, right = exposed(flat(0.2), QUIET)
    assert (left == right).all()
    assert (left == round(255.0 * 0.2 ** (1.0 / GAMMA))).all()


@pytest.mark.parametrize("name", ["exposure", "gain"])
def test_exposure_and_gain_shift_one_camera_by_their_factor_in_light(name):
    left, right = exposed(flat(0.2), msgspec.structs.replace(QUIET, **{f"{name}_left": 1.3}))
    assert linear(left).mean() == pytest.approx(0.26, rel=0.01)
    assert linear(right).mean() == pytest.approx(0.2, rel=0.01)
    left, right = exposed(flat(0.2), msgspec.structs.replace(QUIET, **{f"{name}_right": 0.7}))
    assert linear(left).mean() == pytest.approx(0.2, rel=0.01)
    assert linear(right).mean() == pytest.approx(0.14, rel=0.01)


def test_too_much_light_is_white():
    left, right = exposed(flat(0.9), CameraFaults(exposure_left=1.5))
    assert (left == 255).all()
    assert (right < 255).any()


@pytest.mark.parametrize("strength", [0.5, 1.0, 2.0])
def test_vignetting_is_the_fourth_power_of_the_cosine(strength):
    sensor = Sensor(RIG, msgspec.structs.replace(QUIET, vignetting=strength))
    light = linear(sensor.noise_free(flat(0.5).left, 0))
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    radius = np.hypot(u - RIG.left.cx, v - RIG.left.cy) / RIG.left.fx
    law = np.cos(np.arctan(radius)) ** (4.0 * strength)
    np.testing.assert_allclose(light, 0.5 * law, rtol=1e-4)
    assert light[0, 0] < 0.8 * light[60, 80]


def test_vignetting_keeps_to_the_bent_camera_it_belongs_to():
    sensor = Sensor(bent_minibee(0.25), msgspec.structs.replace(QUIET, vignetting=1.0))
    left, right = (sensor.noise_free(flat(0.5).left, camera) for camera in (0, 1))
    assert left.max() == pytest.approx(right.max(), abs=0.1)
    assert 0.005 < np.abs(left - right).max() < 2.0


@pytest.mark.parametrize("light", [0.03, 0.1, 0.3, 0.7])
@pytest.mark.parametrize(("noise", "gain"), [(1.0, 1.0), (3.0, 1.0), (1.0, 1.3)])
def test_noise_has_the_stated_deviation_in_light(light, noise, gain):
    faults = CameraFaults(noise=noise, gain_left=gain)
    left, right = exposed(flat(light), faults)
    stated = float(Sensor(RIG, faults).noise_sigma(np.array(light)))
    slope = gain * light / GAMMA  # d light / d grey is the light times GAMMA / grey
    rounding = 255.0 * (gain * light) ** (1.0 / GAMMA)
    levels = math.hypot(gain * stated * rounding / (slope * GAMMA**2), math.sqrt(1.0 / 12.0))
    assert left.std() == pytest.approx(levels, rel=0.04)
    assert linear(left).mean() == pytest.approx(gain * light, rel=0.01)
    correlation = np.corrcoef(left.ravel(), right.ravel())[0, 1]
    assert abs(correlation) < 0.04


def test_plain_noise_is_near_two_grey_levels_from_dark_to_bright():
    levels = [exposed(flat(light), CameraFaults())[0].std() for light in (0.03, 0.1, 0.3, 0.7)]
    assert 1.5 < min(levels) < max(levels) < 2.1


def test_noise_is_keyed_by_seed_and_frame():
    first, again = (exposed(flat(0.3), CameraFaults(), 1, 7) for _ in range(2))
    assert (first[0] == again[0]).all()
    assert (first[1] == again[1]).all()
    for seed, frame in ((2, 7), (1, 8)):
        assert (exposed(flat(0.3), CameraFaults(), seed, frame)[0] != first[0]).mean() > 0.5


def test_defocus_widens_an_edge_by_its_deviation():
    light = flat(0.1)
    light.left[:, 80:] = 0.6
    sensor = Sensor(RIG, msgspec.structs.replace(QUIET, defocus=2.5))
    profile = np.diff(linear(sensor.noise_free(light.left, 0))[60])
    column = np.arange(profile.size)
    mean = (profile * column).sum() / profile.sum()
    deviation = math.sqrt((profile * (column - mean) ** 2).sum() / profile.sum())
    assert mean == pytest.approx(79.0, abs=0.01)
    assert deviation == pytest.approx(2.5, rel=0.03)


def test_jpeg_leaves_blocks_but_not_another_brightness():
    light = flat(0.1)
    light.left[:] = np.random.default_rng(0).uniform(0.05, 0.6, SHAPE).astype(np.float32)
    clean = exposed(light, QUIET)[0]
    before = 0.0
    for quality in (95, 85, 40):
        image = exposed(light, msgspec.structs.replace(QUIET, jpeg=quality))[0]
        again = cv2.imencode(".jpg", clean, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        assert (image == cv2.imdecode(again, cv2.IMREAD_GRAYSCALE)).all()
        off = np.abs(image.astype(float) - clean).mean()
        assert off > before + 0.5
        assert image.mean() == pytest.approx(clean.mean(), abs=0.5)
        before = off


def test_faults_are_read_from_text():
    faults = with_faults(CAMERAS["cheap"], ["noise=0", " shutter = 1e-2 ", "jpeg=70"])
    assert faults == msgspec.structs.replace(CAMERAS["cheap"], noise=0.0, shutter=0.01, jpeg=70)
    assert with_faults(CAMERAS["plain"], []) == CameraFaults()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("blur=3", r"blur=3.*known: .*shutter"),
        ("shutter", r"NAME=VALUE"),
        ("shutter=long", r"shutter is 'long': give a number"),
        ("jpeg=8.5", r"jpeg is '8.5': give a whole number"),
        ("shutter=10", r"shutter is 10.0: give 0 to 0.5 s"),
        ("vignetting=-1", r"vignetting is -1.0: give 0 to 4 "),
        ("noise=nan", r"noise is nan: give 0 to 50"),
        ("jpeg=101", r"jpeg is 101: give 0 to 100 %"),
    ],
)
def test_a_wrong_fault_is_named(text, told):
    with pytest.raises(FaultError, match=told):
        with_faults(CameraFaults(), [text])
    with pytest.raises(FaultError, match="skew"):
        CameraFaults(skew=2.0)
