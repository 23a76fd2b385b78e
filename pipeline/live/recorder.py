"""Recorder: a thread that writes a recording while it is made, and one that syncs it.

Nothing waits for the disk: what is to be written stands in a queue of bounded size. When the disk
is too slow for the cameras the queue is full; then pairs are lost, counted and named.
"""

from __future__ import annotations

import errno
import queue
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable

from odometry.reader import Tap
from pipeline.live.recording_files import RecordingFiles
from stereo.camera import CapturedPair

WAITING = 200  # pairs
MOST_NOTES = 1000  # that wait to be written
SYNC_EVERY = 1.0  # s
# So much of the disk is left free, so that the map can still be saved [bytes].
RESERVE = 64 << 20
TICKS_EVERY = 0.05  # s

Tell = Callable[[str], None]


class Recorder:
    """Writes pairs, readings and notes until it is closed; a context manager.

    counts: pairs recorded; `dropped`: pairs that were not, because the queue was full or the
    disk failed; `notes_lost`: notes that found no place. error: why it
    stopped, in words, when the disk is full or fails; what was written is kept.
    """

    def __init__(self, files: RecordingFiles, tell: Tell, reserve: int = RESERVE) -> None:
        self.files = files
        self.counts: Counter[str] = Counter(pairs=0, dropped=0, notes_lost=0)
        self.error: str | None = None
        self.slowest_sync = 0.0
        self._tell = tell
        self._reserve = reserve
        self._tap: Tap | None = None
        self._waiting: queue.Queue[CapturedPair] = queue.Queue(WAITING)
        self._notes: deque[tuple[int, str]] = deque(maxlen=MOST_NOTES)
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._writer = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._syncer = threading.Thread(target=self._sync, name="sync", daemon=True)

    def listen(self, tap: Tap) -> None:
        """Also record the readings of a tap; before `start`."""
        self._tap = tap

    def start(self) -> None:
        """Begin to write."""
        self._writer.start()
        self._syncer.start()

    def __enter__(self) -> Recorder:
        self.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def add(self, pair: CapturedPair) -> bool:
        """Take a pair; False: it is lost, the disk is too slow or full. Never waits."""
        if self.error is None:
            try:
                self._waiting.put_nowait(pair)
                return True
            except queue.Full:
                if not self.counts["dropped"]:
                    self._tell("the disk is too slow: pairs are lost (give fewer or a faster one)")
        self._drop()
        return False

    def note(self, stamp: int, text: str) -> None:
        """Write down what happened."""
        self.counts["notes_lost"] += len(self._notes) == MOST_NOTES
        self._notes.append((stamp, text))

    def drain(self) -> None:
        """Wait until every pair that was taken is written, or lost: `counts` is then final."""
        self._waiting.join()

    @property
    def backlog(self) -> int:
        """Pairs that wait to be written."""
        return self._waiting.qsize()

    def close(self) -> None:
        """Write and sync all that is waiting."""
        self._stop.set()
        self._writer.join()
        self._syncer.join()
        try:
            self.files.close()
        except OSError as error:
            self._fail(error)

    def _write(self) -> None:
        last = False
        while True:
            # What came before the end was asked for is still written.
            last = last or self._stop.is_set()
            try:
                pair = self._waiting.get(timeout=0.0 if last else TICKS_EVERY)
            except queue.Empty:
                pair = None
            written = self.counts["pairs"]
            if self.error is None:
                try:
                    self._take(pair)
                except OSError as error:
                    self._fail(error)
            if pair is not None:
                if self.counts["pairs"] == written:
                    self._drop()
                self._waiting.task_done()
            if pair is None and last:
                return

    def _drop(self) -> None:
        with self._lock:
            self.counts["dropped"] += 1

    def _take(self, pair: CapturedPair | None) -> None:
        if self._tap is not None:
            self.files.add_readings(self._tap.readings())
        while self._notes:
            self.files.add_note(*self._notes.popleft())
        if pair is not None:
            self.files.add_pair(pair)
            self.counts["pairs"] += 1

    def _sync(self) -> None:
        while not self._stop.wait(SYNC_EVERY) and self.error is None:
            begin = time.monotonic()
            try:
                self.files.sync()
                if shutil.disk_usage(self.files.folder).free < self._reserve:
                    raise OSError(errno.ENOSPC, "")
            except OSError as error:
                self._fail(error)
            self.slowest_sync = max(self.slowest_sync, time.monotonic() - begin)

    def _fail(self, error: OSError) -> None:
        if self.error is not None:
            return
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        why = "no space left on the disk" if full else f"cannot be written ({error.strerror})"
        self.error = f"{self.files.folder}: {why}: recording ended, all before it is kept"
        self._tell(self.error)
