"""How long something takes, again and again, on a machine whose other work is measured."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

#: Tries that count, unless a test asks for others.
TRIES = 10
#: For slow ones: three, all of which must be within the bound; ten where `-m soak` asks for them.
FEW_OR_TEN = pytest.mark.parametrize("tries", [3, pytest.param(TRIES, marks=pytest.mark.soak)])
#: A try counts where others than this test used no more of the processors than this.
QUIET = 0.15
#: So many may not count, and after each a quiet moment must come within this time [s].
_LEFT_OUT, _PATIENCE_S, _MOMENT_S = 5, 20.0, 0.5


@dataclass(frozen=True)
class Used:
    """Processor time since the machine's start [s], and when that was.

    Attributes:
        at: When [s], monotonic.
        all: What all processes have used, and what the hypervisor gave to other machines.
            In a container that is the whole host, not its share of it.
        ours: What this process and all that it has started have used.
        pids: What this process has started; who of them is orphaned later stays ours.
    """

    at: float
    all: float
    ours: float
    pids: frozenset[int] = frozenset()

    @classmethod
    def now(cls, known: frozenset[int] = frozenset()) -> Used:
        """As it is now, with processes that were ours before."""
        tick = os.sysconf("SC_CLK_TCK")
        pids = known | frozenset(_descendants())
        ours = sum(os.times()[:4]) + sum(map(_used_by, pids)) / tick
        line = Path("/proc/stat").read_text().splitlines()[0].split()
        user, nice, system, _idle, _iowait, _irq, _softirq, steal = map(int, line[1:9])
        return cls(time.monotonic(), (user + nice + system + steal) / tick, ours, pids)

    def by_others(self) -> float:
        """Share of the machine's processors that others have used since then."""
        now = Used.now(self.pids)
        others = (now.all - self.all) - (now.ours - self.ours)
        return max(0.0, others) / ((now.at - self.at) * (os.cpu_count() or 1))


def _fields(pid: int | str) -> list[str]:
    """Of /proc/PID/stat, from the third field on; empty: it is no more."""
    try:
        return Path("/proc", str(pid), "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def _descendants() -> list[int]:
    """What this process has started, and what these have."""
    parents = {int(f.name): _fields(f.name) for f in Path("/proc").iterdir() if f.name.isdigit()}
    found = [os.getpid()]
    for one in found:
        found += [pid for pid, fields in parents.items() if fields and int(fields[1]) == one]
    return found[1:]


def _used_by(pid: int) -> int:
    """Processor time of a process and of its children that ended [ticks]."""
    return sum(map(int, _fields(pid)[11:15]))


def nine_of_ten(
    take: Callable[[], float],
    bound: float,
    what: str,
    *,
    unit: str = "s",
    tries: int = TRIES,
    show: Callable[[str], None] = print,
) -> None:
    """Holds that nine of ten tries are within a bound, and says how long they took.

    A try counts by what else the machine did meanwhile, never by what came out. Where it is too
    busy too little is known: unless the tries that count have failed already, whatever the others
    would be, the test is skipped (see `too_busy`).

    Args:
        take: One try; returns what it took: the less the better.
        bound: What the documentation promises.
        what: What takes so long.
        unit: Of both.
        tries: How many must count; of fewer than ten all must be within the bound.
        show: Prints a line.
    """
    took: list[float] = []
    left_out: list[float] = []
    shares: list[float] = []
    while len(took) < tries and len(left_out) < _LEFT_OUT:
        before = Used.now()
        one = take()
        shares.append(before.by_others())
        if shares[-1] <= QUIET:
            took.append(one)
        else:
            left_out.append(one)
            if not _quiet_moment_comes():
                break
    counted = [share for share in shares if share <= QUIET]
    show(
        f"{what}: {_listed(took)} {unit}; others had {max(counted, default=0.0):.0%} of the "
        f"processors at most; left out, with up to {max(shares):.0%}: {_listed(left_out)}"
    )
    over = sum(one > bound for one in took)
    allowed = tries - math.ceil(0.9 * tries)
    assert over <= allowed, (
        f"{what}: {over} of {len(took)} took longer than the promised {bound:g} {unit}; "
        f"allowed: {allowed} of {tries}"
    )
    if len(took) < tries:
        raise too_busy(f"{what}: {len(took)} of {tries} tries counted", show)


def too_busy(what: str, show: Callable[[str], None] = print) -> BaseException:
    """What a test raises on a machine that is too busy: it is skipped, and says so aloud.

    In CI, too: what could not be measured is no failure of what is tested.

    Args:
        what: What was measured, and what was not.
        show: Prints a line.
    """
    reason = f"this machine is too busy: others had more than {QUIET:.0%} of its processors; {what}"
    show(f"NOT MEASURED: {reason}")
    return pytest.skip.Exception(reason)


def _quiet_moment_comes() -> bool:
    end = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end:
        before = Used.now()
        time.sleep(_MOMENT_S)
        if before.by_others() <= QUIET:
            return True
    return False


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.2f}" for value in sorted(values)) or "none"
