"""The guide: from people and poses to the posts of the robots and the pace of a tour."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.guiding.formation import FormationPlanner, Scenery
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import GOES_ON, HALTS, Guidance, Post, State
from mrs_people_loc.guiding.guided_group import LONGEST_STEP_S, Guest, GuidedGroup
from mrs_people_loc.guiding.pace import PaceControl
from mrs_people_loc.guiding.tour import Stop, Tour
from mrs_people_loc.guiding.tour_team import TourTeam
from mrs_people_loc.guiding.views import are_in_view
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class GuideTuning:
    """Constants of a tour; chosen.

    Attributes:
        settled_s: A tour sets off once its group has been the same for so long [s].
        ahead: The post of a leader that drives is ahead of it by this [m] ...
        ahead_s: ... and its way in this time [s].
        there: A leader this near to its place at a stop has arrived [m].
        brake_m: A leader that waits stops within this [m].
        brakes: The leader slows down before a stop, to this speed a metre before it [1/s].
        closes_up_s: Nobody waits any longer for a group that is near a stop, but has come no
            nearer in this time [s] ...
        nearer: ... by more than this [m].
        fetch_s: A person who has been behind for so long is fetched [s].
    """

    settled_s: float = 2.0
    ahead: float = 0.5
    ahead_s: float = 1.7
    there: float = 0.4
    brake_m: float = 0.15
    brakes: float = 0.8
    closes_up_s: float = 10.0
    nearer: float = 0.2
    fetch_s: float = 2.0


GUIDE_TUNING = GuideTuning()
#: Where places are nearer to each other than this share of the way between them, it turns back.
_FOLDED = 0.5
#: States of a tour that has not ended.
RUNNING = (State.GATHERING, State.LEADING, State.WAITING, State.AT_STOP, State.HALTED)


class Guide:
    """Guides a group along a tour.

    Args:
        config: Parameters; may be replaced at any time.
        space: Where robots may drive; likewise.
        tuning: Constants.

    Attributes:
        config: Likewise.
        space: Likewise.
        faults: Why robots can take no part, by name; besides what the guide finds itself.
    """

    def __init__(
        self, config: cfg.GuideConfig, space: FreeSpace, tuning: GuideTuning = GUIDE_TUNING
    ) -> None:
        self.config, self.space = config, space
        self.faults: Mapping[str, str] = {}
        self._tuning = tuning
        self._run: _Run | None = None

    @property
    def state(self) -> State:
        """Of the tour."""
        return State.IDLE if self._run is None else self._run.state

    @property
    def is_running(self) -> bool:
        """Whether a tour has begun and has not ended."""
        return self.state in RUNNING

    def begin(self, tour: Tour) -> None:
        """Begins a tour, with the group that is there then."""
        self._run = _Run(tour, self.config, self.space, self._tuning)

    def cancel(self) -> None:
        """Ends the tour."""
        if self._run is not None and self.is_running:
            self._run.end(State.CANCELLED, "cancelled")

    def halt(self, reason: str) -> Guidance:
        """The robots stand until the next step.

        Args:
            reason: Why, such as that people are outdated.
        """
        if self._run is None:
            return Guidance(0, State.IDLE)
        if self.is_running:
            self._run.halt(reason)
        return self._run.guidance({})

    def step(
        self,
        people: Sequence[Person],
        groups: Sequence[Group],
        poses: Mapping[str, Pose],
        now_ns: int,
    ) -> Guidance:
        """Takes the people of an interval.

        Args:
            people: Who is followed, with ids.
            groups: Their groups, with ids.
            poses: The newest pose of each robot, in the common frame.
            now_ns: Stamp of the people [ns].

        Returns:
            Where the robots are to go; no posts before a tour, after it, and while they stand.
        """
        if self._run is None:
            return Guidance(now_ns, State.IDLE)
        if not self.is_running:
            return self._run.guidance({})
        self._run.configure(self.config, self.space, self.faults)
        return self._run.guidance(self._run.step(people, groups, poses, now_ns))


class _Run:
    """A tour on its way."""

    def __init__(
        self, tour: Tour, config: cfg.GuideConfig, space: FreeSpace, tuning: GuideTuning
    ) -> None:
        self.config = config
        self.state, self._reason = State.GATHERING, "waits for people"
        self._tour, self._space, self._tuning = tour, space, tuning
        self._team, self._group, self._pace = TourTeam(), GuidedGroup(tour.way), PaceControl()
        self._formation = FormationPlanner(config, tour.way, space)
        self._faults: Mapping[str, str] = {}
        self._events = [f"the tour {tour.name} begins".replace("  ", " ")]
        self._now_ns: int | None = None
        self._post_m = 0.0
        self._settled_s = self._there_s = 0.0
        self._nearest_m = math.inf
        self._is_off, self._is_at_stop, self._overtakes = False, False, False
        self._next = 0

    def configure(
        self, config: cfg.GuideConfig, space: FreeSpace, faults: Mapping[str, str]
    ) -> None:
        """Takes other parameters, another map and faults of robots, from the next step on."""
        if space is not self._space or config is not self.config:
            self._formation.configure(config, space)
        self.config, self._space, self._faults = config, space, faults

    def end(self, state: State, reason: str) -> None:
        """Ends the tour."""
        self.state, self._reason = state, reason
        self._pace.stand()

    def halt(self, reason: str) -> None:
        """The robots stand until the next step."""
        if self.state != State.HALTED:
            self._events.append(f"{HALTS}{reason}")
        self.state, self._reason = State.HALTED, reason
        self._pace.stand()

    def step(
        self,
        people: Sequence[Person],
        groups: Sequence[Group],
        poses: Mapping[str, Pose],
        now_ns: int,
    ) -> dict[str, Post]:
        """Takes the people of an interval, see `Guide.step`."""
        since_s = 0.0 if self._now_ns is None else (now_ns - self._now_ns) / 1e9
        dt_s, self._now_ns = min(max(since_s, 0.0), LONGEST_STEP_S), now_ns
        self._team.take(poses, self.config, now_ns, self._faults)
        if not self._team.robots:
            faults = "; ".join(f"{name}: {why}" for name, why in self._team.faults.items())
            self._events += self._team.events
            self.halt(f"no robot takes part: {faults or 'none is there'}")
            self._team.watch({}, dt_s)
            return {}
        if self.state == State.HALTED:
            self._events.append(GOES_ON)
        self._choose_leader()
        if not self._is_off:
            self._gather(people, groups, dt_s)
        else:
            self._group.leader_m = self._team.leader_m
            self._group.step(people, groups, now_ns / 1e9, self._in_view)
            self._group.give_up(self.config.pace.patience)
            self._events += self._group.events
            self._go_on(dt_s)
        posts = self._posts() if self.state in RUNNING else {}
        self._team.watch(posts, dt_s)
        return posts

    def guidance(self, posts: Mapping[str, Post]) -> Guidance:
        """What is told of the tour; events once."""
        group, events = self._group, tuple(self._events)
        self._events = []
        return Guidance(
            stamp_ns=self._now_ns or 0,
            state=self.state,
            reason=self._reason,
            stop="" if self._stop is None else self._stop.name,
            way_m=float(np.clip(group.way_m, 0.0, self._tour.way.length)),
            length_m=self._tour.way.length,
            speed=self._pace.speed,
            people=tuple(sorted({one.id for one in group.guided})),
            stragglers=tuple(sorted({one.id for one in group.behind})),
            lost=tuple(sorted({one.id for one in group.lost})),
            posts=posts,
            faults=dict(self._team.faults),
            events=events,
        )

    # ---- the tour ----

    @property
    def _stop(self) -> Stop | None:
        """The next stop; None: the end of the way is next."""
        return self._tour.stops[self._next] if self._next < len(self._tour.stops) else None

    @property
    def _stop_m(self) -> float:
        """Where on the way the leader stands at the next stop [m]; the group is behind it."""
        end_m = self._tour.way.length
        return end_m if self._stop is None else min(self._stop.way_m + self.config.pace.lead, end_m)

    def _gather(
        self, people: Sequence[Person], groups: Sequence[Group], dt_s: float
    ) -> None:  # fmt: skip
        """Waits until a group is there."""
        assert self._now_ns is not None
        self.state = State.GATHERING
        before, pose = len(self._group.guests), self._team.robots[self._team.leader]
        leader, now_s = np.array([pose.x, pose.y]), self._now_ns / 1e9
        self._group.gather(people, groups, leader, now_s, self._in_view)
        guests = self._group.guests
        if not guests:
            self._settled_s, self._reason = 0.0, "waits for people: none is seen"
            return
        self._settled_s = self._settled_s + dt_s if len(guests) <= before else 0.0
        ways = np.array([one.way_m for one in guests])
        off = np.array([one.xy for one in guests]) - self._tour.way.at(ways)
        away, allowed = float(np.median(np.hypot(*off.T))), self.config.pace.max_stretch
        self._reason = f"sees {_people(guests)}"
        if away > allowed:
            self._reason = (
                f"waits for the group: it is {away:.1f} m from the way; allowed: {allowed:g} m"
            )
        elif self._settled_s >= self._tuning.settled_s:
            self._is_off, self.state, self._reason = True, State.LEADING, ""
            self._events.append(f"sets off with {_people(guests)}")

    def _go_on(self, dt_s: float) -> None:
        """State and speed."""
        group, tuning = self._group, self._tuning
        to_go = self._stop_m - self._team.leader_m
        waits = self._waits_for()
        if not group.guided:
            self.end(State.CANCELLED, "nobody of the group is left")
        elif self._is_at_stop:
            self._stay(waits, dt_s)
        elif self._overtakes:
            self.state = State.WAITING
            self._reason = f"waits until {self._team.leader} is in front"
            self._pace.stand()
        elif waits:
            self.state, self._reason, self._there_s = State.WAITING, waits, 0.0
            self._nearest_m = math.inf
            self._pace.stand()
        elif to_go <= tuning.there:
            self._close_up(dt_s)
        else:
            self._there_s, self._nearest_m = 0.0, math.inf
            self._walk(to_go, dt_s)

    def _close_up(self, dt_s: float) -> None:
        """The leader is at a stop, or at the end, and waits for the others."""
        away, tuning = self._away(), self._tuning
        where = "the end" if self._stop is None else self._stop.name
        if away < self._nearest_m - tuning.nearer:
            self._nearest_m, self._there_s = away, 0.0
        self._there_s += dt_s
        self._pace.stand()
        self.state, self._reason = State.WAITING, f"waits until everybody is at {where}"
        if self._is_group_there():
            self._arrive(f"everybody is at {where}")
        elif self._there_s >= tuning.closes_up_s and away <= self.config.pace.max_stretch:
            self._arrive(
                f"goes on after {tuning.closes_up_s:g} s: the group is {away:.1f} m from {where}"
            )
        elif self._there_s >= self.config.pace.patience:
            self._end_without_group()

    def _arrive(self, event: str) -> None:
        self._events.append(event)
        self._nearest_m = math.inf
        self._is_at_stop, self._there_s, self.state, self._reason = True, 0.0, State.AT_STOP, ""
        if self._stop is None:
            self.end(State.FINISHED, "")
            self._events.append(f"the tour {self._tour.name} is finished".replace("  ", " "))

    def _end_without_group(self) -> None:
        reason = f"the group has not come along for {self.config.pace.patience:g} s"
        self._events.append(reason)
        self.end(State.CANCELLED, reason)

    def _stay(self, waits: str, dt_s: float) -> None:
        """The group is at a stop."""
        assert self._stop is not None
        self.state, self._reason, self._there_s = State.AT_STOP, "", self._there_s + dt_s
        if self._there_s < self._stop.wait_s:
            return
        self._reason = waits
        if not waits:
            self._events.append(f"goes on from {self._stop.name}")
            self._is_at_stop, self._there_s, self.state = False, 0.0, State.LEADING
            self._next += 1

    def _walk(self, to_go: float, dt_s: float) -> None:
        """The leader goes as the group follows."""
        config, group = self.config.pace, self._group
        leader = self._team.robots[self._team.leader]
        speed = self._pace.step(
            config,
            highest=min(self._tour.speed or config.speed, self._tuning.brakes * to_go),
            gap=group.gap(self._team.leader_m, np.array([leader.x, leader.y])),
            stretch=group.stretch,
            dt_s=dt_s,
        )
        self.state, self._reason = State.LEADING, ""
        if speed == 0.0:
            long = group.stretch > config.stretch
            self.state = State.WAITING
            self._reason = "waits until the group has closed up" if long else "waits for the group"
            if self._pace.in_vain_s >= self.config.pace.patience:
                self._end_without_group()

    def _waits_for(self) -> str:
        """Whom the group waits for, in words; empty: nobody."""
        behind = self._group.behind
        if not behind:
            return "" if self._group.together else "waits: nobody of the group is seen"
        return f"waits for {_people(behind)}"

    @property
    def _stop_xy(self) -> Float:
        """Where the group is to be next [m], shape (2,)."""
        return self._tour.way.at(self._tour.way.length if self._stop is None else self._stop.way_m)

    def _away(self) -> float:
        """How far the group's middle is from the next stop [m]."""
        xy = np.array([one.xy for one in self._group.together])
        return float(np.hypot(*(np.median(xy, axis=0) - self._stop_xy)))

    def _is_group_there(self) -> bool:
        """Whether everybody is at the next stop: near it, or near each other behind the leader."""
        xy = np.array([one.xy for one in self._group.together])
        gather, lead = self.config.pace.gather, self.config.pace.lead
        if (np.hypot(*(xy - self._stop_xy).T) <= gather).all():
            return True
        is_close = bool((np.hypot(*(xy - np.median(xy, axis=0)).T) <= gather).all())
        return is_close and self._away() <= gather + lead

    # ---- robots ----

    def _choose_leader(self) -> None:
        group = self._group
        front_m = group.front_m + self.config.pace.lead
        moving = self._is_off and not self._is_at_stop
        assert self._now_ns is not None
        if self._team.lead(
            self.config.leader, self._tour.way, group.way_m, front_m, self._now_ns, moving=moving
        ):
            self._post_m = self._team.leader_m
            self._pace.stand()
            self._overtakes = self._is_off and self._team.leader_m < group.way_m
        else:
            in_front_m = group.front_m + 0.5 * self.config.pace.lead
            enough_m = min(in_front_m, self._stop_m - self._tuning.there)
            self._overtakes = self._overtakes and self._team.leader_m < enough_m
        self._events += self._team.events

    def _in_view(self, xy: Float) -> Bool:
        """Where nobody is unnoticed, shape (n,): robots look there, or the floor is not free."""
        people = np.array([one.xy for one in self._group.guided if one.followed]).reshape(-1, 2)
        in_view = are_in_view(xy, people, self._team.robots, self.config, self._space)
        return np.asarray(in_view | (self._space.clearance(xy) < 0.0))

    def _posts(self) -> dict[str, Post]:
        """Where the robots are to go."""
        group, team, speed = self._group, self._team, self._pace.speed
        there = [one for one in group.guests if not one.lost and not one.is_behind]
        there += [one for one in group.behind if one.followed]
        there = there or group.behind  # nobody is seen: robots look where they were last
        if not there:
            return {}
        fetched = self._who_is_fetched()
        if fetched is not None and fetched not in there:
            there.append(fetched)
        self._post_m, speed = self._leaders_post(speed)
        assert self._now_ns is not None
        posts = self._formation.step(
            Scenery(
                people=np.array([one.xy for one in there]),
                people_m=np.array([one.way_m for one in there]),
                straggler=None if fetched is None else there.index(fetched),
                leader=team.leader,
                leader_m=self._post_m,
                leader_speed=speed,
                robots=team.robots,
                moving=self._pace.speed > 0.0,
                overtakes=self._overtakes and bool(group.together),
                now_s=self._now_ns / 1e9,
                unseen_s=np.array([one.unseen_s for one in there]),
            )
        )
        return dict(sorted(posts.items()))

    def _leaders_post(self, speed: float) -> tuple[float, float]:
        """Where on the way the leader is to go [m], and how fast [m/s]."""
        group, leader_m, tuning = self._group, self._team.leader_m, self._tuning
        if self._overtakes and group.together:
            front_m = group.front_m + self.config.pace.lead
            return min(front_m, max(self._stop_m, leader_m)), self.config.base.max_speed
        if speed > 0.0:
            post_m = min(leader_m + tuning.ahead + tuning.ahead_s * speed, self._stop_m)
            if self._turns_back(post_m):
                self._team.leader_m = post_m
                post_m = min(post_m + tuning.ahead, self._stop_m)
            return post_m, speed
        return min(self._post_m, leader_m + tuning.brake_m), self.config.pace.speed

    def _turns_back(self, post_m: float) -> bool:
        """Whether the way turns back on itself between the leader and its next place."""
        pose = self._team.robots[self._team.leader]
        away = float(np.hypot(*(self._tour.way.at(post_m) - (pose.x, pose.y))))
        return away < _FOLDED * (post_m - self._team.leader_m)

    def _who_is_fetched(self) -> Guest | None:
        """Who has been behind for the longest time."""
        behind = self._group.behind
        if not behind or (behind[0].behind_s or 0.0) < self._tuning.fetch_s:
            return None
        return behind[0]


def _people(guests: Sequence[Guest]) -> str:
    if len(guests) == 1:
        return f"person {guests[0].id}"
    return f"people {', '.join(str(number) for number in sorted(one.id for one in guests))}"
