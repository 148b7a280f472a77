"""A tour in the terminal: a bar, and a line for each change."""

from __future__ import annotations

import math
import re
import time
from typing import TYPE_CHECKING, Any

from mrs_people_loc.guiding.guidance import Role, State
from mrs_people_loc.guiding.tour import Tour
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.console import Console

#: Numbers that change all the time, such as how old a pose is; ids of people are whole ones.
_NUMBER = re.compile(r"\d+\.\d+")
#: The same halt, and that the tour goes on after it, are told again after so long [s].
_AGAIN_S = 10.0


class TourView:
    """Shows a tour as it goes on; use it as a context manager.

    Where the output is no terminal, there is no bar. Of short halts for one reason that follow each
    other, one is told every 10 s.

    Args:
        console: Where to.
        tour: The tour.
    """

    def __init__(self, console: Console, tour: Tour) -> None:
        from rich.progress import BarColumn, Progress, TextColumn

        self._console, self._tour = console, tour
        self._last = ""
        self._halts: dict[str, float] = {}  # when a halt was told, by its line without ages
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.completed:.1f} of {task.total:.1f} m"),
            TextColumn("{task.fields[people]}", markup=False),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        name = plain(tour.name)
        self._task = self._progress.add_task(name, total=tour.way.length, people="")

    def __enter__(self) -> TourView:
        """Begins to show: that the tour begins with the first people."""
        from rich.text import Text

        name = plain(self._tour.name)
        self._console.print(Text(f"{name}: waits for guide_node and the first people"))
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Removes the bar."""
        self._progress.stop()

    def show(self, status: Any) -> None:
        """Takes a mrs_people_msgs/GuideStatus."""
        from rich.text import Text

        people = f"{len(status.people)} people, {status.speed:.2f} m/s"
        self._progress.update(
            self._task, completed=status.way, total=max(status.length, status.way), people=people
        )
        line = describe(status)
        without_ages = _NUMBER.sub("", line)
        if without_ages == self._last:
            return
        if status.state == State.HALTED:
            now_s = time.monotonic()
            if now_s < self._halts.get(without_ages, -math.inf) + _AGAIN_S:
                return
            self._halts[without_ages] = now_s
        self._last = without_ages
        self._progress.console.print(Text(f"{status.way:6.1f} m  {line}"))


def describe(status: Any) -> str:
    """What a mrs_people_msgs/GuideStatus says, without what changes all the time."""
    state = State(status.state).name.lower().replace("_", " ")
    parts = [f"{state} {plain(status.stop)}" if status.state == State.AT_STOP else state]
    if status.reason:
        parts.append(plain(status.reason))
    posts = ", ".join(
        f"{plain(one.robot)} {'out: ' + plain(one.fault) if one.fault else _role(one.role)}"
        for one in status.posts
    )
    if posts:
        parts.append(posts)
    return "; ".join(parts)


def _role(number: int) -> str:
    return Role(number).name.lower() if number in list(Role) else "?"
