"""The server of the pages: who may look, bounds, and that nobody's slowness is another's."""

from __future__ import annotations

import contextlib
import http.client
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from urllib.parse import urlsplit

import pytest

pytest.importorskip("uvicorn", reason="the extra 'web' is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection

from pipeline.errors import InputError
from pipeline.web import connections, hub, server
from pipeline.web.server import WebServer
from tests.web_viewers import Counter, news, receive, viewer


@contextmanager
def serving(page: Counter | None = None, host: str | None = None) -> Iterator[WebServer]:
    with WebServer(page or Counter(), host, 0, lambda text: None) as running:
        yield running


@pytest.fixture(autouse=True)
def often(monkeypatch) -> None:
    """News come more often than to people, and less patience is had."""
    monkeypatch.setattr(hub, "RATE", 20.0)
    monkeypatch.setattr(hub, "FAREWELL", 0.1)
    monkeypatch.setattr(connections, "LOOK_EVERY", 0.1)


@pytest.fixture(scope="module")
def running() -> Iterator[WebServer]:
    """A server that no test harms."""
    with serving() as one:
        yield one


def get(url: str, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=5.0)
    headers.setdefault("Host", urlsplit(url).netloc)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    return connection.getresponse()


def refused(url: str, **options) -> int:
    """The status with which a WebSocket is refused."""
    with pytest.raises(InvalidStatus) as error, viewer(url, **options):
        pass
    return error.value.response.status_code


def end_of(one: ClientConnection) -> int:
    """The code with which the server closes a connection, however much it sends before."""
    try:
        while True:
            one.recv(5.0)
    except ConnectionClosed as end:
        return end.rcvd.code if end.rcvd else 0


def bare_viewer(url: str) -> socket.socket:
    """A WebSocket, asked for by hand."""
    place = urlsplit(url)
    one = socket.create_connection((place.hostname, place.port), timeout=5.0)
    lines = (
        "GET /live HTTP/1.1",
        f"Host: {place.netloc}",
        f"Origin: http://{place.netloc}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==",
    )
    one.sendall("\r\n".join((*lines, "", "")).encode())
    return one


def is_cut(one: socket.socket, wait: float) -> bool:
    one.settimeout(wait)
    try:
        return one.recv(1) == b""
    except ConnectionResetError:
        return True
    except TimeoutError:
        return False


def test_news_come_to_all_and_are_made_once():
    page = Counter(b"image" * 1000)
    with serving(page) as running, ExitStack() as stack:
        time.sleep(2.5 / hub.RATE)
        assert page.asked == 0  # nobody looks
        viewers = [stack.enter_context(viewer(running.url)) for _ in range(5)]
        for one in viewers:
            news(one, "count")
        before, begin = page.asked, time.monotonic()
        for _ in range(3):
            got = [news(one, "count") for one in viewers]
            assert all(message.blob == page.blob for message in got)
        seconds = time.monotonic() - begin
        assert 2 <= page.asked - before <= 1 + seconds * hub.RATE


def test_who_looks_away_gets_the_newest_not_a_queue(running):
    with viewer(running.url) as slow, viewer(running.url) as quick:
        assert slow.recv()
        numbers = [news(quick, "count").values["n"] for _ in range(4)]
        assert numbers == list(range(numbers[0], numbers[0] + 4))
        slow.send('{"do":"seen"}')
        (message,) = receive(slow)
        assert message.values["n"] >= numbers[-1]


def test_a_viewer_who_says_nothing_is_let_go(running, monkeypatch):
    monkeypatch.setattr(hub, "SLOW", 0.3)
    ends: list[int] = []
    with viewer(running.url) as slow, viewer(running.url) as quick:
        waiting = threading.Thread(target=lambda: ends.append(end_of(slow)))
        waiting.start()
        while waiting.is_alive():
            assert news(quick, "count")
        assert ends == [hub.TRY_AGAIN_LATER]
        assert running.viewers == 1


def test_who_never_reads_is_cut_off_and_frees_the_place(monkeypatch):
    monkeypatch.setattr(hub, "SLOW", 0.2)
    monkeypatch.setattr(connections, "MOST", 3)
    monkeypatch.setattr(connections, "LEAVING", 0.1)
    with serving(Counter(b"x" * (6 << 20))) as running, ExitStack() as stack:
        for _ in range(connections.MOST):
            stack.enter_context(bare_viewer(running.url))
        tries = 0
        while True:
            try:
                assert get(running.url).status == 200
                break
            except (OSError, http.client.HTTPException):  # the places are taken
                tries += 1
                time.sleep(0.1)
                assert tries < 50
        assert tries > 0


def test_a_connection_that_asks_for_nothing_is_cut_off(running, monkeypatch):
    monkeypatch.setattr(connections, "SILENT", 0.1)
    with viewer(running.url) as asking:
        place = urlsplit(running.url)
        with socket.create_connection((place.hostname, place.port)) as silent:
            silent.sendall(b"GET / HT")
            assert is_cut(silent, 5.0)
        assert news(asking, "count")


def test_two_hundred_connections_are_bounded():
    with serving() as running, viewer(running.url) as first:
        place = urlsplit(running.url)
        with ExitStack() as stack:
            many = [
                stack.enter_context(socket.create_connection((place.hostname, place.port)))
                for _ in range(200)
            ]
            assert all(is_cut(one, 2.0) for one in many[connections.MOST :])
            assert not is_cut(many[0], 0.1)
            assert news(first, "count")
        with ExitStack() as stack:
            for _ in range(hub.MOST_VIEWERS - 1):
                receive(stack.enter_context(viewer(running.url)))
            for _ in range(3):
                with viewer(running.url) as one:
                    assert end_of(one) == hub.TRY_AGAIN_LATER
            assert running.viewers == hub.MOST_VIEWERS
        assert news(first, "count")


def test_connections_that_have_ended_make_room(running, monkeypatch):
    monkeypatch.setattr(connections, "MOST", 4)
    for _ in range(12):
        with viewer(running.url) as one:
            receive(one)
        assert get(running.url).status == 200


def test_a_message_of_100_mb_is_refused(running):
    with viewer(running.url) as other, bare_viewer(running.url) as one:
        one.recv(4096)
        head = b"\x82\xff" + (100 << 20).to_bytes(8, "big") + b"mask"
        one.sendall(head)
        taken = 0
        with contextlib.suppress(OSError):
            while taken < 100 << 20:
                taken += one.send(bytes(1 << 16))
        assert taken < 50 << 20
        assert news(other, "count")


@pytest.mark.parametrize(
    "text", ["", "{", "seen", '{"do": 1}', '{"do": "greet", "else": 1}', "[" * 4000]
)
def test_what_is_not_understood_ends_the_connection(running, text):
    with viewer(running.url) as one:
        one.send(text)
        assert end_of(one) == hub.POLICY_VIOLATION


def test_orders_are_answered_and_too_many_are_not_taken():
    page = Counter()
    with serving(page) as running, viewer(running.url) as one:
        one.send('{"do":"greet","value":"bee"}')
        assert news(one, "answer").values == {"to": "greet", "text": "hello bee", "done": True}
        one.send('{"do":"fly"}')
        assert news(one, "answer").values == {"to": "fly", "text": "cannot fly", "done": False}
        with contextlib.suppress(ConnectionClosed):
            for _ in range(10 * hub.MOST_ORDERS):
                one.send('{"do":"greet","value":"again"}')
        assert end_of(one) in (hub.POLICY_VIOLATION, 0)
    assert len(page.orders) <= 1 + 2 * hub.MOST_ORDERS


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""])
def test_a_name_that_is_not_ours_is_refused_on_loopback(running, host):
    answer = get(running.url, Host=host)
    assert answer.status == 403
    assert b"<html" not in answer.read()
    assert get(running.url, "/live", Host=host).status == 403
    # A tunnel may end at another port, under another of the names of this machine.
    assert get(running.url, Host="localhost:9000").status == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "file://", None]
)
def test_a_page_of_another_site_is_refused(running, origin):
    assert refused(running.url, origin=origin) == 403
    if origin is not None:
        assert get(running.url, Origin=origin).status == 403


def test_beyond_loopback_a_token_is_asked_for():
    with serving(host="127.0.0.1") as running, serving(host="127.0.0.1") as other:
        url, _, token = running.url.partition("?token=")
        assert len(token) >= 20
        assert token not in other.url
        for path in ("/", "/static/connection.js", "/?token=", "/?token=wrong", "/live"):
            assert get(url, path).status == 403
        assert refused(url) == 403
        assert refused(f"{url}?token={token}x") == 403
        answer = get(url, f"/?token={token}")
        cookie = answer.headers["Set-Cookie"]
        assert (answer.status, answer.headers["Location"]) == (303, "/")
        assert "HttpOnly" in cookie
        assert "SameSite=lax" in cookie
        kept = cookie.partition(";")[0]
        assert get(url, "/", Cookie=kept).status == 200
        with viewer(url, additional_headers={"Cookie": kept}) as one:
            news(one, "count")
        with viewer(running.url) as one:
            news(one, "count")


def test_pages_load_nothing_from_elsewhere(running):
    for path, kind in (("/", "text/html"), ("/static/connection.js", "text/javascript")):
        answer = get(running.url, path)
        assert answer.status == 200
        assert answer.headers["Content-Type"].startswith(kind)
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert f"connect-src 'self' ws://{urlsplit(running.url).netloc};" in policy
    by_number = get(running.url, Host="[::1]:80").headers["Content-Security-Policy"]
    assert "connect-src 'self';" in by_number  # it has no form for such addresses
    assert get(running.url, "/static/nothing.js").status == 404
    assert get(running.url, "/static/..%2fserver.py").status == 404


def test_a_report_may_hold_its_styles_and_pictures_but_no_script():
    page = Counter()
    with serving(page) as running:
        assert get(running.url, "/report").status == 404
        page.html = b"<!DOCTYPE html><style>p { color: red }</style><p>fine"
        answer = get(running.url, "/report")
        assert answer.read() == page.html
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "script" not in policy
        assert "style-src 'unsafe-inline'; img-src data:" in policy
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert get(running.url, "/report", Host="evil.example").status == 403


def test_a_port_that_is_taken_is_named_with_the_next_free_one(running, monkeypatch):
    with pytest.raises(InputError, match=rf"--port {running.port}: is taken: \d+ is free"):
        WebServer(Counter(), None, running.port, print)
    monkeypatch.setattr(server, "PORT", running.port)
    with WebServer(Counter(), None, None, print) as other:
        assert running.port < other.port <= running.port + server.NEXT_PORTS
    with pytest.raises(InputError, match=r"--host 192\.0\.2\.1: cannot be listened at"):
        WebServer(Counter(), "192.0.2.1", None, print)
    assert server.reachable("::1") == "[::1]"
    assert server.reachable("0.0.0.0") not in ("0.0.0.0", "")


def test_an_error_of_the_page_is_told_once_and_the_last_news_are_sent():
    class Broken(Counter):
        broken = True

        def news(self):
            yield from super().news()
            if self.broken:
                raise ValueError("no such picture")

    page, told, got = Broken(), [], []
    with WebServer(page, None, 0, told.append) as running, viewer(running.url) as one:
        assert news(one, "count").values["n"] < news(one, "count").values["n"]
        page.broken = False
        stopping = threading.Thread(target=running.stop)
        stopping.start()
        try:
            while True:
                got.extend(message.values["n"] for message in receive(one))
        except ConnectionClosed:
            stopping.join()
    assert told == ["the page shows no news: ValueError: no such picture"]
    assert got[-1] == page.asked
