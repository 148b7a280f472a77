"""Parameters of the planner: from the robots' scans to people."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass

from mrs_people_loc.config.parameters import Section, field
from mrs_people_loc.errors import ConfigError


@dataclass(frozen=True)
class Interval(Section):
    """When an interval closes."""

    max_wait: float = field(
        0.1, "after the first scan the others have this long [s]", low=0.0, high=5.0
    )
    max_scan_age: float = field(
        0.25, "a scan that is older than the newest by more is left out [s]", low=0.0, high=5.0
    )
    max_pose_age: float = field(
        0.25, "a scan is placed with poses no farther from its stamp than this [s]",
        low=0.0, high=5.0,
    )  # fmt: skip
    robot_timeout: float = field(
        2.0,
        "a robot that is silent for longer is not waited for, and what is seen where it "
        "was is not taken for it [s]",
        low=0.1,
        high=60.0,
    )
    max_clock_offset: float = field(
        0.2, "a robot whose clock differs by more from that of the robot nearest to the planner's "
        "clock is left out [s]",
        low=0.001, high=5.0,
    )  # fmt: skip
    scan_rate: float = field(
        0.0, "scans expected of each robot per second, of which half are enough; 0: as many as the "
        "fastest delivers [Hz]",
        low=0.0, high=1000.0,
    )  # fmt: skip
    walking_speed: float = field(
        0.7, "a scan older than the interval's newest is less sure of where people are, by so much "
        "per second [m/s]; 0: it is not",
        low=0.0, high=5.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Clustering(Section):
    """Clustering based segmentation (eqs. 8-10)."""

    distance: float = field(
        0.15, "points within this distance belong together: d_th [m]", low=0.01, high=2.0
    )


@dataclass(frozen=True)
class Splitting(Section):
    """How clusters that are more than one person are told apart."""

    max_width: float = field(
        0.75, "a cluster that is wider than this is split into parts that are not [m]; 0: none is",
        low=0.0, high=5.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Human(Section):
    """Size of a human, as a cluster shows it. The paper says 'a priori' and prints no values.

    Heights: from a school child to a tall man; a table's edge or a chair's back is lower, a wall or
    a door higher. Width and depth: a body is 0.3 to 0.6 m; depth noise of 1/16 px and more smears
    its cells along the line of sight. Points: of a body 5 m away the zone covers about 12 x 25
    pixels of a 160 x 120 image (block matching widens it), of which half may be lost.
    """

    min_height: float = field(1.2, "least height of the cluster's top [m]", low=0.0, high=3.0)
    max_height: float = field(2.2, "greatest height of the cluster's top [m]", low=0.0, high=10.0)
    min_width: float = field(0.20, "least extent along the long side [m]", low=0.0, high=5.0)
    max_width: float = field(1.3, "greatest extent along the long side [m]", low=0.0, high=10.0)
    max_depth: float = field(0.9, "greatest extent along the short side [m]", low=0.0, high=10.0)
    min_points: int = field(150, "least number of 3D points in its cells", low=1, high=1_000_000)
    circle_sigmas: float = field(
        3.0, "radius of the drawn circle, in sigmas of the cluster", low=0.0, high=10.0
    )

    def _check_relations(self) -> None:
        for low, high in (("min_height", "max_height"), ("min_width", "max_width")):
            if getattr(self, low) > getattr(self, high):
                raise ConfigError(
                    f"human.{low} is {getattr(self, low):g}; "
                    f"allowed: at most human.{high}, {getattr(self, high):g}"
                )


@dataclass(frozen=True)
class Joining(Section):
    """How the bodies that several robots found become people."""

    line_of_sight: bool = field(
        True, "true: a body's place is less sure along the line of sight than across it; false: it "
        "is equally sure in all directions"
    )  # fmt: skip
    gate: float = field(
        3.0, "bodies of different robots within so many sigmas are one", low=0.1, high=10.0
    )
    max_distance: float = field(0.7, "... and within this distance [m]", low=0.05, high=5.0)
    min_score: float = field(0.5, "log-odds from which a body is a person", low=-20.0, high=50.0)
    apart: float = field(0.36, "two people are no closer than this [m]", low=0.0, high=2.0)
    fragment_gate: float = field(
        5.0, "a body within so many sigmas of a likelier person whom its robots did not see is "
        "that person; 0: none is",
        low=0.0, high=20.0,
    )  # fmt: skip
    fragment_distance: float = field(1.0, "... and within this distance [m]", low=0.0, high=5.0)


@dataclass(frozen=True)
class Masking(Section):
    """What stands at known places and is no person: robots of the team, walls, furniture."""

    robot_radius: float = field(
        0.25, "what is within this of another robot of the team is that robot [m]; 0: robots are "
        "not told from people",
        low=0.0, high=2.0,
    )  # fmt: skip
    cell_range_sigma: float = field(
        0.25 / 10.5, "standard deviation of the range r of a plain cell, over r^2 [m/m^2]: the "
        "error of disparity [px] over focal length times baseline [px m]; the default is 0.25 px "
        "over 10.5 px m",
        low=0.0, high=1.0,
    )  # fmt: skip
    occupancy_grid: bool = field(
        False, "true: the nav_msgs/OccupancyGrid on `map` says where walls and furniture are; "
        "false: nothing does",
        live=False,
    )  # fmt: skip
    occupied_from: int = field(
        65, "cells of the grid from this value on are occupied [%]", low=1, high=100
    )
    wall_margin: float = field(
        0.15, "nobody's axis is nearer to walls and furniture than this [m]", low=0.0, high=1.0
    )
    wall_score: float = field(
        5.0, "log-odds of being a person that a body in a wall or in furniture loses, at most",
        low=0.0, high=50.0,
    )  # fmt: skip
    beside_score: float = field(
        1.5, "log-odds that a body beside a wall or furniture gains, at most", low=0.0, high=50.0
    )


@dataclass(frozen=True)
class Tracking(Section):
    """How people are followed from interval to interval."""

    enabled: bool = field(
        True, "true: people have ids, velocities and a past; false: each interval stands for "
        "itself, as in the paper"
    )  # fmt: skip
    acceleration: float = field(
        0.5, "people change their velocity by about this much in a second, and by the square root "
        "of n times it in n seconds [m/s]",
        low=0.01, high=10.0,
    )  # fmt: skip
    any_velocity: float = field(
        0.8, "standard deviation of the velocity of somebody new: people stand or walk [m/s]",
        low=0.01, high=10.0,
    )  # fmt: skip
    max_speed: float = field(
        2.0, "nobody walks faster while he is not seen [m/s]", low=0.1, high=20.0
    )
    gate: float = field(
        4.0, "what is found within so many sigmas of where somebody is expected may be him",
        low=0.5, high=20.0,
    )  # fmt: skip
    max_distance: float = field(1.0, "... and within this distance [m]", low=0.1, high=10.0)
    body: float = field(
        0.3, "... or within this, however sure both are: no two bodies are so close [m]",
        low=0.0, high=2.0,
    )  # fmt: skip
    height_sigma: float = field(
        0.15, "standard deviation of the difference of two heights of one person [m]",
        low=0.01, high=10.0,
    )  # fmt: skip
    evidence_time: float = field(
        0.5,
        "log-odds of being a person, height and uncertainty are means over about so long [s]",
        low=0.01,
        high=60.0,
    )
    sure_score: float = field(
        6.0, "log-odds from which somebody new is a person at once", low=-20.0, high=8.0
    )
    birth_score: float = field(
        1.0, "... and from which somebody is a person who is followed for tracking.birth_time",
        low=-20.0, high=8.0,
    )  # fmt: skip
    birth_time: float = field(0.2, "see tracking.birth_score [s]", low=0.0, high=10.0)
    start_time: float = field(
        0.35,
        "in the beginning, for so long, whoever is found and is no doubt is a person [s]",
        low=0.0,
        high=60.0,
    )
    doubt_score: float = field(
        0.0, "log-odds from which somebody new is followed, as no person yet", low=-20.0, high=50.0
    )
    doubt_time: float = field(
        0.25, "who is no person yet is given up when unseen for longer [s]", low=0.0, high=10.0
    )
    expected_score: float = field(
        1.0, "log-odds that what is found gains where a person is expected", low=0.0, high=50.0
    )
    expected_points: float = field(
        0.5, "where a person is expected a plain cluster needs this share of human.min_points",
        low=0.0, high=1.0,
    )  # fmt: skip
    keep_score: float = field(
        -1.0, "who is a person stays one down to these log-odds", low=-20.0, high=8.0
    )
    coast_time: float = field(
        1.0, "a person who is not seen is given up after this [s]", low=0.0, high=60.0
    )
    coast_share: float = field(
        0.5, "... and after this share of the time for which he was seen", low=0.0, high=1e3
    )
    memory: float = field(
        10.0, "who was given up, and is found again where he may have got to, has his id again, "
        "for so long after he was seen, and no longer than he was seen [s]; 0: nobody has",
        low=0.0, high=600.0,
    )  # fmt: skip
    lasting_share: float = field(
        0.25, "share of the variance of what is found that stays the same from interval to "
        "interval, so that following makes nobody's place surer than this",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_tracks: int = field(
        1000, "no more people than this are followed at a time", low=1, high=10_000
    )


@dataclass(frozen=True)
class Groups(Section):
    """Who walks together, and who has fallen behind or left."""

    distance: float = field(
        2.5, "a member who is farther than this from every other one is a straggler [m]",
        low=0.3, high=100.0,
    )  # fmt: skip
    margin: float = field(
        0.4,
        "who comes to a group, or back to it, is nearer than groups.distance by this [m]",
        low=0.0,
        high=100.0,
    )
    speed: float = field(
        0.8, "... and walks with it: velocities differ by no more than this [m/s]",
        low=0.0, high=20.0,
    )  # fmt: skip
    hidden_sigmas: float = field(
        2.0, "who is hidden may be nearer than he is expected, by so many sigmas",
        low=0.0, high=20.0,
    )  # fmt: skip
    leave_time: float = field(0.5, "a straggler is farther for so long [s]", low=0.0, high=60.0)
    join_time: float = field(
        2.0, "who comes to a group, or back to it, is near for so long [s]", low=0.0, high=60.0
    )
    missing_time: float = field(
        6.0, "a member who has been given up for so long is a straggler, too [s]; less than "
        "tracking.memory, so that he can come back",
        low=0.0, high=600.0,
    )  # fmt: skip
    forget_time: float = field(
        60.0, "who has been a straggler for so long is no member any more [s]",
        low=0.0, high=3600.0,
    )  # fmt: skip


@dataclass(frozen=True)
class PlannerConfig(Section):
    """Configuration of the planner: from the robots' scans to people."""

    robots: tuple[str, ...] = field(
        (), "names (namespaces) of the robots; empty: discovered as they appear", live=False
    )
    map_frame: str = field("map", "the common frame", live=False)
    interval: Interval = dataclasses.field(default_factory=Interval)
    masking: Masking = dataclasses.field(default_factory=Masking)
    joining: Joining = dataclasses.field(default_factory=Joining)
    clustering: Clustering = dataclasses.field(default_factory=Clustering)
    splitting: Splitting = dataclasses.field(default_factory=Splitting)
    human: Human = dataclasses.field(default_factory=Human)
    tracking: Tracking = dataclasses.field(default_factory=Tracking)
    groups: Groups = dataclasses.field(default_factory=Groups)

    def memoryless(self) -> PlannerConfig:
        """The same, but every interval stands for itself."""
        return dataclasses.replace(self, tracking=dataclasses.replace(self.tracking, enabled=False))

    def _check_relations(self) -> None:
        for name in self.robots:
            if not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name):
                raise ConfigError(
                    f"robots has {name!r}; allowed: ROS namespaces without a leading slash"
                )
        if len(set(self.robots)) < len(self.robots):
            name = next(name for name in self.robots if self.robots.count(name) > 1)
            raise ConfigError(f"robots names {name} more than once; allowed: each robot once")
