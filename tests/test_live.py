"""Recording and mapping live, from a virtual rig on loopback and a pseudo-terminal."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pipeline.checkpoint import NOTHING
from pipeline.live import mapping_thread
from pipeline.live.devices import load_live_rig
from pipeline.live.live_run import LiveOptions, begin_output, live_run
from pipeline.live.record_run import record_run
from pipeline.recordings import open_recording
from pipeline.settings import load_settings
from pipeline.watcher import NOBODY, Watcher
from tests.virtual_rigs import virtual_rig

SETTINGS = ("odometry.max_speed=100", "mapping.particles=20")
RESULTS = (
    "map.npz",
    "map.pgm",
    "map.yaml",
    "map.png",
    "trajectory.tum",
    "online.tum",
    "health.csv",
)


def images(recording: Path, camera: str) -> list[bytes]:
    files = sorted((recording / "mav0" / camera / "data").iterdir(), key=lambda f: int(f.stem))
    return [file.read_bytes() for file in files]


def record_all(rig, folder: Path, virtual) -> dict:
    """Record until the virtual drive is over."""
    believed = load_settings(None, SETTINGS).odometry
    return record_run(load_live_rig(rig), folder, virtual.timeline.finished, believed)


def live_all(
    rig, output: Path, virtual, motion: str = "fused", watcher: Watcher = NOBODY, **options
):
    settings = load_settings(None, SETTINGS)
    facts = {"motion": motion}
    wanted = LiveOptions(
        settings,
        seed=1,
        stop=virtual.timeline.finished,
        motion=motion,
        facts=facts,
        opened=lambda: begin_output(output, {}) or NOTHING,
        watcher=watcher,
    )
    return live_run(load_live_rig(rig), output, output / "recording", wanted, **options)


@pytest.mark.parametrize("protocol", ["stream", "arduino_bridge", "roboclaw", "odrive"])
def test_a_recording_holds_the_bytes_that_the_cameras_sent(office_piece, tmp_path, protocol):
    with virtual_rig(office_piece, tmp_path / "rig", protocol=protocol) as virtual:
        report = record_all(tmp_path / "rig" / "rig.yaml", tmp_path / "rec", virtual)
    assert report["recorded"]["dropped"] == 0
    for camera in ("cam0", "cam1"):
        sent, kept = images(office_piece, camera), images(tmp_path / "rec", camera)
        # Where the drive ends the robot stands and its cameras go on.
        assert kept[: len(sent)] == sent
        assert set(kept[len(sent) :]) <= {sent[-1]}
    recording = open_recording(tmp_path / "rec")
    assert recording.skipped == {}
    assert recording.rig is not None
    assert recording.rig.mount is not None
    assert recording.ticks is not None
    source = open_recording(office_piece).ticks
    assert source is not None
    assert np.ptp(recording.ticks.left) == pytest.approx(np.ptp(source.left), rel=0.05)
    assert (tmp_path / "rec" / "mav0" / "odom0" / "serial.log").stat().st_size > 100


def test_a_live_map_is_that_of_its_recording_whoever_looks_on(office_piece, tmp_path, beemap):
    pytest.importorskip("uvicorn", reason="the extra 'web' is not installed")
    from pipeline.web.run_page import RunPage
    from pipeline.web.server import WebServer
    from tests.web_viewers import Onlooker

    poses, maps = [], []
    page = RunPage("run", tmp_path / "run", threading.Event())
    with (
        virtual_rig(office_piece, tmp_path / "rig", speed=5.0) as virtual,
        WebServer(page, None, 0, print) as server,
    ):
        onlookers = [Onlooker(server.url), Onlooker(server.url)]
        summary = live_all(
            tmp_path / "rig" / "rig.yaml",
            tmp_path / "run",
            virtual,
            watcher=page.state,
            on_pose=poses.append,
            on_map=maps.append,
        )
    for onlooker in onlookers:
        onlooker.join()
        assert {"picture", "depth", "local", "map", "path", "pose"} <= set(onlooker.topics)
        pictures = onlooker.topics["picture"]
        sent = set(images(tmp_path / "run" / "recording", "cam0"))
        assert {p.blob[p.values["columns"] :] for p in pictures} <= sent
        assert onlooker.topics["run"][-1].values["phase"] == "ended"
    assert summary["pairs_skipped"] == 0
    assert summary["local_maps"] >= 3
    assert len(poses) == summary["counts"]["pairs used"]
    assert all(a.stamp < b.stamp for a, b in pairwise(poses))
    assert maps
    assert maps[-1].file == tmp_path / "run" / "map.yaml"
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "image to pose" in page
    assert page.count("data:image/jpeg") >= 2  # from the recording that was made meanwhile
    offline = beemap(
        "map", tmp_path / "run" / "recording", "-o", tmp_path / "again", "--quiet",
        "--settings", tmp_path / "run" / "settings.yaml",
    )  # fmt: skip
    assert offline.code == 0, offline.err
    for name in RESULTS:
        live, again = ((tmp_path / run / name).read_bytes() for run in ("run", "again"))
        assert live == again, name


@pytest.mark.parametrize("motion", ["visual", "fused"])
def test_a_live_map_with_motion_from_the_images(
    office_piece, tmp_path, beemap, motion, monkeypatch
):
    # What is asked is whether the maps are alike, not whether this machine keeps up.
    monkeypatch.setattr(mapping_thread, "WAITING", 1000)
    with virtual_rig(office_piece, tmp_path / "rig", speed=4.0) as virtual:
        rig = tmp_path / "rig" / "rig.yaml"
        if motion == "visual":
            text = rig.read_text()
            kept = [line for line in text.splitlines() if "protocol" not in line]
            kept = [line for line in kept if not line.lstrip().startswith(("encoders: /", "baud"))]
            rig.write_text("\n".join(kept) + "\n")
            assert load_live_rig(rig).parameters is None
        summary = live_all(rig, tmp_path / "run", virtual, motion=motion)
    assert summary["pairs_skipped"] == 0
    assert summary["counts"]["pairs used"] >= 40
    assert summary["odometry"]["visual_pairs"] >= 40
    assert (motion == "fused") == ("steps_fused" in summary["odometry"])
    offline = beemap(
        "map", tmp_path / "run" / "recording", "-o", tmp_path / "again", "--quiet",
        "--settings", tmp_path / "run" / "settings.yaml", "--motion", motion,
    )  # fmt: skip
    assert offline.code == 0, offline.err
    for name in RESULTS:
        live, again = ((tmp_path / run / name).read_bytes() for run in ("run", "again"))
        assert live == again, name


def test_a_cable_pulled_in_the_middle_costs_a_gap_not_the_map(office_piece, tmp_path):
    told: list[str] = []
    faults = ("move@8s:4s", "lost@12s:1s", "corrupt@14s:1s", "garbage@15s:1s")
    piece, folder = office_piece, tmp_path / "rig"
    # Counters of 32 bits: those of 16 could have wrapped meanwhile at this speed.
    with virtual_rig(piece, folder, *faults, speed=4.0, protocol="roboclaw") as virtual:
        summary = live_all(
            tmp_path / "rig" / "rig.yaml", tmp_path / "run", virtual, tell=told.append
        )
    assert any("lost" in text and "encoders" in text for text in told), told
    assert any("reading again" in text for text in told), told
    assert any("camera lost" in text for text in told), told
    assert any("camera is back" in text for text in told), told
    log = (tmp_path / "run" / "recording" / "log.txt").read_text()
    assert all(" ".join(text.split()) in log for text in told)
    path = np.loadtxt(tmp_path / "run" / "trajectory.tum")
    truth = open_recording(office_piece).poses
    assert truth is not None
    length = np.linalg.norm(truth.poses[-1, :2] - truth.poses[0, :2])
    assert np.linalg.norm(path[-1, 1:3] - path[0, 1:3]) == pytest.approx(length, abs=0.4)
    assert summary["local_maps"] >= 2


def test_a_killed_recording_opens_with_all_but_the_last_second(office_piece, tmp_path):
    with virtual_rig(office_piece, tmp_path / "rig", speed=4.0) as virtual:
        rig = tmp_path / "rig" / "rig.yaml"
        command = [sys.executable, "-m", "pipeline.cli", "record", rig, "-o", tmp_path / "rec"]
        process = subprocess.Popen([*map(str, command), "--quiet"])
        while virtual.timeline.seconds() < 10.0:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        process.wait()
        seconds = virtual.timeline.seconds()
    recording = open_recording(tmp_path / "rec")
    source = open_recording(office_piece).pairs
    taken = sum(pair.stamp - source[0].stamp <= (seconds - 4.0) * 1e9 for pair in source)
    assert len(recording.pairs) >= taken
    assert recording.pairs[-1].load().left.shape == (240, 320)
    assert recording.ticks is not None


def test_poses_as_lines_a_page_and_the_end_by_a_signal(office_piece, tmp_path):
    with virtual_rig(office_piece, tmp_path / "rig", speed=10.0) as virtual:
        command = [sys.executable, "-m", "pipeline.cli", "live", tmp_path / "rig" / "rig.yaml"]
        command += ["-o", tmp_path / "run", "--poses", "-", "--quiet", "--web", "--port", "0"]
        for setting in SETTINGS:
            command += ["--set", setting]
        process = subprocess.Popen(
            [*map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        virtual.timeline.finished.wait(30.0)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60.0)
    assert process.returncode == 0
    assert err.startswith("page: http://127.0.0.1:")
    events = [json.loads(line) for line in out.splitlines()]
    assert {event["type"] for event in events} == {"pose", "map"}
    summary = json.loads((tmp_path / "run" / "run.json").read_text())
    assert summary["partial"] is False
    assert not (tmp_path / "run" / "checkpoint").exists()
    assert sum(event["type"] == "pose" for event in events) == summary["counts"]["pairs used"]


def test_a_full_disk_ends_a_recording_and_keeps_all(office_piece, tmp_path, monkeypatch):
    from pipeline.errors import InputError
    from pipeline.live import recording_files

    written = recording_files._write_all
    count = [0]

    def full(fd, data):
        count[0] += 1
        if count[0] > 60:
            written(fd, data[: len(data) // 2])
            raise OSError(28, "No space left on device")
        written(fd, data)

    monkeypatch.setattr(recording_files, "_write_all", full)
    with (
        virtual_rig(office_piece, tmp_path / "rig") as virtual,
        pytest.raises(InputError, match="no space left on the disk: recording ended"),
    ):
        record_all(tmp_path / "rig" / "rig.yaml", tmp_path / "rec", virtual)
    assert len(open_recording(tmp_path / "rec").pairs) >= 3


def test_devices_that_are_not_there_are_named(office_piece, tmp_path, refused):
    rig = tmp_path / "rig" / "rig.yaml"
    with virtual_rig(office_piece, tmp_path / "rig"):
        text = rig.read_text()
        right = text.split("right: http://127.0.0.1:")[1].split("/")[0]
        rig.write_text(text.replace(f"{right}/right", f"{right}/nothing"))
        line = refused("record", rig, "-o", tmp_path / "rec", "--quiet")
        assert "only the left camera was found; right camera: http" in line
        assert "answers 404" in line
        rig.write_text(text.replace("ttyENC*", "ttyGONE0"))
        line = refused("record", rig, "-o", tmp_path / "rec", "--quiet")
        assert "ttyGONE0: no such port" in line
        rig.write_text(text.replace(f"http://127.0.0.1:{right}/left.mjpg", "/dev/video77"))
        line = refused("live", rig, "-o", tmp_path / "run", "--quiet")
        assert "/dev/video77: no such camera" in line
        assert "only the right camera was found" in line
    assert not (tmp_path / "rec").exists()


def test_live_speaks_to_the_devices_of_the_rig_alone(office_piece, tmp_path, refused):
    with virtual_rig(office_piece, tmp_path / "rig") as virtual:
        rig = tmp_path / "rig" / "rig.yaml"
        poses = ("--poses", "tcp://10.0.0.1:9000")
        assert "no address" in refused("live", rig, "-o", tmp_path / "run", *poses)
        for thread in threading.enumerate():
            assert thread.name != "capture"
        assert virtual.cameras.address("left").startswith("http://127.0.0.1:")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("protocol: stream", "protocol: morse", "devices.protocol"),
        ("fps:", "speed_of_light:", "unknown field 'devices.speed_of_light'"),
        ("right: http", "right: ftp", "devices.right: 'ftp"),
        ("track:", "trak:", "unknown field 'trak'"),
        ("devices:", "devces:", "unknown field 'devces'"),
    ],
)
def test_a_wrong_rig_file_is_named(office_piece, tmp_path, refused, old, new, message):
    with virtual_rig(office_piece, tmp_path / "rig"):
        rig = tmp_path / "rig" / "rig.yaml"
        rig.write_text(rig.read_text().replace(old, new))
        line = refused("record", rig, "-o", tmp_path / "rec")
    assert message in line
    assert "rig.yaml" in line


def test_a_rig_of_devices_alone_is_recorded_but_not_mapped(office_piece, tmp_path, refused):
    with virtual_rig(office_piece, tmp_path / "rig", calibrated=False) as virtual:
        rig = tmp_path / "rig" / "rig.yaml"
        assert "beemap calibrate capture" in refused("live", rig, "-o", tmp_path / "run")
        record_all(rig, tmp_path / "rec", virtual)
    recording = open_recording(tmp_path / "rec")
    assert recording.rig is None
    assert len(recording.pairs) >= 40
    assert "names devices and no calibration yet" in refused(
        "map", tmp_path / "rec", "-o", tmp_path / "run"
    )
