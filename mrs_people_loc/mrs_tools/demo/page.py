"""The page of the demo: what it is about to do, then its team, then the recording of it."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.view import protocol
from mrs_tools.view.protocol import CommandError, Control, Hello, Look, Publish
from mrs_tools.view.server import Address, serve
from mrs_tools.view.source import Source

if TYPE_CHECKING:
    from mrs_tools.view.results import Results

#: The page's port, where it is free; messages are sent at most so often [Hz].
_PORT, _RATE = 8765, 30.0
#: The server gets this long to start [s].
_START_S = 10.0


class DemoSource:
    """What the demo shows just now; a `Source` that becomes another one.

    Args:
        title: What the demo replays.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._publish: Publish | None = None
        self._look = Look()
        self._shown: Source | None = None

    def tell(self, text: str) -> None:
        """Shows what is done while there is no team."""
        finding = protocol.Finding(
            level="waiting", subject="demo", text=text, advice="", follows=[]
        )
        self._say(protocol.Health(type="health", level="waiting", findings=[finding]))

    @contextmanager
    def team(self) -> Iterator[None]:
        """Meanwhile the team is shown that runs in the ROS domain of the environment."""
        from mrs_tools.view.live import LiveSource

        self._become(LiveSource())
        try:
            yield
        finally:
            self._end()
            self._say(self.hello())
            self.tell("the team has seen the whole recording, and ends")

    def show_bag(self, bag: Path, files: Sequence[Path], results: Results) -> None:
        """Shows a bag.

        Args:
            bag: The bag.
            files: Parameter files of its team.
            results: The people that were found in it.

        Raises:
            PeopleLocError: It cannot be shown.
        """
        from mrs_tools.view.playback import Playback

        self._become(Playback(bag, files, results))

    def _become(self, source: Source) -> None:
        """Shows another source from now on, and closes the one before."""
        self._end()
        if self._publish is None:
            source.close()
            return
        self._shown = source
        self._say(self.hello())
        source.start(self._publish)
        source.look(self._look)

    def hello(self) -> Hello:
        """What each viewer gets first."""
        if self._shown is not None:
            return {**self._shown.hello(), "title": self._title}
        return Hello(
            type="hello",
            version=protocol.VERSION,
            mode="live",
            title=self._title,
            control=False,
            bag=None,
            tours=[],
        )

    def start(self, publish: Publish) -> None:
        """Begins."""
        self._publish = publish
        self.tell("starting")

    def look(self, wanted: Look) -> None:
        """Takes what viewers look at."""
        self._look = wanted
        if self._shown is not None:
            self._shown.look(wanted)

    def control(self, command: Control) -> str:
        """Does what a viewer asks for.

        Raises:
            CommandError: It is not possible here, or not yet.
        """
        if self._shown is None:
            raise CommandError("the demo has only started")
        return self._shown.control(command)

    def close(self) -> None:
        """Ends what is shown."""
        self._publish = None
        self._end()

    def _end(self) -> None:
        shown, self._shown = self._shown, None
        if shown is not None:
            shown.close()

    def _say(self, message: protocol.Message) -> None:
        if self._publish is not None:
            self._publish(message)


class DemoPage:
    """Serves the page in a thread of its own; use it as a context manager.

    Args:
        title: What the demo replays.

    Attributes:
        source: What it shows.
        url: What to open in a browser, once it is entered.
    """

    def __init__(self, title: str) -> None:
        self.source = DemoSource(title)
        self.url = ""
        self._stop = threading.Event()
        self._is_ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="page", daemon=True)

    def __enter__(self) -> DemoPage:
        """Begins to serve."""
        self._thread.start()
        self._is_ready.wait(_START_S)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Ends it."""
        self._stop.set()
        self._thread.join()

    def _serve(self) -> None:
        for port in (_PORT, 0):  # another one, where `mrs view` has it
            try:
                address = Address.of("127.0.0.1", port, "")
                asyncio.run(
                    serve(self.source, address, rate=_RATE, stop=self._stop, ready=self._on_ready)
                )
                return
            except PeopleLocError:
                continue
        self._is_ready.set()

    def _on_ready(self, url: str) -> None:
        self.url = url
        self._is_ready.set()


def is_watched() -> bool:
    """Whether somebody sits in front of this: a terminal, and not CI."""
    return sys.stdin.isatty() and sys.stdout.isatty() and not os.environ.get("CI")


def has_display() -> bool:
    """Whether a browser could show itself."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
