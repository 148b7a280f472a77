"""The guide: from people and poses to the posts of the robots and the pace of a tour."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_people_loc.guiding.guided_group import LONGEST_STEP_S, GuidedGroup
from mrs_people_loc.guiding.pace import PaceControl
from mrs_people_loc.guiding.tour import Space, Stop, Tour
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.poses import Pose

#: A tour begins once its group has been the same for so long [s].
_SETTLED_S = 2.0
#: The post of a leader that drives is ahead of it by the way of this time [s] and by this [m].
_AHEAD_S, _AHEAD_M = 1.0, 0.4
#: A leader that is nearer to its place at a stop than this is there [m].
_THERE_M = 0.4
#: A person who has fallen behind is fetched after this time [s].
_FETCH_S = 2.0

RUNNING = (State.GATHERING, State.LEADING, State.WAITING, State.AT_STOP, State.HALTED)


class Guide:
    """Guides a group along a tour.

    Args:
        config: Parameters; may be replaced at any time.
        space: Where robots may drive; likewise.

    Attributes:
        config: Likewise.
        space: Likewise.
    """

    def __init__(self, config: cfg.GuideConfig, space: Space) -> None:
        self.config = config
        self.space = space
        self._tour: Tour | None = None
        self._state = State.IDLE
        self._reason = ""

    @property
    def state(self) -> State:
        """Of the tour."""
        return self._state

    def begin(self, tour: Tour) -> None:
        """Begins a tour, with the group that is there then."""
        self._tour = tour
        self._state, self._reason = State.GATHERING, "waits for people"
        self._group = GuidedGroup(tour.way)
        self._pace = PaceControl()
        self._events = [f"the tour {tour.name} begins"]
        self._leader = ""
        self._leader_m = self._post_m = 0.0
        self._out: dict[str, str] = {}
        self._now_ns: int | None = None
        self._settled_s = self._stayed_s = 0.0
        self._next = 0

    def cancel(self) -> None:
        """Ends the tour."""
        if self._state in RUNNING:
            self._state, self._reason = State.CANCELLED, "cancelled"

    def halt(self, reason: str) -> Guidance:
        """The robots stand until the next step: why, such as that people are outdated."""
        if self._tour is None:
            return Guidance(0, State.IDLE)
        if self._state in RUNNING:
            self._state, self._reason = State.HALTED, reason
            self._pace.stand()
        return self._guidance({})

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
            Where the robots are to go; no posts before a tour and after it.
        """
        if self._tour is None or self._state not in RUNNING:
            return Guidance(now_ns, self._state) if self._tour is None else self._guidance({})
        since_ns = 0 if self._now_ns is None else now_ns - self._now_ns
        dt_s = min(max(since_ns, 0) / 1e9, LONGEST_STEP_S)
        first, self._now_ns = self._now_ns is None, now_ns
        robots = self._who_takes_part(poses, now_ns)
        if not robots:
            return self.halt("no robot takes part: " + self._faults())
        self._lead(robots, first)
        if self._state == State.HALTED:
            self._state = State.LEADING if self._settled_s >= _SETTLED_S else State.GATHERING
            self._events.append("goes on")
        if self._state == State.GATHERING:
            self._gather(people, groups, robots, dt_s)
        else:
            self._group.step(people, groups, now_ns / 1e9, lambda xy: self._see(robots, xy))
            self._group.give_up(self.config.pace.patience)
            self._events += self._group.events
            self._go_on(robots[self._leader], dt_s)
        if self._state == State.FINISHED:
            return self._guidance({})
        return self._guidance(self._posts(robots))

    # ---- robots ----

    def _who_takes_part(self, poses: Mapping[str, Pose], now_ns: int) -> dict[str, Pose]:
        """Robots whose poses are not outdated; why the others take no part."""
        names = self.config.robots or tuple(sorted({*poses, *self._out}))
        timeout = self.config.safety.robot_timeout
        robots, out = {}, {}
        for name in names:
            age_s = (now_ns - poses[name].stamp_ns) / 1e9 if name in poses else math.inf
            if age_s > timeout:
                age = f"pose is {age_s:.1f} s old" if name in poses else "no pose"
                out[name] = f"{age}; allowed: {timeout:g} s"
                if name not in self._out:
                    self._events.append(f"{name} takes no part: {age}")
            else:
                robots[name] = poses[name]
                if name in self._out:
                    self._events.append(f"{name} takes part again")
        self._out = out
        return robots

    def _faults(self) -> str:
        return "; ".join(f"{name}: {why}" for name, why in self._out.items())

    def _lead(self, robots: Mapping[str, Pose], first: bool) -> None:
        """Chooses the leader."""
        assert self._tour is not None
        way, named = self._tour.way, self.config.leader
        xy = np.array([(pose.x, pose.y) for pose in robots.values()])
        start = first or self._state == State.GATHERING
        around = 0.0 if start else self._group.foremost_m
        ways = dict(zip(robots, way.nearest(xy, around, 12.0), strict=True))
        before = self._leader
        if named in robots:
            if start or ways[named] >= self._group.way_m or self._leader not in robots:
                self._leader = named
        elif self._leader not in robots:
            goal_m = self._group.foremost_m + self.config.pace.lead
            off = np.hypot(*(xy - way.at(goal_m)).T)
            self._leader = (
                max(ways, key=lambda name: (ways[name], name))
                if first
                else list(robots)[int(off.argmin())]
            )
        self._leader_m = float(ways[self._leader])
        if self._leader != before:
            self._post_m = self._leader_m
            self._pace.stand()
            self._events.append(f"{self._leader} leads")

    def _see(self, robots: Mapping[str, Pose], xy: Float) -> Bool:
        """Which places robots see, shape (n,)."""
        formation, seen = self.config.formation, np.zeros(len(xy), dtype=bool)
        for name, pose in robots.items():
            back = math.pi if name in self.config.looks_back else 0.0
            dx, dy = (xy - (pose.x, pose.y)).T
            away, turn = np.hypot(dx, dy), np.arctan2(dy, dx) - pose.yaw - back
            aside = np.abs(np.angle(np.exp(1j * turn)))
            seen |= (
                (away > formation.nearest)
                & (away < formation.reach)
                & (aside < 0.5 * formation.view)
            )
        return seen

    # ---- the tour ----

    def _gather(
        self,
        people: Sequence[Person],
        groups: Sequence[Group],
        robots: Mapping[str, Pose],
        dt_s: float,
    ) -> None:
        """Waits until a group is there."""
        assert self._now_ns is not None
        assert self._tour is not None
        group, pose = self._group, robots[self._leader]
        before = {guest.id for guest in group.guests}
        group.gather(people, groups, np.array([pose.x, pose.y]), self._now_ns / 1e9)
        ids = {guest.id for guest in group.guests}
        if not ids:
            self._settled_s, self._reason = 0.0, "waits for people: none is seen"
            return
        xy = np.array([guest.xy for guest in group.guests])
        ways = np.array([guest.way_m for guest in group.guests])
        away = float(np.median(np.hypot(*(xy - self._tour.way.at(ways)).T)))
        self._settled_s = self._settled_s + dt_s if before <= ids else 0.0
        allowed = self.config.pace.max_stretch
        if away > allowed:
            self._reason = (
                f"waits for the group: it is {away:.1f} m from the way; allowed: {allowed:g} m"
            )
        elif self._settled_s < _SETTLED_S:
            self._reason = f"sees {len(ids)} people"
        else:
            self._state, self._reason = State.LEADING, ""
            self._events.append(f"sets off with {len(ids)} people")

    def _go_on(self, leader: Pose, dt_s: float) -> None:
        """State and speed."""
        assert self._tour is not None
        group, config, stop = self._group, self.config.pace, self._stop
        self._reason = ""
        held = self._state == State.AT_STOP
        if not group.guided:
            self._state, self._reason = State.CANCELLED, "nobody of the group is left"
            self._pace.stand()
            return
        waits = self._waits_for()
        there = self._is_there(stop)
        if there and not held and not waits:
            held, self._stayed_s = True, 0.0
            if stop is not None:
                self._events.append(f"everybody is at {stop.name}")
        if held:
            self._state, self._stayed_s = State.AT_STOP, self._stayed_s + dt_s
            self._pace.stand()
            if stop is None:
                self._state = State.FINISHED
                self._events.append(f"the tour {self._tour.name} is finished")
            elif self._stayed_s >= stop.wait_s and not waits:
                self._next += 1
                self._state = State.LEADING
                self._events.append(f"goes on from {stop.name}")
            return
        if waits:
            self._state, self._reason = State.WAITING, waits
            self._pace.stand()
            return
        limit = self._end_m - self._leader_m
        highest = min(self._tour.speed or config.speed, max(0.0, 0.8 * limit))
        gap = self._leader_m - group.foremost_m
        speed = self._pace.step(config, highest=highest, gap=gap, stretch=group.stretch, dt_s=dt_s)
        self._state = State.LEADING
        if speed == 0.0 and limit > _THERE_M:
            self._state = State.WAITING
            self._reason = (
                "waits until the group has closed up"
                if group.stretch > config.stretch
                else "waits for the group"
            )

    @property
    def _stop(self) -> Stop | None:
        """The next stop; None: the end of the way is next."""
        assert self._tour is not None
        return self._tour.stops[self._next] if self._next < len(self._tour.stops) else None

    @property
    def _end_m(self) -> float:
        """Where on the way the leader is at the next stop [m]: the group is behind it there."""
        assert self._tour is not None
        if self._stop is None:
            return self._tour.way.length
        return min(self._stop.way_m + self.config.pace.lead, self._tour.way.length)

    def _waits_for(self) -> str:
        """Whom the group waits for, in words."""
        behind = self._group.behind
        if not self._group.together:
            return "nobody of the group is seen"
        if not behind:
            return ""
        if len(behind) == 1:
            what = "fallen behind" if behind[0].followed else "not been seen lately"
            return f"waits for person {behind[0].id}, who has {what}"
        return f"waits for people {', '.join(str(one.id) for one in behind)}"

    def _is_there(self, stop: Stop | None) -> bool:
        """Whether everybody is at the next stop, or at the end."""
        assert self._tour is not None
        if self._leader_m < self._end_m - _THERE_M:
            return False
        xy = np.array([one.xy for one in self._group.together])
        if not len(xy):
            return False
        gather, lead = self.config.pace.gather, self.config.pace.lead
        place = self._tour.way.at(self._tour.way.length if stop is None else stop.way_m)
        middle = np.median(xy, axis=0)
        at_place = np.hypot(*(xy - place).T).max() <= gather
        around = np.hypot(*(xy - middle).T).max() <= gather
        return bool(at_place or (around and np.hypot(*(middle - place)) <= gather + lead))

    # ---- posts ----

    def _posts(self, robots: Mapping[str, Pose]) -> dict[str, Post]:
        """Where the robots are to go."""
        assert self._tour is not None
        way, group, speed = self._tour.way, self._group, self._pace.speed
        front_m = group.foremost_m + self.config.pace.lead
        if self._leader_m < front_m - 0.5 * self.config.pace.lead and group.together:
            self._post_m, speed = min(front_m, self._end_m), self.config.base.max_speed
        elif speed > 0.0:
            self._post_m = min(self._leader_m + _AHEAD_M + _AHEAD_S * speed, self._end_m)
        at, ahead = way.at(self._post_m), way.ahead(self._post_m)
        yaw = math.atan2(ahead[1], ahead[0])
        posts = {self._leader: Post(Role.LEADER, at, yaw, speed)}
        ways = [one.way_m for one in group.together] or [0.0]
        behind_m = min(ways) - self.config.formation.distance
        others = [name for name in robots if name != self._leader]
        lefts = np.linspace(-1.0, 1.0, len(others)) if len(others) > 1 else np.zeros(1)
        for name, left in zip(others, lefts, strict=False):
            ahead = way.ahead(behind_m)
            posts[name] = Post(
                Role.REAR,
                way.at(behind_m, float(left)),
                math.atan2(ahead[1], ahead[0]),
                self.config.base.max_speed,
            )
        return posts

    def _guidance(self, posts: Mapping[str, Post]) -> Guidance:
        assert self._tour is not None
        group, events = self._group, tuple(self._events)
        self._events = []
        stop = self._stop
        return Guidance(
            stamp_ns=self._now_ns or 0,
            state=self._state,
            reason=self._reason,
            stop="" if stop is None else stop.name,
            way_m=float(np.clip(group.way_m, 0.0, self._tour.way.length)),
            length_m=self._tour.way.length,
            speed=self._pace.speed,
            people=tuple(sorted(one.id for one in group.guided)),
            stragglers=tuple(sorted(one.id for one in group.behind)),
            lost=tuple(sorted(one.id for one in group.lost)),
            posts=posts,
            faults=dict(self._out),
            events=events,
        )
