"""The options `--web`, `--host`, `--port` of commands that show a page, and the page served."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from pipeline.errors import InputError
from pipeline.extras import need

if TYPE_CHECKING:
    from pipeline.web.hub import Page
    from pipeline.web.run_state import RunState
    from pipeline.web.server import WebServer

F = TypeVar("F", bound=Callable[..., object])


def web_options(command: F) -> F:
    """Decorate a command with the three options."""
    port = click.option(
        "--port",
        type=click.IntRange(0, 65535),
        help="Of the page.  [default: 8233, or the next that is free]",
    )
    host = click.option(
        "--host",
        metavar="HOST",
        help="Let others look, too: listen here (0.0.0.0: everywhere), with a token in the "
        "address.  [default: this machine alone]",
    )
    web = click.option("--web", is_flag=True, help="Show a page in the browser.")
    return web(host(port(command)))


def check_web(web: bool, host: str | None, port: int | None) -> None:
    """Refuse early what cannot be served.

    Raises:
        InputError: the extra is not installed; or host and port without `--web`.
    """
    if not web:
        given = [name for name, value in (("--host", host), ("--port", port)) if value is not None]
        if given:
            raise InputError(f"{given[0]}: belongs to --web")
        return
    need("web", "--web")


@contextmanager
def served(page: Page, host: str | None, port: int | None) -> Iterator[WebServer]:
    """The page in a thread of its own; its address is printed on standard error."""
    from pipeline.web.server import WebServer

    def tell(text: str) -> None:
        click.echo(f"note: {text}", err=True)

    with WebServer(page, host, port, tell) as server:
        click.echo(f"page: {server.url}", err=True)
        yield server


@contextmanager
def watched(
    web: bool,
    host: str | None,
    port: int | None,
    name: str,
    output: Path | None,
    stop: threading.Event,
) -> Iterator[RunState | None]:
    """What to tell about the run called `name`, whose map is saved in `output`, so that it is seen
    on a page; None where none is wanted. stop: set by a viewer."""
    if not web:
        yield None
        return
    from pipeline.web.run_page import RunPage

    page = RunPage(name, output, stop)
    with served(page, host, port):
        try:
            yield page.state
        except Exception as error:
            page.state.failed(str(error))
            raise
