"""The guide: from people and poses to posts, pace and velocities of the robots of a tour."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.errors import TourError
from mrs_people_loc.guiding.drive import Velocity
from mrs_people_loc.guiding.formation import FormationPlanner, Scenery
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import GOES_ON, Guidance, Post, Role, State
from mrs_people_loc.guiding.guided_group import Guest, GuidedGroup
from mrs_people_loc.guiding.pace import PaceControl
from mrs_people_loc.guiding.sight import Sights
from mrs_people_loc.guiding.steering import Steering
from mrs_people_loc.guiding.tour import Stop, Tour, check_tour, narrowest
from mrs_people_loc.guiding.tour_states import PHASES, RUNNING, Cue
from mrs_people_loc.guiding.tour_team import TourTeam
from mrs_people_loc.guiding.views import are_in_view
from mrs_people_loc.guiding.yielding import Yielding, yielding
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
        unseen_s: Somebody is unseen after this time: robots that are off their posts are waited for
            [s].
        closes_up_s: Nobody waits any longer for a group that is near a stop, but has come no
            nearer in this time [s] ...
        nearer: ... by more than this [m].
        fetch_s: A person who has been behind for so long is fetched [s].
        halts_s: A tour is halted once people have been outdated for so long [s]: robots that are
            driven from here stand as soon as they are outdated.
        spare: Margins of unsure poses leave so much of the room in the narrowest place of the way
            [m].
        near: A robot may stand for somebody who is not of the group and so near to it [m].
        folded: Where places are nearer to each other than this share of the way between them, it
            turns back.
    """

    settled_s: float = 2.0
    ahead: float = 0.5
    ahead_s: float = 1.7
    there: float = 0.4
    brake_m: float = 0.15
    brakes: float = 0.8
    unseen_s: float = 1.0
    closes_up_s: float = 10.0
    nearer: float = 0.2
    fetch_s: float = 2.0
    halts_s: float = 1.0
    spare: float = 0.05
    near: float = 1.5
    folded: float = 0.5


GUIDE_TUNING = GuideTuning()
#: Why a robot in quarantine takes no part.
_APART = "it is in quarantine: it is lost, or its team doubts its pose"


class Guide:
    """A tour under way: where its robots go, how they drive there, and what stops them.

    Args:
        tour: The tour.
        config: Parameters; `robots` are those that are driven.
        space: Where robots may drive.
        now_ns: Time [ns].
        tuning: Constants.

    Attributes:
        tour: The tour.
        state: Of the tour.
        guidance: The last one; without events, which are told once.
        space: Where robots may drive, see `take_space`.
        faults: Why robots can take no part, by name, besides what is found here; may be set.

    Raises:
        TourError: The tour is not possible there.
    """

    def __init__(
        self,
        tour: Tour,
        config: cfg.GuideConfig,
        space: FreeSpace,
        now_ns: int = 0,
        tuning: GuideTuning = GUIDE_TUNING,
    ) -> None:
        check_tour(tour, space, config.safety.wall_distance)
        self.tour, self.guidance = tour, Guidance(now_ns, State.GATHERING)
        self.faults: Mapping[str, str] = {}
        self._steering = Steering(config, space, config.robots)
        self._config, self.space, self._tuning = config, space, tuning
        self._team, self._group, self._pace = TourTeam(), GuidedGroup(tour.way), PaceControl()
        self._sights, self._yields = Sights(), Yielding()
        self._quarantined: frozenset[str] = frozenset()
        self._formation = FormationPlanner(config, tour.way, space)
        self._events: list[str] = []
        self._phase, self._misfit, self._is_stopped = State.GATHERING, "", False
        self._begun_ns, self._now_ns = now_ns, 0
        self._post_m = self._settled_s = self._there_s = 0.0
        self._nearest_m = math.inf
        self._overtakes = False
        self._next = 0
        self._set_spare()
        self._turn(Cue.BEGINS)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self.state in RUNNING

    @property
    def config(self) -> cfg.GuideConfig:
        """Parameters; may be replaced at any time, but for `robots`."""
        return self._config

    @config.setter
    def config(self, config: cfg.GuideConfig) -> None:
        config = dataclasses.replace(config, robots=self._steering.robots)
        self._config = self._steering.config = config
        self._formation.configure(config, self.space)
        self._set_spare()

    def _set_spare(self) -> None:
        room = narrowest(self.tour, self.space) - self._config.safety.wall_distance
        self._steering.spare = max(room - self._tuning.spare, 0.0)

    @property
    def avoided(self) -> tuple[str, ...]:
        """Names of the robots outside the tour that are avoided."""
        return self._steering.avoided

    # ---- inputs ----

    def take_pose(self, robot: str, pose: Pose, now_ns: int) -> None:
        """Takes a pose of any robot, also of one that is not driven: it is avoided."""
        self._steering.take_pose(robot, pose, now_ns)

    def take_driven(self, robot: str, velocity: Velocity) -> None:
        """Takes what a collision monitor has made of a robot's velocity."""
        self._steering.take_driven(robot, velocity)

    def take_space(self, space: FreeSpace) -> Guidance | None:
        """Takes another map: robots stand while the tour is not possible by it.

        Returns:
            How the tour goes on, if that has changed.
        """
        self.space = self._steering.space = space
        self._formation.configure(self._config, space)
        self._set_spare()
        before, self._misfit = self._misfit, ""
        try:
            check_tour(self.tour, space, self._config.safety.wall_distance)
        except TourError as err:
            self._misfit = f"by the new map {err}"
        is_news = self._misfit not in ("", before) and not self._is_stopped
        return self.halt(self._misfit) if is_news else None

    def take_people(
        self,
        people: Sequence[Person],
        groups: Sequence[Group],
        stamp_ns: int,
        now_ns: int,
        scans: Collection[str],
        quarantined: Collection[str] = (),
    ) -> Guidance | None:
        """Takes the people of an interval.

        Args:
            people: Who is followed, with ids.
            groups: Their groups, with ids.
            stamp_ns: Of the people [ns].
            now_ns: Time [ns].
            scans: Names of the robots whose scans were used.
            quarantined: Names of the robots in quarantine.

        Returns:
            How the tour goes on; None: it has ended before, or robots are stopped, or stand for
            the map.
        """
        if not self.is_running:
            return None
        self._steering.take_people(people, stamp_ns, now_ns)
        if self._misfit or self._is_stopped:
            return None
        self._quarantined = frozenset(quarantined)
        guidance = self._step(people, groups, stamp_ns, scans)
        self._steering.blind = frozenset(self._steering.robots) - self._sights.seeing
        return self._told(guidance)

    def limits(self, count: int) -> list[str]:
        """What is not done for all of so many people, in words."""
        most, guided = self._steering.most, self._group.tuning.most
        kept = f"more than {most} people: each robot keeps clear of the nearest {most}"
        led = f"the group has more than {guided} people; guides the nearest {guided}"
        return [kept] * (count > most) + [led] * (self._group.size > guided)

    def check_age(self, now_ns: int) -> Guidance | None:
        """Halts the tour once people are outdated.

        Args:
            now_ns: Time [ns].

        Returns:
            How the tour goes on, if that has changed.
        """
        age_s = min(self._steering.people_age_s(now_ns), (now_ns - self._begun_ns) / 1e9)
        timeout = self._config.safety.people_timeout
        # Nav2 goes on to its goal until it is moved.
        longer_s = 0.0 if self._config.drive == "nav2" else self._tuning.halts_s
        stands = self.state in (State.HALTED, State.STOPPED)
        if not self.is_running or age_s < timeout + longer_s or stands:
            return None
        return self.halt(f"no people have come for {age_s:.2f} s; allowed: {timeout:g} s")

    def cancel(self, reason: str = "") -> Guidance:
        """Ends the tour.

        Args:
            reason: Why, in words; empty: somebody asked for it.

        Returns:
            How it has ended; what is known of the group is that of the last step.
        """
        if self.is_running:
            self._turn(Cue.CANCELLED, why=reason)
        ended = dataclasses.replace(
            self.guidance, state=self.state, reason=self._reason, speed=0.0, posts={}
        )
        return self._told(ended)

    def stop(self, reason: str) -> Guidance:
        """The robots stand until `release`.

        Args:
            reason: Who has stopped them, in words.
        """
        self._is_stopped = True
        self._turn(Cue.STOPPED, why=reason)
        return self._told(self._guidance({}))

    def release(self) -> Guidance:
        """The tour goes on with the next people."""
        self._is_stopped = False
        return self.halt(self._misfit or "waits for people after a stop")

    def halt(self, reason: str) -> Guidance:
        """The robots stand until the next step.

        Args:
            reason: Why, such as that people are outdated.
        """
        if self.is_running:
            self._halt(reason)
        return self._told(self._guidance({}))

    def _halt(self, reason: str) -> None:
        is_halted = self.state == State.HALTED
        self._turn(Cue.STILL_HALTED if is_halted else Cue.HALTS, why=reason)

    def _told(self, guidance: Guidance) -> Guidance:
        self.guidance = dataclasses.replace(guidance, events=())
        self._steering.take_posts(guidance.posts)
        return guidance

    # ---- outputs ----

    def velocities(self, now_ns: int) -> dict[str, Velocity]:
        """The velocity of each robot from now on, see `Steering.step`."""
        return self._steering.step(now_ns)

    def poses(self) -> dict[str, Pose]:
        """The newest pose of each robot; its stamp is no later than when it came."""
        return self._steering.poses()

    def goals(self, now_ns: int) -> dict[str, Post]:
        """Posts of the robots whose poses are not outdated."""
        timeout = self._config.safety.pose_timeout
        return {
            robot: post
            for robot, post in self.guidance.posts.items()
            if self._steering.pose_age_s(robot, now_ns) < timeout
        }

    def off_posts(self) -> dict[str, float]:
        """How far robots are from their posts [m]."""
        poses = self._steering.poses()
        return {
            robot: math.dist(post.xy, (poses[robot].x, poses[robot].y))
            for robot, post in self.guidance.posts.items()
            if robot in poses
        }

    # ---- a step ----

    def _step(
        self,
        people: Sequence[Person],
        groups: Sequence[Group],
        now_ns: int,
        scans: Collection[str],
    ) -> Guidance:
        """Where the robots are to go, by people of a time [ns]."""
        since_s = (now_ns - (self._now_ns or now_ns)) / 1e9
        dt_s = min(max(since_s, 0.0), self._group.tuning.longest_step_s)
        self._now_ns = now_ns
        posts: dict[str, Post] = {}
        known = {**dict.fromkeys(self._quarantined, _APART), **self.faults}
        guests = {one.id for one in self._group.guests}
        others = [person for person in people if person.id not in guests]
        self._team.take(self._steering.poses(), self._config, now_ns, known)
        self._sights.step(scans, people, self._team.robots, self._config, self.space, now_ns / 1e9)
        self._events += self._sights.events
        if not self._team.robots:
            faults = "; ".join(f"{name}: {why}" for name, why in self._team.faults.items())
            self._events += self._team.events
            self._halt(f"no robot takes part: {faults or 'none is there'}")
        else:
            if self.state == State.HALTED:
                self._events.append(GOES_ON)
            self._choose_leader()
            if self._phase == State.GATHERING:
                self._gather(people, groups, dt_s)
            else:
                self._group.leader_m = self._team.leader_m
                self._yields = yielding(others, self.tour.way, self._team.leader_m)
                self._group.step(people, groups, now_ns / 1e9, self._in_view)
                self._group.give_up(self._config.pace.patience)
                self._events += self._group.events
                self._go_on(dt_s)
            posts = self._posts() if self.state in RUNNING else {}
        is_to_go = self._pace.speed > 0.0 or self._overtakes
        held, self._steering.held = self._steering.held, frozenset()
        told = self._unhindered(posts, others) if is_to_go else {}
        self._team.watch({name: told[name] for name in told.keys() - held}, dt_s)
        return self._guidance(posts)

    def _unhindered(self, posts: Mapping[str, Post], others: Sequence[Person]) -> dict[str, Post]:
        """Posts of robots that do not stand for somebody who is not of the group."""
        robots = self._team.robots
        xy = np.array([person.position for person in others]).reshape(-1, 2)
        away = {
            name: np.hypot(*(xy - (robots[name].x, robots[name].y)).T).min(initial=math.inf)
            for name in posts
        }
        return {name: post for name, post in posts.items() if away[name] > self._tuning.near}

    def _guidance(self, posts: Mapping[str, Post]) -> Guidance:
        """What is told of the tour; events once."""
        group, events, way = self._group, tuple(self._events), self.tour.way
        self._events = []
        return Guidance(
            stamp_ns=self._now_ns,
            state=self.state,
            reason=self._reason,
            stop="" if self._stop is None else self._stop.name,
            way_m=float(np.clip(group.way_m, 0.0, way.length)),
            length_m=way.length,
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
        return self.tour.stops[self._next] if self._next < len(self.tour.stops) else None

    @property
    def _stop_m(self) -> float:
        """Where on the way the leader stands at the next stop [m]; the group is behind it."""
        end_m, stop = self.tour.way.length, self._stop
        return end_m if stop is None else min(stop.way_m + self._config.pace.lead, end_m)

    def _turn(self, cue: Cue, **words: object) -> None:
        """Changes the state as the table of `Cue` says."""
        turn = cue.value
        assert turn.phase in (None, self._phase)
        words |= {
            "tour": f"tour {self.tour.name}".rstrip(),
            "where": "the end" if self._stop is None else self._stop.name,
            "leader": self._team.leader,
            "patience": self._config.pace.patience,
        }
        self.state, self._reason = turn.state, turn.reason.format(**words)
        if turn.event:
            self._events.append(turn.event.format(**words))
        if turn.state in PHASES:
            self._phase = turn.state
        if not turn.walks:
            self._pace.stand()

    def _gather(self, people: Sequence[Person], groups: Sequence[Group], dt_s: float) -> None:
        """Waits until a group is there."""
        before, pose = len(self._group.guests), self._team.robots[self._team.leader]
        leader, now_s = np.array([pose.x, pose.y]), self._now_ns / 1e9
        self._group.gather(people, groups, leader, now_s, self._in_view)
        guests = self._group.guests
        if not guests:
            self._settled_s = 0.0
            self._turn(Cue.NOBODY_SEEN)
            return
        self._settled_s = self._settled_s + dt_s if len(guests) <= before else 0.0
        ways = np.array([one.way_m for one in guests])
        off = np.array([one.xy for one in guests]) - self.tour.way.at(ways)
        away, allowed = float(np.median(np.hypot(*off.T))), self._config.pace.max_stretch
        if away > allowed:
            self._turn(Cue.GROUP_AWAY, away=away, allowed=allowed)
        elif self._settled_s >= self._tuning.settled_s:
            self._turn(Cue.GROUP_SETTLED, people=_people(guests))
        else:
            self._turn(Cue.GROUP_SEEN, people=_people(guests))

    def _go_on(self, dt_s: float) -> None:
        """The tour has set off."""
        to_go = self._stop_m - self._team.leader_m
        waits = self._waits_for()
        if not self._group.guided:
            self._turn(Cue.NOBODY_LEFT)
        elif self._phase == State.AT_STOP:
            self._stay(waits, dt_s)
        elif self._overtakes:
            self._turn(Cue.OVERTAKES)
        elif not self._yields.share:
            self._turn(Cue.LETS_PASS)
        elif not waits and to_go <= self._tuning.there:
            self._close_up(dt_s)
        else:
            self._there_s, self._nearest_m = 0.0, math.inf
            if waits:
                self._turn(Cue.SOMEBODY_BEHIND, waits=waits)
            else:
                self._walk(to_go, dt_s)

    def _close_up(self, dt_s: float) -> None:
        """The leader is at a stop, or at the end, and waits for the others."""
        away, tuning, pace = self._away(), self._tuning, self._config.pace
        if away < self._nearest_m - tuning.nearer:
            self._nearest_m, self._there_s = away, 0.0
        self._there_s += dt_s
        if self._is_group_there():
            self._turn(Cue.ALL_THERE)
        elif self._there_s >= tuning.closes_up_s and away <= pace.max_stretch:
            self._turn(Cue.MOST_THERE, after=tuning.closes_up_s, away=away)
        elif self._there_s >= pace.patience:
            self._turn(Cue.NOT_COMING)
        else:
            self._turn(Cue.SOME_ON_THEIR_WAY)
        if self._phase == State.AT_STOP:
            self._there_s, self._nearest_m = 0.0, math.inf
            if self._stop is None:
                self._turn(Cue.AT_END)

    def _stay(self, waits: str, dt_s: float) -> None:
        """The group is at a stop."""
        assert self._stop is not None
        self._there_s += dt_s
        if self._there_s < self._stop.wait_s:
            self._turn(Cue.STAYS)
        elif waits:
            self._turn(Cue.STAYS_FOR_SOMEBODY, waits=waits)
        else:
            self._turn(Cue.STAYED)
            self._there_s, self._next = 0.0, self._next + 1

    def _walk(self, to_go: float, dt_s: float) -> None:
        """The leader goes as the group follows."""
        config, group = self._config.pace, self._group
        leader = self._team.robots[self._team.leader]
        speed = self._pace.step(
            config,
            highest=min(
                self._yields.share * (self.tour.speed or config.speed),
                self._tuning.brakes * to_go,
            ),
            gap=group.gap(self._team.leader_m, np.array([leader.x, leader.y])),
            stretch=group.stretch,
            dt_s=dt_s,
            off=self._companions_off_posts(),
        )
        if speed > 0.0:
            self._turn(Cue.FOLLOWS)
        elif self._pace.in_vain_s >= config.patience:
            self._turn(Cue.NOT_COMING)
        else:
            is_long = group.stretch > config.stretch
            self._turn(Cue.STRETCHED if is_long else Cue.FAR_BEHIND)

    def _companions_off_posts(self) -> float:
        """How far robots that could see somebody who is unseen are from their posts [m].

        It is the average of those that accompany the group.
        """
        if all(one.unseen_s <= self._tuning.unseen_s for one in self._group.guided):
            return 0.0
        off, robots = self.off_posts(), self._team.robots
        away = [
            off[name]
            for name, post in self.guidance.posts.items()
            if post.role in (Role.REAR, Role.SIDE) and name in robots
        ]
        return sum(away) / len(away) if away else 0.0

    def _waits_for(self) -> str:
        """Whom the group waits for, in words; empty: nobody."""
        behind = self._group.behind
        if not behind:
            return "" if self._group.together else "waits: nobody of the group is seen"
        return f"waits for {_people(behind)}"

    @property
    def _stop_xy(self) -> Float:
        """Where the group is to be next [m], shape (2,)."""
        return self.tour.way.at(self.tour.way.length if self._stop is None else self._stop.way_m)

    def _away(self) -> float:
        """How far the group's middle is from the next stop [m]."""
        xy = np.array([one.xy for one in self._group.together])
        return float(np.hypot(*(np.median(xy, axis=0) - self._stop_xy)))

    def _is_group_there(self) -> bool:
        """Whether everybody is at the next stop: near it, or near each other behind the leader."""
        xy = np.array([one.xy for one in self._group.together])
        gather, lead = self._config.pace.gather, self._config.pace.lead
        if (np.hypot(*(xy - self._stop_xy).T) <= gather).all():
            return True
        is_close = bool((np.hypot(*(xy - np.median(xy, axis=0)).T) <= gather).all())
        return is_close and self._away() <= gather + lead

    # ---- robots ----

    def _choose_leader(self) -> None:
        group = self._group
        front_m = group.front_m + self._config.pace.lead
        moving = self._phase == State.LEADING
        if self._team.lead(
            self._config.leader, self.tour.way, group.way_m, front_m, self._now_ns, moving=moving
        ):
            self._post_m = self._team.leader_m
            self._pace.stand()
            self._overtakes = self._phase != State.GATHERING and self._team.leader_m < group.way_m
        else:
            enough_m = min(group.front_m, self._stop_m - self._tuning.there)
            self._overtakes = self._overtakes and self._team.leader_m < enough_m
        self._events += self._team.events

    def _in_view(self, xy: Float) -> Bool:
        """Where nobody is unnoticed, shape (n,): robots look there, or the floor is not free."""
        people = np.array([one.xy for one in self._group.guided if one.followed]).reshape(-1, 2)
        robots = {n: pose for n, pose in self._team.robots.items() if n in self._sights.seeing}
        in_view = are_in_view(xy, people, robots, self._config, self.space)
        return np.asarray(in_view | (self.space.clearance(xy) < 0.0))

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
        posts = self._formation.step(
            Scenery(
                people=np.array([one.xy for one in there]),
                people_m=np.array([one.way_m for one in there]),
                straggler=None if fetched is None else there.index(fetched),
                leader=team.leader,
                leader_m=self._post_m,
                leader_left=-self._right(),
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
            front_m = group.front_m + self._config.pace.lead
            return min(front_m, max(self._stop_m, leader_m)), self._config.base.max_speed
        if speed > 0.0:
            post_m = min(leader_m + tuning.ahead + tuning.ahead_s * speed, self._stop_m)
            if self._turns_back(post_m):
                self._team.leader_m = post_m
                post_m = min(post_m + tuning.ahead, self._stop_m)
            return post_m, speed
        return min(self._post_m, leader_m + tuning.brake_m), self._config.pace.speed

    def _right(self) -> float:
        """How far to the right of the way the leader goes, where it is free [m]."""
        right = self._yields.right if self._phase == State.LEADING else 0.0
        least = self._config.safety.wall_distance + self._tuning.spare
        free = self.space.clearance(self.tour.way.at(self._post_m, -right)) >= least
        return right if free else 0.0

    def _turns_back(self, post_m: float) -> bool:
        """Whether the way turns back on itself between the leader and its next place."""
        pose = self._team.robots[self._team.leader]
        away = float(np.hypot(*(self.tour.way.at(post_m) - (pose.x, pose.y))))
        return away < self._tuning.folded * (post_m - self._team.leader_m)

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
