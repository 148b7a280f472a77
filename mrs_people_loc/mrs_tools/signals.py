"""Lets a command end in its own order when it is interrupted."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Stop(threading.Event):
    """Set when the user, or the system, wants the command to end.

    Attributes:
        exit_code: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP, 0 before. A command for
            which being stopped is the ordinary end leaves with 0 instead.
    """

    exit_code = 0


@contextmanager
def stop_on_signals() -> Iterator[Stop]:
    """Lets SIGINT, SIGTERM and SIGHUP set an event.

    SIGHUP comes when the terminal is closed; `nohup` keeps it away. A second Ctrl-C interrupts at
    once. Only in the main thread.

    Yields:
        The event; hand it to what runs.
    """
    stop = Stop()

    def handle(number: int, _frame: FrameType | None) -> None:
        if stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.exit_code = 128 + number
        stop.set()

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
