"""The addresses of a page: `/`, its files under `/static/`, the WebSocket `/live`, `/report`."""

from __future__ import annotations

import asyncio
import mimetypes
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from pipeline.web.access import Access
from pipeline.web.connections import Connections
from pipeline.web.hub import POLICY_VIOLATION, Hub

STATIC = Path(__file__).parent / "static"
# A report holds its own styles and pictures, and no script.
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)


def make_app(hub: Hub, access: Access, connections: Connections) -> Starlette:
    """The application; its hub and the bounds on connections run as long as it does."""
    files = {file.name: file.read_bytes() for file in STATIC.iterdir() if file.is_file()}

    async def index(request: Request) -> Response:
        if access.token is not None and "token" in request.query_params:
            # The token leaves the address bar, where others may read it. "lax": the link may be
            # followed from anywhere, in a mail for one; requests by other sites lack the cookie.
            response = RedirectResponse("/", 303)
            name = access.cookie(request)
            response.set_cookie(name, access.token, httponly=True, samesite="lax")
            return response
        return Response(files[hub.page.index], media_type="text/html")

    async def static(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in files:
            return PlainTextResponse("There is no such file.", 404)
        return Response(files[name], media_type=mimetypes.guess_type(name)[0])

    async def report(request: Request) -> Response:
        found = hub.page.report()
        if found is None:
            return PlainTextResponse("There is no report yet.", 404)
        policy = {"Content-Security-Policy": REPORT_POLICY}
        return Response(found, media_type="text/html", headers=policy)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(work) for work in (hub.run(), connections.watch())]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()

    return Starlette(
        routes=[
            Route("/", index),
            Route("/static/{name}", static),
            Route("/report", report),
            WebSocketRoute("/live", hub.serve),
        ],
        middleware=[Middleware(_Guard, access=access, connections=connections)],
        lifespan=lifespan,
    )


class _Guard:
    """Lets in who may come in, and tells browsers what a page of ours does not do."""

    def __init__(self, app: ASGIApp, access: Access, connections: Connections) -> None:
        self._app = app
        self._access = access
        self._connections = connections

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        self._connections.asked(scope)
        request = HTTPConnection(scope)
        refusal = self._access.refusal(request)
        if scope["type"] == "websocket":
            answer = self._app if refusal is None else WebSocketClose(POLICY_VIOLATION, refusal)
            await answer(scope, receive, send)
            return
        answer = self._app if refusal is None else PlainTextResponse(refusal + "\n", 403)
        strict = headers("" if refusal else request.headers["host"])

        async def send_strictly(message: Message) -> None:
            if message["type"] == "http.response.start":
                told = MutableHeaders(scope=message)
                for name, value in strict.items():
                    told.setdefault(name, value)
            await send(message)

        await answer(scope, receive, send_strictly)


def headers(host: str) -> dict[str, str]:
    """A page of ours loads and speaks to nothing but its own server, and stands in no frame.

    host: as the Host header names it; older browsers do not count a WebSocket as 'self'. A policy
    has no form for addresses of IPv6.
    """
    named = host and not host.startswith("[")
    connect = f"'self' ws://{host}" if named else "'self'"
    policy = (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        f"connect-src {connect}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return {
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }
