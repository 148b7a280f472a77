"""Times by stage, and in which turns they are taken."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

#: Configurations take turns after so many views or intervals, and the first ones do not count.
_BLOCK, _WARM_UP = 25, 3


@dataclass
class Samples:
    """Times by stage [ms]."""

    ms: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, times: Mapping[str, float]) -> None:
        """Takes one run."""
        for stage, ms in times.items():
            self.ms[stage].append(ms)

    def median(self, stage: str) -> float:
        """Median of a stage [ms]."""
        return float(np.median(self.ms[stage]))

    def report(self) -> dict[str, Any]:
        """Median and 99th percentile of each stage [ms]."""
        return {
            stage: {"median": float(np.median(ms)), "p99": float(np.percentile(ms, 99))}
            for stage, ms in self.ms.items()
        }


def blocks(count: int) -> Iterator[list[tuple[int, bool]]]:
    """Turns from 0 in blocks: one head has the caches for itself, as in its own process.

    Yields:
        Turns, and whether each one counts; the first ones of a block warm up.
    """
    for begin in range(0, count, _BLOCK):
        turns = range(begin, min(begin + _BLOCK, count))
        yield [(turn, False) for turn in turns[:_WARM_UP]] + [(turn, True) for turn in turns]
