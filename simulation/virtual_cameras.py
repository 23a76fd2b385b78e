"""VirtualCameras: the pairs of a drive served as two MJPEG streams over HTTP, on loopback alone."""

from __future__ import annotations

import contextlib
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np

from simulation.virtual_drive import Timeline
from simulation.virtual_faults import SIDES, Fault, active

LOOPBACK = "127.0.0.1"
BOUNDARY = "frame"
# A camera that is watched alone shows where the robot stands after this long, this often [s].
ALONE, STANDING = 1.0, 0.5
# Images that a slow watcher has not taken in this time are lost [s].
PATIENCE = 2.0


class VirtualCameras:
    """Serves `http://127.0.0.1:PORT/left.mjpg` and `right.mjpg`."""

    def __init__(self, timeline: Timeline, faults: tuple[Fault, ...] = (), port: int = 0) -> None:
        self._timeline = timeline
        self._faults = faults
        self._stop = threading.Event()
        self._server = ThreadingHTTPServer((LOOPBACK, port), self._handler())
        self._server.daemon_threads = True
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), name="virtual cameras", daemon=True
        )

    def address(self, side: str) -> str:
        """Of the stream of the left or right camera."""
        return f"http://{LOOPBACK}:{self._server.server_address[1]}/{side}.mjpg"

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def stop(self) -> None:
        """End all streams."""
        self._stop.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        cameras = self

        class Handler(BaseHTTPRequestHandler):
            disable_nagle_algorithm = True

            def do_GET(self) -> None:
                side = self.path.strip("/").partition(".")[0]
                if side not in SIDES:
                    self.send_error(404)
                    return
                if active(cameras._faults, "lost", cameras._timeline.seconds(), side):
                    self.send_error(503)
                    return
                self.send_response(200)
                kind = f"multipart/x-mixed-replace; boundary={BOUNDARY}"
                self.send_header("Content-Type", kind)
                self.end_headers()
                with contextlib.suppress(OSError):
                    cameras._serve(side, self.wfile.write)

            def log_message(self, format: str, *args: object) -> None:
                """Nothing: the command says what matters."""

        return Handler

    def _serve(self, side: str, write) -> None:
        timeline = self._timeline
        timeline.watch(side)
        try:
            self._stand(side, write)
            pair = timeline.pair_at(timeline.seconds())
            while not self._stop.is_set():
                due = timeline.time_of(pair)
                if not self._wait(timeline.until(due) + self._late(side, due)):
                    return
                if active(self._faults, "lost", due, side):
                    return
                if timeline.until(due) > -PATIENCE:
                    self._send(side, pair, due, write)
                pair += 1
                if pair > len(timeline.drive.stamps):
                    timeline.finished.set()
        finally:
            timeline.leave(side)

    def _stand(self, side: str, write) -> None:
        """Until the drive begins: nothing, or what is seen at the start for a lone watcher."""
        begin = time.monotonic()
        while self._timeline.seconds() < 0 and not self._stop.wait(0.002):
            if self._timeline.waiting and time.monotonic() - begin > ALONE:
                begin = time.monotonic() - ALONE + STANDING
                self._send(side, 0, -1.0, write)

    def _wait(self, seconds: float) -> bool:
        return not self._stop.wait(seconds) if seconds > 0 else not self._stop.is_set()

    def _late(self, side: str, due: float) -> float:
        late = [f.late for f in self._faults if f.kind == "skew" and f.during(due)]
        return max(late, default=0.0) if side == "right" else 0.0

    def _send(self, side: str, pair: int, due: float, write) -> None:
        if any(active(self._faults, kind, due, side) for kind in ("stall", "drop")):
            return
        jpegs = self._timeline.drive.jpegs(min(pair, len(self._timeline.drive.stamps) - 1))
        jpeg = jpegs[SIDES.index(side)]
        if active(self._faults, "corrupt", due, side):
            jpeg = _damaged(jpeg, pair)
        head = (
            f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n"
            f"X-Timestamp: {self._timeline.clock(due) + self._late(side, due):.6f}\r\n\r\n"
        )
        write(head.encode("ascii") + jpeg + b"\r\n")


def _damaged(jpeg: bytes, pair: int) -> bytes:
    """Cut short, or scrambled in the middle."""
    rng = np.random.default_rng((pair, 8))
    if rng.random() < 0.5:
        return jpeg[: int(rng.integers(2, len(jpeg) - 2))]
    begin = int(rng.integers(2, len(jpeg) // 2))
    noise = rng.integers(0, 256, len(jpeg) // 4).astype(np.uint8).tobytes()
    return jpeg[:begin] + noise + jpeg[begin + len(noise) :]
