"""Who is guided: the people of the group, how far along the way they are, and who falls behind.

People are told by the ids of the planner's tracks as long as these are followed. An id that ends
and one that begins near by are the same person, see `GuidedGroup._reassign`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.people import Group, Person

#: After a longer pause, for which the robots stood, times of people go on by no more than this [s].
LONGEST_STEP_S = 0.5


@dataclass(frozen=True)
class GroupTuning:
    """Constants of the guided group; chosen.

    Attributes:
        start_reach: People at the start of the tour are no farther along the way than this [m].
        fastest: People do not come along the way faster than this [m/s].
        astray: A person farther from their place along the way than this is sought anew on it [m].
        apart_s: A person who is apart from the group for so long has fallen behind [s].
        near: A person who has fallen behind is back when this near to somebody of the group [m].
        ahead: Who is apart but not farther ahead of the group's middle than this walks ahead [m].
        missing_s: A person whose track ended so long ago has fallen behind [s].
        joins_m: A newcomer is guided once they have come along the way for so far [m].
        switch_s: A track that begins within this time of another's end may be the same person [s]
        switch_reach: ... within this distance [m], and what people walk meanwhile.
        empty_s: A place that robots have seen empty for so long is empty [s].
        beside: Who is nearer to a place than this is there [m].
        same_s: A track with the id of another is another one if it began later by this [s].
    """

    start_reach: float = 12.0
    fastest: float = 1.6
    astray: float = 2.5
    apart_s: float = 0.6
    near: float = 2.0
    ahead: float = 4.0
    missing_s: float = 6.0
    joins_m: float = 1.5
    switch_s: float = 3.0
    switch_reach: float = 1.0
    empty_s: float = 0.6
    beside: float = 0.7
    same_s: float = 1.0


@dataclass(eq=False)
class Guest:
    """A person of the group.

    Attributes:
        id: Of their track.
        xy: Where they are, or were when last followed [m], shape (2,).
        velocity: Likewise [m/s], shape (2,).
        way_m: How far along the way they are [m].
        began_s: When their track began [s].
        last_s: When they were last followed [s].
        followed: Whether their track goes on.
        unseen_s: Time since they were last seen [s].
        apart_s: For how long they have been apart from the group [s].
        behind_s: For how long they have fallen behind [s]; None: they have not.
        lost: Whether the tour goes on without them.
        joined_m: How far along the way they were when they joined the group; None: they are guided.
        empty_s: For how long robots have seen the place empty where they were last [s].
    """

    id: int
    xy: Float
    velocity: Float
    way_m: float
    began_s: float
    last_s: float
    followed: bool = True
    unseen_s: float = 0.0
    apart_s: float = 0.0
    behind_s: float | None = None
    lost: bool = False
    joined_m: float | None = None
    empty_s: float = 0.0

    @property
    def is_behind(self) -> bool:
        """Whether the group waits for them."""
        return self.behind_s is not None and not self.lost


@dataclass
class GuidedGroup:
    """The people of the group.

    Attributes:
        way: Of the tour.
        tuning: Constants.
        guests: Everybody, newcomers included, by when they joined.
        way_m: How far along the way the group's middle has come [m]; never less than before.
        events: What has happened in the last step.
    """

    way: Way
    tuning: GroupTuning = field(default_factory=GroupTuning)
    guests: list[Guest] = field(default_factory=list)
    way_m: float = -math.inf
    events: list[str] = field(default_factory=list)
    _now_s: float = math.inf

    @property
    def guided(self) -> list[Guest]:
        """Those who are guided, also who has fallen behind; nobody who is lost."""
        return [one for one in self.guests if one.joined_m is None and not one.lost]

    @property
    def together(self) -> list[Guest]:
        """Those of them who are followed and have not fallen behind."""
        return [one for one in self.guided if one.followed and one.behind_s is None]

    @property
    def behind(self) -> list[Guest]:
        """Those who have fallen behind, the longest time first."""
        found = [one for one in self.guided if one.is_behind]
        return sorted(found, key=lambda one: (-(one.behind_s or 0.0), one.id))

    @property
    def lost(self) -> list[Guest]:
        """Those without whom the tour goes on."""
        return [one for one in self.guests if one.lost]

    @property
    def foremost_m(self) -> float:
        """How far along the way the foremost are [m]; a single one may be ahead by 1.5 m."""
        ways = [one.way_m for one in self.together]
        if not ways:
            return max(self.way_m, 0.0)
        return float(min(max(ways), np.quantile(ways, 0.75) + 1.5))

    @property
    def stretch(self) -> float:
        """Length of the group, with those who have fallen behind but are followed [m].

        It is summed from person to person: along the way, but no more than straight on, for people
        cut corners.
        """
        there = sorted((one for one in self.guided if one.followed), key=lambda one: one.way_m)
        if len(there) < 2:
            return 0.0
        ways = np.minimum([one.way_m for one in there], self.foremost_m)
        xy = np.array([one.xy for one in there])
        return float(np.minimum(np.diff(ways), np.hypot(*np.diff(xy, axis=0).T)).sum())

    def gap(self, leader_m: float, leader: Float) -> float:
        """How far a leader is ahead of the foremost, along the way or straight, the less [m].

        Args:
            leader_m: How far along the way it is [m].
            leader: Where it is [m], shape (2,).
        """
        away = [float(np.hypot(*(one.xy - leader))) for one in self.together]
        return min([leader_m - self.foremost_m, *away])

    def gather(
        self, people: Sequence[Person], groups: Sequence[Group], leader: Float, now_s: float
    ) -> None:
        """Takes the people with whom the tour begins: the largest group, the nearest of several.

        Args:
            people: Who is followed.
            groups: Their groups.
            leader: Where the leader is [m], shape (2,).
            now_s: Time of the interval [s].
        """
        by_id = {person.id: person for person in people if person.id}
        parts = [[by_id[i] for i in group.members if i in by_id] for group in groups]
        parts = [part for part in parts if part]
        self.guests, self.way_m, self._now_s = [], -math.inf, now_s
        if not parts:
            return
        chosen = min(parts, key=lambda part: (-len(part), _distance(part, leader)))
        xy = np.array([person.position for person in chosen])
        ways = self.way.nearest(xy, 0.0, self.tuning.start_reach)
        for person, way_m in zip(chosen, ways, strict=True):
            self.guests.append(_guest(person, float(way_m), now_s))
        self.way_m = float(np.median(ways))

    def step(
        self,
        people: Sequence[Person],
        groups: Sequence[Group],
        now_s: float,
        sees: Callable[[Float], Bool],
    ) -> None:
        """Takes the people of an interval.

        Args:
            people: Who is followed.
            groups: Their groups.
            now_s: Time of the interval [s].
            sees: Which places the robots see: of places, shape (n, 2), to shape (n,).
        """
        self.events = []
        away_s = max(now_s - self._now_s, 0.0)
        dt_s, self._now_s = min(away_s, LONGEST_STEP_S), now_s
        by_id = {person.id: person for person in people if person.id}
        self._follow(by_id, now_s, dt_s)
        self._watch_places(by_id.values(), dt_s, sees)
        home = self._home(groups)
        self._reassign(by_id, home, now_s)
        self._admit(by_id, home, now_s)
        self._locate(dt_s, away_s)
        self._judge(home, dt_s)
        self._advance(away_s)

    def give_up(self, patience_s: float) -> None:
        """The tour goes on without those who have been behind for so long [s]."""
        for guest in self.behind:
            if (guest.behind_s or 0.0) >= patience_s:
                guest.lost = True
                self.events.append(f"goes on without person {guest.id}")

    # ---- identity ----

    def _follow(self, by_id: Mapping[int, Person], now_s: float, dt_s: float) -> None:
        """Takes the tracks that go on; one of the same id that began later is another one."""
        for guest in self.guests:
            person = by_id.get(guest.id)
            if person is None or abs(now_s - person.age_s - guest.began_s) > self.tuning.same_s:
                guest.followed = False
                guest.unseen_s += dt_s
                continue
            guest.unseen_s = guest.unseen_s + dt_s if person.coasting else 0.0
            _take(guest, person, now_s)

    def _watch_places(
        self, people: Iterable[Person], dt_s: float, sees: Callable[[Float], Bool]
    ) -> None:
        """For how long the places of those who are not followed have been empty."""
        gone = [guest for guest in self.guests if not guest.followed]
        if not gone:
            return
        places = np.array([guest.xy for guest in gone])
        xy = np.array([person.position for person in people]).reshape(-1, 2)
        away = np.linalg.norm(places[:, None] - xy[None], axis=2).min(axis=1, initial=math.inf)
        empty = sees(places) & (away > self.tuning.beside)
        for guest, is_empty in zip(gone, empty, strict=True):
            guest.empty_s += dt_s if is_empty else 0.0

    def _home(self, groups: Sequence[Group]) -> frozenset[int]:
        """Ids of the group with most of the guests; what else there is of it are newcomers."""
        mine = {guest.id for guest in self.guided if guest.followed}
        if not groups:
            return frozenset(mine)
        chosen = max(groups, key=lambda group: (len(mine & set(group.members)), group.size))
        return frozenset(chosen.members)

    def _reassign(self, by_id: Mapping[int, Person], home: frozenset[int], now_s: float) -> None:
        """Gives new tracks to people whose own have ended.

        A track that begins soon after the end of another, near by, is of the same person; later
        one of the group is, too, if the place where the other ended has been seen empty.
        """
        tuning = self.tuning
        gone = [one for one in self.guests if not one.followed and one.joined_m is None]
        taken = {one.id for one in self.guests if one.followed and one.joined_m is None}
        fresh = [p for i, p in sorted(by_id.items()) if i not in taken and not p.coasting]
        if not gone or not fresh:
            return
        distance = np.array([[float(np.hypot(*(g.xy - p.position))) for p in fresh] for g in gone])
        last_s = np.array([guest.last_s for guest in gone])[:, None]
        unseen_s = np.array([guest.unseen_s for guest in gone])[:, None]
        began_s = now_s - np.array([person.age_s for person in fresh])[None]
        in_group = np.array([person.id in home for person in fresh])[None]
        empty = np.array([guest.empty_s >= tuning.empty_s for guest in gone])[:, None]
        allowed = distance <= tuning.switch_reach + tuning.fastest * (now_s - last_s)
        allowed &= began_s > last_s - tuning.same_s
        allowed &= (unseen_s <= tuning.switch_s) | (distance <= tuning.beside) | (empty & in_group)
        cost = np.where(allowed, distance, 1e3)
        for row, column in zip(*linear_sum_assignment(cost), strict=True):
            if allowed[row, column]:
                guest, person = gone[row], fresh[column]
                self.guests = [g for g in self.guests if g is guest or g.id != person.id]
                guest.id, guest.unseen_s = person.id, 0.0
                _take(guest, person, now_s)

    def _admit(self, by_id: Mapping[int, Person], home: frozenset[int], now_s: float) -> None:
        """Newcomers of the group are guided once they have come along for a while."""
        known = {guest.id for guest in self.guests if guest.followed}
        for number in sorted(home - known):
            if number in by_id:
                xy = by_id[number].position[None]
                (way_m,) = self.way.nearest(xy, self.way_m, self.tuning.start_reach)
                guest = _guest(by_id[number], float(way_m), now_s)
                guest.joined_m = guest.way_m
                self.guests.append(guest)
        kept = []
        for guest in self.guests:
            if guest.joined_m is not None:
                if guest.id not in home or not guest.followed:
                    continue
                if guest.way_m - guest.joined_m >= self.tuning.joins_m:
                    guest.joined_m = None
                    self.events.append(f"person {guest.id} joins the tour")
            kept.append(guest)
        self.guests = kept

    # ---- along the way ----

    def _locate(self, dt_s: float, away_s: float) -> None:
        """How far along the way everybody is."""
        there = [guest for guest in self.guests if guest.followed]
        if not there:
            return
        tuning = self.tuning
        xy = np.array([guest.xy for guest in there])
        before = np.array([guest.way_m for guest in there])
        found = self.way.nearest(xy, before, 1.0 + tuning.fastest * max(away_s, 0.0))
        off = np.hypot(*(self.way.at(found) - xy).T)
        near_group = self.way.nearest(xy, max(self.way_m, 0.0), tuning.start_reach)
        better = np.hypot(*(self.way.at(near_group) - xy).T)
        found = np.where((off > tuning.astray) & (better < off - 0.5), near_group, found)
        most = tuning.fastest * max(away_s, dt_s) + 0.1
        for guest, before_m, way_m, jumps in zip(
            there, before, found, np.abs(found - before) > 2.0, strict=True
        ):
            limited = before_m + float(np.clip(way_m - before_m, -most, most))
            guest.way_m = float(way_m) if jumps and guest.apart_s > 1.0 else limited

    def _judge(self, home: frozenset[int], dt_s: float) -> None:
        """Who has fallen behind, and who is back."""
        tuning = self.tuning
        near = np.array([one.xy for one in self.together if one.id in home]).reshape(-1, 2)
        for guest in self.guests:
            if guest.joined_m is not None:
                continue
            away = np.hypot(*(near - guest.xy).T).min(initial=math.inf)
            if guest.followed:
                ahead = 0.0 < guest.way_m - self.way_m < tuning.ahead
                with_group = guest.id in home or (guest.is_behind and away < tuning.near)
                guest.apart_s = 0.0 if with_group or ahead else guest.apart_s + dt_s
                behind = guest.apart_s >= tuning.apart_s
            else:
                behind = guest.unseen_s >= tuning.missing_s
            if behind and guest.behind_s is None:
                guest.behind_s = 0.0
                what = "has fallen behind" if guest.followed else "is not seen any more"
                self.events.append(f"person {guest.id} {what}")
            elif guest.behind_s is not None and guest.followed and guest.apart_s == 0.0:
                guest.behind_s, guest.lost = None, False
                self.events.append(f"person {guest.id} is back")
            elif guest.behind_s is not None:
                guest.behind_s += dt_s

    def _advance(self, away_s: float) -> None:
        """How far the group's middle has come: the median of those who are together."""
        ways = [guest.way_m for guest in self.together]
        if ways:
            most = self.way_m + self.tuning.fastest * max(away_s, 0.0)
            self.way_m = max(self.way_m, min(float(np.median(ways)), most))


def _guest(person: Person, way_m: float, now_s: float) -> Guest:
    guest = Guest(person.id, person.position, np.zeros(2), way_m, now_s, now_s)
    _take(guest, person, now_s)
    return guest


def _take(guest: Guest, person: Person, now_s: float) -> None:
    guest.xy, guest.began_s, guest.last_s = person.position, now_s - person.age_s, now_s
    guest.velocity = np.zeros(2) if person.velocity is None else person.velocity
    guest.followed, guest.empty_s = True, 0.0


def _distance(people: Sequence[Person], xy: Float) -> float:
    return float(min(np.hypot(*(person.position - xy)) for person in people))
