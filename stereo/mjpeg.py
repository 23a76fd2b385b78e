"""The body of an MJPEG stream over HTTP (multipart/x-mixed-replace) cut into its images."""

from __future__ import annotations

import re
from typing import NamedTuple

from stereo.encoded import JPEG_END, JPEG_START

LONGEST_HEADER = 4096  # bytes
LONGEST_IMAGE = 32 << 20  # bytes

_LENGTH = re.compile(rb"^content-length:\s*(\d{1,9})\s*$", re.IGNORECASE | re.MULTILINE)
# Seconds of the camera's clock, as mjpg-streamer and others send them.
_TAKEN = re.compile(rb"^x-timestamp:\s*(\d{1,10})\.(\d{1,9})\s*$", re.IGNORECASE | re.MULTILINE)
_TYPE = re.compile(rb"^content-type:\s*image/jpe?g", re.IGNORECASE | re.MULTILINE)


class Part(NamedTuple):
    """One image: when its headers had arrived [ns], when the camera says it was taken [ns of its
    own clock] where it does, and the JPEG."""

    arrival: int
    taken: int | None
    jpeg: bytes


class MjpegParser:
    """Takes chunks of the stream, gives whole images with the time their headers were complete.

    Parts with a Content-Length are cut by it, others by the boundary. Keeps at most one image
    between chunks; bytes that make no part are dropped and counted in `dropped`.
    """

    def __init__(self, boundary: bytes) -> None:
        self.dropped = 0
        self._mark = b"--" + boundary.removeprefix(b"--")
        self._rest = bytearray()
        self._stamp: int | None = None  # of the part whose body is awaited
        self._length: int | None = None
        self._taken: int | None = None

    def feed(self, chunk: bytes, stamp: int) -> list[Part]:
        """Every image that this chunk completes; `stamp` of the chunk's arrival [ns]."""
        self._rest += chunk
        images = []
        while True:
            if self._stamp is None and not self._header(stamp):
                return images
            body = self._body()
            if body is None:
                return images
            assert self._stamp is not None
            images.append(Part(self._stamp, self._taken, body))
            self._stamp = None

    def _header(self, stamp: int) -> bool:
        """Take the next part's headers off the buffer; False while they are not complete."""
        while True:
            begin = self._rest.find(self._mark)
            if begin < 0:
                self._drop(max(0, len(self._rest) - len(self._mark)))
                return False
            self._drop(begin)
            end = self._rest.find(b"\r\n\r\n", 0, LONGEST_HEADER)
            if end < 0:
                if len(self._rest) < LONGEST_HEADER:
                    return False
                self._drop(len(self._mark))
                continue
            headers = bytes(self._rest[:end]).replace(b"\r\n", b"\n")
            length = _LENGTH.search(headers)
            size = int(length[1]) if length else None
            if (size is None and not _TYPE.search(headers)) or (size or 0) > LONGEST_IMAGE:
                self._drop(len(self._mark))
                continue
            del self._rest[: end + 4]
            self._stamp, self._length = stamp, size
            taken = _TAKEN.search(headers)
            self._taken = None
            if taken:
                self._taken = int(taken[1]) * 1_000_000_000 + int(taken[2].ljust(9, b"0"))
            return True

    def _body(self) -> bytes | None:
        if self._length is not None:
            if len(self._rest) < self._length:
                return None
            body = bytes(self._rest[: self._length])
            del self._rest[: self._length]
            return body
        end = self._rest.find(b"\r\n" + self._mark)
        if end < 0:
            if len(self._rest) > LONGEST_IMAGE:
                self._drop(len(self._rest))
                self._stamp = None
            return None
        body = bytes(self._rest[:end])
        del self._rest[:end]
        return body

    def _drop(self, count: int) -> None:
        # Line ends between the parts are no loss.
        self.dropped += len(bytes(self._rest[:count]).strip(b"\r\n"))
        del self._rest[:count]


def looks_like_jpeg(data: bytes) -> bool:
    """Whether bytes begin and end as a JPEG does."""
    return data.startswith(JPEG_START) and JPEG_END in data[-64:]
