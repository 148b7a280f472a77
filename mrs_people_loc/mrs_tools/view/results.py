"""People of a bag that has none: of a team that ran on it, or found in the background."""

from __future__ import annotations

import pickle
import threading
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from typing import Any

import numpy as np

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.bags.offline import BagRun, Interval
from mrs_tools.diagnosis.facts import ERROR, OK, STALE
from mrs_tools.plain import plain
from mrs_tools.view.moment import Found, MapCells
from mrs_tools.view.recorded import Told


class Results:
    """People of a bag that are not in it, interval by interval.

    They are kept compressed, some megabytes per hour of a group.

    Args:
        start_ns: Bag time of the bag's beginning [ns].

    Attributes:
        ready_ns: People are known until this bag time [ns].
        first_ns: Bag time of the first people [ns]; None: there are none yet.
        events: Bag time [ns] and sentence of each event.
    """

    def __init__(self, start_ns: int) -> None:
        self.ready_ns = start_ns
        self.first_ns: int | None = None
        self.events: list[tuple[int, str]] = []
        self._times_ns: list[int] = []
        self._packed: list[bytes] = []

    def add(self, time_ns: int, found: Found) -> None:
        """Adds the people of an interval; bag times [ns] grow."""
        self._packed.append(zlib.compress(pickle.dumps(found), 1))
        self._times_ns.append(time_ns)
        if self.first_ns is None and found.persons:
            self.first_ns = time_ns

    def between(self, after_ns: int, until_ns: int) -> Iterator[tuple[int, Told]]:
        """Bag time [ns] and what was found, after a bag time and until another one."""
        first, last = (bisect_right(self._times_ns, time_ns) for time_ns in (after_ns, until_ns))
        for number in range(first, last):
            found = pickle.loads(zlib.decompress(self._packed[number]))
            yield self._times_ns[number], _teller(found)

    def start(self) -> None:
        """Begins to find more."""

    def close(self) -> None:
        """Ends, and waits for it."""

    def status(self) -> tuple[str, str]:
        """A level, and where the people come from."""
        return OK, "the bag has none: they are those of the team that has just run"


class Computed(Results):
    """People of a bag, as `mrs evaluate` finds them, in a thread of its own.

    Args:
        run: The bag, and the team that its robots make.
    """

    def __init__(self, run: BagRun) -> None:
        super().__init__(run.start_ns)
        self._run = run
        self._is_done, self._error = False, ""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._compute, name="people of the bag", daemon=True)

    def start(self) -> None:
        """Begins."""
        self._thread.start()

    def close(self) -> None:
        """Ends, and waits for it."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()

    def status(self) -> tuple[str, str]:
        """A level, and how far it is."""
        if self._error:
            return ERROR, self._error
        if self._is_done:
            return OK, "the bag has none: they were found by this viewer"
        span_ns = max(1, self._run.end_ns - self._run.start_ns)
        share = (self.ready_ns - self._run.start_ns) / span_ns
        return STALE, f"the bag has none: they are being found, {share:.0%} of it is done"

    def _compute(self) -> None:
        try:
            for interval in self._run.intervals(on_progress=self._on_progress):
                self._take(interval)
                if self._closing.is_set():
                    return
            self.ready_ns = self._run.end_ns
        except PeopleLocError as err:
            self._error = str(err)
        self._is_done = True

    def _on_progress(self, part: float) -> None:
        span_ns = self._run.end_ns - self._run.start_ns
        self.ready_ns = max(self.ready_ns, self._run.start_ns + int(part * span_ns))

    def _take(self, interval: Interval) -> None:
        people = interval.people
        # The last one closes after the bag's end.
        time_ns = min(interval.closed_ns, self._run.end_ns)
        cells = MapCells(people.fused.xy, people.fused.robot.astype(np.uint8))
        found = Found(people.stamp_ns, people.everybody, people.groups, people.poses, cells)
        self.add(time_ns, found)
        self.events += [(time_ns, plain(event)) for event in people.events]


def _teller(found: Any) -> Told:
    return lambda moment, time_ns: moment.take_people(time_ns, found)
