"""Cases that are repeated with several seeds, in several processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, Protocol, TypeVar


class _Scores(Protocol):
    def __add__(self, other: Any) -> Any: ...


_Case = TypeVar("_Case")
_ScoresT = TypeVar("_ScoresT", bound=_Scores)


def added_up(
    run: Callable[[_Case, int], _ScoresT],
    cases: Sequence[_Case],
    seeds: Sequence[int],
    none: _ScoresT,
    *,
    jobs: int = 1,
) -> Iterator[_ScoresT]:
    """Runs each case with its seeds, and adds up the scores.

    Args:
        run: Runs a case with a seed; a function of a module where `jobs` is more than 1.
        cases: The cases.
        seeds: How many seeds each has; they are 1, 2, ...
        none: The scores of nothing.
        jobs: Processes.

    Yields:
        The scores of each case, in their order.
    """
    todo = [
        (case, seed)
        for case, count in zip(cases, seeds, strict=True)
        for seed in range(1, count + 1)
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
