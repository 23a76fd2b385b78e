"""Encoders and faults: `python -m benchmarks.serial_faults`.

A thousand seeded faults over simulated hours, fuzzed parsers, and the processor's share of a
thousand lines a second.
"""

from __future__ import annotations

import math
import os
import threading
import time
import tracemalloc
import tty
from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np

from benchmarks.encoder_stream import FAULTS, MS, STEP, UNTOLD, Board, drive, events, poses
from odometry.counters import Limits, TickReading
from odometry.decoder import EncoderDecoder
from odometry.devices import EncoderDevice, make_protocol
from odometry.encoders import EncoderParameters
from odometry.live import LiveOdometry
from odometry.motion import Motion, compose, inverse, wrap_angle
from odometry.protocols.base import EncoderProtocol
from odometry.protocols.guess import looks_like
from odometry.protocols.stream import checksum_of
from odometry.raw_log import LOST, OPENED, RECEIVED, SENT, LineEvent
from odometry.reader import open_encoders
from odometry.settings import OdometrySettings
from odometry.tick_log import parse_tick_log

SETTINGS = OdometrySettings()
WHEELS = EncoderParameters(2000, 0.075, 0.075, 0.3, 16)
RUNS, FAULTS_A_RUN = 50, 20
SEGMENT = 750  # steps of 20 ms from one fault to the next
# When the fault begins, when it is over for sure, and when what came of it is looked at.
AT, OVER, UNTIL = 200, 450, 650
IMAGES = 5  # steps between two images
LATE = 10  # steps until an image is asked for
JUMP_M = 0.2
# 99.9 % of a chi-square variable of three degrees of freedom. What the line's delay of up to 5 ms
# does to a motion that is asked for at an exact time [m, m, rad] comes on top.
CHI_SQUARE = 16.27
TIMING = np.array([0.003, 0.001, 0.005])
FUZZED = 100_000
LINES = 10_000


class _Tap:
    """Stands for a live tap: what the decoder gave is there at once."""

    def __init__(self) -> None:
        self.new: list[TickReading] = []
        self.latest = -1

    def put(self, readings: list[TickReading]) -> None:
        if readings:
            self.new += readings
            self.latest = readings[-1].stamp

    def wait_until(self, stamp: int, timeout_s: float) -> bool:
        del timeout_s
        return self.latest >= stamp

    def readings(self) -> list[TickReading]:
        new, self.new = self.new, []
        return new


class Tally:
    """What became of the faults of one kind."""

    def __init__(self) -> None:
        self.faults = self.named = self.beyond = self.silent_jumps = self.broken = 0
        self.errors: list[float] = []


def fault_run(seed: int, tallies: dict[str, Tally], told: Counter[str]) -> float:
    """One run of `FAULTS_A_RUN` faults; the hours that it lasts."""
    rng = np.random.default_rng((seed, 7))
    style = ("sketch", "plain", "poll")[seed % 3]
    wheels = replace(WHEELS, counter_bits=(16, 32, 12)[seed // 3 % 3])
    device = EncoderDevice("p", "arduino_bridge" if style == "poll" else "stream")
    decoder = EncoderDecoder(make_protocol(device, wheels), Limits(wheels, 1.5), device.rate)
    tap = _Tap()
    odometry = LiveOdometry(tap, wheels, SETTINGS)  # type: ignore[arg-type]
    board = Board(wheels, style, rng)
    steps = SEGMENT * FAULTS_A_RUN
    paths = drive(steps, rng)
    truth = poses(paths)
    decoder.take(LineEvent(0, OPENED, b"port"))
    kinds = [FAULTS[int(k)] for k in rng.integers(len(FAULTS), size=FAULTS_A_RUN)]
    if style != "sketch":  # a board that sends no time cannot send a wrong one
        kinds = ["stall" if kind == FAULTS[-1] else kind for kind in kinds]
    motions: list[Motion] = []
    counts = dict(decoder.report())
    for step in range(steps):
        now = step * STEP + 1000 * MS
        segment, within = divmod(step, SEGMENT)
        if within == AT:
            board.fail(kinds[segment], now, paths[step])
        for event in events(board, decoder, now, paths[step]):
            tap.put(decoder.take(event))
        if step % IMAGES == 0 and step >= LATE:
            motion = odometry.until((step - LATE) * STEP + 1000 * MS)
            if motion is not None:
                motions.append(motion)
        if within == SEGMENT - 1:
            now_counts = decoder.report()
            found = {k: n - counts.get(k, 0) for k, n in now_counts.items() if n > counts.get(k, 0)}
            found.pop("readings", None)
            told.update(found)
            counts = dict(now_counts)
            window = [m for m in motions if m.last > m.first]
            _judge(tallies[kinds[segment]], window, truth, segment, bool(found))
            motions = []
    return steps * STEP / 3.6e12


def _judge(
    tally: Tally, motions: list[Motion], truth: np.ndarray, segment: int, named: bool
) -> None:
    begin = segment * SEGMENT + AT - 50
    end = segment * SEGMENT + UNTIL
    whole: Motion | None = None
    judged: Motion | None = None  # over the fault alone: doubt of headings bends later travel
    for motion in motions:
        first, last = (round((t - 1000 * MS) / STEP) for t in (motion.first, motion.last))
        if first < begin or last > end:
            continue
        off = float(np.hypot(*_error(motion, truth)[:2]))
        doubt = math.sqrt(max(float(np.linalg.eigvalsh(motion.covariance[:2, :2]).max()), 0.0))
        tally.silent_jumps += off > JUMP_M and off > 3.0 * doubt
        whole = motion if whole is None else whole.then(motion)
        if last <= segment * SEGMENT + OVER:
            judged = whole
    tally.faults += 1
    tally.named += named
    if (
        whole is None
        or judged is None
        or not np.isfinite([*whole.increment, *whole.covariance.ravel()]).all()
    ):
        tally.broken += 1
        return
    tally.errors.append(float(np.hypot(*_error(whole, truth)[:2])))
    error, covariance = _error(judged, truth), judged.covariance + np.diag(TIMING**2)
    tally.beyond += float(error @ np.linalg.solve(covariance, error)) > CHI_SQUARE


def _error(motion: Motion, truth: np.ndarray) -> np.ndarray:
    """(3,) of a motion's increment."""
    first, last = (round((t - 1000 * MS) / STEP) for t in (motion.first, motion.last))
    error = motion.increment - compose(inverse(truth[first]), truth[last])
    error[2] = wrap_angle(error[2])
    return error


def faults() -> str:
    """The table of a thousand faults."""
    tallies: dict[str, Tally] = defaultdict(Tally)
    told: Counter[str] = Counter()
    began = time.process_time()
    hours = sum(fault_run(seed, tallies, told) for seed in range(RUNS))
    seconds = time.process_time() - began
    lines = [
        f"{RUNS * FAULTS_A_RUN} seeded faults over {hours:.1f} simulated hours ({seconds:.0f} s of "
        "processor time), three protocols, counters of 12, 16 and 32 bits, robot at up to "
        "0.7 m/s that drives on through every fault. The error is that of the motion from 1 s "
        "before the fault to 9 s after it; *beyond doubt*: from 1 s before to "
        "5 s after its begin the motion was off by more than 99.9 % of its covariance.",
        "",
        "| fault | n | named | no pose or NaN | silent jumps > 0.2 m | error median / worst [m] | "
        "beyond doubt |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind in FAULTS:
        t = tallies[kind]
        named = "no event" if kind in UNTOLD and not t.named else f"{t.named}"
        lines.append(
            f"| {kind} | {t.faults} | {named} | {t.broken} | {t.silent_jumps} | "
            f"{np.median(t.errors):.3f} / {max(t.errors):.3f} | {t.beyond} |"
        )
    counted = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in sorted(told.items()))
    return "\n".join([*lines, "", f"Named in the reports: {counted}."])


def fuzz() -> str:
    """The table of fuzzed parsers."""
    rng = np.random.default_rng(11)
    devices = {
        "stream": EncoderDevice("p"),
        "stream, fields in metres": EncoderDevice(
            "p", fields=("skip", "time_ms", "left", "right"), units="metres"
        ),
        "arduino_bridge": EncoderDevice("p", "arduino_bridge"),
        "roboclaw": EncoderDevice("p", "roboclaw"),
        "roboclaw, one by one": EncoderDevice("p", "roboclaw", command=16),
        "odrive": EncoderDevice("p", "odrive", checked=True),
    }
    seeds = [
        b"123,-5\n",
        b"9,1,2*55\r\n",
        b"12 -7\r\n",
        b"1.5 0.2\n",
        b"x;5;0.1;.2\n",
        b"1e9 nan\n",
    ]
    lines = ["| parser | inputs | exceptions | most memory [kB] |", "|---|---|---|---|"]
    for name, device in devices.items():
        limits = Limits(WHEELS, 1.5)
        decoder = EncoderDecoder(make_protocol(device, WHEELS), limits, device.rate)
        tracemalloc.start()
        for k in range(FUZZED // len(devices)):
            _fuzz_step(decoder, decoder.protocol, seeds, k, rng)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        lines.append(f"| {name} | {FUZZED // len(devices)} | 0 | {most / 1e3:.0f} |")
    text = 0
    for _ in range(2000):
        parse_tick_log("1,0,0\n2,0,0\n" + _mutated(seeds, rng).decode("latin-1"), "fuzz")
        text += 1
    lines.append(f"| ticks file | {text} | 0 | |")
    return "\n".join(lines)


def _fuzz_step(
    decoder: EncoderDecoder,
    protocol: EncoderProtocol,
    seeds: list[bytes],
    k: int,
    rng: np.random.Generator,
) -> None:
    stamp = k * 5 * MS + int(rng.integers(0, 9 * MS))
    kind = rng.random()
    if kind < 0.01:
        decoder.take(LineEvent(stamp, OPENED if kind < 0.005 else LOST, rng.bytes(5)))
    if protocol.requests and kind < 0.6:
        request = decoder.due(stamp) or protocol.requests[k % len(protocol.requests)]
        decoder.take(LineEvent(stamp, SENT, request))
    data = _mutated(seeds, rng)
    decoder.take(LineEvent(stamp, RECEIVED, data))
    looks_like(data)
    if k % 100 == 0:
        decoder.events()


def _mutated(seeds: list[bytes], rng: np.random.Generator) -> bytes:
    kind = rng.random()
    if kind < 0.3:
        return rng.bytes(int(rng.integers(0, 300)))
    data = bytearray(seeds[int(rng.integers(len(seeds)))] * int(rng.integers(1, 4)))
    for _ in range(int(rng.integers(0, 4))):
        place = int(rng.integers(len(data)))
        if rng.random() < 0.5:
            data[place] = int(rng.integers(256))
        else:
            del data[place : place + int(rng.integers(1, 5))]
            data += b"\n"
    return bytes(data)


def share() -> str:
    """What reading a thousand lines a second over a pseudo terminal costs."""
    import pty

    master, slave = pty.openpty()
    tty.setraw(slave)
    threads: dict[str, float] = {}
    device = EncoderDevice(os.ttyname(slave))
    with open_encoders(device, WHEELS, SETTINGS) as encoders:
        writer = threading.Thread(target=_write, args=(master, threads))
        began = time.monotonic()
        before = time.process_time()
        writer.start()
        read = 0
        while writer.is_alive():
            encoders.wait_until(time.monotonic_ns() + 50 * MS, 0.2)
            read += len(encoders.readings())
        time.sleep(0.2)
        read += len(encoders.readings())
        seconds = time.monotonic() - began
        used = time.process_time() - before - threads["writer"]
        report = encoders.report()
    return (
        f"{LINES} lines with time and checksum in {seconds:.1f} s over a pseudo terminal: {read} "
        f"readings, {100 * used / seconds:.1f} % of a core (reader and consumer, the writer's own "
        f"share taken off); report: {report}."
    )


def _write(master: int, threads: dict[str, float]) -> None:
    began = time.monotonic()
    for k in range(LINES):
        body = b"%d,%d,%d" % (1000 * k, k % 65536, (-k) % 65536)
        os.write(master, body + b"*%d\r\n" % checksum_of(body))
        ahead = began + k * 1e-3 - time.monotonic()
        if ahead > 0:
            time.sleep(ahead)
    threads["writer"] = time.thread_time()


def main() -> str:
    """The section of the page."""
    parts = [
        "## Encoders: `python -m benchmarks.serial_faults`",
        faults(),
        "### Parsers fuzzed",
        fuzz(),
        "### A thousand lines a second",
        share(),
    ]
    return "\n\n".join(parts)


if __name__ == "__main__":
    print(main())
