"""What stages take."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_clock: Callable[[], int] = time.perf_counter_ns


def now_ns() -> int:
    """The clock that stages are timed with [ns]: the time that passes."""
    return _clock()


@contextmanager
def processor_time() -> Iterator[None]:
    """Within, stages are timed by what they take of the processor.

    That is what passes on an idle machine; on a busy one, what other programs take in between does
    not count. For benchmarks, in one thread.
    """
    global _clock
    before, _clock = _clock, time.thread_time_ns
    try:
        yield
    finally:
        _clock = before


class StageTimes:
    """What passed between marks, by `now_ns`."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = now_ns()

    def mark(self, stage: str) -> None:
        """Ends a stage: its time is what passed since the last mark."""
        now = now_ns()
        self.ms[stage] = (now - self._last) / 1e6
        self._last = now
