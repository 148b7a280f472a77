"""What several commands share: progress bars, numbers, files, processors."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrs_people_loc.errors import PeopleLocError

if TYPE_CHECKING:
    from rich.progress import Progress


# ------------------------------------------------------------------------------------- terminal


def progress_bar() -> Progress:
    """A bar of percentages; shows nothing where the output is no terminal. Use it in a `with`."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


@contextmanager
def counting_bar(label: str, total: int) -> Iterator[Callable[[], None]]:
    """A bar that counts; shows nothing where the output is no terminal.

    Yields:
        A function that advances it by one.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    console = Console(stderr=True)
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), Remaining())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=total)
        yield lambda: bar.advance(task)


def number(value: float | None, factor: float, digits: int) -> str:
    """A number times a factor, with so many digits after the point; "-" for None."""
    return "-" if value is None else f"{value * factor:.{digits}f}"


# ---------------------------------------------------------------------------------------- files


def write_text(path: Path, text: str) -> None:
    """Writes a file.

    Raises:
        PeopleLocError: It cannot be written.
    """
    try:
        path.write_text(text, "utf-8")
    except OSError as err:
        raise PeopleLocError(f"{path}: cannot be written ({err.strerror or err})") from err


def replace_from(path: Path, heading: str, text: str) -> None:
    """Replaces a file from a heading to its end; a file that is not there is made.

    Args:
        path: The file.
        heading: The beginning of the heading's line, such as "## Results".
        text: What follows in its place, heading included.

    Raises:
        PeopleLocError: The file cannot be read or written.
    """
    try:
        before = path.read_text("utf-8").partition(heading)[0] if path.exists() else ""
    except OSError as err:
        raise PeopleLocError(f"{path}: cannot be read ({err.strerror or err})") from err
    write_text(path, before + text)


def write_json(path: Path, report: Mapping[str, Any]) -> None:
    """Writes a report as indented JSON.

    Raises:
        PeopleLocError: The file cannot be written.
        ValueError: A number is NaN or infinite.
    """
    write_text(path, json.dumps(report, indent=2, allow_nan=False) + "\n")


# ----------------------------------------------------------------------------------- processors


def process_count(jobs: int) -> int:
    """The number of processes that `--jobs` asks for; 0: one per core."""
    return jobs or os.cpu_count() or 1


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV uses one thread meanwhile."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
