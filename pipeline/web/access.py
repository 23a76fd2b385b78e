"""Who may look and command: by the names in Host and Origin, and by a token beyond loopback.

A page of another site, open in the same browser, can send requests here: its Origin differs from
the Host. A name of its own that it makes point to this machine (DNS rebinding) is none of ours. An
address written in digits cannot be made to point elsewhere.
"""

from __future__ import annotations

import ipaddress
import re
import secrets
import socket
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from starlette.requests import HTTPConnection

LOOPBACK = "127.0.0.1"
_LOOPBACK_NAMES = frozenset(("localhost", LOOPBACK, "::1"))
_HOST = re.compile(
    r"(\[(?P<address>[0-9a-f:.]+)\]|(?P<name>[a-z0-9.-]+))(:(?P<port>\d{1,5}))?", re.IGNORECASE
)


@dataclass(frozen=True)
class Access:
    """host: where the server listens when it was told so; None: on loopback, where no token is
    asked for."""

    host: str | None = None
    token: str | None = field(default=None, repr=False)

    @staticmethod
    def choose(host: str | None) -> Access:
        """With a new random token where `host` is given."""
        return Access(host, None if host is None else secrets.token_urlsafe(16))

    def refusal(self, request: HTTPConnection) -> str | None:
        """Why a request is refused, in words; None: it is welcome."""
        host = request.headers.get("host", "")
        if not self._is_ours(_name(host)):
            return "This name does not belong to this server."
        origin = request.headers.get("origin")
        if origin is None and request.scope["type"] == "websocket":
            return "A browser says where its page comes from."
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return "A page of another site may not ask here."
        if not self.knows(request):
            return "Open the address that beemap printed: it ends with a token."
        return None

    def knows(self, request: HTTPConnection) -> bool:
        """Whether it brings the token, where one is asked for."""
        if self.token is None:
            return True
        given = request.query_params.get("token") or request.cookies.get(self.cookie(request), "")
        # Compared in constant time: how long it takes tells nothing about the token.
        return secrets.compare_digest(given.encode(), self.token.encode())

    @staticmethod
    def cookie(request: HTTPConnection) -> str:
        """Cookies do not tell ports apart: their names do."""
        found = _HOST.fullmatch(request.headers.get("host", ""))
        return f"beemap-{found['port'] if found else ''}"

    def _is_ours(self, name: str) -> bool:
        if name in _LOOPBACK_NAMES:
            return True
        if self.host is None:
            return False
        here = socket.gethostname().lower()
        return _is_address(name) or name in (self.host.lower(), here, f"{here}.local")


def _name(host: str) -> str:
    """The name or address in a Host header; empty where it is none."""
    found = _HOST.fullmatch(host)
    return (found["address"] or found["name"]).lower() if found else ""


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
