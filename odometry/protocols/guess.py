"""What bytes look like when they do not fit the protocol that was chosen."""

from __future__ import annotations

import re

# (pattern of one line, what to write in the rig)
_LINES = (
    (re.compile(rb"-?\d{1,10} -?\d{1,10}"), "protocol: arduino_bridge"),
    (re.compile(rb"-?\d+\.\d+ -?\d+\.\d+"), "protocol: odrive"),
    (re.compile(rb"(\d+[,;\t] ?)?-?\d+[,;\t] ?-?\d+(\*\d{1,3})?"), "protocol: stream"),
    (re.compile(rb"-?[\d.]+([,;\t ]+-?[\d.]+)+(\*\d{1,3})?"), "protocol: stream with its fields"),
    (re.compile(rb"\$[A-Z]{2,}.*"), "a GPS receiver"),
)
PRINTABLE = 0.9


def looks_like(data: bytes) -> str:
    """Words for what the bytes may be: a protocol, text, or a wrong baud rate."""
    text = sum(32 <= byte < 127 or byte in b"\t\r\n" for byte in data)
    if not data:
        return "nothing arrived"
    if text < PRINTABLE * len(data):
        return "they are no text: the baud rate is probably wrong, or it is a binary protocol"
    lines = [line.strip() for line in data.split(b"\n")[1:-1]]
    for pattern, meaning in _LINES:
        if lines and sum(bool(pattern.fullmatch(line)) for line in lines) > len(lines) / 2:
            return f"they look like {meaning}"
    return f"they are text, such as {(lines or [data])[-1][:40].decode('ascii', 'replace')!r}"
