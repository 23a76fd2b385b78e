"""Hub: one page and all who look at it.

Nothing is encoded while nobody looks, and then once for all viewers, at most RATE times a second.
A viewer has one place for each topic, which holds the newest message only, and is sent what stands
there when it says that it has seen the last: one behind a poor network sees fewer of them, not
older ones, and no queue grows. One that says nothing for SLOW seconds is let go; its page connects
again.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from typing import Protocol

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from pipeline.web.messages import Message

RATE = 5.0  # 1/s
SLOW = 10.0  # s
FAREWELL = 1.0  # s
MOST_VIEWERS = 16
MOST_ORDERS = 40  # of one viewer in a second
TRY_AGAIN_LATER = 1013  # RFC 6455 and its registry
POLICY_VIOLATION = 1008


class RefusedError(Exception):
    """A command that cannot be done; the message tells the viewer why."""


class Page(Protocol):
    """What is shown. Its methods are called in the server's thread and must be quick."""

    @property
    def index(self) -> str:
        """The HTML file in `static/`."""
        ...

    def news(self) -> Iterable[Message]:
        """The topics that changed since the last call."""
        ...

    def command(self, name: str, value: str) -> str:
        """Do what a viewer asks for; what to answer. Raises RefusedError."""
        ...

    def report(self) -> bytes | None:
        """HTML that needs nothing beside it, served at `/report`; None: there is none."""
        ...


class Order(msgspec.Struct, forbid_unknown_fields=True):
    """What a page sends: `seen`, or a command with its value."""

    do: str
    value: str = ""


class Viewer:
    """What one viewer has not been sent yet: the newest message of each topic."""

    def __init__(self, messages: dict[str, bytes]) -> None:
        self._waiting = dict(messages)
        self._news = asyncio.Event()
        self._seen = asyncio.Event()
        self.ready = True
        if messages:
            self._news.set()

    def put(self, topic: str, message: bytes) -> None:
        """Have it sent, in place of an older one."""
        self._waiting[topic] = message
        self._news.set()

    def seen(self) -> None:
        """The viewer has got what it was sent."""
        self._seen.set()

    @property
    def content(self) -> bool:
        """Whether it has got all there is."""
        return self.ready and not self._waiting

    async def feed(self, socket: WebSocket) -> None:
        """Send until the viewer leaves; returns when it is too slow."""
        while True:
            await self._news.wait()
            self._news.clear()
            self.ready = False
            batch, self._waiting = self._waiting, {}
            self._seen.clear()
            try:
                async with asyncio.timeout(SLOW):
                    await socket.send_bytes(b"".join(batch.values()))
                    await self._seen.wait()
            except TimeoutError:
                return
            self.ready = True


class Hub:
    """page: what is shown; tell: where an error of the page is told, once."""

    def __init__(self, page: Page, tell: Callable[[str], None]) -> None:
        self.page = page
        self.viewers: set[Viewer] = set()
        self._tell = tell
        self._latest: dict[str, bytes] = {}
        self._watched = asyncio.Event()
        self._failed = self._finished = False

    async def run(self) -> None:
        """Hand out news until `finish`."""
        while not self._finished:
            await self._watched.wait()
            await asyncio.sleep(1.0 / RATE)
            if not self._finished and any(viewer.ready for viewer in self.viewers):
                self.gather()

    def gather(self) -> None:
        """Hand out what is new now."""
        try:
            for message in self.page.news():
                packed = message.packed()
                self._latest[message.topic] = packed
                for viewer in self.viewers:
                    viewer.put(message.topic, packed)
        except Exception as error:  # the run goes on without its page
            if not self._failed:
                self._failed = True
                self._tell(f"the page shows no news: {type(error).__name__}: {error}")

    async def finish(self, seconds: float) -> None:
        """Hand out the last news; return when all viewers have them, or after `seconds`."""
        self._finished = True
        self.gather()
        for _ in range(round(seconds * 20)):
            if all(viewer.content for viewer in self.viewers):
                return
            await asyncio.sleep(0.05)

    async def serve(self, socket: WebSocket) -> None:
        """One viewer, from its first message to its last."""
        await socket.accept()
        if len(self.viewers) >= MOST_VIEWERS:
            await socket.close(TRY_AGAIN_LATER, f"{MOST_VIEWERS} viewers are watching")
            return
        if not self.viewers:
            self.gather()  # what is kept may be old
        viewer = Viewer(self._latest)
        self.viewers.add(viewer)
        self._watched.set()
        feeding = asyncio.create_task(viewer.feed(socket))
        listening = asyncio.create_task(self._listen(socket, viewer))
        try:
            await asyncio.wait((feeding, listening), return_when=asyncio.FIRST_COMPLETED)
            if feeding.done() and not listening.done():
                async with asyncio.timeout(FAREWELL):
                    await socket.close(TRY_AGAIN_LATER, "too slow")
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            pass  # gone meanwhile, or it does not even read this: cut off in a while
        finally:
            self.viewers.discard(viewer)
            if not self.viewers:
                self._watched.clear()
            for task in (feeding, listening):
                task.cancel()
            await asyncio.gather(feeding, listening, return_exceptions=True)

    async def _listen(self, socket: WebSocket, viewer: Viewer) -> None:
        """Take orders until the viewer leaves, or sends what no page of ours would."""
        loop = asyncio.get_running_loop()
        second, count = 0, 0
        while True:
            message = await socket.receive()
            if message["type"] != "websocket.receive":
                return
            try:
                order = msgspec.json.decode(message.get("text") or "", type=Order)
            except msgspec.DecodeError:
                await socket.close(POLICY_VIOLATION, "not understood")
                return
            now = int(loop.time())
            second, count = now, (count + 1 if now == second else 1)
            if count > MOST_ORDERS:
                await socket.close(POLICY_VIOLATION, "too many orders")
                return
            if order.do == "seen":
                viewer.seen()
            else:
                viewer.put("answer", self._obey(order))

    def _obey(self, order: Order) -> bytes:
        try:
            text, done = self.page.command(order.do, order.value), True
        except RefusedError as error:
            text, done = str(error), False
        return Message("answer", {"to": order.do, "text": text, "done": done}).packed()
