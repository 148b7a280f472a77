"""A page that is served, and what its viewers get."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp

from mrs_tools.view import server
from mrs_tools.view.server import Address, serve
from mrs_tools.view.source import Source

PATIENCE_S = 20.0


@contextmanager
def served(
    source: Source, page: Path = server.PAGE, token: str = "", rate: float = 30.0
) -> Iterator[str]:
    """The page's address while it is served."""
    stop, there, urls = threading.Event(), threading.Event(), []

    def ready(url: str) -> None:
        urls.append(url)
        there.set()

    def run() -> None:
        address = Address("127.0.0.1", 0, token)
        asyncio.run(serve(source, address, rate=rate, stop=stop, ready=ready, page=page))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert there.wait(PATIENCE_S)
        yield urls[0]
    finally:
        stop.set()
        thread.join()


async def until(viewer: Any, wanted: Callable[[dict], bool]) -> list[dict]:
    """Everything that a viewer gets up to what is wanted."""
    got: list[dict] = []
    while not got or not wanted(got[-1]):
        got.append(json.loads(await viewer.receive_str()))
    return got


class Looker(threading.Thread):
    """A viewer in a thread of its own.

    Attributes:
        got: What it was sent.
    """

    def __init__(self, url: str) -> None:
        super().__init__()
        self.got: list[dict[str, Any]] = []
        self._url, self._loop = url, asyncio.new_event_loop()
        self._socket: Any = None
        self._there = threading.Event()
        self.start()
        assert self._there.wait(PATIENCE_S)

    def run(self) -> None:
        self._loop.run_until_complete(self._listen())
        self._loop.close()

    async def _listen(self) -> None:
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{self._url}live", max_msg_size=0) as self._socket,
        ):
            self._there.set()
            async for message in self._socket:
                self.got.append(json.loads(message.data))

    def send(self, **command: Any) -> None:
        asyncio.run_coroutine_threadsafe(self._socket.send_json(command), self._loop).result()

    def last(self, kind: str) -> dict[str, Any]:
        """The last message of a type; empty before the first."""
        return next((m for m in reversed(self.got) if m["type"] == kind), {})

    def leave(self) -> None:
        if self.is_alive():
            asyncio.run_coroutine_threadsafe(self._socket.close(), self._loop).result()
            self.join()
