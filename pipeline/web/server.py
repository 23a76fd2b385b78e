"""WebServer: a page served from a thread of its own, while the command does its work."""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import socket
import threading
import time
from collections.abc import Callable

import uvicorn

from pipeline.errors import InputError
from pipeline.web.access import LOOPBACK, Access
from pipeline.web.app import make_app
from pipeline.web.connections import Connections
from pipeline.web.hub import Hub, Page

PORT = 8233  # spells BEE on a telephone
NEXT_PORTS = 50  # that are tried after a taken one
MOST_MESSAGE = 4096  # bytes a viewer may send at once
MOST_HEADERS = 16384  # bytes
START_S, LAST_NEWS_S, STOP_S = 10.0, 1.0, 5.0


class WebServer:
    """Serves `page`; a context manager.

    host: None for loopback alone; else it listens there, and asks for a token. port: None for the
    usual one or the next that is free; 0 for any. tell: what the user must hear.

    url: what to open; with the token, where one is asked for.

    Raises:
        InputError: the port is taken (naming a free one), or the host is none of this machine's.
    """

    def __init__(
        self, page: Page, host: str | None, port: int | None, tell: Callable[[str], None]
    ) -> None:
        self._socket = listen(host or LOOPBACK, port)
        access = Access.choose(host)
        self.port: int = self._socket.getsockname()[1]
        self.url = f"http://{reachable(host or LOOPBACK)}:{self.port}/"
        if access.token is not None:
            self.url += f"?token={access.token}"
        self._hub = Hub(page, tell)
        self._connections = Connections()
        config = uvicorn.Config(
            make_app(self._hub, access, self._connections),
            loop="asyncio",
            http=self._connections.protocol(),
            lifespan="on",
            log_config=None,
            log_level="critical",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            ws_max_size=MOST_MESSAGE,
            ws_per_message_deflate=False,  # images are packed already
            h11_max_incomplete_event_size=MOST_HEADERS,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)

    def __enter__(self) -> WebServer:
        self._thread.start()
        deadline = time.monotonic() + START_S
        while not self._server.started:
            if time.monotonic() > deadline or not self._thread.is_alive():
                raise RuntimeError("the server of the page did not start")
            time.sleep(0.005)
        return self

    def __exit__(self, *_exception: object) -> None:
        self.stop()

    @property
    def viewers(self) -> int:
        """How many look at the page."""
        return len(self._hub.viewers)

    @property
    def thread_id(self) -> int | None:
        """Of the server's thread, as the system counts them."""
        return self._thread.native_id

    def stop(self) -> None:
        """Send the last news, and end."""
        if self._loop is not None and self._thread.is_alive():
            last = asyncio.run_coroutine_threadsafe(self._hub.finish(LAST_NEWS_S), self._loop)
            try:
                last.result(2 * LAST_NEWS_S)
            except TimeoutError:
                last.cancel()
        self._server.should_exit = True
        self._thread.join(STOP_S)
        self._socket.close()

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        await self._server.serve(sockets=[self._socket])


def listen(host: str, port: int | None) -> socket.socket:
    """A socket that is bound; port as in `WebServer`.

    Raises:
        InputError.
    """
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
    except OSError:
        raise InputError(f"--host {host}: is no address of this machine: try 0.0.0.0") from None
    family, address = found[0], str(found[4][0])
    wanted = PORT if port is None else port
    bound = _bind(family, address, wanted)
    if isinstance(bound, socket.socket):
        return bound
    if bound.errno == errno.EADDRINUSE:
        for other in range(wanted + 1, min(wanted + NEXT_PORTS, 65535)):
            free = _bind(family, address, other)
            if isinstance(free, OSError):
                continue
            if port is None:
                return free
            free.close()
            raise InputError(f"--port {port}: is taken: {other} is free: give --port {other}")
        raise InputError(f"--port {wanted}: is taken, and so are the next {NEXT_PORTS}")
    if bound.errno in (errno.EACCES, errno.EPERM):
        raise InputError(f"--port {wanted}: is not for everybody: give one from 1024 on")
    raise InputError(f"--host {host}: cannot be listened at ({bound.strerror}): try 0.0.0.0")


def reachable(host: str) -> str:
    """The host to write into an address: where all of them are listened at, one of this machine."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host
    if address.is_unspecified:
        address = ipaddress.ip_address(_own_address())
    return f"[{address}]" if address.version == 6 else str(address)


def _bind(family: int, address: str, port: int) -> socket.socket | OSError:
    bound = socket.socket(family, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((address, port))
        bound.listen()  # where another one listens, too, only this fails
    except OSError as error:
        bound.close()
        return error
    return bound


def _own_address() -> str:
    """The address by which this machine goes out; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address of nobody (RFC 5737)
            return probe.getsockname()[0]
        except OSError:
            return LOOPBACK
