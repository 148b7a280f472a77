"""The viewers of a page, and what each of them is still to be sent."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from aiohttp import web

from mrs_tools.view.protocol import EVENTS_KEPT, Look, Message, encode

#: A viewer that does not take a message within this is closed [s].
SEND_S = 10.0

#: What a later message replaces an earlier one of: its type, and the robot of an image.
Slot: TypeAlias = tuple[str, str]


class Encoded:
    """A message, as JSON once somebody needs it."""

    def __init__(self, message: Message) -> None:
        self._message = message
        self._text = ""

    def text(self) -> str:
        """The message as JSON."""
        self._text = self._text or encode(self._message)
        return self._text


class Viewer:
    """One connection: the latest message of each kind waits, and the last events and answers.

    Args:
        socket: The connection.

    Attributes:
        look: What it looks at.
    """

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self.look = Look()
        self._socket = socket
        self._waiting: dict[Slot, Encoded] = {}
        self._one_by_one: deque[Encoded] = deque(maxlen=EVENTS_KEPT)
        self._something = asyncio.Event()

    def offer(self, slot: Slot, message: Encoded) -> None:
        """Lets a message wait for it, if it looks at that."""
        kind, robot = slot
        if kind == "hello":  # what waits is of what was shown before
            self._waiting.clear()
            self._one_by_one.clear()
        if kind in ("event", "answer"):
            self._one_by_one.append(message)
        elif self.wants(slot):
            self._waiting[kind, robot] = message
        self._something.set()

    def wants(self, slot: Slot) -> bool:
        """Whether it looks at messages of this kind."""
        kind, robot = slot
        return {"image": robot in self.look.robots, "cells": self.look.cells}.get(kind, True)

    async def send(self) -> None:
        """Sends what waits, until the connection ends; raises TimeoutError if it takes nothing."""
        while not self._socket.closed:
            await self._something.wait()
            self._something.clear()
            while (message := self._next()) is not None:
                await asyncio.wait_for(self._socket.send_str(message.text()), SEND_S)

    def _next(self) -> Encoded | None:
        if self._waiting:
            slot = next(iter(self._waiting))
            return self._waiting.pop(slot)
        return self._one_by_one.popleft() if self._one_by_one else None


class Viewers:
    """All viewers, and the latest message of each kind.

    Args:
        rate: Messages of one kind are handed on at most so often [Hz].
        on_look: Takes what they look at, all together, when that changes.
    """

    def __init__(self, rate: float, on_look: Callable[[Look], None]) -> None:
        self._period_s, self._on_look = 1.0 / rate, on_look
        self._loop = asyncio.get_running_loop()
        self._viewers: set[Viewer] = set()
        self._looked = Look()
        self._latest: dict[Slot, Encoded] = {}
        self._events: deque[Encoded] = deque(maxlen=EVENTS_KEPT)
        self._next_s = 0.0
        # From any thread:
        self._lock = threading.Lock()
        self._came: dict[Slot, Message] = {}
        self._came_events: deque[Message] = deque(maxlen=EVENTS_KEPT)
        self._is_due = False

    def __len__(self) -> int:
        """How many they are."""
        return len(self._viewers)

    # ---- in any thread ----

    def publish(self, message: Message) -> None:
        """Takes a message for all viewers; a later one of its kind may replace it.

        With a `Hello` something else is shown: what came before is forgotten.
        """
        with self._lock:
            if message["type"] == "hello":
                self._came.clear()
                self._came_events.clear()
            if message["type"] == "event":
                self._came_events.append(message)
            else:
                self._came[_slot(message)] = message
            if self._is_due:
                return
            self._is_due = True
        try:
            self._loop.call_soon_threadsafe(self._plan)
        except RuntimeError:  # the loop has ended
            return

    # ---- in the server's ----

    def add(self, viewer: Viewer) -> None:
        """Adds a viewer, and lets the latest messages wait for it."""
        self._viewers.add(viewer)
        for slot, message in self._latest.items():
            viewer.offer(slot, message)
        for message in self._events:
            viewer.offer(("event", ""), message)

    def remove(self, viewer: Viewer) -> None:
        """Removes a viewer."""
        self._viewers.discard(viewer)
        self._look_again()

    def look(self, viewer: Viewer, look: Look) -> None:
        """Takes what a viewer looks at."""
        before, viewer.look = viewer.look, look
        self._look_again()
        for (kind, robot), message in self._latest.items():
            new = {"image": robot not in before.robots, "cells": not before.cells}
            if new.get(kind, False):
                viewer.offer((kind, robot), message)

    def _look_again(self) -> None:
        looks = [viewer.look for viewer in self._viewers]
        robots = frozenset[str]().union(*(look.robots for look in looks))
        look = Look(robots, any(look.cells for look in looks))
        if look == self._looked:
            return
        self._looked = look
        # What nobody looked at is old when somebody does.
        for slot in list(self._latest):
            if (slot[0] == "image" and slot[1] not in robots) or (
                slot[0] == "cells" and not look.cells
            ):
                del self._latest[slot]
        self._on_look(look)

    def _plan(self) -> None:
        """Hands on what came, when it is time."""
        now_s = self._loop.time()
        if now_s < self._next_s:
            self._loop.call_at(self._next_s, self._hand_on)
        else:
            self._hand_on()

    def _hand_on(self) -> None:
        # From when it was due, so that what comes at this rate keeps it.
        self._next_s = max(self._next_s + self._period_s, self._loop.time())
        with self._lock:
            came, self._came = self._came, {}
            events = list(self._came_events)
            self._came_events.clear()
            self._is_due = False
        for slot, message in came.items():
            encoded = Encoded(message)
            if slot[0] == "hello":  # the source has it for viewers that come later
                self._latest.clear()
                self._events.clear()
            else:
                self._latest[slot] = encoded
            for viewer in self._viewers:
                viewer.offer(slot, encoded)
        for message in events:
            encoded = Encoded(message)
            self._events.append(encoded)
            for viewer in self._viewers:
                viewer.offer(("event", ""), encoded)


def _slot(message: Message) -> Slot:
    return message["type"], message["robot"] if message["type"] == "image" else ""
