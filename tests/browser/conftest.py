"""A browser for each module, and pages of one server."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page

from browser import synthetic_scene as scene
from browser.chromium import open_browser, settled
from browser.page_server import PageServer
from mrs_tools.view.protocol import Hello, Message


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as opened:
        yield opened


@pytest.fixture
def make_server() -> Iterator[Callable[..., PageServer]]:
    servers = []

    def make(hello: Hello, *messages: Message) -> PageServer:
        servers.append(PageServer(hello, *messages))
        return servers[-1]

    yield make
    for server in servers:
        server.end()


@pytest.fixture
def server(make_server: Callable[..., PageServer]) -> PageServer:
    """Of the whole scene, live."""
    return make_server(scene.hello(control=True), *scene.everything())


@pytest.fixture
def look_at(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Opens the page of a server, and waits until it shows people; errors of its scripts fail."""
    contexts: list[BrowserContext] = []
    errors: list[str] = []

    def look(server: PageServer, width: int = 1000, height: int = 700, **options: Any) -> Page:
        options = {"reduced_motion": "reduce", **options}
        contexts.append(browser.new_context(viewport={"width": width, "height": height}, **options))
        page = contexts[-1].new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        page.goto(server.url)
        settled(page)
        return page

    yield look
    for context in contexts:
        context.close()
    # What the browser itself says of a server that has gone is none of the page.
    assert not [error for error in errors if "WebSocket connection to" not in error]
