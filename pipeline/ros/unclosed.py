"""Bags that were never closed: what stands in them from the beginning, record by record.

A bag gets its index when it is closed. Of one that was cut off (power, kill -9, a copy that broke
off) the records up to the cut are whole. Sources: MCAP format specification 0; ROS bag format 2.0.
"""

from __future__ import annotations

import bz2
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

MCAP_MAGIC = b"\x89MCAP0\r\n"
BAG_MAGIC = b"#ROSBAG V2.0\n"


class Raw(NamedTuple):
    """A message as it stands in a bag; time: when it was received [ns]."""

    topic: str
    type: str
    time: int
    data: bytes


class Unreadable(NamedTuple):
    """A part of a bag that is damaged: where it begins [byte]."""

    place: int


def scan(path: Path) -> Iterator[Raw | Unreadable]:
    """All messages up to the cut, in the order of the file; nothing where it is no bag."""
    with path.open("rb") as file:
        head = file.read(len(BAG_MAGIC))
        try:
            if head == BAG_MAGIC:
                yield from _scan_bag(file, path.stat().st_size)
            elif head.startswith(MCAP_MAGIC):
                file.seek(len(MCAP_MAGIC))
                yield from _scan_mcap(file, path.stat().st_size)
        except (ValueError, KeyError, struct.error):  # no record begins here
            yield Unreadable(file.tell())


def version_of(path: Path) -> int:
    """Of ROS."""
    with path.open("rb") as file:
        return 1 if file.read(len(BAG_MAGIC)) == BAG_MAGIC else 2


def _scan_mcap(file: BinaryIO, size: int) -> Iterator[Raw | Unreadable]:
    channels = _Channels()
    for place, op, content in _mcap_records(file, size):
        if op != 0x06:
            message = channels.take(op, content)
            if message is not None:
                yield message
            continue
        try:
            inner = _mcap_chunk(content)
        except Exception:  # the decompressors have errors of many kinds
            yield Unreadable(place)
            continue
        at = 0
        while at + 9 <= len(inner):
            op, length = struct.unpack_from("<BQ", inner, at)
            message = channels.take(op, inner[at + 9 : at + 9 + length])
            if message is not None:
                yield message
            at += 9 + length


def _mcap_records(file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
    """Place, kind and content of every whole record before the end of the data."""
    while len(head := file.read(9)) == 9:
        op, length = struct.unpack("<BQ", head)
        place = file.tell()
        if op == 0x0F or length > size - place:
            return
        yield place, op, file.read(length)


def _mcap_chunk(content: bytes) -> bytes:
    size, crc = struct.unpack_from("<QI", content, 16)
    name, at = _text(content, 28)
    (length,) = struct.unpack_from("<Q", content, at)
    inner = _decompressor(name)(content[at + 8 : at + 8 + length])
    if len(inner) != size or (crc and zlib.crc32(inner) != crc):
        raise ValueError("checksum")
    return inner


class _Channels:
    """Topics and types as they are announced; messages by them."""

    def __init__(self) -> None:
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def take(self, op: int, content: bytes) -> Raw | None:
        """The message in a record, if it is one of a topic that is known."""
        if op not in (0x03, 0x04, 0x05) or len(content) < 22 - 10 * (op < 5):
            return None
        (number,) = struct.unpack_from("<H", content)
        if op == 0x03:
            self._schemas[number], _ = _text(content, 2)
        elif op == 0x04:
            (schema,) = struct.unpack_from("<H", content, 2)
            topic, _ = _text(content, 4)
            self._channels[number] = (topic, self._schemas.get(schema, ""))
        elif number in self._channels:
            (time,) = struct.unpack_from("<Q", content, 6)
            return Raw(*self._channels[number], time, content[22:])
        return None


def _text(content: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, at)
    return content[at + 4 : at + 4 + length].decode("utf-8", "replace"), at + 4 + length


def _decompressor(name: str) -> Callable[[bytes], bytes]:
    """By the name that the bag gives; both libraries come with rosbags."""
    if name in ("", "none"):
        return lambda data: data
    if name == "bz2":
        return bz2.decompress
    if name == "lz4":
        from lz4.frame import decompress

        return decompress
    if name == "zstd" and sys.version_info >= (3, 14):
        from compression.zstd import decompress  # pyright: ignore[reportMissingImports]

        return decompress
    if name == "zstd":
        from backports.zstd import decompress

        return decompress
    raise ValueError(name)


def _scan_bag(file: BinaryIO, size: int) -> Iterator[Raw | Unreadable]:
    connections: dict[int, tuple[str, str]] = {}
    while len(head := file.read(4)) == 4:
        place = file.tell()
        record = _bag_record(file, head, size)
        if record is None:
            return
        header, data = record
        if header.get("op") != b"\x05":
            message = _bag_message(header, data, connections)
            if message is not None:
                yield message
            continue
        try:
            inner = _decompressor(header["compression"].decode())(data)
            yield from _bag_chunk(inner, connections)
        except Exception:  # the decompressors have errors of many kinds
            yield Unreadable(place)


def _bag_record(file: BinaryIO, head: bytes, size: int) -> tuple[dict[str, bytes], bytes] | None:
    (length,) = struct.unpack("<I", head)
    if length + 4 > size - file.tell():
        return None
    header = _bag_header(file.read(length))
    (length,) = struct.unpack("<I", file.read(4))
    return None if length > size - file.tell() else (header, file.read(length))


def _bag_chunk(inner: bytes, connections: dict[int, tuple[str, str]]) -> Iterator[Raw]:
    at = 0
    while at + 4 <= len(inner):
        (length,) = struct.unpack_from("<I", inner, at)
        header = _bag_header(inner[at + 4 : at + 4 + length])
        at += 4 + length
        (length,) = struct.unpack_from("<I", inner, at)
        message = _bag_message(header, inner[at + 4 : at + 4 + length], connections)
        if message is not None:
            yield message
        at += 4 + length


def _bag_header(data: bytes) -> dict[str, bytes]:
    fields, at = {}, 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<I", data, at)
        name, _, value = data[at + 4 : at + 4 + length].partition(b"=")
        fields[name.decode("ascii", "replace")] = value
        at += 4 + length
    return fields


def _bag_message(
    header: dict[str, Any], data: bytes, connections: dict[int, tuple[str, str]]
) -> Raw | None:
    """The message in a record; one that announces a topic is remembered."""
    if header.get("op") not in (b"\x02", b"\x07"):
        return None
    (number,) = struct.unpack("<I", header["conn"])
    if header["op"] == b"\x07":
        kind = _bag_header(data).get("type", b"").decode("ascii", "replace")
        topic = header["topic"].decode("utf-8", "replace")
        connections[number] = (topic, kind.replace("/", "/msg/", 1))
    elif number in connections:
        seconds, nanoseconds = struct.unpack("<II", header["time"])
        return Raw(*connections[number], seconds * 1_000_000_000 + nanoseconds, data)
    return None
