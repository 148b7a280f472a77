"""Quarantine: which robots' scans are not to find people, as their poses are wrong.

A robot is in quarantine while it says that it is lost; while others see nobody where it sees people
(`localization.people.contradictions`); and while most of its team doubt its pose, unless others see
people where it does.

A vote is that of another robot that was heard lately and is not lost itself. It counts where fewer
doubt the voter than the one it doubts: two halves of a team that doubt each other leave each other
in. At least two votes that count, of more than half of those who could vote, are needed: with two
robots nobody can tell which one is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

#: A robot votes for so long after it was heard last [ns].
HEARD_NS = 2_000_000_000
#: It is back when nothing was against it for so long [ns].
BACK_NS = 500_000_000
#: So many votes are needed at least.
_VOTES = 2


@dataclass(frozen=True)
class _Told:
    """What a robot said last: when [ns], whether it is lost, and whom it doubts."""

    at_ns: int
    lost: bool
    doubted: frozenset[str]


class Quarantine:
    """Follows what robots tell about themselves and each other.

    What a robot said last about itself holds until it says something else: one that is lost and
    falls silent is still lost.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets everything: the time jumped back."""
        self._told: dict[str, _Told] = {}
        self._fits: tuple[Mapping[str, bool], int] = {}, 0
        self._held: dict[str, str] = {}
        self._against_ns: dict[str, int] = {}
        self._events: list[str] = []

    def hear(self, robot: str, lost: bool, doubted: Iterable[str], now_ns: int) -> None:
        """Takes what a robot tells at a time.

        Args:
            robot: Its name.
            lost: Whether it does not know where it is.
            doubted: Team-mates whose poses do not fit what it knows.
            now_ns: The time [ns].
        """
        self.at(now_ns)  # what was told before held until now
        self._told[robot] = _Told(now_ns, lost, frozenset(doubted) - {robot})
        self.at(now_ns)

    def compare(self, fits: Mapping[str, bool], now_ns: int) -> None:
        """Takes whose people are where others see some (`RelativePoses.fits`), at a time [ns]."""
        self._fits = fits, now_ns
        self.at(now_ns)

    def at(self, now_ns: int) -> dict[str, str]:
        """The robots in quarantine at a time [ns], to be asked for often, and why, in words."""
        against = self._against(now_ns)
        for robot, reason in against.items():
            self._against_ns[robot] = now_ns
            if robot not in self._held:
                self._events.append(f"{robot} is left out: {reason}")
            self._held[robot] = reason
        for robot in list(self._held):
            if robot not in against and now_ns - self._against_ns[robot] >= BACK_NS:
                del self._held[robot]
                self._events.append(f"{robot} is no longer left out")
        return dict(self._held)

    def doubts(self, now_ns: int) -> dict[str, tuple[str, ...]]:
        """By robot whose pose any doubt, those who may vote and do, sorted.

        Args:
            now_ns: The time [ns].
        """
        doubts: dict[str, list[str]] = {}
        for name in sorted(self._voters(now_ns)):
            for robot in self._told[name].doubted:
                doubts.setdefault(robot, []).append(name)
        return {robot: tuple(names) for robot, names in doubts.items()}

    def events(self) -> list[str]:
        """Who has gone into quarantine or come back since the last call, in sentences."""
        events, self._events = self._events, []
        return events

    def _voters(self, now_ns: int) -> set[str]:
        return {
            name
            for name, told in self._told.items()
            if not told.lost and now_ns - told.at_ns <= HEARD_NS
        }

    def _against(self, now_ns: int) -> dict[str, str]:
        """Who would go into quarantine now, and why."""
        fits, since_ns = self._fits
        fits = fits if now_ns - since_ns <= HEARD_NS else {}
        contradicted = (name for name, fit in fits.items() if not fit)
        found = dict.fromkeys(contradicted, "others see nobody where it sees people")
        lost = (name for name, told in self._told.items() if told.lost)
        found |= dict.fromkeys(lost, "it says that it is lost")
        doubts, voters = self.doubts(now_ns), self._voters(now_ns)
        for robot, names in doubts.items():
            votes = [name for name in names if len(doubts.get(name, ())) < len(names)]
            most = len(voters - {robot}) / 2
            is_doubted = len(votes) >= _VOTES and len(votes) > most
            if is_doubted and robot not in found and not fits.get(robot, False):
                found[robot] = f"{', '.join(votes)} doubt its pose"
        return found
