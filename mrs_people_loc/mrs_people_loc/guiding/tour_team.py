"""Which robots take part in a tour, and which of them leads."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.team.poses import Pose

#: The robots are sought this far along the way from where the group is [m].
_REACH = 12.0


class TourTeam:
    """The robots of a tour.

    Attributes:
        robots: Poses of those that take part, by name.
        faults: Why the others do not, by name.
        leader: Name of the one that leads; empty: none takes part.
        leader_m: How far along the way it is [m].
        events: What has happened in the last step.
    """

    def __init__(self) -> None:
        self.robots: dict[str, Pose] = {}
        self.faults: dict[str, str] = {}
        self.leader = ""
        self.leader_m = 0.0
        self.events: list[str] = []

    def take(self, poses: Mapping[str, Pose], config: cfg.GuideConfig, now_ns: int) -> None:
        """Takes poses: a robot whose pose is outdated takes no part.

        Args:
            poses: The newest of each robot.
            config: Names and timeout.
            now_ns: Time [ns].
        """
        self.events = []
        timeout = config.safety.robot_timeout
        names = config.robots or tuple(sorted({*poses, *self.robots, *self.faults}))
        robots, faults = {}, {}
        for name in names:
            pose = poses.get(name)
            age_s = math.inf if pose is None else (now_ns - pose.stamp_ns) / 1e9
            if pose is not None and age_s <= timeout:
                robots[name] = pose
                if name in self.faults:
                    self.events.append(f"{name} takes part again")
            else:
                faults[name] = "no pose" if pose is None else f"pose is {age_s:.1f} s old"
                if name not in self.faults:
                    self.events.append(f"{name} takes no part: {faults[name]}")
        self.robots, self.faults = robots, faults

    def lead(self, named: str, way: Way, group_m: float, front_m: float, *, moving: bool) -> bool:
        """Chooses the leader.

        The first one is the foremost along the way. It stays while it takes part; the next one is
        the robot that is nearest to the front. A robot that is to lead takes the lead as soon as it
        is not behind the group.

        Args:
            named: Name of the robot that is to lead; empty: any.
            way: Of the tour.
            group_m: How far along the way the group is [m].
            front_m: Where the leader's place is [m].
            moving: Whether the group walks.

        Returns:
            Whether it is another one than before.
        """
        names = list(self.robots)
        xy = np.array([(pose.x, pose.y) for pose in self.robots.values()])
        ways = way.nearest(xy, max(group_m, 0.0), _REACH)
        before, there = self.leader, dict(zip(names, ways.tolist(), strict=True))
        if before not in there:
            off = -ways if not before else np.hypot(*(xy - way.at(front_m)).T)
            self.leader = names[int(off.argmin())]
        if named in there and (not moving or there[named] >= group_m):
            self.leader = named
        self.leader_m = there[self.leader]
        if self.leader != before:
            self.events.append(f"{self.leader} leads")
        return self.leader != before
