"""How much this machine has to do."""

from __future__ import annotations

import os
from dataclasses import dataclass


@dataclass(frozen=True)
class Load:
    """How many processes run or wait for a processor, mean over a minute.

    Attributes:
        processes: How many.
        cores: Processors that there are for them.
    """

    processes: float
    cores: int

    @classmethod
    def now(cls) -> Load:
        """Of this machine."""
        return cls(os.getloadavg()[0], len(os.sched_getaffinity(0)))

    @property
    def share(self) -> float:
        """Share of a processor that each process gets."""
        return min(1.0, self.cores / max(self.processes, 1e-3))

    def __str__(self) -> str:
        """Such as "load 11 on 2 cores"."""
        return f"load {self.processes:.0f} on {self.cores} core{'s' if self.cores > 1 else ''}"
