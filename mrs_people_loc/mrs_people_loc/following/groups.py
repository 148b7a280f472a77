"""Groups: people who walk together, stragglers, and events.

Two people are linked once they have walked near each other for a while, and no longer once they
have been farther apart for a while; a group is a connected component of the links. Of the
components that share members with an earlier group, the one with the most is the same group and
keeps its id. A member outside the group's component is a straggler until they are back, or have
been away for so long that they have left. Time is an argument; where it jumps back by more than
`clocks.RESET_NS`, all groups are new, and their ids go on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.neighbours import connected, pairs_within
from mrs_people_loc.people import Group, Person, gather_each

Ids = NDArray[np.int64]

#: Ids are below 2^32: two of them fit in one number.
_HALF = 32


@dataclass(frozen=True)
class GroupsTuning:
    """Constants of groups, beside `groups.*` in the configuration; chosen.

    Attributes:
        max_step_s: After a longer pause, links and the absence of members who are not followed age
            by no more than this [s]; stragglers age by the whole pause.
    """

    max_step_s: float = 1.0


GROUPS_TUNING = GroupsTuning()


@dataclass
class _Roster:
    """The members of a group.

    Attributes:
        joined_s: By member, for how long they have belonged to it [s].
        unseen_s: By member who is not followed at the moment, since when [s].
        away_s: By straggler, since when [s].
    """

    joined_s: dict[int, float] = field(default_factory=dict)
    unseen_s: dict[int, float] = field(default_factory=dict)
    away_s: dict[int, float] = field(default_factory=dict)

    def all(self) -> tuple[dict[int, float], ...]:
        """All three mappings."""
        return self.joined_s, self.unseen_s, self.away_s

    def present(self) -> set[int]:
        """The members who are no stragglers."""
        return set(self.joined_s) - set(self.away_s)

    def drop(self, member: int) -> None:
        """Forgets a member."""
        for each in self.all():
            each.pop(member, None)

    def enter(self, member: int, dt_s: float) -> None:
        """A new or former member is there: neither unseen nor away any more."""
        joined_s = self.joined_s.get(member, -dt_s) + dt_s
        self.drop(member)
        self.joined_s[member] = joined_s

    def absorb(self, other: _Roster) -> None:
        """Stragglers, and members who are not followed at the moment, come along."""
        own = set(self.joined_s)
        for mine, theirs in zip(self.all(), other.all(), strict=True):
            mine.update({member: s for member, s in theirs.items() if member not in own})
            theirs.clear()


class Groups:
    """Follows groups of people.

    Args:
        config: Its parameters; may be replaced at any time.
        tuning: Its constants.

    Attributes:
        config: Likewise.
    """

    def __init__(self, config: cfg.Groups, tuning: GroupsTuning = GROUPS_TUNING) -> None:
        self.config = config
        self.tuning = tuning
        self._next_id = 1
        self.reset()

    def reset(self) -> None:
        """Forgets all groups: the time jumped back. Ids go on, so that none means two groups."""
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
            people: The followed people, in the order of their ids.
            time_ns: Time of the interval [ns]; a little older than the last one: nothing gets
                older; older by more than `RESET_NS`: all groups are new.

        Returns:
            The groups, the largest first, and what has happened, in sentences.
        """
        if self._time_ns is not None and self._time_ns - time_ns > RESET_NS:
            self.reset()
        since_ns = 0 if self._time_ns is None else time_ns - self._time_ns
        # Scans that came late by themselves are no other time.
        if self._time_ns is None or since_ns >= 0:
            self._time_ns = time_ns
        dt_s = max(since_ns, 0) / 1e9
        group_of = self.group_of()
        self._link(people, group_of, min(dt_s, self.tuning.max_step_s))
        components = self._components()
        events: list[str] = []
        ids = self._identify(components, group_of, events)
        self._update_rosters(ids, components, group_of, dt_s, events)
        in_component = {member: k for k, each in enumerate(components) for member in each}
        number_of = np.array([in_component[person.id] for person in people], dtype=np.intp)
        gathered = gather_each(people, number_of)
        groups = []
        for number, group in zip(ids, gathered, strict=True):
            away = dict(sorted(self._rosters[number].away_s.items()))
            groups.append(dataclasses.replace(group, id=number, stragglers=away))
        groups.sort(key=lambda group: (-group.size, group.id))
        return tuple(groups), tuple(events)

    def group_of(self) -> dict[int, int]:
        """By member, their group; without stragglers."""
        return {
            member: number
            for number, roster in self._rosters.items()
            for member in roster.joined_s
            if member not in roster.away_s
        }

    # ---- links ----

    def _link(self, people: Sequence[Person], group_of: Mapping[int, int], dt_s: float) -> None:
        """Brings the links up to date; only pairs that are near each other or linked are kept."""
        config = self.config
        ids = np.array([person.id for person in people], dtype=np.int64)
        xy = np.array([person.position for person in people]).reshape(-1, 2)
        # As `np.isin`; the ids ascend.
        followed = np.append(ids, 0)[np.searchsorted(ids, self._pairs)] == self._pairs
        held = np.asarray(followed.all(axis=1))
        waiting = self._pairs[self._waiting(followed, ids, group_of)]
        pairs, linked, doubt_s = self._candidates(held, ids, xy)
        one, other = np.searchsorted(ids, pairs).T
        apart, together = self._compare(people, xy, one, other)

        # Two members of one group, or two new people, are linked at once.
        group = np.array([group_of.get(person.id, 0) for person in people], dtype=np.intp)
        young = np.array([person.age_s < config.join_time for person in people], dtype=bool)
        at_once = (group[one] == group[other]) & (group[one] > 0) & ~apart
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

    def _waiting(self, followed: Bool, ids: Ids, group_of: Mapping[int, int]) -> Bool:
        """Which pairs are links of members who are not followed at the moment; they stay.

        Args:
            followed: Who of the pairs is, shape (n, 2).
            ids: The followed people.
            group_of: By member, their group.
        """
        waiting = self._linked & ~followed.all(axis=1)
        if waiting.any():
            hidden = set(group_of) - set(ids.tolist())
            waiting &= (followed | np.isin(self._pairs, list(hidden))).all(axis=1)
        return waiting

    def _candidates(self, held: Bool, ids: Ids, xy: Float) -> tuple[Ids, Bool, Float]:
        """Pairs of followed people that are near each other or were kept.

        Args:
            held: Pairs that were kept of followed people, shape (m,).
            ids: The followed people.
            xy: Where they are [m].

        Returns:
            Their ids, shape (n, 2); whether they are linked; for how long that has been in doubt
            [s]; shape (n,) each.
        """
        one, other, _ = pairs_within(xy, self.config.distance)
        keys = np.concatenate([_key(self._pairs[held]), _key(ids[np.stack([one, other], axis=1)])])
        keys, first = np.unique(keys, return_index=True)
        old = first < np.count_nonzero(held)
        linked, doubt_s = np.zeros(len(keys), dtype=bool), np.zeros(len(keys))
        linked[old] = self._linked[held][first[old]]
        doubt_s[old] = self._doubt_s[held][first[old]]
        pairs = np.stack([keys >> _HALF, keys & ((1 << _HALF) - 1)], axis=1)
        return pairs, linked, doubt_s

    def _compare(
        self, people: Sequence[Person], xy: Float, one: Int, other: Int
    ) -> tuple[Bool, Bool]:
        """Which pairs of people are too far apart, and which walk together, shape (n,) each."""
        config = self.config
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
        return apart, together

    def _components(self) -> list[list[int]]:
        """Connected components of the links: ids of the followed people in each."""
        linked = np.union1d(self._ids, self._pairs)
        one, other = np.searchsorted(linked, self._pairs[self._linked]).T
        root = connected(one, other, len(linked))[np.searchsorted(linked, self._ids)]
        components: dict[int, list[int]] = {}
        for member, first in zip(self._ids.tolist(), root.tolist(), strict=True):
            components.setdefault(first, []).append(member)
        return list(components.values())

    # ---- rosters ----

    def _identify(
        self,
        components: Sequence[Sequence[int]],
        group_of: Mapping[int, int],
        events: list[str],
    ) -> list[int]:
        """Which group each component is; new ones get a roster."""
        shared = []
        for index, component in enumerate(components):
            for number in sorted({group_of[m] for m in component if m in group_of}):
                joined_s = self._rosters[number].joined_s
                held = [joined_s[m] for m in component if group_of.get(m) == number]
                shared.append((-len(held), -max(held), number, index))
        ids: dict[int, int] = {}
        for _, _, number, index in sorted(shared):
            if index not in ids and number not in ids.values():
                ids[index] = number
        for index, component in enumerate(components):
            if index in ids:
                continue
            ids[index] = self._next_id
            self._next_id += 1
            self._rosters[ids[index]] = _Roster()
            before = {group_of[m] for m in component if m in group_of}
            if len(component) > 1 and before:
                origin = ", ".join(f"group {number}" for number in sorted(before))
                events.append(f"{_people(component)} split from {origin} as group {ids[index]}")
        return [ids[index] for index in range(len(components))]

    def _update_rosters(
        self,
        ids: Sequence[int],
        components: Sequence[Sequence[int]],
        group_of: Mapping[int, int],
        dt_s: float,
        events: list[str],
    ) -> None:
        for number, component in zip(ids, components, strict=True):
            self._admit(number, component, group_of, dt_s, events)
        present = dict(zip(ids, components, strict=True))
        size_of = {member: len(component) for component in components for member in component}
        for number, roster in list(self._rosters.items()):
            for member in sorted(set(roster.joined_s).difference(present.get(number, ()))):
                self._mark_absent(number, member, size_of.get(member, 0), dt_s, events)
            if not roster.joined_s and number not in present:
                del self._rosters[number]

    def _admit(
        self,
        number: int,
        component: Sequence[int],
        group_of: Mapping[int, int],
        dt_s: float,
        events: list[str],
    ) -> None:
        """Enters the people of a component in the roster of its group."""
        roster = self._rosters[number]
        founded = not roster.joined_s
        newcomers: dict[int, list[int]] = {}  # by the group that they come from; 0: none
        for member in component:
            former = group_of.get(member, 0)
            if member in roster.away_s:
                away_s = roster.away_s[member]
                text = f"{_people([member])} is back with group {number} after {away_s:.1f} s"
                events.append(text)
            elif member not in roster.joined_s and not founded:
                newcomers.setdefault(former, []).append(member)
            if former not in (0, number) and not founded:
                self._rosters[former].drop(member)
            roster.enter(member, dt_s)
        followed = self._ids.tolist()
        for former, members in newcomers.items():
            if former and self._rosters[former].present().isdisjoint(followed):
                roster.absorb(self._rosters[former])
            if former and len(members) > 1:
                events.append(f"group {former} ({_people(members)}) merges into group {number}")
            else:
                events += [f"{_people([member])} joins group {number}" for member in members]

    def _mark_absent(
        self, number: int, member: int, elsewhere: int, dt_s: float, events: list[str]
    ) -> None:
        """A member is not there.

        Args:
            number: The group.
            member: The member.
            elsewhere: Size of the group that they are in instead; 0: not seen.
            dt_s: Time since the last interval [s].
            events: What has happened; appended to.
        """
        config, roster = self.config, self._rosters[number]
        alone = len(roster.joined_s) == 1
        if member in roster.away_s:
            roster.away_s[member] += dt_s
            if roster.away_s[member] >= config.forget_time:
                roster.drop(member)
                events.append(f"{_people([member])} has left group {number}")
        elif elsewhere:
            if alone or roster.joined_s[member] < config.join_time:
                roster.drop(member)
                return
            roster.away_s[member] = config.leave_time
            if elsewhere == 1:
                events.append(f"{_people([member])} has fallen behind or left group {number}")
        else:
            recent_s = min(dt_s, self.tuning.max_step_s)
            roster.unseen_s[member] = roster.unseen_s.get(member, 0.0) + recent_s
            unseen_s = roster.unseen_s[member]
            if unseen_s >= config.missing_time:
                if alone or roster.joined_s[member] < config.join_time:
                    roster.drop(member)
                    return
                roster.away_s[member] = unseen_s
                events.append(
                    f"{_people([member])} of group {number} has not been seen for {unseen_s:.0f} s"
                )


def _people(members: Iterable[int]) -> str:
    each = [str(member) for member in members]
    return f"person {each[0]}" if len(each) == 1 else f"people {', '.join(each)}"


def _key(pairs: Ids) -> Ids:
    """One number for each pair of ids."""
    return np.asarray(pairs[:, 0] << _HALF | pairs[:, 1])


def _sigma(covariance: Float) -> float:
    """Standard deviation along the long axis of an ellipse [m]."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
