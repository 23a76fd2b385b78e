"""beemap doctor on a virtual rig: what is right passes, what is wrong is named with its remedy."""

from __future__ import annotations

import json

import pytest

from pipeline.doctor.cameras import camera_checks
from pipeline.doctor.machine import disk_check
from pipeline.doctor.watch import Watched, watch
from pipeline.live.devices import load_live_rig
from pipeline.settings import Settings
from tests.virtual_rigs import virtual_rig


def statuses(outcome) -> dict[str, dict]:
    return {check["name"]: check for check in json.loads(outcome.out)}


@pytest.fixture(scope="module")
def healthy(office_piece, tmp_path_factory):
    """The rig file, and what the doctor saw on it."""
    folder = tmp_path_factory.mktemp("doctor") / "rig"
    with virtual_rig(office_piece, folder, speed=2.0) as virtual:
        rig = load_live_rig(folder / "rig.yaml")
        seen = watch(rig, 2.5, Settings().odometry)
        assert virtual.timeline.seconds() > 0
        yield rig, seen


def test_a_healthy_rig_passes(office_piece, tmp_path, beemap):
    with virtual_rig(office_piece, tmp_path / "rig", speed=2.0):
        outcome = beemap("doctor", tmp_path / "rig" / "rig.yaml", "--seconds", "3", "--json")
    checks = statuses(outcome)
    names = ("rig file", "encoders", "direction", "cameras", "skew", "exposure", "calibration")
    assert {name: checks[name]["status"] for name in names} == dict.fromkeys(names, "PASS")
    assert "320x240" in checks["cameras"]["found"]
    assert {"mount", "disk", "processor"} <= set(checks)


def test_a_counter_that_falls_is_named(office_piece, tmp_path, beemap):
    with virtual_rig(office_piece, tmp_path / "rig", speed=2.0):
        rig = tmp_path / "rig" / "rig.yaml"
        text = rig.read_text().replace("reversed: [false, false]", "reversed: [true, false]")
        rig.write_text(text.replace("[320, 240]", "[640, 480]", 1))
        outcome = beemap("doctor", rig, "--seconds", "3", "--json")
    checks = statuses(outcome)
    assert outcome.code == 3
    assert checks["direction"]["status"] == "FAIL"
    assert "the left counter fell" in checks["direction"]["found"]
    assert "reversed: [false, false]" in checks["direction"]["remedy"]
    assert checks["calibration"]["status"] == "FAIL"
    assert "640x480, the cameras send 320x240" in checks["calibration"]["found"]


def test_devices_that_do_not_open_are_named_one_by_one(office_piece, tmp_path, beemap):
    with virtual_rig(office_piece, tmp_path / "rig"):
        rig = tmp_path / "rig" / "rig.yaml"
        text = rig.read_text().replace("left.mjpg", "none.mjpg").replace("ttyENC*", "ttyNONE")
        rig.write_text(text)
        outcome = beemap("doctor", rig, "--seconds", "1")
    assert outcome.code == 3
    lines = outcome.out.splitlines()
    assert any(line.startswith("FAIL  encoders") and "no such port" in line for line in lines)
    assert any(line.startswith("FAIL  cameras") and "404" in line for line in lines)


def test_late_right_images_are_a_skew(office_piece, tmp_path):
    with virtual_rig(office_piece, tmp_path / "rig", "skew@0s:15ms", speed=2.0):
        rig = load_live_rig(tmp_path / "rig" / "rig.yaml")
        seen = watch(rig, 2.0, Settings().odometry)
    (skew,) = [check for check in camera_checks(rig, seen) if check.name == "skew"]
    assert skew.status == "WARN"
    assert "+15.0 ms" in skew.found


def test_cameras_without_pairs_fail(healthy):
    rig, seen = healthy
    assert [check.status for check in camera_checks(rig, seen)] == ["PASS"] * 3
    (check,) = camera_checks(rig, Watched(1.0, cameras=seen.cameras))
    assert check.status == "FAIL"


def test_a_disk_is_judged_by_what_a_recording_needs(tmp_path):
    assert disk_check(tmp_path, 100_000.0, 10.0).status in ("PASS", "WARN")
    assert disk_check(tmp_path, 1e12, 1000.0).status == "FAIL"
    assert disk_check(tmp_path / "none", None, 10.0).status == "FAIL"


def test_a_broken_rig_file_fails_and_the_machine_is_looked_at_all_the_same(tmp_path, beemap):
    file = tmp_path / "rig.yaml"
    file.write_text("beemap_rig: 1\n")
    outcome = beemap("doctor", file, "--json")
    checks = statuses(outcome)
    assert outcome.code == 3
    assert checks["rig file"]["status"] == "FAIL"
    assert "names no devices" in checks["rig file"]["found"]
    assert checks["processor"]["found"]
