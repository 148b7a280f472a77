"""Connections that say nothing keep no places of the page's server from viewers."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from aiohttp import web

#: A request has to be whole, and what is answered has to be read, within this [s].
SILENT_S = 10.0
#: So many connections may have no request with the right token; of more, the oldest are closed.
MOST_SILENT = 64
#: Connections are looked at this often [s].
_LOOK_S = 0.2


class Places:
    """The connections of a server; those on which a request is worked on are busy.

    Attributes:
        busy: Protocols of the connections that are.
    """

    def __init__(self) -> None:
        self.busy: set[Any] = set()
        self._since_s: dict[Any, float] = {}  # since when a connection is silent

    async def watch(self, server: web.Server) -> None:
        """Closes what is silent for too long, and the oldest of too many, until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            before, now_s = self._since_s, loop.time()
            silent = [one for one in server.connections if one not in self.busy]
            self._since_s = {one: before.get(one, now_s) for one in silent}
            oldest = sorted(silent, key=self._since_s.__getitem__)
            too_many = oldest[: max(len(oldest) - MOST_SILENT, 0)]
            for one in oldest:
                is_old = now_s - self._since_s[one] > SILENT_S
                if one.transport is not None and (is_old or one in too_many):
                    one.transport.abort()
            await asyncio.sleep(_LOOK_S)


class Once(logging.Filter):
    """Lets each kind of record through once: by the first line of its text."""

    def __init__(self) -> None:
        super().__init__()
        self._kinds: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether it goes through."""
        kind = str(record.msg).partition("\n")[0]
        is_new = kind not in self._kinds
        self._kinds.add(kind)
        return is_new
