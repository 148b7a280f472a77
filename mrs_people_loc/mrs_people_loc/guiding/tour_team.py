"""Which robots take part in a tour, and which of them leads."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.guiding.guidance import Post, Role
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.team.poses import Pose, places_of


@dataclass(frozen=True)
class TeamTuning:
    """Constants of who takes part and who leads; chosen.

    Attributes:
        reach: A robot whose place on the way is not known yet is sought up to so far from the group
            [m]: first within the shorter ones, ...
        as_good: ... on the part of the way from which it is no farther than from any other by this
            [m].
        fastest: A robot drives no faster than this along the way [m/s]: it is sought within what
            it may have driven, ...
        slack: ... and this [m].
        step: Its direction is looked at after so much of its way [m]; ...
        beside: ... the part of the way that it changes to is no farther from it than the one before
            by this [m].
        moved: A robot has moved if it is so far from where it was [m], ...
        turned: ... or has turned by so much [rad].
        away: Farther from its post than this, a robot has to move [m]: ...
        stuck_s: ... a leader that has not for so long is at fault [s],
        pause_s: ... and takes no part for so long, unless it moves [s].
    """

    reach: tuple[float, ...] = (2.0, 5.0, 12.0)
    as_good: float = 0.5
    fastest: float = 1.6
    slack: float = 1.0
    step: float = 0.1
    beside: float = 0.1
    moved: float = 0.15
    turned: float = 0.3
    away: float = 0.5
    stuck_s: float = 8.0
    pause_s: float = 20.0


TEAM_TUNING = TeamTuning()


@dataclass
class _Motion:
    """Whether a robot does what it is told.

    Attributes:
        pose: Where it was when it moved last.
        still_s: For how long it was told to drive since, and did not [s].
        fault_s: For how long it takes no part for that [s]; None: it takes part.
        has_failed: Whether it did, and has not moved since.
    """

    pose: Pose
    still_s: float = 0.0
    fault_s: float | None = None
    has_failed: bool = False


@dataclass(frozen=True)
class _Place:
    """Where a robot is along the way.

    Attributes:
        way_m: [m].
        xy: Where it was when its direction was looked at last [m], shape (2,).
    """

    way_m: float
    xy: Float

    def after(self, xy: Float, way: Way, reach: float, tuning: TeamTuning) -> _Place:
        """When the robot is elsewhere, by no more than so far along the way [m].

        Where the way turns back on itself, a robot that drives against it is on its next part.
        """
        (way_m,) = way.nearest(xy[None], self.way_m, reach).tolist()
        moved = xy - self.xy
        if np.hypot(*moved) < tuning.step:
            return _Place(way_m, self.xy)
        if float(way.ahead(way_m) @ moved) < 0.0:
            (onward,) = way.nearest(xy[None], way_m + reach, reach).tolist()
            off, here = (float(np.hypot(*(way.at(m) - xy))) for m in (onward, way_m))
            if off <= here + tuning.beside and float(way.ahead(onward) @ moved) > 0.0:
                way_m = onward
        return _Place(way_m, xy)


class TourTeam:
    """The robots of a tour.

    Args:
        tuning: Constants.

    Attributes:
        robots: Poses of those that take part, by name.
        faults: Why the others do not, by name.
        leader: Name of the one that leads; empty: none takes part.
        events: What has happened in the last step.
    """

    def __init__(self, tuning: TeamTuning = TEAM_TUNING) -> None:
        self._tuning = tuning
        self.robots: dict[str, Pose] = {}
        self.faults: dict[str, str] = {}
        self.leader = ""
        self.events: list[str] = []
        self._places: dict[str, _Place] = {}
        self._placed_ns = 0
        self._motions: dict[str, _Motion] = {}

    @property
    def leader_m(self) -> float:
        """How far along the way the leader is [m]; may be set, within a step's reach."""
        place = self._places.get(self.leader)
        return 0.0 if place is None else place.way_m

    @leader_m.setter
    def leader_m(self, way_m: float) -> None:
        self._places[self.leader] = dataclasses.replace(self._places[self.leader], way_m=way_m)

    def take(
        self,
        poses: Mapping[str, Pose],
        config: cfg.GuideConfig,
        now_ns: int,
        known: Mapping[str, str],
    ) -> None:
        """Takes poses: a robot whose pose is outdated, or that does not move, takes no part.

        Args:
            poses: The newest of each robot.
            config: Names and timeout.
            now_ns: Time [ns].
            known: Why other robots take no part, by name.
        """
        self.events = []
        timeout = config.safety.robot_timeout
        names = config.robots or tuple(sorted({*poses, *self.robots, *self.faults}))
        robots, faults = {}, {}
        for name in names:
            pose = poses.get(name)
            age_s = math.inf if pose is None else (now_ns - pose.stamp_ns) / 1e9
            fault = "no pose" if pose is None else known.get(name, "")
            if age_s > timeout and pose is not None:
                fault = f"pose is {age_s:.1f} s old"
            elif pose is not None and self._stands_still(name, pose):
                fault = f"is told to drive, but has not moved for {self._tuning.stuck_s:g} s"
            if fault or pose is None:
                faults[name] = fault
                if name not in self.faults:
                    self.events.append(f"{name} takes no part: {fault}")
            else:
                robots[name] = pose
                if name in self.faults:
                    self.events.append(f"{name} takes part again")
        self.robots, self.faults = robots, faults

    def _stands_still(self, name: str, pose: Pose) -> bool:
        """Whether a robot takes no part since it does not move."""
        motion = self._motions.setdefault(name, _Motion(pose))
        before = motion.pose
        moved = math.hypot(pose.x - before.x, pose.y - before.y) >= self._tuning.moved
        if moved or abs(wrap_angle(pose.yaw - before.yaw)) >= self._tuning.turned:
            self._motions[name] = _Motion(pose)
            return False
        return motion.fault_s is not None

    def watch(self, posts: Mapping[str, Post], dt_s: float) -> None:
        """Watches whether robots do what they are told.

        The leader, whose way nobody blocks as a rule, is at fault if it does not move. The others
        may have to stand for people; they are so only if they failed before, and have not moved
        since.

        Args:
            posts: Where those are to go that are told to drive; for the others no time counts.
            dt_s: Time since the last interval [s].
        """
        tuning = self._tuning
        for name, motion in self._motions.items():
            if motion.fault_s is not None:
                motion.fault_s += dt_s
                if motion.fault_s >= tuning.pause_s:
                    motion.fault_s, motion.still_s = None, 0.0
            elif name in posts and name in self.robots:
                post, pose = posts[name], self.robots[name]
                away = math.dist(post.xy, (pose.x, pose.y))
                counts = post.role == Role.LEADER or motion.has_failed
                told = counts and post.speed > 0.0 and away > tuning.away
                motion.still_s = motion.still_s + dt_s if told else 0.0
                if motion.still_s >= tuning.stuck_s:
                    motion.fault_s, motion.has_failed = 0.0, True

    def _place(self, way: Way, group_m: float, now_ns: int) -> dict[str, float]:
        """How far along the way the robots are [m]; each stays on its part of the way."""
        tuning = self._tuning
        reach = tuning.slack + tuning.fastest * max(now_ns - self._placed_ns, 0) / 1e9
        before, self._placed_ns = self._places, now_ns
        self._places = {}
        for name, pose in self.robots.items():
            xy, place = np.array([pose.x, pose.y]), before.get(name)
            if place is None or reach >= tuning.reach[-1]:
                self._places[name] = _Place(_first_place(way, xy, max(group_m, 0.0), tuning), xy)
            else:
                self._places[name] = place.after(xy, way, reach, tuning)
        return {name: place.way_m for name, place in self._places.items()}

    def lead(
        self, named: str, way: Way, group_m: float, front_m: float, now_ns: int, *, moving: bool
    ) -> bool:
        """Chooses the leader.

        The first one is the foremost along the way. It stays while it takes part; the next one is
        the robot that is nearest to the front. While that one is still behind the group, a robot in
        front leads instead: one that was silent for a moment only. A robot that is to lead takes
        the lead as soon as it is not behind the group.

        Args:
            named: Name of the robot that is to lead; empty: any.
            way: Of the tour.
            group_m: How far along the way the group is [m].
            front_m: Where the leader's place is [m].
            now_ns: Time [ns].
            moving: Whether the group walks.

        Returns:
            Whether it is another one than before.
        """
        there = self._place(way, group_m, now_ns)
        names, ways = list(there), np.array(list(there.values()))
        xy = places_of(self.robots.values())
        before = self.leader
        if before not in there:
            off = -ways if not before else np.hypot(*(xy - way.at(front_m)).T)
            self.leader = names[int(off.argmin())]
        able = {name for name in names if not self._motions[name].has_failed}
        if moving and there[self.leader] < group_m:
            in_front = [name for name in able if there[name] >= group_m]
            self.leader = max(in_front, key=lambda name: (there[name], name), default=self.leader)
        if named in able and (not moving or there[named] >= group_m):
            self.leader = named
        if self.leader != before:
            self.events.append(f"{self.leader} leads")
        return self.leader != before


def _first_place(way: Way, xy: Float, group_m: float, tuning: TeamTuning) -> float:
    """How far along the way a robot is that has not been there before [m]."""
    found = [float(way.nearest(xy[None], group_m, reach)[0]) for reach in tuning.reach]
    away = [float(np.hypot(*(way.at(way_m) - xy))) for way_m in found]
    return next(m for m, off in zip(found, away, strict=True) if off <= min(away) + tuning.as_good)
