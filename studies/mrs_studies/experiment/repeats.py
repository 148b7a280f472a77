"""Cases that are repeated with several seeds: run in several processes, printed as tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol, TypeVar

import typer

from mrs_people_sim.common import progress_bar, replace_from, write_json


class NamedCase(Protocol):
    """A case."""

    @property
    def name(self) -> str:
        """What the table calls it."""


class Scores(Protocol):
    """Scores of a case; those of several seeds are added."""

    def __add__(self, other: Any) -> Any: ...

    def report(self) -> dict[str, Any]:
        """The figures."""


_Case = TypeVar("_Case", bound=NamedCase)
_ScoresT = TypeVar("_ScoresT", bound=Scores)
#: Makes tables of cases and the reports of their scores.
Tables = Callable[[Sequence[_Case], Sequence[Mapping[str, Any]]], str]


def added_up(
    run: Callable[[_Case, int], _ScoresT],
    cases: Sequence[_Case],
    seeds: Sequence[int],
    none: _ScoresT,
    *,
    first: int = 1,
    jobs: int = 1,
) -> Iterator[_ScoresT]:
    """Runs each case with its seeds, and adds up the scores.

    Args:
        run: Runs a case with a seed; a function of a module where `jobs` is more than 1.
        cases: The cases.
        seeds: How many seeds each has.
        none: The scores of nothing.
        first: The first seed; others follow.
        jobs: Processes.

    Yields:
        The scores of each case, in their order.
    """
    todo = [
        (case, seed)
        for case, count in zip(cases, seeds, strict=True)
        for seed in range(first, first + count)
    ]
    pool = ProcessPoolExecutor(jobs, get_context("spawn")) if jobs > 1 else None
    apply = map if pool is None else pool.map
    made = iter(apply(run, *zip(*todo, strict=True))) if todo else iter(())
    try:
        for count in seeds:
            total = none
            for _ in range(count):
                total = total + next(made)
            yield total
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)


def chosen_cases(cases: Sequence[_Case], only: str) -> list[_Case]:
    """The cases whose name contains a text.

    Raises:
        typer.BadParameter: There is none.
    """
    chosen = [case for case in cases if only in case.name]
    if not chosen:
        names = ", ".join(case.name for case in cases)
        raise typer.BadParameter(f"--only is {only!r}; allowed: a part of a name of {names}")
    return chosen


def print_cases(
    cases: Sequence[_Case],
    scores: Iterator[Scores],
    tables: Tables[_Case],
    *,
    heading: str,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Shows how far the cases are, and prints their tables.

    Args:
        cases: The cases.
        scores: Of each, as they are ready.
        tables: Makes the tables.
        heading: From which on they replace what is in a file.
        out: That file; None: none.
        json_file: Where the figures go; None: nowhere.
    """
    reports = []
    with progress_bar() as progress:
        task = progress.add_task(cases[0].name, total=len(cases))
        for one in scores:
            reports.append(one.report())
            following = cases[min(len(reports), len(cases) - 1)].name
            progress.update(task, completed=len(reports), description=following)
    text = tables(cases, reports)
    typer.echo(text, nl=False)
    if json_file is not None:
        named = zip((case.name for case in cases), reports, strict=True)
        write_json(json_file, dict(named))
    if out is not None:
        replace_from(out, heading, text)
