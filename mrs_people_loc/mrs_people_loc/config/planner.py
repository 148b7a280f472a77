"""Parameters of the planner: from the robots' scans to people."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from mrs_people_loc.anthropometry import APART, APART_ACROSS
from mrs_people_loc.config.parameters import Section, check_robots, field
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.precision import PIXEL_SIGMA_PX

#: Names that the topic of mrs_people_msgs/People may have, the default first. The second is the old
#: one, which elsewhere belongs to people_msgs/People.
PEOPLE_TOPICS = ("tracked_people", "people")


@dataclass(frozen=True)
class Interval(Section):
    """When an interval closes."""

    max_wait: float = field(
        0.1, "maximum waiting time for the other scans after the first one [s]", low=0.0, high=5.0
    )
    max_scan_age: float = field(
        0.25, "a scan that is older than the newest one by more is dropped [s]", low=0.0, high=5.0
    )
    max_pose_age: float = field(
        0.25, "maximum time between a scan and the poses that locate it [s]", low=0.0, high=5.0
    )
    robot_timeout: float = field(
        2.0, "no interval waits for a robot that is silent for longer, and its last position is "
        "no longer masked [s]",
        low=0.1, high=60.0,
    )  # fmt: skip
    max_clock_offset: float = field(
        0.2, "a robot whose clock differs by more from that of the robot nearest to the planner's "
        "clock is excluded [s]",
        low=0.001, high=5.0,
    )  # fmt: skip
    scan_rate: float = field(
        0.0, "expected rate of scans per robot, of which half is sufficient; 0: the rate of the "
        "fastest robot [Hz]",
        low=0.0, high=1000.0,
    )  # fmt: skip
    walking_speed: float = field(
        0.7, "growth of the position uncertainty of a scan with its age relative to the newest "
        "scan of the interval [m/s]",
        low=0.0, high=5.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Clustering(Section):
    """Clustering based segmentation (eqs. 8-10)."""

    distance: float = field(
        0.15, "points within this distance belong to one cluster: d_th [m]", low=0.01, high=2.0
    )


@dataclass(frozen=True)
class Splitting(Section):
    """Splitting of clusters that are more than one person."""

    max_width: float = field(
        0.75, "a cluster wider than this is split into parts that are not [m]; 0: no splitting",
        low=0.0, high=5.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Human(Section):
    """Size of a human, as a cluster shows it. The paper has it 'a priori' and prints no values.

    Heights: from a school child to a tall adult; a table's edge or a chair's back is lower, a wall
    or a door higher. Width and depth: those of a body (`anthropometry`), smeared along the line of
    sight by depth noise of 1/16 px and more. Points: of a body 5 m away the zone covers about
    12 x 25 pixels of a 160 x 120 image (block matching widens it), of which half may be lost.
    """

    min_height: float = field(1.2, "minimum height of the cluster's top [m]", low=0.0, high=3.0)
    max_height: float = field(2.2, "maximum height of the cluster's top [m]", low=0.0, high=10.0)
    min_width: float = field(0.20, "minimum extent along the long side [m]", low=0.0, high=5.0)
    max_width: float = field(1.3, "maximum extent along the long side [m]", low=0.0, high=10.0)
    max_depth: float = field(0.9, "maximum extent along the short side [m]", low=0.0, high=10.0)
    min_points: int = field(150, "minimum number of 3D points in its cells", low=1, high=1_000_000)
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
    """Joining of bodies that several robots found to people."""

    line_of_sight: bool = field(
        True, "true: the position covariance of a body is elongated along the line of sight; "
        "false: it is isotropic",
    )  # fmt: skip
    gate: float = field(
        3.0, "bodies of different robots within this number of sigmas are one", low=0.1, high=10.0
    )
    max_distance: float = field(0.7, "... and within this distance [m]", low=0.05, high=5.0)
    min_score: float = field(0.5, "log-odds from which a body is a person", low=-20.0, high=50.0)
    apart: float = field(APART, "minimum distance of two people [m]", low=0.0, high=2.0)
    fragment_gate: float = field(
        5.0, "a body within this number of sigmas of a likelier person, whom its robots did not "
        "see, belongs to that person; 0: off",
        low=0.0, high=20.0,
    )  # fmt: skip
    fragment_distance: float = field(1.0, "... and within this distance [m]", low=0.0, high=5.0)


@dataclass(frozen=True)
class Masking(Section):
    """Masking of the team's robots, walls and furniture, which stand at known places."""

    robot_radius: float = field(
        0.25, "detections within this distance of another robot of the team are that robot [m]; "
        "0: robots are not masked",
        low=0.0, high=2.0,
    )  # fmt: skip
    cell_range_sigma: float = field(
        PIXEL_SIGMA_PX / 10.5,
        "standard deviation of the range r of a plain cell, over r^2 [m/m^2]: the "
        "error of disparity [px] over focal length times baseline [px m]; the default is 0.25 px "
        "over 10.5 px m",
        low=0.0, high=1.0,
    )  # fmt: skip
    occupancy_grid: bool = field(
        False, "true: walls and furniture are masked by the nav_msgs/OccupancyGrid on `map`",
        live=False,
    )  # fmt: skip
    occupied_from: int = field(
        65, "cells of the grid from this value on are occupied [%]", low=1, high=100
    )
    wall_margin: float = field(
        0.15, "minimum distance of a person's axis from walls and furniture [m]", low=0.0, high=1.0
    )
    wall_score: float = field(
        5.0, "maximum log-odds that a body in a wall or in furniture loses", low=0.0, high=50.0
    )
    beside_score: float = field(
        1.5, "maximum log-odds that a body beside a wall or furniture gains", low=0.0, high=50.0
    )


@dataclass(frozen=True)
class Tracking(Section):
    """Tracking of people over intervals."""

    enabled: bool = field(
        True, "true: people are tracked, with ids and velocities; false: intervals are "
        "independent, as in the paper",
    )  # fmt: skip
    acceleration: float = field(
        0.5, "standard deviation of the change of velocity in one second; it grows with the "
        "square root of time [m/s]",
        low=0.01, high=10.0,
    )  # fmt: skip
    any_velocity: float = field(
        0.8, "standard deviation of the velocity of a new track: people stand or walk [m/s]",
        low=0.01, high=10.0,
    )  # fmt: skip
    max_speed: float = field(2.0, "maximum speed of unobserved people [m/s]", low=0.1, high=20.0)
    gate: float = field(
        4.0, "detections within this number of sigmas of a predicted position may be assigned to "
        "it",
        low=0.5, high=20.0,
    )  # fmt: skip
    max_distance: float = field(1.0, "... and within this distance [m]", low=0.1, high=10.0)
    body: float = field(
        APART_ACROSS,
        "... or within this distance, whatever the covariances: no two bodies are so close "
        "[m]",
        low=0.0, high=2.0,
    )  # fmt: skip
    height_sigma: float = field(
        0.15, "standard deviation of the difference of two height measurements of one person [m]",
        low=0.01, high=10.0,
    )  # fmt: skip
    evidence_time: float = field(
        0.5, "averaging time of the log-odds, height and uncertainty of a track [s]",
        low=0.01, high=60.0,
    )  # fmt: skip
    sure_score: float = field(
        2.0, "log-odds from which a new track is a person at once", low=-20.0, high=8.0
    )
    birth_score: float = field(
        1.0, "... and from which a track is a person after tracking.birth_time", low=-20.0, high=8.0
    )
    birth_time: float = field(0.2, "see tracking.birth_score [s]", low=0.0, high=10.0)
    start_time: float = field(
        0.35, "time after the start in which every detection from tracking.birth_score on is a "
        "person at once [s]",
        low=0.0, high=60.0,
    )  # fmt: skip
    doubt_score: float = field(
        0.0, "log-odds from which a new tentative track is started", low=-20.0, high=50.0
    )
    doubt_time: float = field(
        0.25, "a tentative track that is unobserved for longer is terminated [s]",
        low=0.0, high=10.0,
    )  # fmt: skip
    expected_score: float = field(
        1.0, "log-odds that a detection gains where a person is expected", low=0.0, high=50.0
    )
    expected_points: float = field(
        0.5, "share of human.min_points that a plain cluster needs where a person is expected",
        low=0.0, high=1.0,
    )  # fmt: skip
    static_score: float = field(
        7.5, "maximum log-odds that a body loses where something has been standing that never "
        "looked like more than a doubtful person; 0: off",
        low=0.0, high=50.0,
    )  # fmt: skip
    keep_score: float = field(
        -1.0, "a person remains one down to these log-odds", low=-20.0, high=8.0
    )
    in_view_time: float = field(
        0.4, "an unobserved person remains among `persons` for this time, and is then among "
        "`hidden` [s]",
        low=0.0, high=60.0,
    )  # fmt: skip
    coast_time: float = field(
        1.0, "the track of an unobserved person is terminated after this time [s]",
        low=0.0, high=60.0,
    )  # fmt: skip
    coast_share: float = field(
        0.5, "... and after this share of the time for which the person was observed",
        low=0.0, high=1e3,
    )  # fmt: skip
    hidden_time: float = field(
        10.0, "the track of a member of a group whom no robot has in view is terminated after this "
        "time instead of tracking.coast_time [s]",
        low=0.0, high=60.0,
    )  # fmt: skip
    memory: float = field(
        10.0, "time after the last observation for which a terminated track can resume with its "
        "id, where the person may have got to, at most the time of observation [s]; 0: off",
        low=0.0, high=600.0,
    )  # fmt: skip
    lasting_share: float = field(
        0.25, "share of the variance of detections that is correlated over time, and is not "
        "reduced by filtering",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_tracks: int = field(1000, "maximum number of tracks", low=1, high=10_000)


@dataclass(frozen=True)
class Groups(Section):
    """Groups of people who walk together, and their stragglers."""

    distance: float = field(
        2.5, "a member farther than this from every other one is a straggler [m]",
        low=0.3, high=100.0,
    )  # fmt: skip
    margin: float = field(
        0.4, "a person who joins or returns is nearer than groups.distance by this margin [m]",
        low=0.0, high=100.0,
    )  # fmt: skip
    speed: float = field(
        0.8, "... and velocities differ by no more than this [m/s]", low=0.0, high=20.0
    )
    hidden_sigmas: float = field(
        2.0, "occluded people may be nearer than predicted by this number of sigmas",
        low=0.0, high=20.0,
    )  # fmt: skip
    leave_time: float = field(0.5, "time for which a straggler is farther [s]", low=0.0, high=60.0)
    join_time: float = field(
        2.0, "time for which a person who joins or returns is near [s]", low=0.0, high=60.0
    )
    missing_time: float = field(
        6.0, "a member whose track was terminated this long ago is a straggler, too [s]; less "
        "than tracking.memory, so that the track can resume",
        low=0.0, high=600.0,
    )  # fmt: skip
    forget_time: float = field(
        60.0, "a straggler ceases to be a member after this time [s]", low=0.0, high=3600.0
    )


@dataclass(frozen=True)
class Outputs(Section):
    """The people in messages of other packages (docs/use_with.md)."""

    people_msgs: bool = field(
        True, "true: people_msgs/People on `people`, where that package is installed", live=False
    )
    hri_msgs: bool = field(
        True, "true: persons and groups on /humans as in REP 155, where hri_msgs is installed",
        live=False,
    )  # fmt: skip
    vision_msgs: bool = field(
        True, "true: vision_msgs/Detection3DArray on `people_detections`, where that package is "
        "installed",
        live=False,
    )  # fmt: skip
    person_frames: bool = field(
        False, "true: a frame person_p<id> of each person on TF, with tf2_msgs", live=False
    )
    people_costmap: bool = field(
        False, "true: costs around people on `people_costmap`, with the geometry of `map`",
        live=False,
    )  # fmt: skip
    costmap_rate: float = field(5.0, "rate of people_costmap [Hz]", low=0.1, high=50.0, live=False)


@dataclass(frozen=True)
class PlannerConfig(Section):
    """Configuration of the planner: from the robots' scans to people."""

    robots: tuple[str, ...] = field(
        (), "names (namespaces) of the robots; empty: discovered as they appear", live=False
    )
    map_frame: str = field("map", "the common frame", live=False)
    people_topic: str = field(
        PEOPLE_TOPICS[0], "name of the topic with mrs_people_msgs/People: tracked_people; or "
        "people, the old name, which leaves none for people_msgs/People",
        choices=PEOPLE_TOPICS, live=False,
    )  # fmt: skip
    interval: Interval = dataclasses.field(default_factory=Interval)
    masking: Masking = dataclasses.field(default_factory=Masking)
    joining: Joining = dataclasses.field(default_factory=Joining)
    clustering: Clustering = dataclasses.field(default_factory=Clustering)
    splitting: Splitting = dataclasses.field(default_factory=Splitting)
    human: Human = dataclasses.field(default_factory=Human)
    tracking: Tracking = dataclasses.field(default_factory=Tracking)
    groups: Groups = dataclasses.field(default_factory=Groups)
    outputs: Outputs = dataclasses.field(default_factory=Outputs)

    def memoryless(self) -> PlannerConfig:
        """The same, but every interval stands for itself."""
        return dataclasses.replace(self, tracking=dataclasses.replace(self.tracking, enabled=False))

    def _check_relations(self) -> None:
        check_robots("robots", self.robots)
