"""Parameters of the guide: from people and poses to where the robots drive."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from mrs_people_loc.config.parameters import Section, check_robots, field
from mrs_people_loc.config.planner import PEOPLE_TOPICS
from mrs_people_loc.errors import ConfigError


@dataclass(frozen=True)
class Pace(Section):
    """How fast the leader goes, and whom it waits for."""

    speed: float = field(0.6, "highest speed of the leader [m/s]", low=0.05, high=2.0)
    lead: float = field(
        1.6, "distance of the leader ahead of the foremost person [m]", low=0.6, high=5.0
    )
    stretch: float = field(
        4.0, "the leader slows down while the group is longer than this along the way [m]",
        low=1.0, high=20.0,
    )  # fmt: skip
    max_stretch: float = field(
        6.0, "... and waits while it is longer than this [m]", low=1.0, high=30.0
    )
    gather: float = field(
        3.0, "the group is at a stop once everybody is within this distance of it, or of the "
        "group's middle where that is no farther off than this and `lead` [m]",
        low=1.0, high=10.0,
    )  # fmt: skip
    patience: float = field(
        60.0,
        "the tour goes on without a straggler after this time, and ends if the whole group "
        "has not come along for this time [s]",
        low=1.0,
        high=3600.0,
    )

    def _check_relations(self) -> None:
        if self.stretch > self.max_stretch:
            raise ConfigError(
                f"pace.stretch is {self.stretch:g}; "
                f"allowed: at most pace.max_stretch, {self.max_stretch:g}"
            )


@dataclass(frozen=True)
class Formation(Section):
    """Where robots go around the group."""

    distance: float = field(
        1.3, "smallest distance of a robot on its post from people [m]", low=0.5, high=5.0
    )
    reach: float = field(4.5, "people are seen up to this distance [m]", low=1.0, high=20.0)
    nearest: float = field(1.0, "... and from this distance on [m]", low=0.1, high=5.0)
    view: float = field(1.2, "horizontal field of view of the heads [rad]", low=0.2, high=6.3)
    hysteresis: float = field(
        0.08, "a robot changes its post only where the team sees more by this share",
        low=0.0, high=1.0,
    )  # fmt: skip
    hold: float = field(1.5, "... and not sooner than after this time [s]", low=0.0, high=60.0)

    def _check_relations(self) -> None:
        if self.nearest >= self.reach:
            raise ConfigError(
                f"formation.nearest is {self.nearest:g}; "
                f"allowed: less than formation.reach, {self.reach:g}"
            )


@dataclass(frozen=True)
class Safety(Section):
    """When robots stand, and what they avoid."""

    people_timeout: float = field(
        0.5, "robots stand when no people have come for this time: they are never faster than "
        "they can stop by then [s]",
        low=0.1, high=5.0,
    )  # fmt: skip
    pose_timeout: float = field(
        0.5, "a robot stands while its pose is older than this; it is never faster than it can "
        "stop by then [s]",
        low=0.05, high=5.0,
    )  # fmt: skip
    robot_timeout: float = field(
        1.0, "a robot whose pose is older than this takes no part, until it is back [s]",
        low=0.2, high=60.0,
    )  # fmt: skip
    person_distance: float = field(
        0.6, "robots do not drive nearer to people, from centre to centre [m]", low=0.3, high=3.0
    )
    robot_distance: float = field(0.6, "... nor to each other [m]", low=0.2, high=3.0)
    wall_distance: float = field(
        0.35, "... nor, from their centre, to walls and furniture [m]", low=0.1, high=3.0
    )
    monitored: bool = field(
        False, "true: a tour of a robot without a collision monitor, which takes its "
        "cmd_vel_guide, is refused",
    )  # fmt: skip
    occupied_from: int = field(
        65, "cells of the grid on `map` from this value on are walls or furniture [%]",
        low=1, high=100,
    )  # fmt: skip


@dataclass(frozen=True)
class Base(Section):
    """What the bases can do, for robots that are driven by `cmd_vel`."""

    stamped: bool = field(
        False, "true: cmd_vel is geometry_msgs/TwistStamped; false: Twist", live=False
    )
    max_speed: float = field(0.8, "highest speed ahead [m/s]", low=0.05, high=3.0)
    max_reverse: float = field(0.6, "highest speed backwards; 0: never [m/s]", low=0.0, high=3.0)
    max_turn: float = field(1.5, "highest rate of turn [rad/s]", low=0.1, high=6.3)
    acceleration: float = field(0.8, "highest acceleration [m/s^2]", low=0.1, high=5.0)
    deceleration: float = field(2.0, "highest deceleration [m/s^2]", low=0.1, high=10.0)
    turn_acceleration: float = field(
        3.0, "highest change of the rate of turn [rad/s^2]", low=0.2, high=20.0
    )


@dataclass(frozen=True)
class GuideConfig(Section):
    """All parameters of the guide."""

    robots: tuple[str, ...] = field(
        (), "names (namespaces) of the robots of the tour; empty: those whose scans the planner "
        "uses when the tour starts",
    )  # fmt: skip
    leader: str = field("", "name of the robot that leads; empty: the foremost one along the way")
    looks_back: tuple[str, ...] = field(
        (), "names of the robots whose head looks back over base_link"
    )
    map_frame: str = field("map", "the common frame", live=False)
    people_topic: str = field(
        PEOPLE_TOPICS[0], "name of the topic with the planner's people: as the planner's "
        "people_topic",
        choices=PEOPLE_TOPICS, live=False,
    )  # fmt: skip
    drive: str = field(
        "cmd_vel", "how robots are driven: cmd_vel: by velocities from here; nav2: by goals for "
        "Nav2",
        choices=("cmd_vel", "nav2"), live=False,
    )  # fmt: skip
    pace: Pace = dataclasses.field(default_factory=Pace)
    formation: Formation = dataclasses.field(default_factory=Formation)
    safety: Safety = dataclasses.field(default_factory=Safety)
    base: Base = dataclasses.field(default_factory=Base)

    def _check_relations(self) -> None:
        check_robots("robots", self.robots)
        check_robots("looks_back", self.looks_back)
        if self.leader:
            check_robots("leader", (self.leader,))
        for parameter, names in (("leader", (self.leader,)), ("looks_back", self.looks_back)):
            for name in filter(None, names):
                if self.robots and name not in self.robots:
                    raise ConfigError(
                        f"{parameter} has {name!r}; allowed: those of `robots`, "
                        f"{', '.join(self.robots)}"
                    )
