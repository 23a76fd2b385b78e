"""The streamed line on hostile bytes, and the reader's thread on a pseudo terminal."""

from __future__ import annotations

import itertools
import os
import threading
import time
from functools import reduce
from operator import xor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from odometry.clock import SenderClock
from odometry.errors import OdometryError
from odometry.protocol import MAX_LINE, EncoderLine, LineSplitter, parse_line
from odometry.serial_reader import SerialEncoderReader

pty = pytest.importorskip("pty", reason="pseudo terminals exist on POSIX systems only")

counter = st.integers(-(2**31), 2**32 - 1)


def with_checksum(body: bytes) -> bytes:
    return body + b"*%d" % reduce(xor, body, 0)


@given(st.one_of(st.none(), st.integers(0, 2**40)), counter, counter, st.booleans())
def test_a_written_line_is_read_back(t_us, left, right, checked):
    body = b"%d,%d" % (left, right) if t_us is None else b"%d,%d,%d" % (t_us, left, right)
    line = with_checksum(body) if checked else body
    assert parse_line(line) == EncoderLine(left, right, t_us)
    assert parse_line(line + b"\r") == EncoderLine(left, right, t_us)


@pytest.mark.parametrize(
    "line",
    [b"", b"1", b"1,2,3,4", b"1,2*9", b"1,2*", b"1,2*x", b"1,2*46*46", b"1.5,2", b"a,b", b"-1,2,3"],
)
def test_garbage_lines(line):
    assert parse_line(line) is None


def test_a_checksum_finds_a_changed_digit():
    line = with_checksum(b"1000,-2000")
    assert parse_line(line) == EncoderLine(1000, -2000)
    assert parse_line(line.replace(b"-2000", b"-2001")) is None


@given(st.binary(max_size=300))
def test_no_bytes_break_the_parser(line):
    parse_line(line)


@given(st.lists(st.one_of(st.binary(max_size=200), st.just(b"\n"), st.just(b"7" * 100))))
def test_chunks_do_not_matter_and_memory_is_bounded(chunks):
    stream = b"".join(chunks)
    whole, pieces = LineSplitter(), LineSplitter()
    expected = whole.feed(stream)
    lines = []
    for chunk in chunks:
        lines += pieces.feed(chunk)
        assert len(pieces._rest) <= MAX_LINE
    assert lines == expected
    assert pieces.overlong == whole.overlong
    dropped = [line for line in stream.split(b"\n")[:-1] if len(line) > MAX_LINE]
    assert whole.overlong == len(dropped)


def test_remarks_and_blank_lines_are_no_readings():
    assert LineSplitter().feed(b"# ready\r\n\r\n1,2\r\n  \n3,4\n5,") == [b"1,2\r", b"3,4"]


def test_the_senders_clock_takes_out_the_delay_and_its_own_wrap():
    clock = SenderClock()
    sent = [2**32 - 50_000 + 10_000 * k for k in range(20)]
    delays = [3_000_000 * (k % 4) for k in range(20)]
    host = 5_000_000_000
    for k, (t_us, delay) in enumerate(zip(sent, delays, strict=True)):
        true_time = host + 10_000_000 * k
        assert clock.host_time(t_us % 2**32, true_time + delay) == pytest.approx(
            true_time, abs=100_000
        )


def test_a_slow_senders_clock_is_followed_and_a_restart_costs_one_line():
    clock = SenderClock()
    arrival = stamp = 0
    for k in range(2000):
        arrival = 100_000_000 * k
        # 100 ppm slow: after 200 s it is 20 ms behind.
        stamp = clock.host_time(int(arrival * (1 - 1e-4)) // 1000, arrival)
    assert arrival - stamp < 100_000
    assert clock.host_time(123, arrival + 1000) == arrival + 1000
    assert clock.host_time(100_123, arrival + 100_001_000) == pytest.approx(
        arrival + 100_001_000, abs=100_000
    )


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    yield master, path
    for descriptor in (master, slave):
        try:
            os.close(descriptor)
        except OSError:  # closed by the test that unplugs it
            continue


def collect(reader: SerialEncoderReader, count: int, seconds: float = 5.0) -> list:
    readings, end = [], time.monotonic() + seconds
    while len(readings) < count and time.monotonic() < end and not reader.error:
        reader.wait(0.2)
        readings += reader.ticks()
    return readings


@pytest.mark.parametrize("with_clock", [False, True])
def test_five_hundred_lines_with_garbage_and_a_wrap(terminal, with_clock):
    master, path = terminal
    lines = []
    for k in range(500):
        body = b"%d,%d" % ((65000 + 10 * k) % 65536, (-7 * k) % 65536)
        lines.append(with_checksum(b"%d," % (k * 1000) + body) if with_clock else body)
        if k % 50 == 0:
            lines.append([b"\xff\x00,,", b"12,99999", b"9" * 300, b"1,2*77"][k // 50 % 4])
    stream = b"\r\n".join(lines) + b"\r\n"

    def write() -> None:
        for begin in range(0, len(stream), 37):
            os.write(master, stream[begin : begin + 37])

    with SerialEncoderReader(path, counter_bits=16) as reader:
        writer = threading.Thread(target=write)
        writer.start()
        readings = collect(reader, 500)
        writer.join()
        assert reader.error is None
        assert reader.garbled == 10
    assert [r.left_total for r in readings] == [65000 + 10 * k for k in range(500)]
    assert readings[-1].left == (65000 + 4990) % 65536
    assert [r.right_total for r in readings] == [-7 * k for k in range(500)]
    stamps = [r.stamp for r in readings]
    assert all(a < b for a, b in itertools.pairwise(stamps))
    assert time.monotonic_ns() - stamps[-1] < 10e9


def test_another_protocol_is_another_parser(terminal):
    master, path = terminal

    def semicolons(line: bytes) -> EncoderLine | None:
        return parse_line(line.replace(b";", b","))

    with SerialEncoderReader(path, counter_bits=16, parse=semicolons) as reader:
        os.write(master, b"1;2\n")
        (reading,) = collect(reader, 1)
    assert (reading.left, reading.right) == (1, 2)


def test_an_unplugged_device_is_an_error_state_and_nothing_hangs():
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    reader = SerialEncoderReader(path, counter_bits=16)
    reader.connect()
    os.write(master, b"1,2\n3,4\n")
    assert len(collect(reader, 2)) == 2
    os.close(slave)
    os.close(master)
    end = time.monotonic() + 3.0
    while reader.error is None and time.monotonic() < end:
        time.sleep(0.01)
    assert reader.error is not None
    assert path in reader.error
    assert "check the cable" in reader.error
    begin = time.monotonic()
    assert reader.wait(1.0) is False
    reader.disconnect()
    assert time.monotonic() - begin < 1.0


def test_silence_is_no_error_and_closing_is_quick(terminal):
    _, path = terminal
    with SerialEncoderReader(path) as reader:
        assert reader.wait(0.05) is False
        assert reader.error is None
        begin = time.monotonic()
    assert time.monotonic() - begin < 1.0


def test_a_port_that_is_not_there(tmp_path):
    with pytest.raises(OdometryError, match=r"ttyNONE: cannot be opened.*check the cable"):
        SerialEncoderReader(str(tmp_path / "ttyNONE")).connect()
