"""The page of a command that runs a team: its start, the team, then the recording of it."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.common import print_note
from mrs_tools.installing import how_to_install
from mrs_tools.signals import stop_on_signals
from mrs_tools.view import protocol
from mrs_tools.view.protocol import PORT, CommandError, Control, Hello, Look, Publish
from mrs_tools.view.source import Source

if TYPE_CHECKING:
    from rich.console import Console

    from mrs_tools.view.results import Results

#: Messages are sent at most so often [Hz].
_RATE = 30.0
#: The server gets this long to start [s].
_START_S = 10.0


class TeamSource:
    """What a command that runs a team shows just now; a `Source` that becomes another one.

    Args:
        title: What is run.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._publish: Publish | None = None
        self._look = Look()
        self._shown: Source | None = None

    def tell(self, text: str) -> None:
        """Shows what is done while there is no team: a sentence."""
        self._say(protocol.starting(text))

    @contextmanager
    def team(self) -> Iterator[None]:
        """Meanwhile the team is shown that starts in the ROS domain of the environment."""
        from mrs_tools.view.live import LiveSource

        self._become(LiveSource(starting=True))
        try:
            yield
        finally:
            self.tell("The team ends.")
            self._end()
            self._say(self.hello())
            self.tell("The team has ended.")

    def show_bag(
        self, bag: Path, files: Sequence[Path] = (), results: Results | None = None
    ) -> None:
        """Shows a bag, again and again.

        Args:
            bag: The bag.
            files: Parameter files of its team.
            results: The people that were found in it; None: those in the bag.

        Raises:
            PeopleLocError: It cannot be shown.
        """
        from mrs_tools.view.playback import Playback

        self._become(Playback(bag, files, results, loop=True))

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
        self.tell("Starting.")

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
            raise CommandError("there is nothing to control yet")
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


class TeamPage:
    """Serves the page in a thread of its own; use it as a context manager.

    Args:
        title: What is run.

    Attributes:
        source: What it shows.
        url: What to open in a browser, once it is entered; empty: it cannot be served.
    """

    def __init__(self, title: str) -> None:
        self.source = TeamSource(title)
        self.url = ""
        self._stop = threading.Event()
        self._is_ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="page", daemon=True)

    def __enter__(self) -> TeamPage:
        """Begins to serve."""
        self._thread.start()
        self._is_ready.wait(_START_S)
        return self

    def __exit__(self, *_: object) -> None:
        """Ends it."""
        self._stop.set()
        self._thread.join()

    def stay(self, console: Console) -> None:
        """Lets the page stay until Ctrl-C, if somebody watches."""
        if not is_watched():
            return
        with stop_on_signals() as stop:
            console.print(f"the page stays, with the recording: {self.url} (Ctrl-C ends it)")
            stop.wait()

    def _serve(self) -> None:
        from mrs_tools.view.server import Address, serve

        for port in (PORT, 0):  # another one, where `mrs view` has it
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


def open_page(
    title: str, console: Console, open_: bool | None, stack: ExitStack
) -> TeamPage | None:
    """Serves the page while the stack lasts, and opens it.

    Args:
        title: What is run.
        console: Where a reason is printed why there is none.
        open_: Whether it is opened in the browser; None: where there are a terminal and a display.
        stack: Ends it.

    Returns:
        The page; None: there is none.
    """
    try:
        import aiohttp  # noqa: F401
    except ModuleNotFoundError as err:
        print_note(console, f"no page: it needs {err.name}: {how_to_install(str(err.name))}")
        return None
    page = stack.enter_context(TeamPage(title))
    if not page.url:
        print_note(console, "no page: no port of this machine can be used")
        return None
    if open_ or (open_ is None and is_watched() and _has_display()):
        webbrowser.open(page.url)
    return page


def is_watched() -> bool:
    """Whether somebody sits in front of this: a terminal, and not CI."""
    return sys.stdin.isatty() and sys.stdout.isatty() and not os.environ.get("CI")


def _has_display() -> bool:
    """Whether a browser could show itself."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
