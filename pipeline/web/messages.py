"""Message: the newest state of one topic, as it goes to all viewers.

    4 bytes   length of the head, little-endian
    4 bytes   length of the blob
    head      JSON: {"topic": ..., **values}
    blob      an image, or the values of an array

Messages that go out together stand behind one another.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any

import msgspec

_LENGTHS = struct.Struct("<II")


@dataclass(frozen=True, eq=False)
class Message:
    """values: what JSON can hold; blob: anything."""

    topic: str
    values: dict[str, Any] = field(default_factory=dict)
    blob: bytes = b""

    def packed(self) -> bytes:
        """As it is sent."""
        head = msgspec.json.encode({"topic": self.topic, **self.values})
        return b"".join((_LENGTHS.pack(len(head), len(self.blob)), head, self.blob))


def unpacked(data: bytes) -> list[Message]:
    """The messages in what was sent at once."""
    messages, at = [], 0
    while at < len(data):
        head, blob = _LENGTHS.unpack_from(data, at)
        begin = at + _LENGTHS.size
        at = begin + head + blob
        values = msgspec.json.decode(data[begin : begin + head])
        messages.append(Message(values.pop("topic"), values, data[begin + head : at]))
    return messages
