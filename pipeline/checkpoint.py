"""What a run has seen so far, in a file that grows with it: a run that was cut off goes on.

Nearly all the time of a run is stereo. The checkpoint is the log of the observations: on
`--resume` they are taken from there in place of the images, and all else is computed again. A run
is a function of its input, so that it ends with the same bytes as one that was never cut off.

    first line   JSON: what the run was asked for
    then         records: length and CRC-32 (4 bytes each, little-endian), MessagePack

A record that is cut short or damaged ends the log. Losing the last of them costs time only, so
that nothing is synced to the disk.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Protocol

import msgspec
import numpy as np

from pipeline.errors import InputError
from pipeline.frontend import Observation
from stereo.scan import RangeScan

VERSION = 1
_FRAME = struct.Struct("<II")


class Observations(Protocol):
    """What was seen before, by the stamp of the pair."""

    def get(self, stamp: int) -> Observation | None:
        """The observation of that pair; None: it must be looked at."""
        ...

    def add(self, stamp: int, seen: Observation) -> None:
        """Remember it."""
        ...


class _Nothing:
    def get(self, stamp: int) -> Observation | None:
        del stamp

    def add(self, stamp: int, seen: Observation) -> None:
        del stamp, seen


NOTHING: Observations = _Nothing()


class _Record(msgspec.Struct, array_like=True):
    """An observation; arrays as their bytes (float64; points float32, colours uint8)."""

    stamp: int
    kind: str
    damage: str
    brightness: float = 1.0
    origin: tuple[float, float, float] | None = None
    max_range: float = 0.0
    bearing: bytes | None = None  # None: that of the record before
    range: bytes = b""
    sigma: bytes = b""
    points: bytes | None = None
    colours: bytes | None = None


class Checkpoint:
    """The log of a run at `path`.

    start: begins a new one. resume: opens one, with what it was asked for in `asked`.
    """

    def __init__(self, path: Path, asked: dict[str, Any], known: list[_Place], file: BinaryIO):
        self.path = path
        self.asked = asked
        # Records stay on the disk: those of a long run do not fit into a small machine's memory.
        self._known = {place.stamp: place for place in known}
        self._reader = path.open("rb") if known else None
        self._file: BinaryIO | None = file
        self._bearing = known[-1].bearing if known else None
        self._empty = not known

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_exception: object) -> None:
        # What ended a run by an error would end it again; one that was interrupted goes on.
        if kind is not None and issubclass(kind, Exception):
            self.discard()
        else:
            self.close()
        if self._reader is not None:
            self._reader.close()

    def __len__(self) -> int:
        return len(self._known)

    @staticmethod
    def start(path: Path, asked: dict[str, Any]) -> Checkpoint:
        """A new log, in place of an old one.

        Raises:
            InputError: it cannot be written.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = path.open("wb")
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from None
        head = {"beemap_checkpoint": VERSION, **asked}
        try:
            file.write(json.dumps(head).encode("ascii") + b"\n")
            file.flush()
        except OSError as error:
            with suppress(OSError):
                file.close()
            path.unlink(missing_ok=True)
            raise InputError(f"{path}: cannot be written ({error.strerror})") from None
        return Checkpoint(path, asked, [], file)

    @staticmethod
    def resume(path: Path) -> Checkpoint:
        """The log of a run that was cut off, to be gone on with.

        Raises:
            InputError: there is none, or it is not one of ours.
        """
        try:
            file = path.open("r+b")
        except OSError as error:
            raise InputError(
                f"{path}: no checkpoint ({error.strerror}): the run ended well, or never began"
            ) from None
        try:
            asked = json.loads(file.readline())
            version = asked.pop("beemap_checkpoint")
        except (ValueError, KeyError, AttributeError):
            version = None
        if version != VERSION:
            file.close()
            raise InputError(f"{path}: not a checkpoint of this version: map afresh") from None
        places = _places(file)
        file.truncate()
        return Checkpoint(path, asked, places, file)

    def get(self, stamp: int) -> Observation | None:
        """What the log holds of the pair."""
        place = self._known.get(stamp)
        if place is None or self._reader is None:
            return None
        payload = os.pread(self._reader.fileno(), place.length, place.offset)
        record = msgspec.msgpack.decode(payload, type=_Record)
        record.bearing = record.bearing or place.bearing
        return _observation(record)

    def add(self, stamp: int, seen: Observation) -> None:
        """Append an observation that is not in the log; a full disk ends the log, not the run."""
        if stamp in self._known or self._file is None:
            return
        record = _as_record(stamp, seen)
        bearing, record.bearing = record.bearing, _if_new(record.bearing, self._bearing)
        self._bearing = bearing or self._bearing
        payload = msgspec.msgpack.encode(record)
        try:
            self._file.write(_FRAME.pack(len(payload), zlib.crc32(payload)) + payload)
            self._file.flush()
            self._empty = False
        except OSError:
            self.close()

    def close(self) -> None:
        """End the log; it stays when there is something in it."""
        file, self._file = self._file, None
        if file is not None:
            file.close()
            if self._empty:
                self.path.unlink(missing_ok=True)

    def discard(self) -> None:
        """The run ended well: the log is of no use any more."""
        self.close()
        self.path.unlink(missing_ok=True)


class _Place(NamedTuple):
    """Where the payload of a record lies in the file; bearing: as of `_Record`, shared."""

    stamp: int
    offset: int
    length: int
    bearing: bytes | None


def _places(file: BinaryIO) -> list[_Place]:
    """Of all whole records; the file stands behind the last of them."""
    places: list[_Place] = []
    bearing = None
    while True:
        place = file.tell()
        head = file.read(_FRAME.size)
        length, crc = _FRAME.unpack(head) if len(head) == _FRAME.size else (0, 0)
        payload = file.read(length) if length else b""
        if not payload or len(payload) < length or zlib.crc32(payload) != crc:
            file.seek(place)
            return places
        record = msgspec.msgpack.decode(payload, type=_Record)
        bearing = record.bearing or bearing
        places.append(_Place(record.stamp, place + _FRAME.size, length, bearing))


def _as_record(stamp: int, seen: Observation) -> _Record:
    if seen.scan is None:
        return _Record(stamp, seen.kind, seen.damage)
    scan = seen.scan
    bearing, ranges, sigma = (
        np.asarray(a, np.float64).tobytes() for a in (scan.bearing, scan.range, scan.sigma)
    )
    record = _Record(stamp, "", "", seen.brightness, scan.origin, scan.max_range)
    record.bearing, record.range, record.sigma = bearing, ranges, sigma
    if seen.points is not None and seen.colours is not None:
        record.points = np.asarray(seen.points, np.float32).tobytes()
        record.colours = seen.colours.tobytes()
    return record


def _observation(record: _Record) -> Observation:
    if record.origin is None:
        return Observation(None, record.kind, record.damage)
    bearing, ranges, sigma = (
        np.frombuffer(a or b"").copy() for a in (record.bearing, record.range, record.sigma)
    )
    scan = RangeScan(record.stamp, record.origin, bearing, ranges, sigma, record.max_range)
    if record.points is None or record.colours is None:
        return Observation(scan, brightness=record.brightness)
    points = np.frombuffer(record.points, np.float32).reshape(-1, 3)
    colours = np.frombuffer(record.colours, np.uint8).reshape(-1, 3)
    return Observation(scan, "", "", record.brightness, points, colours)


def _if_new(bearing: bytes | None, before: bytes | None) -> bytes | None:
    return None if bearing == before else bearing
