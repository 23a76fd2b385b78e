"""EncoderDecoder: the bytes of a serial line with their times -> readings. No I/O.

The same events give the same readings, so that a raw log replays a run exactly.
"""

from __future__ import annotations

from collections import Counter

from odometry.clock import SenderClock
from odometry.counters import CounterTracker, Limits, TickReading
from odometry.protocols.base import Banner, EncoderProtocol, Sample
from odometry.protocols.guess import looks_like
from odometry.raw_log import LOST, OPENED, SENT, LineEvent

MS = 1_000_000
# An answer that took longer than this a request tells too little of when it was true.
SLOW = 50 * MS
# An answer that took longer than this will not come; then the line must be quiet for a while.
TIMEOUT = 300 * MS
QUIET = 100 * MS
# Readings further apart than this are a silence.
SILENCE = 500 * MS
# So many bytes without a reading are the wrong protocol or baud rate.
MANY_BYTES = 200
REMEMBERED = 512
# Lines of one chunk were sent one after the other, no further apart than this.
SPREAD = 20 * MS
MOST_EVENTS = 1000


class EncoderDecoder:
    """Follows one serial line. Times are the host's monotonic clock in ns.

    A reading that was polled is stamped with the middle of its round trip; a streamed one with
    the sender's clock brought to the host's, or with its arrival.

    counts: all that went wrong, by name; events: the same in words.
    """

    def __init__(self, protocol: EncoderProtocol, limits: Limits, rate: float) -> None:
        self.protocol = protocol
        self.counts: Counter[str] = Counter()
        self._tracker = CounterTracker(limits)
        self._clock = SenderClock()
        self._period = round(1e9 / rate)
        self._open = False
        self._next = 0  # when the next request is due
        self._asked = 0  # how many requests of the cycle were sent
        self._cycle_began = 0
        self._sent = 0
        self._last_chunk = 0
        self._last_sample: int | None = None
        self._last_stamp: int | None = None
        self._opened_at = 0
        self._unread = b""  # the latest bytes, while there is no reading
        self._unread_size = 0
        self._advised = False
        self._events: list[str] = []

    def take(self, event: LineEvent) -> list[TickReading]:
        """What an event of the line, live or from a log, brings."""
        if event.kind == OPENED:
            self._opened(event.stamp, event.data)
        elif event.kind == LOST:
            self._lost(event.data)
        elif event.kind == SENT:
            self._requested(event.stamp, event.data)
        else:
            return self._received(event.stamp, event.data)
        return []

    def due(self, now: int) -> bytes | None:
        """The request to send now, if any."""
        requests = self.protocol.requests
        if not requests or not self._open:
            return None
        if self.protocol.waiting:
            quiet = now - max(self._sent, self._last_chunk) > QUIET
            return requests[0] if now - self._sent > TIMEOUT and quiet else None
        if 0 < self._asked < len(requests):
            return requests[self._asked]
        return requests[0] if now >= self._next else None

    def wait_s(self, now: int) -> float:
        """How long no request is due, 0.1 s at most [s]."""
        if 0 < self._asked < len(self.protocol.requests):
            return 0.0
        return min(max(self._next - now, 0) / 1e9, 0.1)

    def report(self) -> dict[str, int]:
        """How often what happened."""
        counts = self.counts + self.protocol.counts + self._tracker.counts
        counts["clock_jumps"] += self._clock.jumps
        return {name: n for name, n in sorted(counts.items()) if n}

    def events(self) -> list[str]:
        """Messages since the last call."""
        self._collect()
        events, self._events = self._events, []
        return events

    def advice(self) -> str | None:
        """Why there are no readings: None while there are some, or too few bytes to tell."""
        if self._unread_size < MANY_BYTES:
            return None
        return (
            f"{self._unread_size} bytes arrived and none of them is a reading; "
            f"{looks_like(self._unread)}"
        )

    def say(self, message: str) -> None:
        """Add a message in words."""
        self._events = [*self._events[-MOST_EVENTS:], message]

    def _collect(self) -> None:
        for message in self._tracker.events:
            self.say(message)
        self._tracker.events.clear()

    def _opened(self, stamp: int, port: bytes) -> None:
        if self._open or self._last_stamp is not None:
            self.counts["reconnects"] += 1
            self.say(f"encoders: reading again from {port.decode('utf-8', 'replace')}")
            self._tracker.announce_restart()
        self.protocol.restart()
        self._clock = _fresh(self._clock)
        self._open, self._asked, self._opened_at = True, 0, stamp
        self._next = stamp + round(self.protocol.startup_s * 1e9)

    def _lost(self, reason: bytes) -> None:
        self.counts["lost_devices"] += 1
        self._open = False
        self.protocol.restart()
        self.say(f"encoders: {reason.decode('utf-8', 'replace')}")

    def _requested(self, stamp: int, data: bytes) -> None:
        if self.protocol.waiting:
            self.counts["unanswered"] += 1
            self.protocol.restart()
            self._asked = 0
        if self._asked >= len(self.protocol.requests):
            self._asked = 0
        if self._asked == 0:
            self._cycle_began = stamp
            # Late requests are not made up for.
            self._next = max(self._next, stamp - self._period) + self._period
        self._asked += 1
        self._sent = stamp
        self.protocol.expect(data)

    def _received(self, stamp: int, data: bytes) -> list[TickReading]:
        polled = bool(self.protocol.requests)
        asked = self.protocol.waiting
        samples: list[Sample] = []
        for item in self.protocol.feed(data):
            if isinstance(item, Banner):
                self._banner(item)
            elif polled and not asked:
                self.counts["unasked"] += 1
            else:
                samples.append(item)
        chunk, self._last_chunk = self._last_chunk, stamp
        self._remember(data, bool(samples))
        if not samples:
            return []
        if polled:
            self.counts["unasked"] += len(samples) - 1
            trip = stamp - self._cycle_began
            if trip > SLOW * len(self.protocol.requests):
                self.counts["slow_round_trips"] += 1
                return []
            return self._readings([(self._cycle_began + trip // 2, samples[0])])
        apart = min(max(stamp - chunk, 0) // len(samples), SPREAD)
        return self._readings(
            [
                (self._stamp(sample, stamp, apart * (len(samples) - 1 - k)), sample)
                for k, sample in enumerate(samples)
            ]
        )

    def _stamp(self, sample: Sample, arrival: int, before: int) -> int:
        if sample.t_us is None:
            return arrival - before
        return self._clock.host_time(sample.t_us, arrival)

    def _readings(self, samples: list[tuple[int, Sample]]) -> list[TickReading]:
        readings: list[TickReading] = []
        for stamp, sample in samples:
            last = self._last_stamp
            if last is not None:
                # Lines that came in one chunk, and clocks, must not stop time or turn it back.
                stamp = max(stamp, last + 1)
                if stamp - last > SILENCE:
                    self.counts["silences"] += 1
                    self.say(f"encoders: silent for {(stamp - last) / 1e9:.1f} s")
            self._last_stamp = stamp
            readings += self._tracker.take(stamp, sample.left, sample.right)
        self._collect()
        return readings

    def _banner(self, banner: Banner) -> None:
        self.counts["banners"] += 1
        if self.counts["banners"] <= MOST_EVENTS:
            self.say(f"encoders: the board says {banner.text[:60]!r}")
        self._tracker.announce_restart()

    def _remember(self, data: bytes, read: bool) -> None:
        if read:
            self._unread, self._unread_size, self._advised = b"", 0, False
            return
        self._unread = (self._unread + data)[-REMEMBERED:]
        self._unread_size += len(data)
        advice = None if self._advised else self.advice()
        if advice is not None:
            self._advised = True
            self.say(f"encoders: {advice}")


def _fresh(clock: SenderClock) -> SenderClock:
    """A clock that has learned nothing yet, with the count of the one before."""
    new = SenderClock()
    new.jumps = clock.jumps
    return new
