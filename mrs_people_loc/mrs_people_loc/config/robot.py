"""Parameters of a robot: from its images to its scan."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass

from mrs_people_loc.config.parameters import Section, field
from mrs_people_loc.errors import ConfigError

_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True)
class Images(Section):
    """Which images come in, and how they pair."""

    rectified: bool = field(
        True, "true: image_rect is used as it is; false: image_raw is rectified here", live=False
    )
    top: bool = field(False, "true: a third camera `top` above (or below) `left`", live=False)
    working_width: int = field(
        160, "larger images are scaled down to fit this width [px]", low=32, high=4096
    )
    working_height: int = field(
        120, "larger images are scaled down to fit this height [px]", low=24, high=4096
    )
    max_stamp_difference: float = field(
        0.005, "largest difference of the stamps of a pair; 0: equal stamps [s]", low=0.0, high=1.0
    )
    queue_size: int = field(8, "images per camera that wait for their counterpart", low=1, high=100)


@dataclass(frozen=True)
class Mounting(Section):
    """Pose of the left (reference) camera in the robot's base_link.

    Angles turn as in REP 103: first yaw (to the left), then pitch (nose down), then roll (right
    side down), each about the axis that the former left. Zero: level, looking ahead.
    """

    height: float = field(1.0, "lens height over the floor [m]", low=0.0, high=20.0)
    forward: float = field(0.0, "lens in front of base_link's origin [m]", low=-5.0, high=5.0)
    left: float = field(0.0, "lens to the left of base_link's origin [m]", low=-5.0, high=5.0)
    pitch: float = field(
        0.0, "nose down is positive; pi/2 looks straight down [rad]", low=-math.pi, high=math.pi
    )
    roll: float = field(0.0, "right side down is positive [rad]", low=-math.pi, high=math.pi)
    yaw: float = field(0.0, "turned to the left is positive [rad]", low=-math.pi, high=math.pi)


@dataclass(frozen=True)
class Disparity(Section):
    """Stereo matching with OpenCV's StereoBM (SAD)."""

    pre_filter: str = field(
        "xsobel", "StereoBM's pre-filter, instead of the edge filter of the paper's heads",
        choices=("xsobel", "normalized_response"),
    )  # fmt: skip
    pre_filter_size_px: int = field(
        11, "window of normalized_response [px] (the paper's edge mask)",
        low=5, high=255, odd=True,
    )  # fmt: skip
    pre_filter_cap: int = field(
        63, "the pre-filter's output is clipped to this value", low=1, high=63
    )
    block_size_px: int = field(
        7, "SAD window [px] (the paper's stereo mask is 15)", low=5, high=51, odd=True
    )
    fill_block_size_px: int = field(
        11, "pixels without a disparity get that of a second pass with this window [px], an odd "
        "number from 5; 0: no second pass",
        low=0, high=51,
    )  # fmt: skip
    min_range: float = field(0.7, "nearest working depth [m]", low=0.1, high=50.0)
    max_range: float = field(5.0, "farthest working depth [m]", low=0.2, high=100.0)
    uniqueness_ratio: int = field(
        10, "margin of the best match over the second best [%]", low=0, high=100
    )
    texture_threshold: int = field(
        10, "minimum sum of the absolute pre-filter output over the block", low=0, high=100_000
    )
    left_right_difference_px: int = field(
        -1, "left and right match must agree within this [px], with pre_filter_cap up to 31 and "
        "windows up to 21 px; -1: not checked",
        low=-1, high=16,
    )  # fmt: skip
    trinocular_difference_px: float = field(
        1.0, "horizontal and vertical pair must agree within this [px]", low=0.0, high=16.0
    )

    @property
    def largest_block_px(self) -> int:
        """The larger window of both passes [px]."""
        return max(self.block_size_px, self.fill_block_size_px)

    def _check_relations(self) -> None:
        if self.fill_block_size_px and (
            self.fill_block_size_px % 2 == 0 or self.fill_block_size_px < 5
        ):
            raise ConfigError(
                f"disparity.fill_block_size_px is {self.fill_block_size_px}; "
                "allowed: 0 or an odd whole number from 5 to 51"
            )
        if self.left_right_difference_px >= 0 and (
            self.pre_filter_cap > 31 or self.largest_block_px > 21
        ):  # OpenCV compares the costs of other pixels then, some of them never written
            raise ConfigError(
                f"disparity.left_right_difference_px is {self.left_right_difference_px} with a "
                f"pre_filter_cap of {self.pre_filter_cap} and a window of {self.largest_block_px} "
                "px; allowed: -1, or a cap up to 31 and windows up to 21 px"
            )
        if self.min_range >= self.max_range:
            raise ConfigError(
                f"disparity.min_range is {self.min_range:g}; "
                f"allowed: less than disparity.max_range, {self.max_range:g}"
            )


@dataclass(frozen=True)
class Sight(Section):
    """When the diagnostics report that a head is blind."""

    min_valid: float = field(
        0.25, "minimum share of pixels with a disparity; 0: not checked", low=0.0, high=1.0
    )
    frames: int = field(
        5, "consecutive bad views before a warning is raised, and good views before it is cleared",
        low=1, high=1000,
    )  # fmt: skip


@dataclass(frozen=True)
class Floor(Section):
    """When the diagnostics report that the mounting does not fit the floor in view."""

    watch: bool = field(True, "true: the floor is estimated in some of the views")
    max_angle: float = field(
        0.026, "rotation of the head from which a warning is raised, in addition to twice the "
        "floor's standard deviation [rad]",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_height: float = field(
        0.08, "change of the head's height from which a warning is raised, likewise [m]",
        low=0.0, high=5.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Zones(Section):
    """Zone discrimination (eq. 1): heights over the floor that are kept."""

    low: float = field(0.20, "knees: th1 of eq. 1 [m]", low=-1.0, high=10.0)
    high: float = field(1.40, "shoulders: th2 of eq. 1 [m]", low=-1.0, high=10.0)

    def _check_relations(self) -> None:
        if self.low >= self.high:
            raise ConfigError(
                f"zones.low is {self.low:g}; allowed: less than zones.high, {self.high:g}"
            )


@dataclass(frozen=True)
class Noise(Section):
    """Noise reduction (eqs. 2-3)."""

    window: float = field(0.10, "side of a noise window: fwin of eq. 2 [m]", low=0.01, high=2.0)
    min_points: int = field(
        20, "a window with fewer points is emptied: th_n of eq. 3", low=1, high=100_000
    )


@dataclass(frozen=True)
class Quantization(Section):
    """Point reduction (eqs. 4-5)."""

    cell: float = field(0.05, "side of a cell: hwin of eq. 4 [m]", low=0.01, high=1.0)
    top_support: int = field(
        5, "points at or above the top of a column that support it", low=1, high=1000
    )
    top_gap: float = field(
        0.25, "a column ends at a vertical gap larger than this [m]", low=0.05, high=2.0
    )


@dataclass(frozen=True)
class Bodies(Section):
    """Detection of people as bodies, instead of the paper's noise windows and cells."""

    search: bool = field(
        True, "true: upright bodies are detected in bearing and inverse range; false: the paper's "
        "zones, noise windows and cells",
    )  # fmt: skip
    max_range: float = field(6.0, "farthest range of a body [m]", low=0.5, high=50.0)
    min_extent: float = field(
        0.35, "minimum visible vertical extent, mean over a body's width [m]", low=0.05, high=2.0
    )
    max_count: int = field(16, "maximum number of candidates per view", low=1, high=100)
    vote: bool = field(True, "true: all pixels of a body vote for one disparity")
    human_test: bool = field(
        True, "true: a fitted model gives the log-odds that a body is a person; false: its "
        "vertical extent is used instead; fitted with bodies.vote",
    )  # fmt: skip
    appearance: bool = field(
        True, "true: the grey values of a body (networks see people in them) add to the "
        "log-odds of the human test; without bodies.human_test it has no effect",
    )  # fmt: skip
    axis: bool = field(
        True, "true: fitted offsets move a body from its visible surface to its axis; requires "
        "bodies.vote",
    )  # fmt: skip
    min_score: float = field(
        -3.0, "bodies with at least these log-odds of being a person are sent", low=-20.0, high=20.0
    )

    def _check_relations(self) -> None:
        if self.axis and not self.vote:
            raise ConfigError("bodies.axis is true but bodies.vote is false; allowed: both true")


@dataclass(frozen=True)
class PoseInput(Section):
    """Where the robot's pose comes from, and how often it goes out."""

    source: str = field(
        "odom", "source of the pose: nav_msgs/Odometry on `odom`, "
        "geometry_msgs/PoseWithCovarianceStamped on `pose_in`, the parameter pose.static "
        "(static), or TF (tf), which requires tf2_ros",
        choices=("odom", "pose_in", "static", "tf"), live=False,
    )  # fmt: skip
    static: tuple[float, ...] = field(
        (), "x, y [m] and yaw [rad] of base_link in the map (source static)",
        kind="floats", length=3,
    )  # fmt: skip
    sigmas: tuple[float, ...] = field(
        (), "standard deviations of x, y [m] and yaw [rad] of a pose without covariance (source "
        "static or tf), at least 0; empty: exact",
        kind="floats", length=3,
    )  # fmt: skip
    map_from_odom: tuple[float, ...] = field(
        (), "x, y [m] and yaw [rad] of the odometry's frame in the map, for poses that are not in "
        "the map frame; empty: from TF, where tf2_ros is installed",
        kind="floats", length=3,
    )  # fmt: skip
    publish_tf: str = field(
        "auto", "transforms published on TF besides the cameras, where tf2_msgs is installed: "
        "auto (map to base_link for source static and for odometry in the map; map to the "
        "odometry's frame with map_from_odom), always (map to base_link: no other node may "
        "publish it), never (no cameras either)",
        choices=("auto", "always", "never"), live=False,
    )  # fmt: skip
    map_frame: str = field("map", "the common frame", live=False)
    max_rate: float = field(100.0, "maximum rate of published poses [Hz]", low=1.0, high=1e3)

    def _check_relations(self) -> None:
        if self.source == "tf" and self.publish_tf == "always":
            raise ConfigError(
                "pose.publish_tf is always; allowed where pose.source is tf: auto, never"
            )
        if any(sigma < 0 for sigma in self.sigmas):
            raise ConfigError(f"pose.sigmas is {list(self.sigmas)}; allowed: numbers of at least 0")


#: Wheels with larger systematic errors are not those of a robot that was measured.
MAX_WHEEL_ERROR = 0.3


@dataclass(frozen=True)
class Localization(Section):
    """Where the robot is: dead reckoning, corrected by walls, absolute poses and the team."""

    run: str = field(
        "auto", "whether the robot's pose is estimated: auto (where pose.source is odom, in its "
        "own frame, whose place is given by pose.map_from_odom or localization.start), always "
        "(pose.source odom or pose_in), never",
        choices=("auto", "always", "never"), live=False,
    )  # fmt: skip
    start: tuple[float, ...] = field(
        (), "x, y [m] and yaw [rad] of base_link in the map at the start; empty: as the odometry "
        "says, with pose.map_from_odom",
        kind="floats", length=3, live=False,
    )  # fmt: skip
    start_sigmas: tuple[float, ...] = field(
        (0.1, 0.1, 0.05), "standard deviations of that x, y [m] and yaw [rad]",
        kind="floats", length=3, live=False,
    )  # fmt: skip
    position_noise: float = field(
        0.02, "standard deviation that a metre of way adds to the position; it grows with the "
        "square root of the way [m]",
        low=0.0, high=1.0,
    )  # fmt: skip
    heading_noise: float = field(
        0.006, "standard deviation that a metre of way adds to the heading, likewise [rad]",
        low=0.0, high=1.0,
    )  # fmt: skip
    turn_noise: float = field(
        0.02, "standard deviation that a radian of turn adds to the heading, likewise [rad]",
        low=0.0, high=1.0,
    )  # fmt: skip
    wheels: tuple[float, ...] = field(
        (0.0, 0.0, 0.0), "systematic errors of the wheels that the odometry is corrected by: the "
        "true way is longer by this share, the true turn is greater by this many radians per metre "
        "of way, and by this share",
        kind="floats", length=3, live=False,
    )  # fmt: skip
    wheel_sigmas: tuple[float, ...] = field(
        (0.02, 0.01, 0.03), "standard deviations of these at the start; what remains is estimated "
        "on the way",
        kind="floats", length=3, live=False,
    )  # fmt: skip
    gate: float = field(
        0.999, "share of correct observations that pass the chi-square gate",
        low=0.5, high=0.999999, live=False,
    )  # fmt: skip
    share_rate: float = field(
        20.0, "rate at which the robot tells its team where it is [Hz]", low=1.0, high=1e3
    )

    def _check_relations(self) -> None:
        for name in ("start_sigmas", "wheel_sigmas"):
            sigmas = getattr(self, name)
            if not sigmas or any(sigma < 0 for sigma in sigmas):
                raise ConfigError(
                    f"localization.{name} is {list(sigmas)}; allowed: 3 numbers of at least 0"
                )
        if not self.wheels or max(map(abs, self.wheels)) > MAX_WHEEL_ERROR:
            raise ConfigError(
                f"localization.wheels is {list(self.wheels)}; allowed: 3 numbers from "
                f"-{MAX_WHEEL_ERROR:g} to {MAX_WHEEL_ERROR:g}"
            )


@dataclass(frozen=True)
class WallSensors(Section):
    """Where localization sees walls, and which it knows."""

    stereo: bool = field(True, "true: walls are found in the disparity images of the head")
    laser: bool = field(
        False, "true: walls are found in the sensor_msgs/LaserScan on `scan`", live=False
    )
    laser_mounting: tuple[float, ...] = field(
        (), "x, y [m] and yaw [rad] of the laser scanner in base_link; empty: from TF, which "
        "requires tf2_ros",
        kind="floats", length=3, live=False,
    )  # fmt: skip
    laser_sigma: float = field(
        0.02, "standard deviation of the laser scanner's ranges [m]", low=0.001, high=1.0
    )
    sonars: tuple[str, ...] = field(
        (), "topics of the robot's sonars (sensor_msgs/Range) in which walls are found, such as "
        "sonar/left",
        live=False,
    )  # fmt: skip
    sonar_mountings: tuple[float, ...] = field(
        (), "x, y [m] and yaw [rad] of each sonar in base_link, one after another; empty: from TF, "
        "which requires tf2_ros",
        kind="floats", live=False,
    )  # fmt: skip
    file: str = field(
        "", "YAML file of known walls, lines in the map frame; empty: none", live=False
    )
    occupancy_grid: bool = field(
        False, "true: the straight walls of the first nav_msgs/OccupancyGrid on the team's topic "
        "`map` are known",
        live=False,
    )  # fmt: skip
    occupied_from: int = field(
        65, "cells of the grid from this value on are occupied [%]", low=1, high=100, live=False
    )

    def _check_relations(self) -> None:
        for topic in self.sonars:
            if not _TOPIC.fullmatch(topic) or self.sonars.count(topic) > 1:
                raise ConfigError(
                    f"walls.sonars has {topic!r}; allowed: names of ROS topics, each once"
                )
        given, wanted = len(self.sonar_mountings), 3 * len(self.sonars)
        if given not in (0, wanted):
            raise ConfigError(
                f"walls.sonar_mountings has {given} numbers; allowed for {len(self.sonars)} "
                f"sonars: none, or {wanted}"
            )


@dataclass(frozen=True)
class CollisionMonitoring(Section):
    """What limits the velocities on `cmd_vel_guide` before they go to the base."""

    enabled: bool = field(
        True, "true: what comes on cmd_vel_guide goes out on cmd_vel as far as nothing is in the "
        "way that the head, or the laser scanner and the sonars of the section walls, see",
        live=False,
    )  # fmt: skip
    stamped: bool = field(
        False, "true: cmd_vel and cmd_vel_guide are geometry_msgs/TwistStamped; false: Twist",
        live=False,
    )  # fmt: skip
    radius: float = field(
        0.25, "of the circle about base_link in which the robot is [m]", low=0.05, high=2.0
    )
    time_before_collision: float = field(
        1.2, "speeds are scaled so that no collision is nearer than this [s]", low=0.1, high=10.0
    )
    stop_distance: float = field(0.2, "left to what is in the way [m]", low=0.0, high=2.0)
    deceleration: float = field(
        1.0, "with which the base brakes at least [m/s^2]", low=0.1, high=10.0
    )
    crawl: float = field(
        0.1, "highest speed where no sensor sees the way; 0: the robot stands there [m/s]",
        low=0.0, high=1.0,
    )  # fmt: skip
    source_timeout: float = field(
        0.6, "the robot stands while a sensor that has delivered is silent for longer [s]",
        low=0.05, high=5.0,
    )  # fmt: skip
    min_height: float = field(
        0.25, "what the head sees from this height over the floor on is an obstacle [m]",
        low=0.0, high=1.5,
    )  # fmt: skip
    max_height: float = field(1.8, "... up to this one [m]", low=0.5, high=5.0)

    def _check_relations(self) -> None:
        if self.min_height >= self.max_height:
            raise ConfigError(
                f"collision_monitor.min_height is {self.min_height:g}; allowed: less than "
                f"collision_monitor.max_height, {self.max_height:g}"
            )


@dataclass(frozen=True)
class RobotConfig(Section):
    """Configuration of one robot: from its images to its scan."""

    images: Images = dataclasses.field(default_factory=Images)
    mounting: Mounting = dataclasses.field(default_factory=Mounting)
    disparity: Disparity = dataclasses.field(default_factory=Disparity)
    sight: Sight = dataclasses.field(default_factory=Sight)
    floor: Floor = dataclasses.field(default_factory=Floor)
    zones: Zones = dataclasses.field(default_factory=Zones)
    noise: Noise = dataclasses.field(default_factory=Noise)
    quantization: Quantization = dataclasses.field(default_factory=Quantization)
    bodies: Bodies = dataclasses.field(default_factory=Bodies)
    pose: PoseInput = dataclasses.field(default_factory=PoseInput)
    localization: Localization = dataclasses.field(default_factory=Localization)
    walls: WallSensors = dataclasses.field(default_factory=WallSensors)
    collision_monitor: CollisionMonitoring = dataclasses.field(default_factory=CollisionMonitoring)
