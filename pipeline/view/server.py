"""Rerun's viewer for a browser, on 127.0.0.1 alone.

The SDK's own server listens on every address; the program that comes with it can be told. The
viewer's page would report to its makers how it is used: it is passed on with a policy that lets it
speak to this machine only.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote

from pipeline.errors import InputError

HOST = "127.0.0.1"
POLICY = (
    f"default-src 'self' blob: data: 'unsafe-inline' 'unsafe-eval'; connect-src 'self' blob: data: "
    f"http://{HOST}:*"
)
PASSED_ON = ("Content-Type", "Content-Encoding", "Content-Length")
PATIENCE = 20.0  # s until it answers


@dataclass(frozen=True)
class Viewer:
    """page: for a browser; sink: where a recording is sent to."""

    page: str
    sink: str


@contextmanager
def viewer(memory: str = "2GiB") -> Iterator[Viewer]:
    """The viewer while the block runs; memory: kept for browsers that come later.

    Raises:
        InputError: it does not start.
    """
    data, inner = _free_ports(2)
    options = ("--bind", HOST, "--port", str(data), "--web-viewer-port", str(inner))
    command = [str(_program()), "--serve-web", *options, "--server-memory-limit", memory]
    # It reports to its makers how it is used, unless it believes to be on a build server.
    environment = {**os.environ, "CI": "true", "RUST_LOG": "off"}
    process = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is ours
    )
    sink = f"rerun+http://{HOST}:{data}/proxy"
    try:
        _await(process, f"http://{HOST}:{inner}/")
        with _passed_on(f"http://{HOST}:{inner}") as page:
            yield Viewer(f"{page}/?url={quote(sink, safe='')}", sink)
    finally:
        process.terminate()
        process.wait()


@contextmanager
def _passed_on(inner: str) -> Iterator[str]:
    """The address under which the pages at `inner` are served, with the policy."""

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked = urllib.request.Request(inner + self.path)
            asked.add_header("Accept-Encoding", self.headers.get("Accept-Encoding", "identity"))
            try:
                with urllib.request.urlopen(asked, timeout=PATIENCE) as answer:
                    headers, content = answer.headers, answer.read()
            except OSError:
                self.send_error(404)
                return
            self.send_response(200)
            for name in PASSED_ON:
                if headers.get(name):
                    self.send_header(name, headers[name])
            self.send_header("Content-Security-Policy", POLICY)
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """Nobody wants to know."""

    server = ThreadingHTTPServer((HOST, 0), Page)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://{HOST}:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def _program() -> Path:
    import rerun_cli

    folder = Path(str(rerun_cli.__file__)).parent
    return folder / ("rerun.exe" if sys.platform == "win32" else "rerun")


def _free_ports(count: int) -> list[int]:
    sockets = [socket.create_server((HOST, 0)) for _ in range(count)]
    try:
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()


def _await(process: subprocess.Popen[bytes], page: str) -> None:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and process.poll() is None:
        try:
            with urllib.request.urlopen(page, timeout=1.0):
                return
        except OSError:
            time.sleep(0.05)
    raise InputError(
        f"rerun's viewer does not answer on {HOST}: give --save FILE.rrd and open that elsewhere"
    )
