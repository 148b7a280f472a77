"""The steps of the demo in the terminal, each with the time that it takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

#: Reports how much of a step is done, 0 to 1.
OnProgress = Callable[[float], None]


@contextmanager
def step(console: Console, text: str, below: RenderableType | None = None) -> Iterator[OnProgress]:
    """Shows a step as long as it lasts; then its time stays.

    A bar and a clock run in a terminal. Elsewhere there is the line with the time alone.

    Args:
        console: Where to.
        text: What is done.
        below: What is shown below it meanwhile, and stays above the time.

    Yields:
        What may be told how much is done.
    """
    from rich.console import Group
    from rich.live import Live
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    began_s = time.monotonic()
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(20),
        TimeElapsedColumn(),
        console=console,
    )
    task = bar.add_task(text, total=None)

    def on_progress(share: float) -> None:
        bar.update(task, total=1.0, completed=share)

    shown = bar if below is None else Group(below, bar)
    with Live(shown, console=console, refresh_per_second=5, transient=True):
        yield on_progress
    if below is not None:
        console.print(below)
    tell(console, text, time.monotonic() - began_s)


def tell(console: Console, text: str, took_s: float) -> None:
    """Prints a step that is done, and how long it took [s]."""
    from rich.text import Text

    console.print(Text.assemble((f"{took_s:6.1f} s  ", "dim"), text))
