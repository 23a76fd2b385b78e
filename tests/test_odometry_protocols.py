"""Every protocol on its own bytes, however they are cut, and on hostile ones."""

from __future__ import annotations

import binascii
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from odometry.devices import EncoderDevice, encoder_device, make_protocol
from odometry.errors import OdometryError
from odometry.protocols.arduino_bridge import ArduinoBridgeProtocol
from odometry.protocols.base import MAX_LINE, Banner, LineSplitter, Sample
from odometry.protocols.guess import looks_like
from odometry.protocols.odrive import ODriveProtocol
from odometry.protocols.roboclaw import RoboClawProtocol
from odometry.protocols.stream import StreamProtocol
from tests.serial_devices import WHEELS, checked, sketch_line

counter = st.integers(-(2**31), 2**31 - 1)
DEVICES = [
    EncoderDevice("p"),
    EncoderDevice("p", fields=("skip", "time_ms", "left", "right")),
    EncoderDevice("p", units="metres", checked=True),
    EncoderDevice("p", "arduino_bridge"),
    EncoderDevice("p", "roboclaw"),
    EncoderDevice("p", "roboclaw", command=16),
    EncoderDevice("p", "odrive"),
    EncoderDevice("p", "odrive", checked=True),
]


@given(st.one_of(st.none(), st.integers(0, 2**40)), counter, counter, st.booleans())
def test_a_written_line_is_read_back(t_us, left, right, with_checksum):
    body = b"%d,%d" % (left, right) if t_us is None else b"%d,%d,%d" % (t_us, left, right)
    line = checked(body) if with_checksum else body
    for end in (b"\n", b"\r\n"):
        assert StreamProtocol().feed(line + end) == [Sample(left, right, t_us)]


@given(st.integers(0, 2**33), counter, counter)
def test_the_sketch_is_understood(t_us, left, right):
    protocol = make_protocol(EncoderDevice("p", checked=True), WHEELS)
    assert protocol.feed(b"# beemap encoders, ready\r\n") == [Banner("# beemap encoders, ready")]
    assert protocol.feed(sketch_line(t_us, left, right)) == [Sample(left, right, t_us % 2**32)]
    assert protocol.counts.total() == 0


def test_the_sketch_prints_what_its_twin_here_prints():
    sketch = (Path(__file__).parent.parent / "docs" / "arduino" / "encoders.ino").read_text()
    assert 'snprintf(line, sizeof line, "%lu,%ld,%ld", now, left, right);' in sketch
    for part in ("checksum ^= *c", "Serial.print('*')", "Serial.println(checksum)"):
        assert part in sketch
    assert sketch_line(7, 1, -2) == b"7,1,-2*25\r\n"


@pytest.mark.parametrize(
    "line",
    [b"1", b"1,2,3,4", b"1,2*9", b"1,2*", b"1,2*x", b"1,2*46*46", b"1.5,2", b"a,b", b"-1,2,3"],
)
def test_garbage_lines_are_counted(line):
    protocol = StreamProtocol()
    assert protocol.feed(line + b"\n") == []
    assert protocol.counts.total() == 1


def test_a_checksum_finds_a_changed_digit_and_can_be_demanded():
    line = checked(b"1000,-2000") + b"\n"
    protocol = StreamProtocol(checked=True)
    assert protocol.feed(line) == [Sample(1000, -2000)]
    assert protocol.feed(line.replace(b"-2000", b"-2001")) == []
    assert protocol.feed(b"1,2\n") == []
    assert protocol.counts == {"garbled": 0, "checksum": 2}


def test_fields_metres_and_milliseconds():
    device = EncoderDevice("p", fields=("skip", "time_ms", "right", "left"), units="metres")
    protocol = make_protocol(device, WHEELS)
    tick = WHEELS.metres_per_tick[0]
    assert protocol.feed(b"x; 12; %.9f; -1e0\n" % (100 * tick)) == [
        Sample(round(-1.0 / tick) % 65536, 100, 12_000)
    ]
    scaled = make_protocol(EncoderDevice("p", units="metres", counts_per_unit=1000.0), WHEELS)
    assert scaled.feed(b"5,0.25,.5\n") == [Sample(250, 500, 5)]
    assert scaled.feed(b"5,0,1e99\n0.1\n--1,2\n") == []
    assert scaled.counts["garbled"] == 3


def test_arduino_bridge_answers_and_refuses():
    protocol = ArduinoBridgeProtocol()
    assert protocol.requests == (b"e\r",)
    protocol.expect(b"e\r")
    assert protocol.feed(b"12") == []
    assert protocol.waiting
    assert protocol.feed(b"34 -56\r\n") == [Sample(1234, -56)]
    assert not protocol.waiting
    protocol.expect(b"e\r")
    assert protocol.feed(b"Invalid Command\r\n") == []
    assert protocol.counts["refused"] == 1
    assert not protocol.waiting
    assert protocol.feed(b"1 2 3\r\nRebooting\r\n") == [Banner("Rebooting")]
    assert protocol.counts["garbled"] == 1


def roboclaw_answer(command: int, body: bytes) -> bytes:
    return body + binascii.crc_hqx(bytes((0x80, command)) + body, 0).to_bytes(2, "big")


def test_roboclaw_by_the_bytes():
    # CRC-16/XMODEM of "123456789" is 0x31C3: the polynomial of the manual.
    assert binascii.crc_hqx(b"123456789", 0) == 0x31C3
    protocol = RoboClawProtocol()
    assert protocol.requests == (b"\x80\x4e",)
    answer = roboclaw_answer(78, (70000).to_bytes(4, "big") + (2**32 - 5).to_bytes(4, "big"))
    protocol.expect(b"\x80\x4e")
    assert protocol.feed(answer[:3]) == []
    assert protocol.feed(answer[3:]) == [Sample(70000, 2**32 - 5)]
    protocol.expect(b"\x80\x4e")
    assert protocol.feed(answer[:-1] + b"\x00") == []
    assert protocol.counts["checksum"] == 1
    assert protocol.feed(b"stray") == []
    assert protocol.counts["unasked"] == 1


def test_roboclaw_one_motor_at_a_time_and_a_lost_half():
    protocol = RoboClawProtocol(both=False)
    left, right = protocol.requests
    assert (left, right) == (b"\x80\x10", b"\x80\x11")
    protocol.expect(left)
    assert protocol.feed(roboclaw_answer(16, b"\x00\x00\x00\x07\x00")) == []
    protocol.expect(right)
    assert protocol.feed(roboclaw_answer(17, b"\x00\x00\x00\x09\x02")) == [Sample(7, 9)]
    protocol.expect(left)
    protocol.restart()
    protocol.expect(right)
    assert protocol.feed(roboclaw_answer(17, b"\x00\x00\x00\x09\x02")) == []


def test_odrive_turns_become_counts():
    protocol = ODriveProtocol((2000.0, 2000.0), checked=True)
    assert protocol.requests == (checked(b"f 0") + b"\n", checked(b"f 1") + b"\n")
    protocol.expect(protocol.requests[0])
    assert protocol.feed(checked(b"1.500000 0.1") + b"\n") == []
    protocol.expect(protocol.requests[1])
    assert protocol.feed(checked(b"-0.25 -0.1") + b"\r\n") == [Sample(3000, 2**32 - 500)]
    protocol.expect(protocol.requests[0])
    assert protocol.feed(b"1.5 0.1\n") == []
    assert protocol.counts["checksum"] == 1
    assert ODriveProtocol((1.0, 1.0)).requests == (b"f 0\n", b"f 1\n")


@given(
    st.sampled_from(DEVICES),
    st.lists(
        st.one_of(
            st.binary(max_size=300),
            st.sampled_from([b"\n", b"7" * 100, b"1,2\n", b"1 2\r\n", b"*", b"1.5 2\n", b"ask"]),
        )
    ),
)
def test_no_bytes_break_a_protocol_and_memory_is_bounded(device, chunks):
    protocol = make_protocol(device, WHEELS)
    asked = 0
    for chunk in chunks:
        if chunk == b"ask" and protocol.requests:
            protocol.expect(protocol.requests[asked % len(protocol.requests)])
            asked += 1
        for item in protocol.feed(chunk):
            assert isinstance(item, (Sample, Banner))
        assert len(getattr(protocol, "_answer", b"")) <= 10
        if splitter := getattr(protocol, "_splitter", None):
            assert len(splitter._rest) <= MAX_LINE
    looks_like(b"".join(chunks))


@given(st.lists(st.one_of(st.binary(max_size=200), st.just(b"\n"), st.just(b"7" * 100))))
def test_chunks_do_not_matter(chunks):
    whole, pieces = LineSplitter(), LineSplitter()
    expected = whole.feed(b"".join(chunks))
    assert [line for chunk in chunks for line in pieces.feed(chunk)] == expected
    assert pieces.overlong == whole.overlong
    dropped = [line for line in b"".join(chunks).split(b"\n")[:-1] if len(line) > MAX_LINE]
    assert whole.overlong == len(dropped)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"9\n" + b"10 -20\r\n" * 5, "protocol: arduino_bridge"),
        (b"9\n" + b"1.25 0.5\n" * 5, "protocol: odrive"),
        (b"9\n" + b"100,1,2*33\r\n" * 5, "protocol: stream"),
        (b"9\n" + b"1,2,3,4,5\n" * 5, "stream with its fields"),
        (b"9\n" + b"hello\n" * 5, "text, such as 'hello'"),
        (bytes(range(128, 256)) * 3, "baud rate is probably wrong"),
        (b"", "nothing arrived"),
    ],
)
def test_bytes_of_something_else_are_told(data, expected):
    assert expected in looks_like(data)


def test_a_device_from_the_rig():
    section = {"left": "/dev/video0", "encoders": "/dev/ttyUSB0", "protocol": "roboclaw"}
    device = encoder_device(section, "rig.yaml")
    assert (device.encoders, device.usual_baud, device.command) == ("/dev/ttyUSB0", 38400, 78)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        (None, r"rig.yaml: devices.encoders: missing: name the port"),
        ({"protocol": "stream"}, r"devices.encoders: missing"),
        ({"encoders": "p", "protocol": "x"}, r"rig.yaml: devices.protocol: Invalid enum value 'x'"),
        ({"encoders": "p", "baud": "fast"}, r"devices.baud: Expected `int \| null`, got `str`"),
        ({"encoders": "p", "address": 3}, r"devices.address: Expected `int` >= 128"),
        ({"encoders": "p", "fields": ["left", "up"]}, r"devices.fields: .*time_us, time_ms, left"),
        ({"encoders": "p", "axes": [1, 1]}, r"devices.axes: \[1, 1\]: two axes"),
    ],
)
def test_a_device_that_is_wrong(section, message):
    with pytest.raises(OdometryError, match=message):
        encoder_device(section, "rig.yaml")
