"""Durations of stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_clock: Callable[[], int] = time.perf_counter_ns


def now_ns() -> int:
    """The clock that stages are timed with [ns]: wall time, unless in `processor_time`."""
    return _clock()


@contextmanager
def processor_time() -> Iterator[None]:
    """Context in which stages are timed by this thread's processor time.

    Time that other programs take does not count. For benchmarks, in one thread.
    """
    global _clock
    before, _clock = _clock, time.thread_time_ns
    try:
        yield
    finally:
        _clock = before


class StageTimes:
    """Time between marks, by `now_ns`.

    Attributes:
        ms: Duration of each stage, by name [ms].
    """

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = now_ns()

    def mark(self, stage: str) -> None:
        """Ends a stage, which began at the last mark."""
        now = now_ns()
        self.ms[stage] = (now - self._last) / 1e6
        self._last = now
