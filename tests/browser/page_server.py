"""The real server of `mrs view` with a source of the tests' own."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from queue import Queue
from threading import Condition, Event, Thread

from mrs_tools.view import protocol
from mrs_tools.view.protocol import Control, Hello, Look, Message
from mrs_tools.view.server import Address, serve


class PageServer:
    """Serves the page on a free port, in a thread; it is its own source.

    Attributes:
        commands: What the page has asked for, the oldest first.
        looks: What all viewers look at together, the oldest first.
        url: The page's address.
    """

    def __init__(self, hello: Hello, *messages: Message) -> None:
        self.commands: list[Control] = []
        self.looks: list[Look] = []
        self.url = ""
        self._hello = hello
        self._messages = list(messages)
        self._publish: protocol.Publish = lambda message: None
        self._changed = Condition()
        self._port = 0
        self.listen()

    def listen(self) -> None:
        """Serves the page; again on the same port after `close`."""
        self._stop = Event()
        ready: Queue[str] = Queue()
        address = Address("127.0.0.1", self._port, "")
        work = serve(self, address, rate=30.0, stop=self._stop, ready=ready.put)
        self._thread = Thread(target=lambda: asyncio.run(work))
        self._thread.start()
        self.url = ready.get(timeout=20)
        self._port = int(self.url.rstrip("/").rpartition(":")[2])

    def end(self) -> None:
        self._stop.set()
        self._thread.join()

    def show(self, *messages: Message) -> None:
        """Sends messages to the page, now and after `listen`."""
        self._messages += messages
        for message in messages:
            self._publish(message)

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Waits until the page has asked for something."""
        with self._changed:
            assert self._changed.wait_for(condition, 20), (self.commands, self.looks[-3:])

    # ---- as the source ----

    def hello(self) -> Hello:
        return self._hello

    def start(self, publish: protocol.Publish) -> None:
        self._publish = publish
        for message in self._messages:
            publish(message)

    def look(self, wanted: Look) -> None:
        with self._changed:
            self.looks.append(wanted)
            self._changed.notify_all()

    def control(self, command: Control) -> str:
        with self._changed:
            self.commands.append(command)
            self._changed.notify_all()
        return "done"

    def close(self) -> None:
        self._publish = lambda message: None
