"""Groups: who walks together, who has fallen behind or left, and what has happened.

Two people are linked once they have walked near each other for a while, and no more once they have
been farther apart for a while; a group is what links hold together. Of the groups that share
members with an earlier one, that with the most is the same group and keeps its id. A member who is
no longer held is a straggler of his group until he is back, or has been away for so long that he
has left it. Time is an argument; where it jumps back by more than `clocks.RESET_NS`, all groups are
new, and their ids go on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.geometry import Float
from mrs_people_loc.neighbours import connected, pairs_within
from mrs_people_loc.people import Group, Person, gather

Bool = NDArray[np.bool_]

#: Ids are below 2^32: two of them are one number.
_HALF = 32
#: An interval that comes later says nothing of the time between, except to stragglers: for the
#: others it counts as if it came so long after the one before [s].
_LONGEST_STEP = 1.0


@dataclass
class _Roster:
    """Who belongs to a group.

    Attributes:
        joined_s: By member, for how long he has belonged to it [s].
        unseen_s: By member who is not followed at the moment, since when [s].
        away_s: By straggler, since when [s].
    """

    joined_s: dict[int, float] = field(default_factory=dict)
    unseen_s: dict[int, float] = field(default_factory=dict)
    away_s: dict[int, float] = field(default_factory=dict)

    def all(self) -> tuple[dict[int, float], ...]:
        """All that is known."""
        return self.joined_s, self.unseen_s, self.away_s

    def drop(self, member: int) -> None:
        """Forgets a member."""
        for each in self.all():
            each.pop(member, None)


class Groups:
    """Follows who belongs together.

    Args:
        config: Its parameters; may be replaced at any time.

    Attributes:
        config: Likewise.
    """

    def __init__(self, config: cfg.Groups) -> None:
        self.config = config
        self._next_id = 1
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forgets all groups: the time jumped back. Ids go on."""
        self._time_ns: int | None = None
        self._rosters: dict[int, _Roster] = {}
        self._ids = np.empty(0, dtype=np.int64)
        self._pairs = np.empty((0, 2), dtype=np.int64)
        self._linked = np.empty(0, dtype=bool)
        self._doubt_s = np.empty(0)

    def step(
        self, people: Sequence[Person], time_ns: int
    ) -> tuple[tuple[Group, ...], tuple[str, ...]]:
        """Takes the people of an interval.

        Args:
            people: Who is followed, in the order of their ids.
            time_ns: Time of the interval [ns]; a little older than the last one: nothing gets
                older; older by more than `RESET_NS`: all groups are new.

        Returns:
            The groups, the largest first, and what has happened, in sentences.
        """
        if self._time_ns is not None and self._time_ns - time_ns > RESET_NS:
            self.begin_anew()
        since_ns = 0 if self._time_ns is None else time_ns - self._time_ns
        # Scans that came late by themselves are no other time.
        if self._time_ns is None or since_ns >= 0:
            self._time_ns = time_ns
        dt_s = max(since_ns, 0) / 1e9
        homes = self._homes()
        self._link(people, homes, min(dt_s, _LONGEST_STEP))
        parts = self._parts()
        events: list[str] = []
        names = self._names(parts, homes, events)
        self._call_roll(names, parts, homes, dt_s, events)
        by_id = {person.id: person for person in people}
        groups = []
        for name, part in zip(names, parts, strict=True):
            group = gather([by_id[member] for member in part])
            assert group is not None
            away = dict(sorted(self._rosters[name].away_s.items()))
            groups.append(dataclasses.replace(group, id=name, stragglers=away))
        groups.sort(key=lambda group: (-group.size, group.id))
        return tuple(groups), tuple(events)

    # ---- links ----

    def _link(self, people: Sequence[Person], homes: Mapping[int, int], dt_s: float) -> None:
        """Who is linked to whom by now; only pairs that are near each other or linked are held."""
        config = self.config
        ids = np.array([person.id for person in people], dtype=np.int64)
        xy = np.array([person.position for person in people]).reshape(-1, 2)
        one, other, _ = pairs_within(xy, config.distance)
        # Who is not followed at the moment goes on holding together those whom he held together.
        there = np.isin(self._pairs, ids)
        hidden = set(homes) - set(ids.tolist())
        kept = self._linked & ~there.all(axis=1)
        kept &= (there | np.isin(self._pairs, list(hidden))).all(axis=1)
        waiting = self._pairs[kept]
        held = there.all(axis=1)
        keys = np.concatenate([_key(self._pairs[held]), _key(ids[np.stack([one, other], axis=1)])])
        keys, first = np.unique(keys, return_index=True)
        known = first < np.count_nonzero(held)
        linked, doubt_s = np.zeros(len(keys), dtype=bool), np.zeros(len(keys))
        linked[known] = self._linked[held][first[known]]
        doubt_s[known] = self._doubt_s[held][first[known]]
        pairs = np.stack([keys >> _HALF, keys & ((1 << _HALF) - 1)], axis=1)
        one, other = np.searchsorted(ids, pairs).T

        away = np.hypot(*(xy[one] - xy[other]).T)
        unseen = np.array([person.coasting for person in people], dtype=bool)
        slack = np.array(
            [config.hidden_sigmas * _sigma(p.covariance) if p.coasting else 0.0 for p in people]
        )
        apart = away - slack[one] - slack[other] > config.distance
        velocity = np.array(
            [p.velocity if p.velocity is not None else (np.nan, np.nan) for p in people]
        ).reshape(-1, 2)
        faster = np.hypot(*(velocity[one] - velocity[other]).T) > config.speed  # not of NaN
        together = (away < config.distance - config.margin) & ~faster
        together &= ~unseen[one] & ~unseen[other]

        # Who is held by the same group anyway, or is as new as the other one, is linked at once.
        home = np.array([homes.get(person.id, 0) for person in people], dtype=np.intp)
        young = np.array([person.age_s < config.join_time for person in people], dtype=bool)
        at_once = (home[one] == home[other]) & (home[one] > 0) & ~apart
        at_once |= young[one] & young[other] & together
        doubt_s = np.where(np.where(linked, apart, together), doubt_s + dt_s, 0.0)
        changed = doubt_s >= np.where(linked, config.leave_time, config.join_time)
        changed &= doubt_s > 0
        linked = np.where(linked, ~changed, changed | at_once)
        doubt_s[changed | at_once] = 0.0
        keep = linked | (doubt_s > 0)
        self._ids = ids
        self._pairs = np.concatenate([pairs[keep], waiting])
        self._linked = np.concatenate([linked[keep], np.ones(len(waiting), dtype=bool)])
        self._doubt_s = np.concatenate([doubt_s[keep], np.zeros(len(waiting))])

    def _homes(self) -> dict[int, int]:
        """By member, the group that holds him."""
        return {
            member: name
            for name, roster in self._rosters.items()
            for member in roster.joined_s
            if member not in roster.away_s
        }

    def _parts(self) -> list[list[int]]:
        """The ids of those that links hold together."""
        everybody = np.union1d(self._ids, self._pairs)
        one, other = np.searchsorted(everybody, self._pairs[self._linked]).T
        root = connected(one, other, len(everybody))[np.searchsorted(everybody, self._ids)]
        parts: dict[int, list[int]] = {}
        for who, first in zip(self._ids.tolist(), root.tolist(), strict=True):
            parts.setdefault(first, []).append(who)
        return list(parts.values())

    # ---- rosters ----

    def _names(
        self, parts: Sequence[Sequence[int]], homes: Mapping[int, int], events: list[str]
    ) -> list[int]:
        """Which group each part is; those that are new get a roster."""
        shared = []
        for index, part in enumerate(parts):
            for name in sorted({homes[m] for m in part if m in homes}):
                held = [self._rosters[name].joined_s[m] for m in part if homes.get(m) == name]
                shared.append((-len(held), -max(held), name, index))
        names: dict[int, int] = {}
        for _, _, name, index in sorted(shared):
            if index not in names and name not in names.values():
                names[index] = name
        for index, part in enumerate(parts):
            if index in names:
                continue
            names[index] = self._next_id
            self._next_id += 1
            self._rosters[names[index]] = _Roster()
            before = {homes[m] for m in part if m in homes}
            if len(part) > 1 and before:
                whence = ", ".join(f"group {name}" for name in sorted(before))
                events.append(f"{_people(part)} split from {whence} as group {names[index]}")
        return [names[index] for index in range(len(parts))]

    def _call_roll(
        self,
        names: Sequence[int],
        parts: Sequence[Sequence[int]],
        homes: Mapping[int, int],
        dt_s: float,
        events: list[str],
    ) -> None:
        """Brings the rosters up to date: who is there, who is not, and who is no more."""
        for name, part in zip(names, parts, strict=True):
            self._take(name, part, homes, dt_s, events)
        where = {m: name for name, part in zip(names, parts, strict=True) for m in part}
        sizes = {name: len(part) for name, part in zip(names, parts, strict=True)}
        for name, roster in list(self._rosters.items()):
            for member in sorted(set(roster.joined_s) - {m for m in where if where[m] == name}):
                self._miss(name, member, sizes.get(where.get(member, 0), 0), dt_s, events)
            if not roster.joined_s and name not in names:
                del self._rosters[name]

    def _take(
        self,
        name: int,
        part: Sequence[int],
        homes: Mapping[int, int],
        dt_s: float,
        events: list[str],
    ) -> None:
        """The people of a part are there: they are members of the group that it is."""
        roster = self._rosters[name]
        founded = not roster.joined_s
        merged: dict[int, list[int]] = {}
        for member in part:
            if member in roster.away_s:
                away_s = roster.away_s[member]
                events.append(f"{_people([member])} is back with group {name} after {away_s:.1f} s")
            elif member not in roster.joined_s and not founded:
                merged.setdefault(homes.get(member, 0), []).append(member)
            former = homes.get(member, name)
            if former != name and not founded:
                self._rosters[former].drop(member)
            joined_s = roster.joined_s.get(member, -dt_s) + dt_s
            roster.drop(member)
            roster.joined_s[member] = joined_s
        for former, members in merged.items():
            left = self._rosters.get(former, _Roster())
            stay = set(left.joined_s) - set(left.away_s)
            if former and stay.isdisjoint(self._ids.tolist()):
                # Its stragglers, and who is not followed at the moment, come along.
                for each in set(left.joined_s) - set(roster.joined_s):
                    for mine, theirs in zip(roster.all(), left.all(), strict=True):
                        if each in theirs:
                            mine[each] = theirs[each]
                for of in left.all():
                    of.clear()
            if former and len(members) > 1:
                events.append(f"group {former} ({_people(members)}) merges into group {name}")
            else:
                events += [f"{_people([member])} joins group {name}" for member in members]

    def _miss(self, name: int, member: int, elsewhere: int, dt_s: float, events: list[str]) -> None:
        """A member is not there: he is in a group of so many people elsewhere; 0: not seen."""
        config, roster = self.config, self._rosters[name]
        alone = len(roster.joined_s) == 1
        if member in roster.away_s:
            roster.away_s[member] += dt_s
            if roster.away_s[member] >= config.forget_time:
                roster.drop(member)
                events.append(f"{_people([member])} has left group {name}")
        elif elsewhere:
            if alone or roster.joined_s[member] < config.join_time:
                roster.drop(member)
                return
            roster.away_s[member] = config.leave_time
            if elsewhere == 1:
                events.append(f"{_people([member])} has fallen behind or left group {name}")
        else:
            lately_s = min(dt_s, _LONGEST_STEP)
            roster.unseen_s[member] = roster.unseen_s.get(member, 0.0) + lately_s
            unseen_s = roster.unseen_s[member]
            if unseen_s >= config.missing_time:
                if alone or roster.joined_s[member] < config.join_time:
                    roster.drop(member)
                    return
                roster.away_s[member] = unseen_s
                events.append(
                    f"{_people([member])} of group {name} has not been seen for {unseen_s:.0f} s"
                )


def _people(members: Iterable[int]) -> str:
    each = [str(member) for member in members]
    return f"person {each[0]}" if len(each) == 1 else f"people {', '.join(each)}"


def _key(pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number for each pair of ids."""
    return np.asarray(pairs[:, 0] << _HALF | pairs[:, 1])


def _sigma(covariance: Float) -> float:
    """Standard deviation along the long axis of an ellipse [m]."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
