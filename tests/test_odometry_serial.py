"""The reader's thread on pseudo terminals: polls, streams, unplugging, replay, errors in words."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
import pytest

from odometry.counters import Limits, TickReading
from odometry.decoder import EncoderDecoder
from odometry.devices import EncoderDevice, make_protocol
from odometry.errors import OdometryError
from odometry.live import LiveOdometry
from odometry.ports import UsbIdentity, find_port
from odometry.raw_log import LineEvent, read_raw_log
from odometry.reader import open_encoders, replay_encoders
from odometry.settings import OdometrySettings
from odometry.source import EncoderOdometry
from odometry.tick_log import parse_tick_log, tick_lines
from tests.serial_devices import WHEELS, Board, board, sketch_line

pytest.importorskip("pty", reason="pseudo terminals exist on POSIX systems only")

SETTINGS = OdometrySettings()
MS = 1_000_000


def until(true: Callable[[], object], seconds: float = 5.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.005)


def counting_arduino() -> Callable[[bytes], bytes]:
    """Answers each `e\\r` with counters that go on by 7 and -3."""
    state = [0]

    def answer(data: bytes) -> bytes:
        answers = b""
        for command in data.split(b"\r")[:-1]:
            state[0] += command == b"e"
            known = b"%d %d\r\n" % (7 * state[0], -3 * state[0])
            answers += known if command == b"e" else b"Invalid Command\r\n"
        return answers

    return answer


def test_streamed_lines_with_garbage_and_a_wrap(tmp_path):
    link, log = str(tmp_path / "tty"), tmp_path / "raw.log"
    with board(link) as sender, open_encoders(EncoderDevice(link), WHEELS, SETTINGS, log) as live:
        for k in range(300):
            sender.send(sketch_line(1000 * k, (65000 + 2 * k) % 65536, (-k) % 65536))
            if k % 50 == 0:
                sender.send([b"\xff\x00,,\r\n", b"9" * 300 + b"\n", b"1,2*77\n"][k // 50 % 3])
        until(lambda: live.report()["readings"] == 300)
        readings = live.readings()
        assert live.readings() == []
        assert live.report() == {"readings": 300, "garbled": 4, "checksum": 2}
    assert [r.left_total for r in readings] == [65000 + 2 * k for k in range(300)]
    assert (np.diff([r.right_total for r in readings]) == -1).all()
    assert (np.diff([r.stamp for r in readings]) > 0).all()
    again = replay_encoders(log, EncoderDevice(link), WHEELS, SETTINGS)
    assert again.readings() == readings
    assert again.report() == live.report()


def test_a_polled_board_is_stamped_within_its_round_trip(tmp_path, monkeypatch):
    monkeypatch.setattr("odometry.protocols.arduino_bridge.ArduinoBridgeProtocol.startup_s", 0.05)
    link, log = str(tmp_path / "tty"), tmp_path / "raw.log"
    device = EncoderDevice(link, "arduino_bridge", rate=200.0)
    with board(link, counting_arduino()), open_encoders(device, WHEELS, SETTINGS, log) as live:
        live.wait_ready(5.0)
        until(lambda: live.report()["readings"] >= 20)
        tap = live.tap()
        assert tap.wait_until(time.monotonic_ns() + 10 * MS, 5.0)
        assert not tap.wait_until(time.monotonic_ns() + 10_000 * MS, 0.01)
        assert tap.readings()
        readings = live.readings()
    trips = {}
    for event in read_raw_log(log):
        assert event is not None
        if event.kind == ">":
            sent = event.stamp
        elif event.kind == "<":
            trips[int(event.data.split()[0])] = (sent, event.stamp)
    for reading in readings:
        sent, received = trips[reading.left_total]
        assert reading.stamp == sent + (received - sent) // 2
    assert replay_encoders(log, device, WHEELS, SETTINGS).readings()[: len(readings)] == readings


def test_a_board_that_vanishes_and_comes_back_restarted(tmp_path):
    link, log = str(tmp_path / "tty"), tmp_path / "raw.log"
    first = Board(link)
    with open_encoders(EncoderDevice(link), WHEELS, SETTINGS, log) as live:
        odometry = LiveOdometry(live.tap(), WHEELS, SETTINGS, wait_s=3.0)
        for k in range(20):
            first.send(sketch_line(1000 * k, 5000 + k, 5000 + k))
        until(lambda: live.report()["readings"] == 20)
        start = live.readings()
        assert odometry.until(start[5].stamp) is not None
        first.unplug()
        until(lambda: not live.connected)
        with board(link) as second:
            until(lambda: live.connected)
            for k in range(20):
                second.send(sketch_line(1000 * k, k, k))
            until(lambda: live.report()["readings"] == 40)
            readings = live.readings()
            motion = odometry.until(readings[-1].stamp)
            assert motion is not None
            assert motion.increment[0] == pytest.approx(
                (14 + 19) * WHEELS.metres_per_tick[0], abs=1e-9
            )
            assert np.sqrt(motion.covariance[0, 0]) > 0.05
            # Before the second board goes as well.
            report, events = live.report(), " | ".join(live.events())
    assert (report["lost_devices"], report["reconnects"], report["resets"]) == (1, 1, 1)
    for told in ("device was lost", "reading again", "restarted from 5019, 5019 to 0, 0"):
        assert told in events
    assert [r.reset for r in readings] == [True] + [False] * 19
    again = replay_encoders(log, EncoderDevice(link), WHEELS, SETTINGS)
    assert again.readings() == start + readings
    assert again.report() == live.report()  # by then the second board has been unplugged, too


def test_live_and_recorded_motion_are_the_same_to_the_byte():
    rng = np.random.default_rng(1)
    device = EncoderDevice("p")
    decoder = EncoderDecoder(make_protocol(device, WHEELS), Limits(WHEELS, 1.5), device.rate)
    readings: list[TickReading] = []
    left = right = 9000
    stamp = 10**9
    for k in range(3000):
        stamp += 20 * MS + int(rng.integers(0, 3 * MS))
        left, right = left + int(rng.integers(0, 40)), right + int(rng.integers(0, 40))
        if k in (900, 2000):
            left, right, stamp = 0, 0, stamp + 900 * MS
        if k == 1500:
            stamp += 1200 * MS  # a gap
        glitch = (30000, 3) if k % 500 == 77 else (left, right)
        line = b"%d,%d\n" % glitch
        readings += decoder.take(LineEvent(stamp, "<", line))
    recorded = EncoderOdometry(
        parse_tick_log("".join(map(tick_lines, readings)), "x"), WHEELS, SETTINGS
    )
    live = LiveOdometry(_FullTap(readings), WHEELS, SETTINGS)  # type: ignore[arg-type]
    for image in range(readings[3].stamp, readings[-1].stamp, 101 * MS):
        a, b = recorded.until(image), live.until(image)
        assert a is not None
        assert b is not None
        assert a.increment.tobytes() == b.increment.tobytes()
        assert a.covariance.tobytes() == b.covariance.tobytes()
    assert len(live._rows) < 300
    assert live.report()["ticks_resets"] == recorded.report()["ticks_resets"] == 2
    assert decoder.report() == {"implausible": 6, "resets": 2, "silences": 3}
    assert live.until(readings[-1].stamp + 1) is None
    assert live.report()["pairs_without_motion"] == 1


class _FullTap:
    """All readings, given as they become due."""

    def __init__(self, readings: list[TickReading]) -> None:
        self._stamps = [r.stamp for r in readings]
        self._all = readings
        self._given = self._due = 0

    def wait_until(self, stamp: int, timeout_s: float) -> bool:
        del timeout_s
        needed = int(np.searchsorted(self._stamps, stamp)) + 1
        self._due = max(self._due, min(needed, len(self._all)))
        return needed <= len(self._all)

    def readings(self) -> list[TickReading]:
        due = self._all[self._given : self._due]
        self._given = self._due
        return due


def decoder_of(device: EncoderDevice) -> EncoderDecoder:
    return EncoderDecoder(make_protocol(device, WHEELS), Limits(WHEELS, 1.5), device.rate)


def test_slow_round_trips_late_and_unasked_answers_are_told_apart():
    decoder = decoder_of(EncoderDevice("p", "arduino_bridge", rate=10.0))
    decoder.take(LineEvent(0, "o", b"p"))
    assert decoder.due(1000 * MS) is None  # the board is still starting
    assert decoder.due(2000 * MS) == b"e\r"
    decoder.take(LineEvent(2000 * MS, ">", b"e\r"))
    assert decoder.due(2050 * MS) is None
    (reading,) = decoder.take(LineEvent(2010 * MS, "<", b"1 2\r\n"))
    assert reading.stamp == 2005 * MS
    assert decoder.take(LineEvent(2020 * MS, "<", b"1 2\r\n")) == []
    assert decoder.due(2099 * MS) is None
    assert decoder.due(2100 * MS) == b"e\r"
    decoder.take(LineEvent(2100 * MS, ">", b"e\r"))
    assert decoder.take(LineEvent(2180 * MS, "<", b"3 4\r\n")) == []
    decoder.take(LineEvent(2200 * MS, ">", b"e\r"))
    assert decoder.due(2500 * MS) is None
    assert decoder.due(2501 * MS) == b"e\r"
    decoder.take(LineEvent(2501 * MS, ">", b"e\r"))
    (reading,) = decoder.take(LineEvent(2503 * MS, "<", b"5 6\r\n"))
    assert decoder.report() == {"slow_round_trips": 1, "unanswered": 1, "unasked": 1}


def test_lines_of_one_chunk_are_spread_over_the_time_since_the_last():
    decoder = decoder_of(EncoderDevice("p"))
    decoder.take(LineEvent(100 * MS, "<", b"0,0\n"))
    readings = decoder.take(LineEvent(104 * MS, "<", b"1,1\n2,2\n3,3\n4,4\n"))
    assert [r.stamp for r in readings] == [101 * MS, 102 * MS, 103 * MS, 104 * MS]


def test_the_wrong_protocol_is_told_once_in_words():
    decoder = decoder_of(EncoderDevice("p"))
    for k in range(100):
        decoder.take(LineEvent(k * 20 * MS, "<", b"1.25 0.5\n"))
    (event,) = decoder.events()
    assert "none of them is a reading; they look like protocol: odrive" in event
    assert decoder.advice() is not None
    decoder.take(LineEvent(3000 * MS, "<", b"1,2\n"))
    assert decoder.advice() is None


def test_silence_is_told_when_nothing_comes_and_closing_is_quick(tmp_path):
    link = str(tmp_path / "tty")
    with board(link), open_encoders(EncoderDevice(link), WHEELS, SETTINGS) as live:
        with pytest.raises(OdometryError, match=r"tty: no reading within 0.05 s .*no answer"):
            live.wait_ready(0.05)
        begin = time.monotonic()
    assert time.monotonic() - begin < 1.0


def test_a_log_cut_anywhere_gives_the_readings_before_the_cut(tmp_path):
    link, log = str(tmp_path / "tty"), tmp_path / "raw.log"
    with board(link) as sender, open_encoders(EncoderDevice(link), WHEELS, SETTINGS, log) as live:
        for k in range(30):
            sender.send(b"%d,%d\n" % (k, k))
            if k % 7 == 0:
                time.sleep(0.01)
        until(lambda: live.report()["readings"] == 30)
        readings = live.readings()
    data = log.read_bytes()
    for cut in range(0, len(data), 5):
        log.write_bytes(data[:cut])
        part = replay_encoders(log, EncoderDevice(link), WHEELS, SETTINGS).readings()
        assert part == readings[: len(part)]
    log.write_bytes(data.replace(b" < ", b" ? ", 1))
    assert replay_encoders(log, EncoderDevice(link), WHEELS, SETTINGS).report()["damaged_log_lines"]
    log.write_bytes(b"something else\n")
    with pytest.raises(OdometryError, match="not a raw log of encoders"):
        replay_encoders(log, EncoderDevice(link), WHEELS, SETTINGS)
    with pytest.raises(OdometryError, match=r"raw\.log: already exists"):
        open_encoders(EncoderDevice(link), WHEELS, SETTINGS, log)


@pytest.fixture
def no_ports(monkeypatch):
    monkeypatch.setattr("odometry.ports.list_ports.comports", lambda: [])


def opened(named: str) -> None:
    open_encoders(EncoderDevice(named), WHEELS, SETTINGS).close()


def test_a_port_that_is_not_there(tmp_path, no_ports):
    with pytest.raises(OdometryError, match=r"ttyX: no such port: .*no serial port is present"):
        opened(str(tmp_path / "ttyX"))
    with pytest.raises(OdometryError, match=r"tty\*: no port matches"):
        opened(str(tmp_path / "tty*"))


def test_a_busy_port(tmp_path):
    link = str(tmp_path / "tty")
    with (
        board(link),
        open_encoders(EncoderDevice(link), WHEELS, SETTINGS),
        pytest.raises(OdometryError, match="tty: busy: another program has it open"),
    ):
        opened(link)


def test_a_port_that_may_not_be_used(tmp_path, monkeypatch):
    port = tmp_path / "tty"
    port.touch()
    with pytest.raises(OdometryError, match="is not a serial port"):
        opened(str(port))
    monkeypatch.setattr("odometry.ports.os.access", lambda *_: False)
    monkeypatch.setattr("odometry.ports.Path.group", lambda _: "dialout")
    with pytest.raises(
        OdometryError, match=r"permission denied: 'sudo usermod -aG dialout \$USER'"
    ):
        opened(str(port))


def test_patterns_and_devices_that_come_back_under_another_name(tmp_path, monkeypatch):
    for name in ("usb-a", "usb-b"):
        (tmp_path / name).touch()
    os.symlink(tmp_path / "usb-a", tmp_path / "by-id-a")
    assert find_port(str(tmp_path / "usb-a*")) == str(tmp_path / "usb-a")
    assert find_port(str(tmp_path / "*-a")) == str(tmp_path / "usb-a")
    with pytest.raises(OdometryError, match=r"2 ports match .*name one"):
        find_port(str(tmp_path / "usb-*"))

    class Found:
        device, vid, pid, serial_number = "/dev/ttyACM1", 0x2341, 0x43, "A1"

    monkeypatch.setattr("odometry.ports.list_ports.comports", lambda: [Found])
    assert find_port("/dev/ttyACM0", UsbIdentity(0x2341, 0x43, "A1")) == "/dev/ttyACM1"
    assert find_port("/dev/ttyACM0", UsbIdentity(0x2341, 0x43, "B2")) == "/dev/ttyACM0"
