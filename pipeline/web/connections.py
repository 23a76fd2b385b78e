"""Connections: bounds on what may be connected, whatever it is.

More than MOST at once are refused as they come. One that asks for nothing, that does not take what
it was sent, or that stays when it was told to go is cut off.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from starlette.types import Scope
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST = 64
SILENT = 10.0  # s until the first request
LEAVING = 5.0  # s to take the last bytes
UNSENT = 8 << 20  # bytes that wait for it
LOOK_EVERY = 1.0  # s

Address = tuple[str, int]


@dataclass
class _Connection:
    transport: asyncio.Transport
    since: float
    asked: bool = False
    leaving_since: float | None = None

    @property
    def over(self) -> bool:
        return self.transport.is_closing() and not self.transport.get_write_buffer_size()


class Connections:
    """All connections of one server; used in its thread only."""

    def __init__(self) -> None:
        self._open: dict[Address, _Connection] = {}

    def protocol(self) -> type[asyncio.Protocol]:
        """uvicorn's HTTP/1.1, for what is within the bounds."""
        connections = self

        class Bounded(H11Protocol):
            def connection_made(self, transport: Any) -> None:
                super().connection_made(transport)
                connections.add(transport)

        return Bounded

    def add(self, transport: asyncio.Transport) -> None:
        """A new one, cut off at once where there are too many."""
        if len(self._open) >= MOST:
            self._forget_those_over()
        if len(self._open) >= MOST:
            transport.abort()
            return
        now = asyncio.get_running_loop().time()
        host, port, *_ = transport.get_extra_info("peername")
        self._open[host, port] = _Connection(transport, now)

    def asked(self, scope: Scope) -> None:
        """A request has come from it."""
        host, port = scope["client"]
        if (host, port) in self._open:
            self._open[host, port].asked = True

    async def watch(self) -> None:
        """Cut off, for ever, what does not behave."""
        while True:
            await asyncio.sleep(LOOK_EVERY)
            self._forget_those_over()
            now = asyncio.get_running_loop().time()
            for known in self._open.values():
                if known.leaving_since is None and known.transport.is_closing():
                    known.leaving_since = now
                stays = known.leaving_since is not None and now - known.leaving_since > LEAVING
                silent = not known.asked and now - known.since > SILENT
                if stays or silent or known.transport.get_write_buffer_size() > UNSENT:
                    known.transport.abort()

    def _forget_those_over(self) -> None:
        self._open = {a: known for a, known in self._open.items() if not known.over}
