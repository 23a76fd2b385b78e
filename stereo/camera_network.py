"""NetworkCamera: an MJPEG stream over HTTP, its images kept as the bytes that were sent.

OpenCV reads such streams too, but decodes them: the JPEG is lost, and so is its arrival time.
"""

from __future__ import annotations

import base64
import contextlib
import http.client
import re
import socket
import time
from collections import deque
from urllib.parse import urlsplit

from stereo.camera import Camera, Frame
from stereo.errors import CameraError
from stereo.mjpeg import MjpegParser
from stereo.stream_clock import StreamClock

TIMEOUT = 2.0  # s without a byte: the stream is dead
CHUNK = 1 << 16
STREAM = "multipart/x-mixed-replace"


class NetworkCamera(Camera):
    """Frames of `http://HOST[:PORT]/PATH`.

    Stamped by the camera's own clock brought to this machine's where it sends `X-Timestamp`, else
    when an image's headers had arrived. It speaks to that host alone: redirections are refused.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._parts = urlsplit(address)
        self._connection: http.client.HTTPConnection | None = None
        self._response: http.client.HTTPResponse | None = None
        self._parser, self._clock = MjpegParser(b""), StreamClock()
        self._waiting: deque[Frame] = deque()

    def connect(self) -> None:
        """Ask for the stream. Raises CameraError: nobody there, or no MJPEG stream."""
        parts = self._parts
        host = parts.hostname or ""
        connection = http.client.HTTPConnection(host, parts.port or 80, timeout=TIMEOUT)
        path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        try:
            connection.request("GET", path, headers=self._credentials())
            response = connection.getresponse()
            boundary = self._boundary(response)
        except (OSError, http.client.HTTPException) as error:
            connection.close()
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise CameraError(
                f"{self.address}: no answer ({reason}): is the camera on and in this network?"
            ) from None
        except CameraError:
            connection.close()
            raise
        # The response takes the socket over; it is kept to end a read that waits.
        self._connection, self._response = connection, response
        self._parser, self._clock = MjpegParser(boundary), StreamClock()
        self._waiting.clear()

    def read(self) -> Frame:
        """The next image; raises CameraError when the stream ends or stops."""
        response = self._response
        if response is None:
            raise CameraError(f"{self.address}: not connected")
        while not self._waiting:
            try:
                chunk = response.read1(CHUNK)
            except TimeoutError:
                raise CameraError(f"{self.address}: sent nothing for {TIMEOUT:g} s") from None
            except (OSError, ValueError, AttributeError, http.client.HTTPException):
                chunk = b""
            if not chunk:
                raise CameraError(f"{self.address}: the stream ended")
            before = self._parser.dropped
            parts = self._parser.feed(chunk, time.monotonic_ns())
            self.garbage += self._parser.dropped - before
            for arrival, taken, jpeg in parts:
                stamp = arrival if taken is None else self._clock.host_time(taken, arrival)
                self._waiting.append(Frame(stamp, jpeg, taken))
        return self._waiting.popleft()

    def close(self) -> None:
        """End the stream."""
        self.interrupt()
        connection = self._connection
        self._connection = self._response = None
        if connection is not None:
            connection.close()

    def interrupt(self) -> None:
        """Shut the socket down: a `read` that waits raises CameraError."""
        connection, response = self._connection, self._response
        sockets = [connection.sock if connection else None, _socket_of(response)]
        for sock in sockets:
            if sock is not None:
                with contextlib.suppress(OSError):
                    sock.shutdown(socket.SHUT_RDWR)

    def _credentials(self) -> dict[str, str]:
        if self._parts.username is None:
            return {}
        text = f"{self._parts.username}:{self._parts.password or ''}".encode()
        return {"Authorization": f"Basic {base64.b64encode(text).decode('ascii')}"}

    def _boundary(self, response: http.client.HTTPResponse) -> bytes:
        if response.status in (401, 403):
            raise CameraError(
                f"{self.address}: wants a password: write http://NAME:PASSWORD@HOST/STREAM"
            )
        if response.status != 200:
            raise CameraError(
                f"{self.address}: answers {response.status} {response.reason}: give the address "
                "of the MJPEG stream itself"
            )
        kind = response.getheader("Content-Type") or ""
        boundary = re.search(r'boundary="?([^";\s]+)"?', kind)
        if not kind.lower().startswith(STREAM) or boundary is None:
            raise CameraError(
                f"{self.address}: sends {kind or 'an unnamed kind of data'}, no MJPEG stream "
                f"({STREAM}): give the stream's address"
            )
        return boundary[1].encode("latin-1")


def _socket_of(response: http.client.HTTPResponse | None) -> socket.socket | None:
    raw = getattr(getattr(response, "fp", None), "raw", None)
    return getattr(raw, "_sock", None)
