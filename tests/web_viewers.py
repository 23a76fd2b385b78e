"""A page for tests, and viewers without a browser."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from pipeline.web.hub import RefusedError
from pipeline.web.messages import Message, unpacked


class Counter:
    """A page that counts how often it was asked for news."""

    index = "live.html"

    def __init__(self, blob: bytes = b"") -> None:
        self.asked = 0
        self.blob = blob
        self.html: bytes | None = None
        self.orders: list[tuple[str, str]] = []

    def news(self) -> Iterable[Message]:
        self.asked += 1
        yield Message("count", {"n": self.asked}, self.blob)

    def command(self, name: str, value: str) -> str:
        if name != "greet":
            raise RefusedError(f"cannot {name}")
        self.orders.append((name, value))
        return f"hello {value}"

    def report(self) -> bytes | None:
        return self.html


@contextmanager
def viewer(url: str, path: str = "/live", **options) -> Iterator[ClientConnection]:
    """A connection to the page at `url`, as its own script makes it."""
    parts = urlsplit(url)
    query = f"?{parts.query}" if parts.query else ""
    options.setdefault("origin", f"http://{parts.netloc}")
    address = f"ws://{parts.netloc}{path}{query}"
    with connect(address, max_size=None, compression=None, **options) as socket:
        yield socket


def receive(socket: ClientConnection, timeout: float = 5.0) -> list[Message]:
    """What is sent next, and the word that it was seen."""
    data = socket.recv(timeout)
    assert isinstance(data, bytes)
    socket.send('{"do":"seen"}')
    return unpacked(data)


def news(socket: ClientConnection, topic: str, timeout: float = 5.0) -> Message:
    """The next message of a topic."""
    while True:
        for message in receive(socket, timeout):
            if message.topic == topic:
                return message


class Onlooker:
    """A viewer in a thread of its own, until the server ends; topics: all that came."""

    def __init__(self, url: str) -> None:
        self.topics: dict[str, list[Message]] = defaultdict(list)
        self._url = url
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait until the server has ended."""
        self._thread.join(30.0)
        assert not self._thread.is_alive()

    def _look(self) -> None:
        with viewer(self._url) as socket:
            try:
                while True:
                    for message in receive(socket, 30.0):
                        self.topics[message.topic].append(message)
            except ConnectionClosed:
                return
