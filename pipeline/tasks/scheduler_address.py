"""Does a Dask scheduler answer at an address? Within seconds, whatever is there."""

from __future__ import annotations

import asyncio
import socket
from urllib.parse import urlsplit

from pipeline.errors import InputError

SCHEMES = ("tcp", "tls", "ws", "wss")
ANSWER = 3.0  # it must answer within [s]


def is_scheduler(address: str) -> bool:
    """Whether a scheduler answers there.

    Dask's own client tries for a while where nothing listens, and waits long for something else
    that does not answer, or answers otherwise.

    Raises:
        InputError: it is not an address.
    """
    try:
        parts = urlsplit(address if "://" in address else f"tcp://{address}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not (host and port and parts.scheme in SCHEMES):
        raise InputError(f"--scheduler {address}: not an address: write it as tcp://host:8786")
    try:
        socket.create_connection((host, port), ANSWER).close()
        return asyncio.run(asyncio.wait_for(_kind(address), ANSWER)) == "Scheduler"
    except Exception:  # anything may listen there, and say anything
        return False


async def _kind(address: str) -> str:
    """What a Dask server calls itself: Scheduler, Worker, Nanny."""
    from distributed import Security
    from distributed.comm.core import connect

    comm = await connect(address, timeout=ANSWER, **Security().get_connection_args("client"))
    try:
        await comm.write({"op": "identity", "reply": True})
        return (await comm.read())["type"]
    finally:
        comm.abort()
