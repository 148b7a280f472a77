"""A thread that works at a rate of its own, whatever the executor does."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from mrs_ros.closing import Closing

#: Work that is under way at the end is waited for this long [s].
_LAST_S = 1.0


class Beat(Closing):
    """Calls a function again and again, by the steady clock.

    Args:
        period_s: From one call to the next [s]; what was missed is not made up for.
        work: The function; raises nothing.
    """

    def __init__(self, period_s: float, work: Callable[[], object]) -> None:
        self._period_s, self._work = period_s, work
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="beat", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends it; waits for a call that is under way."""
        self._ending.set()
        self._thread.join(_LAST_S)

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._ending.wait(max(due_s - time.monotonic(), 0.0)):
            self._work()
            due_s = max(due_s + self._period_s, time.monotonic())
