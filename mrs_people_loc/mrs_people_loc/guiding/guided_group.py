"""Who is guided: the people of the group, how far along the way they are, and who falls behind.

People are told by the ids of the planner's tracks as long as these are followed. An id that ends
and one that begins near by are the same person, see `GuidedGroup._reassign`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.people import Group, Person


@dataclass(frozen=True)
class GroupTuning:
    """Constants of the guided group; chosen.

    Attributes:
        most: So many people are guided, newcomers included: the nearest to leader and start.
        longest_step_s: After a longer pause, for which the robots stood, times of people go on by
            no more than this [s].
        as_near: Groups are as near to the leader and the start as the nearest one within this [m].
        start_reach: People at the start of the tour are no farther along the way than this [m].
        front_share: The foremost count as no farther ahead of this share of the group than ...
        front_more: ... this [m].
        fastest: People do not come along the way faster than this [m/s].
        reach: A person is sought along the way within this [m], and what people walk meanwhile ...
        away_s: ... for this long, at most [s].
        astray: Who is farther than this from their place along the way is sought near the group,
            too [m]: ...
        nearer: ... they are there if that is nearer to them by this [m].
        slack: From one interval to the next people get along the way no farther than they walk,
            and this [m]; ...
        jump: ... unless they are farther than this from where they were on it [m] ...
        jump_s: ... and have been apart from the group for longer than this [s].
        apart_s: A person who is apart from the group for so long has fallen behind [s].
        near: A person who has fallen behind is back when this near to somebody of the group [m],
        apart: ... and a person who is no farther than this from somebody is with the group [m].
        ahead: Who is apart but not farther ahead of the group's middle than this walks ahead [m].
        missing_s: A person whose track ended so long ago, apart from the group, has fallen behind
            [s].
        joins_m: A newcomer is guided once they have come along the way for so far [m].
        switch_s: A track that begins within this time of another's end may be the same person [s]
        switch_reach: ... within this distance [m], and what people walk meanwhile,
        switch_most: ... but no farther than this [m].
        empty_s: A place that robots have seen empty for so long is empty [s].
        left_s: Who fell behind, and whose last place robots have seen empty for so long, has left
            [s].
        beside: Who is nearer to a place than this is there [m].
        walks: Who walks faster than this against their part of a way that turns back on itself,
            as the leader on a later part does, is on that part, too [m/s]: ...
        beside_way: ... it is no farther from them than the part before by this [m], ...
        later: ... is farther along the way by this, as the leader is [m], ...
        later_reach: ... within this of where they follow the leader [m], ...
        opposed: ... and the cosine of the angle between both parts is below this.
        same_s: A track with the id of another is another one if it began later by this [s].
        never: What two tracks that cannot be the same person's cost [m]: more than all others can.
    """

    most: int = 30
    longest_step_s: float = 0.5
    as_near: float = 2.0
    start_reach: float = 12.0
    front_share: float = 0.75
    front_more: float = 1.5
    fastest: float = 1.6
    reach: float = 1.0
    away_s: float = 30.0
    astray: float = 2.5
    nearer: float = 0.5
    slack: float = 0.1
    jump: float = 2.0
    jump_s: float = 1.0
    apart_s: float = 0.6
    near: float = 2.0
    apart: float = 2.5
    ahead: float = 4.0
    missing_s: float = 3.0
    joins_m: float = 1.5
    switch_s: float = 3.0
    switch_reach: float = 1.0
    switch_most: float = 8.0
    empty_s: float = 0.6
    left_s: float = 5.0
    beside: float = 0.7
    walks: float = 0.2
    beside_way: float = 0.3
    later: float = 1.0
    later_reach: float = 1.5
    opposed: float = -0.5
    same_s: float = 1.5
    never: float = 1e3


GROUP_TUNING = GroupTuning()


@dataclass(eq=False)
class Guest:
    """A person of the group.

    Attributes:
        id: Of their track.
        xy: Where they are; who is hidden among the group is taken to go on with it [m], shape (2,).
        place: Where they were when they were last followed [m], shape (2,).
        velocity: 0 while it is not known [m/s], shape (2,).
        way_m: How far along the way they are [m].
        began_s: When their track began [s].
        last_s: When they were last followed [s].
        followed: Whether their track goes on.
        unseen_s: Time since they were last seen [s].
        apart_s: For how long they have been apart from the group [s].
        behind_s: For how long they have fallen behind [s]; None: they have not.
        lost: Whether the tour goes on without them.
        joined_m: How far along the way they were when they joined the group; None: they are guided.
        came_late: Whether they joined on the way.
        empty_s: For how long robots have seen the place empty where they were last [s].
    """

    id: int
    xy: Float
    place: Float
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
    came_late: bool = False
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
        leader_m: How far along the way the leader is [m]; to be set before a step.
        events: What has happened in the last step.
        size: Of the planner's group with which the tour begins; those beyond `tuning.most` are not
            guided.
    """

    way: Way
    tuning: GroupTuning = GROUP_TUNING
    guests: list[Guest] = field(default_factory=list)
    way_m: float = -math.inf
    leader_m: float = -math.inf
    events: list[str] = field(default_factory=list)
    size: int = 0
    _now_s: float = math.inf
    _news: dict[tuple[str, str], list[int]] = field(default_factory=dict)

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
        return self._front(self.together)

    @property
    def front_m(self) -> float:
        """As `foremost_m`, with those who are hidden, unless robots see that their place is empty.

        Who passes the group has to pass them, too [m].
        """
        hidden = [one for one in self.guided if not one.followed and one.behind_s is None]
        there = [one for one in hidden if one.empty_s < self.tuning.empty_s]
        return self._front([*self.together, *there])

    def _front(self, guests: Sequence[Guest]) -> float:
        ways = [one.way_m for one in guests]
        if not ways:
            return max(self.way_m, 0.0)
        most = np.quantile(ways, self.tuning.front_share) + self.tuning.front_more
        return float(min(max(ways), most))

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
        self,
        people: Sequence[Person],
        groups: Sequence[Group],
        leader: Float,
        now_s: float,
        sees: Callable[[Float], Bool],
    ) -> None:
        """Takes the people with whom the tour begins.

        They are the largest of the groups that are near the leader and the start of the way, and
        the nearest of several that are as large.

        Args:
            people: Who is followed.
            groups: Their groups.
            leader: Where the leader is [m], shape (2,).
            now_s: Time of the interval [s].
            sees: As for `step`.
        """
        by_id = {person.id: person for person in people if person.id}
        members = [[i for i in group.members if i in by_id] for group in groups]
        parts = [part for part in members if part]
        ends = np.stack([leader, self.way.at(0.0)])
        places = {number: person.position for number, person in by_id.items()}
        off = [_distances(np.array([places[i] for i in part]), ends) for part in parts]
        away = [float(one.min(axis=0).mean()) for one in off]
        near = min(away, default=0.0) + self.tuning.as_near
        rows = [row for row, off in enumerate(away) if off <= near]
        rows.sort(key=lambda row: (-len(parts[row]), away[row]))
        self.size = len(parts[rows[0]]) if rows else 0
        nearest = off[rows[0]].mean(axis=1).argsort(kind="stable") if rows else ()
        chosen = [by_id[parts[rows[0]][k]] for k in sorted(nearest[: self.tuning.most])]
        known = {guest.id for guest in self.guests if guest.followed}
        if self.guests and (not chosen or not known.isdisjoint(p.id for p in chosen)):
            self.step(people, groups, now_s, sees)
            self.guests = [one for one in self.guests if one.unseen_s < self.tuning.missing_s]
        else:
            self.guests, self._now_s = [_guest(person, 0.0, now_s) for person in chosen], now_s
        for guest in self.guests:
            guest.joined_m = guest.behind_s = None
        self._start()

    def _start(self) -> None:
        """How far along the way everybody is before the tour has set off."""
        if self.guests:
            xy = np.array([guest.xy for guest in self.guests])
            ways = self.way.nearest(xy, 0.0, self.tuning.start_reach).tolist()
            for guest, way_m in zip(self.guests, ways, strict=True):
                guest.way_m = way_m
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
        dt_s, self._now_s = min(away_s, self.tuning.longest_step_s), now_s
        by_id = {person.id: person for person in people if person.id}
        self._follow(by_id, now_s, dt_s)
        self._watch_places(by_id.values(), dt_s, sees)
        home = self._home(groups)
        self._reassign(by_id, now_s)
        self._admit(by_id, home, now_s)
        self._locate(dt_s, away_s)
        self._judge(home, dt_s)
        self._advance(away_s)

    def give_up(self, patience_s: float) -> None:
        """The tour goes on without those who have been behind, or unseen, for so long [s].

        Who joined on the way and is not seen any more is forgotten: somebody seen twice, perhaps.
        """
        for guest in self.guided:
            if max(guest.behind_s or 0.0, guest.unseen_s) < patience_s:
                continue
            if guest.came_late and guest.behind_s is None:
                self.guests.remove(guest)
            else:
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
        places = np.array([guest.place for guest in gone])
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

    def _reassign(self, by_id: Mapping[int, Person], now_s: float) -> None:
        """Gives new tracks to people whose own have ended.

        A track that begins soon after the end of another, near by, is of the same person; later
        too, unless that person may still stand, apart from the group, where they were last.
        """
        from scipy.optimize import linear_sum_assignment  # here: it takes long to load

        guests = [one for one in self.guests if one.joined_m is None]
        followed = {one.id for one in guests if one.followed}
        ended = [one for one in guests if not one.followed]
        begun = [p for i, p in sorted(by_id.items()) if i not in followed and not p.coasting]
        if not ended or not begun:
            return
        away, may_be = self._away_from_ends(ended, begun, now_s)
        cost = np.where(may_be, away, self.tuning.never)
        for row, column in zip(*linear_sum_assignment(cost), strict=True):
            if may_be[row, column]:
                self._is_now(ended[row], begun[column], now_s)

    def _away_from_ends(
        self, ended: Sequence[Guest], begun: Sequence[Person], now_s: float
    ) -> tuple[Float, Bool]:
        """How far tracks that have begun are from those that ended.

        Returns:
            Distances from where the guests were last, or would be by now, the less [m], and whether
            it may be the same person, shapes (ended, begun).
        """
        tuning, xy = self.tuning, np.array([person.position for person in begun])
        there = np.linalg.norm(np.array([one.place for one in ended])[:, None] - xy, axis=2)
        onward = np.linalg.norm(np.array([one.xy for one in ended])[:, None] - xy, axis=2)
        away = np.minimum(onward, there)
        last_s = np.array([one.last_s for one in ended])[:, None]
        began_s = now_s - np.array([person.age_s for person in begun])
        reach = tuning.switch_reach + tuning.fastest * (now_s - last_s)
        in_reach = away <= np.minimum(reach, tuning.switch_most)
        in_order = began_s > last_s - tuning.same_s
        has_moved = [one.unseen_s <= tuning.switch_s or self._is_hidden(one) for one in ended]
        in_place = np.array(has_moved)[:, None] | (there <= tuning.beside)
        return away, in_reach & in_order & in_place

    def _is_now(self, guest: Guest, person: Person, now_s: float) -> None:
        """A guest has another track from now on."""
        self.guests = [
            one
            for one in self.guests
            if one.joined_m is None or one.id != person.id or one is guest
        ]
        guest.id, guest.unseen_s = person.id, 0.0
        _take(guest, person, now_s)

    def _is_hidden(self, guest: Guest) -> bool:
        """Whether somebody who is not followed is taken to be among the group.

        They are if their last place is there, or if nobody is at that place.
        """
        if guest.followed:
            return False
        return self._is_near(guest) or guest.empty_s >= self.tuning.empty_s

    def _is_near(self, guest: Guest) -> bool:
        """Whether the last place of somebody is among the group."""
        away = [float(np.hypot(*(guest.place - one.xy))) for one in self.together]
        return min(away, default=math.inf) <= self.tuning.apart

    def _admit(self, by_id: Mapping[int, Person], home: frozenset[int], now_s: float) -> None:
        """Newcomers of the group are guided once they have come along for a while.

        Where somebody of the group is hidden, they are that one.
        """
        known = {guest.id for guest in self.guests if guest.followed}
        room = max(self.tuning.most - len(self.guests), 0)
        newcomers = [by_id[number] for number in sorted((home - known) & by_id.keys())[:room]]
        xy = np.array([person.position for person in newcomers]).reshape(-1, 2)
        ways = self.way.nearest(xy, self.way_m, self.tuning.start_reach).tolist()
        for person, way_m in zip(newcomers, ways, strict=True):
            guest = _guest(person, way_m, now_s)
            guest.joined_m = way_m
            self.guests.append(guest)
        for guest in [one for one in self.guests if one.joined_m is not None]:
            if guest.id not in home or not guest.followed:
                self.guests.remove(guest)
            elif guest.way_m - (guest.joined_m or 0.0) >= self.tuning.joins_m:
                self._join(guest, by_id[guest.id], now_s)

    def _join(self, guest: Guest, person: Person, now_s: float) -> None:
        hidden = [one for one in self.guided if self._is_hidden(one)]
        if hidden:
            longest = max(hidden, key=lambda one: (one.unseen_s, -one.id))
            longest.way_m = guest.way_m
            self._is_now(longest, person, now_s)
        else:
            guest.joined_m, guest.came_late = None, True
            self.events.append(f"person {guest.id} joins the tour")

    # ---- along the way ----

    def _locate(self, dt_s: float, away_s: float) -> None:
        """How far along the way everybody is."""
        there = [guest for guest in self.guests if guest.followed]
        if not there:
            return
        tuning = self.tuning
        xy = np.array([guest.xy for guest in there])
        before = np.array([guest.way_m for guest in there])
        reach = tuning.reach + tuning.fastest * min(max(away_s, 0.0), tuning.away_s)
        found = self.way.nearest(xy, before, reach)
        off = np.hypot(*(self.way.at(found) - xy).T)
        near_group = self.way.nearest(xy, max(self.way_m, 0.0), tuning.start_reach)
        better = np.hypot(*(self.way.at(near_group) - xy).T)
        is_astray = (off > tuning.astray) & (better < off - tuning.nearer)
        found = np.where(is_astray, near_group, found)
        most = tuning.fastest * max(away_s, dt_s) + tuning.slack
        for guest, before_m, way_m, jumps in zip(
            there, before, found, np.abs(found - before) > tuning.jump, strict=True
        ):
            limited = before_m + float(np.clip(way_m - before_m, -most, most))
            guest.way_m = float(way_m) if jumps and guest.apart_s > tuning.jump_s else limited
        self._turn_back(there)

    def _turn_back(self, there: Sequence[Guest]) -> None:
        """Where the way turns back on itself, people are on the part on which they follow."""
        tuning, way = self.tuning, self.way
        ways = np.array([guest.way_m for guest in there])
        if not self.leader_m > ways.min() + tuning.later:
            return
        xy = np.array([guest.xy for guest in there])
        velocity = np.array([guest.velocity for guest in there])
        away = np.hypot(*(way.at(self.leader_m) - xy).T)
        follows = np.maximum(self.leader_m - away, 0.0)
        onward = way.nearest(xy, follows, tuning.later_reach)
        beside = np.hypot(*(way.at(onward) - xy).T) - np.hypot(*(way.at(ways) - xy).T)
        turns = (onward > ways + tuning.later) & (beside <= tuning.beside_way)
        turns &= (way.ahead(onward) * way.ahead(ways)).sum(axis=1) < tuning.opposed
        turns &= (way.ahead(onward) * velocity).sum(axis=1) > tuning.walks
        for guest, way_m, is_back in zip(there, onward.tolist(), turns, strict=True):
            if is_back:
                guest.way_m = way_m

    def _judge(self, home: frozenset[int], dt_s: float) -> None:
        """Who has fallen behind, and who is back."""
        near = np.array([one.xy for one in self.together if one.id in home]).reshape(-1, 2)
        for guest in [one for one in self.guests if one.joined_m is None]:
            if guest.followed:
                away = np.hypot(*(near - guest.xy).T).min(initial=math.inf)
                self._judge_followed(guest, float(away), guest.id in home, dt_s)
            else:
                self._judge_unseen(guest)
            if guest.behind_s is not None:
                guest.behind_s += dt_s
        for (one, several), ids in self._news.items():
            numbers = ", ".join(map(str, sorted(ids)))
            self.events.append(
                f"people {numbers} {several}" if len(ids) > 1 else f"person {numbers} {one}"
            )
        self._news.clear()

    def _tell(self, guest: Guest, one: str, several: str) -> None:
        """What happens to several people at once is told in one sentence."""
        self._news.setdefault((one, several), []).append(guest.id)

    def _judge_unseen(self, guest: Guest) -> None:
        tuning = self.tuning
        guest.apart_s = 0.0
        if guest.behind_s is None:
            if not self._is_hidden(guest) and guest.unseen_s >= tuning.missing_s:
                guest.behind_s = guest.unseen_s
                self._stayed(guest)
                self._tell(guest, "is not seen any more", "are not seen any more")
        elif not guest.lost:
            if self._is_near(guest):
                guest.behind_s = None
            elif guest.empty_s >= tuning.left_s and self.together:
                guest.lost = True
                self._tell(
                    guest, "has left; goes on without them", "have left; goes on without them"
                )

    def _stayed(self, guest: Guest) -> None:
        """Somebody has not gone on with the group: robots look for them where they were last."""
        guest.xy = guest.place
        (way_m,) = self.way.nearest(guest.xy[None], guest.way_m, self.tuning.start_reach)
        guest.way_m = float(way_m)

    def _judge_followed(self, guest: Guest, away: float, at_home: bool, dt_s: float) -> None:
        tuning, was_behind = self.tuning, guest.behind_s is not None
        is_with = at_home or away < (tuning.near if was_behind else tuning.apart)
        is_ahead = 0.0 < guest.way_m - self.way_m < tuning.ahead
        guest.apart_s = 0.0 if is_with or is_ahead else guest.apart_s + dt_s
        if not was_behind and guest.apart_s >= tuning.apart_s:
            guest.behind_s = 0.0
            self._tell(guest, "has fallen behind", "have fallen behind")
        elif (was_behind or guest.lost) and guest.apart_s == 0.0:
            guest.behind_s, guest.lost = None, False
            self._tell(guest, "is back", "are back")

    def _advance(self, away_s: float) -> None:
        """How far the group's middle has come: the median of those who are together."""
        ways = [guest.way_m for guest in self.together]
        if not ways:
            return
        most = self.way_m + self.tuning.fastest * max(away_s, 0.0)
        before, self.way_m = self.way_m, max(self.way_m, min(float(np.median(ways)), most))
        onward = self.way_m - before
        for guest in self.guests:
            if not guest.followed and guest.behind_s is None and onward > 0.0:
                guest.xy = guest.xy + self.way.at(guest.way_m + onward) - self.way.at(guest.way_m)
                guest.way_m += onward


def _guest(person: Person, way_m: float, now_s: float) -> Guest:
    xy = person.position
    guest = Guest(person.id, xy, xy, np.zeros(2), way_m, now_s, now_s)
    _take(guest, person, now_s)
    return guest


def _take(guest: Guest, person: Person, now_s: float) -> None:
    guest.xy = guest.place = person.position
    guest.velocity = np.zeros(2) if person.velocity is None else person.velocity
    guest.began_s, guest.last_s = now_s - person.age_s, now_s
    guest.followed, guest.empty_s = True, 0.0


def _distances(xy: Float, others: Float) -> Float:
    """Of places, shape (n, 2), from others, shape (k, 2) [m], shape (n, k)."""
    return np.asarray(np.linalg.norm(xy[:, np.newaxis] - others, axis=2))
