"""Cameras: MJPEG taken apart as it was sent, pairs by stamps, losses counted, errors named."""

from __future__ import annotations

import errno
import os
import socket
import threading
import time

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereo import camera_feed, camera_v4l2
from stereo.camera import Camera, CapturedPair, Frame
from stereo.camera_feed import CameraFeed
from stereo.camera_network import NetworkCamera
from stereo.camera_settings import CameraSettings, camera_settings
from stereo.camera_v4l2 import VideoDevice, jpeg_of
from stereo.errors import CameraError, StereoError
from stereo.frame_pairing import FramePairing
from stereo.mjpeg import MjpegParser
from stereo.stereo_camera import StereoCamera
from stereo.stream_clock import StreamClock

MS = 1_000_000


def jpeg(seed: int = 0) -> bytes:
    image = np.random.default_rng(seed).integers(0, 255, (24, 32), np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()


def stream(jpegs: list[bytes], lengths: bool, stamps: bool) -> bytes:
    parts = b""
    for number, data in enumerate(jpegs):
        head = b"--b\r\nContent-Type: image/jpeg\r\n"
        head += b"Content-Length: %d\r\n" % len(data) if lengths else b""
        head += b"X-Timestamp: %d.500000\r\n" % number if stamps else b""
        parts += head + b"\r\n" + data + b"\r\n"
    return parts + b"--b\r\n"


@given(st.integers(1, 4), st.booleans(), st.booleans(), st.lists(st.integers(1, 900), min_size=1))
def test_images_come_out_as_they_were_sent(count, lengths, stamps, cuts):
    jpegs = [jpeg(n) for n in range(count)]
    data = stream(jpegs, lengths, stamps)
    parser, found, place = MjpegParser(b"b"), [], 0
    for number in range(len(data)):
        if place >= len(data):
            break
        size = cuts[number % len(cuts)]
        found += parser.feed(data[place : place + size], number)
        place += size
    assert [part.jpeg for part in found] == jpegs
    wanted = [n * 1000 * MS + 500 * MS if stamps else None for n in range(count)]
    assert [part.taken for part in found] == wanted
    assert parser.dropped == 0


@given(st.lists(st.one_of(st.binary(max_size=300), st.just(b"--b\r\n"), st.just(b"\r\n\r\n"))))
def test_garbage_raises_nothing_and_the_next_image_is_found(chunks):
    parser = MjpegParser(b"b")
    for chunk in chunks:
        parser.feed(chunk, 0)
    data = stream([jpeg(), jpeg(1), jpeg(2)], True, False)
    found = parser.feed(b"\r\n" + data, 1)
    assert found == [] or found[-1].jpeg == jpeg(2)


@given(st.lists(st.integers(0, 40), min_size=3, max_size=30))
def test_a_cameras_clock_takes_the_network_out(delays):
    clock, times = StreamClock(), [n * 100 * MS for n in range(len(delays))]
    found = [
        clock.host_time(t, t + 7_000 * MS + d * MS) for t, d in zip(times, delays, strict=True)
    ]
    arrivals = [t + 7_000 * MS + d * MS for t, d in zip(times, delays, strict=True)]
    assert all(stamp <= arrival for stamp, arrival in zip(found, arrivals, strict=True))
    quickest = delays.index(min(delays))
    late = [
        stamp - t - 7_000 * MS - min(delays) * MS for stamp, t in zip(found, times, strict=True)
    ]
    assert all(0 <= error < MS for error in late[quickest:])


def frames(stamps: list[int]) -> list[Frame]:
    return [Frame(stamp * MS, b"") for stamp in stamps]


def test_frames_are_paired_by_time_and_lonely_ones_counted():
    pairing, pairs = FramePairing(20 * MS), []
    for left in frames([0, 100, 300, 400]):
        pairs += pairing.add("left", left)
    for right in frames([3, 205, 310, 450]):
        pairs += pairing.add("right", right)
    assert [(p.stamp // MS, p.skew // MS) for p in pairs] == [(0, 3), (300, 10)]
    assert pairing.lonely == 3


def test_pairs_are_halves_of_one_image_or_two_images():
    wide = np.arange(4 * 8, dtype=np.uint8).reshape(4, 8)
    pair = CapturedPair(Frame(5, wide), None).load()
    np.testing.assert_array_equal(np.hstack([pair.left, pair.right]), wide)
    with pytest.raises(StereoError, match="image of 5: cut short"):
        CapturedPair(Frame(5, jpeg()[:-30]), Frame(5, jpeg())).load()


class Script(Camera):
    """Delivers frames at given times [ms]; None: lost."""

    def __init__(self, stamps: list[int | None]) -> None:
        self.stamps, self.connected = list(stamps), 0

    def connect(self) -> None:
        self.connected += 1

    def read(self) -> Frame:
        if not self.stamps:
            time.sleep(0.01)
            raise CameraError("over")
        stamp = self.stamps.pop(0)
        if stamp is None:
            raise CameraError("the cable")
        return Frame(stamp * MS, b"")

    def close(self) -> None:
        pass


def test_drops_stalls_and_losses_are_counted():
    # Every 100 ms; one late and caught up, two dropped, a stall of a second, a loss.
    steady = list(range(0, 1000, 100))
    script = Script([*steady, 1060, 1100, 1200, 1500, 1600, 2600, 2700, None, 2800, 2900])
    told, got = [], []
    feed = CameraFeed("left", script, 100 * MS, lambda _, frame: got.append(frame), told.append)
    feed.start()
    while script.stamps:
        time.sleep(0.01)
    feed.stop()
    assert feed.counts["frames"] == len(got) == 19
    assert feed.counts["dropped"] == 2 + 9
    assert feed.counts["stalls"] == 1
    assert feed.counts["lost"] >= 1
    assert told[0] == "left camera stalled for 1.0 s"
    assert told[1] == "left camera lost: the cable"
    assert told[2].startswith("left camera is back after")


class Slow(Camera):
    """A driver that must be released by the thread that reads: V4L2's, through OpenCV."""

    def __init__(self) -> None:
        self.reading, self.reader, self.closer = False, 0, 0

    def connect(self) -> None:
        pass

    def read(self) -> Frame:
        self.reading, self.reader = True, threading.get_ident()
        time.sleep(0.05)
        self.reading = False
        return Frame(time.monotonic_ns(), b"")

    def close(self) -> None:
        assert not self.reading
        self.closer = threading.get_ident()


def test_a_camera_is_released_by_the_thread_that_reads_it():
    camera = Slow()
    feed = CameraFeed("left", camera, 100 * MS, lambda *_: None, lambda _: None)
    feed.start()
    while not camera.reading:
        time.sleep(0.001)
    feed.stop()
    assert camera.closer == camera.reader != threading.get_ident()


def test_a_driver_that_hangs_does_not_hold_up_the_end(monkeypatch):
    monkeypatch.setattr(camera_feed, "JOIN_S", 0.05)
    told: list[str] = []
    release = threading.Event()

    class Hanging(Slow):
        def read(self) -> Frame:
            release.wait(10.0)
            return Frame(1, b"")

    camera = Hanging()
    feed = CameraFeed("left", camera, 100 * MS, lambda *_: None, told.append)
    feed.start()
    feed.stop()
    release.set()
    assert told == ["left camera: its driver hangs: left open"]


def test_pairs_that_a_clock_turned_back_are_counted():
    camera = StereoCamera(CameraSettings(left="/dev/video0", right="/dev/video2"))
    for stamp in (1000, 2000, 1500, 1600, 1700, 3000):
        camera._deliver("left", Frame(stamp * MS, b""))
        camera._deliver("right", Frame(stamp * MS, b""))
    taken = []
    while pair := camera.read(0.0):
        taken.append(pair.stamp // MS)
    assert taken == [1000, 2000, 3000]
    report = camera.report()
    assert (report.pairs, report.backwards) == (3, 3)
    assert len(camera.events()) == 1


def serve(answer: bytes) -> str:
    """A server on loopback that gives one answer."""
    server = socket.create_server(("127.0.0.1", 0))

    def run() -> None:
        connection, _ = server.accept()
        connection.recv(1000)
        connection.sendall(answer)
        connection.close()
        server.close()

    threading.Thread(target=run, daemon=True).start()
    return f"http://127.0.0.1:{server.getsockname()[1]}/x"


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (b"HTTP/1.0 302 Found\r\nLocation: http://10.0.0.1/\r\n\r\n", "answers 302"),
        (b"HTTP/1.0 401 No\r\n\r\n", "wants a password"),
        (b"HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n", "sends text/html, no MJPEG"),
        (b"nonsense\r\n\r\n", "no answer"),
        (b"", "no answer"),
    ],
)
def test_what_is_no_stream_is_named(answer, message):
    with pytest.raises(CameraError, match=message):
        NetworkCamera(serve(answer)).connect()


def test_a_stream_that_ends_is_a_lost_camera():
    head = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=b\r\n\r\n"
    with NetworkCamera(serve(head + stream([jpeg()], True, True))) as camera:
        frame = camera.read()
        assert frame.data == jpeg()
        assert 0 <= time.monotonic_ns() - frame.stamp < 5_000 * MS
        with pytest.raises(CameraError, match="the stream ended"):
            camera.read()


class FakeCapture:
    """cv2.VideoCapture of a webcam: `mjpg` gives buffers padded with zeros."""

    mjpg, size = True, (640, 480)

    def __init__(self, path, api):
        self.properties = {cv2.CAP_PROP_FRAME_WIDTH: 640, cv2.CAP_PROP_FRAME_HEIGHT: 480}

    def isOpened(self):  # noqa: N802
        return True

    def set(self, key, value):
        if key == cv2.CAP_PROP_FOURCC and not self.mjpg:
            return False
        if key not in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            self.properties[key] = value
        return True

    def get(self, key):
        if key == cv2.CAP_PROP_POS_MSEC:
            return time.monotonic() * 1000.0 - 5.0
        return self.properties.get(key, 0.0)

    def grab(self):
        return True

    def retrieve(self):
        if self.mjpg:
            return True, np.frombuffer(jpeg() + bytes(50), np.uint8).reshape(1, -1)
        return True, np.zeros((480, 640, 3), np.uint8)

    def release(self):
        pass


@pytest.fixture
def webcam(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    monkeypatch.setattr(camera_v4l2, "_look", lambda path: None)
    monkeypatch.setattr(FakeCapture, "mjpg", True)
    return FakeCapture


def test_a_webcams_jpeg_is_kept_and_the_kernels_stamp(webcam):
    with VideoDevice("/dev/video0", (640, 480), 10.0, 8.0) as camera:
        frame = camera.read()
    assert frame.data == jpeg()
    assert 4 * MS < time.monotonic_ns() - frame.stamp < 900 * MS
    assert jpeg_of(np.zeros((1, 4), np.uint8)) == bytes(4)


def test_a_webcam_without_mjpg_gives_pixels_and_a_wrong_size_is_refused(webcam, monkeypatch):
    monkeypatch.setattr(FakeCapture, "mjpg", False)
    with VideoDevice("/dev/video0", None, 10.0, None) as camera:
        frame = camera.read()
    assert isinstance(frame.data, np.ndarray)
    assert frame.data.shape == (480, 640, 3)
    with pytest.raises(CameraError, match="offers 640x480 in place of 1280x720"):
        VideoDevice("/dev/video0", (1280, 720), 10.0, None).connect()


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (errno.EACCES, "join the group 'video'"),
        (errno.EBUSY, "in use by another program"),
        (errno.ENOENT, "no such camera"),
    ],
)
def test_why_a_webcam_does_not_open(monkeypatch, code, message):
    def refuse(path, flags):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(camera_v4l2.os, "open", refuse)
    with pytest.raises(CameraError, match=message):
        VideoDevice("/dev/video0", None, 10.0, None).connect()


@pytest.mark.parametrize(
    ("devices", "message"),
    [
        ({}, "names no camera"),
        ({"left": "/dev/video0"}, "devices.right is missing"),
        ({"left": 0, "right": 0}, "are both 0"),
        ({"left": 0, "right": 1, "stereo": 2}, "not both"),
        ({"left": "https://x/y", "right": 1}, "devices.left: 'https://x/y'"),
        ({"stereo": "rtsp://x"}, "http://HOST:PORT"),
        ({"stereo": "webcam"}, "give /dev/video0"),
        ({"stereo": 0, "fps": -1}, "devices.fps is -1"),
        ({"stereo": 0, "size": [640]}, "devices.size"),
    ],
)
def test_wrong_devices_are_named(devices, message):
    with pytest.raises(StereoError, match=message) as error:
        camera_settings(devices, "rig.yaml")
    assert str(error.value).startswith("rig.yaml: ")
