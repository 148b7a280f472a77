"""What the server of `mrs view` shows: a running team (`live`), or a bag (`playback`)."""

from __future__ import annotations

from typing import Protocol

from mrs_tools.view.protocol import Control, Hello, Look, Publish


class Source(Protocol):
    """Where messages come from. The server calls it; it never waits for a viewer."""

    def hello(self) -> Hello:
        """What each viewer gets first; may be called in any thread."""

    def start(self, publish: Publish) -> None:
        """Begins, once, and returns at once: what there is to show goes to `publish`.

        The server keeps the last message of each kind (of each robot, of images) and the last
        events for viewers that come later.
        """

    def look(self, wanted: Look) -> None:
        """Takes what viewers look at just now, all together; nobody at first. Returns at once.

        Images of other robots, and cells if not wanted, must cost nothing.
        """

    def control(self, command: Control) -> str:
        """Does what a viewer asks for; called in a thread of its own, and may take some seconds.

        Returns:
            What was done, in words.

        Raises:
            CommandError: It is not possible here, or fails.
        """

    def close(self) -> None:
        """Ends what `start` has begun, and waits for it."""
