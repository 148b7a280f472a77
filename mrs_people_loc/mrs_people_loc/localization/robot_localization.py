"""Where a robot is in the map: what its node and the tools call, all of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float32
from mrs_people_loc.clocks import Order, RateLimit, StampOrder
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.config.robot import MAX_WHEEL_ERROR
from mrs_people_loc.errors import PoseError
from mrs_people_loc.localization.localizer import LocalizationState, Localizer
from mrs_people_loc.localization.shared import TeamMeasurement, TeamPose
from mrs_people_loc.localization.walls import SeenWalls, Walls
from mrs_people_loc.localization.walls.finder import Mounting, WallFinder
from mrs_people_loc.localization.walls.known import read_walls
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.poses import Pose

#: Systematic errors of wheels are kept for the next start from this way on [m].
_LEAST_WAY = 10.0
#: What is kept of them is no surer than this: wheels wear, and loads differ.
_LEAST_SIGMAS = (0.004, 0.002, 0.006)


def may_localize(config: RobotConfig) -> bool:
    """Whether poses of `pose.source` may be dead reckoning, depending on their frame."""
    return config.localization.run != "never" and config.pose.source in ("odom", "pose_in")


def localizes(config: RobotConfig, frame_id: str) -> bool:
    """Whether poses of `pose.source` in a frame are dead reckoning, to be corrected.

    Args:
        config: The robot's configuration.
        frame_id: Frame of a pose, without a leading slash.
    """
    pose, localization = config.pose, config.localization
    starts = bool(localization.start or pose.map_from_odom)
    apart = pose.source == "odom" and frame_id != pose.map_frame and starts
    return (localization.run == "always" or apart) and may_localize(config)


class RobotLocalization:
    """Places a robot in the map by poses of its source; it corrects those by dead reckoning.

    What corrects them (walls, absolute poses, team-mates) is used from the first odometry on.

    Args:
        robot: The robot's name.
        config: Its configuration.
        frame_in_map: Says where a frame is in the map, for poses in it that nothing else places;
            None: nothing does.

    Attributes:
        began_ns: Stamp of the first odometry [ns]; 0: there was none yet.

    Raises:
        ConfigError: The file of known walls cannot be read.
    """

    def __init__(
        self, robot: str, config: RobotConfig, frame_in_map: Callable[[str], Pose] | None = None
    ) -> None:
        self._robot, self._config = robot, config
        reads = config.walls.file and may_localize(config)
        self._known = read_walls(config.walls.file) if reads else None
        self._intake = PoseIntake(config.pose, frame_in_map)
        self._walls = WallFinder(config.walls)
        self._rate = RateLimit()
        self.reset()

    def reset(self) -> None:
        """Forgets where the robot is; the next odometry is the start."""
        self._localizer = Localizer(self._robot, self._config.localization, self._known)
        self.began_ns = self._newest_ns = 0
        self._intake.reset()
        self._walls.clear()
        self._rate.reset()

    def configure(self, config: RobotConfig) -> None:
        """Takes another configuration, from the next measurement on; the start stays."""
        self._config, self._intake.config, self._walls.config = config, config.pose, config.walls
        self._localizer.configure(config.localization)

    @property
    def has_begun(self) -> bool:
        """Whether there was odometry that is corrected."""
        return self._localizer.has_begun

    @property
    def way(self) -> float:
        """What the robot has driven since it began, or its clock jumped back [m]."""
        return self._localizer.way

    @property
    def state(self) -> LocalizationState:
        """What it knows now."""
        return self._localizer.state

    def wheels_to_keep(self) -> dict[str, tuple[float, ...]]:
        """Systematic errors of the wheels and how sure these are, as parameters of the next start.

        Raises:
            PoseError: They are not known yet.
        """
        if not self.has_begun:
            raise PoseError("localization does not run, or no odometry has arrived")
        state = self.state
        if state.way < _LEAST_WAY:
            raise PoseError(f"the robot has driven {state.way:.1f} m; wanted: {_LEAST_WAY:g} m")
        wheels = np.clip(state.wheels, -MAX_WHEEL_ERROR, MAX_WHEEL_ERROR)
        before = self._config.localization.wheel_sigmas
        sigmas = np.minimum(np.maximum(state.wheel_sigmas, _LEAST_SIGMAS), before)
        kept = {"wheels": wheels, "wheel_sigmas": sigmas}
        return {
            f"localization.{name}": tuple(round(value, 6) for value in values.tolist())
            for name, values in kept.items()
        }

    # -------------------------------------------------------------------------------------- poses

    def place(self, pose: Pose, frame_id: str) -> Pose | None:
        """base_link in the map, from a pose of the robot's source.

        Args:
            pose: The pose as it came.
            frame_id: Its frame.

        Returns:
            None if it is too early after the last one (`pose.max_rate`).

        Raises:
            PoseError: Its frame is not known in the map, or it is not newer than the last one.
        """
        if localizes(self._config, frame_id.lstrip("/")):
            pose, frame_id = self.take_odometry(pose), self._config.pose.map_frame
        return self._intake(pose, frame_id)

    def take_odometry(self, pose: Pose) -> Pose:
        """base_link in the map, from its pose in the odometry's frame.

        Raises:
            PoseError: The stamp is not newer than the last one.
        """
        x, y, yaw = self._config.pose.map_from_odom or (0.0, 0.0, 0.0)
        placed = self._localizer.take_odometry(Pose(pose.stamp_ns, x, y, yaw) @ pose)
        self._newest_ns = pose.stamp_ns
        self.began_ns = self.began_ns or pose.stamp_ns
        return placed

    # --------------------------------------------------------------------------------------- team

    def share(self) -> TeamPose | None:
        """What the team is to hear now; None: nothing yet, by `localization.share_rate`."""
        rate_hz = self._config.localization.share_rate
        if not self.has_begun or not self._rate.lets_through(self._newest_ns, rate_hz):
            return None
        return self._localizer.share()

    def take_teammate(self, told: TeamPose) -> None:
        """Takes what a team-mate says; what it said before is recognized."""
        self._localizer.take_teammate(told)

    def take_relative(self, relative: TeamMeasurement) -> None:
        """Takes what the planner measured of robots.

        Raises:
            PoseError: It is of a robot to itself, or its covariance has no full rank.
        """
        self._localizer.take_relative(relative)

    def take_absolute(self, pose: Pose) -> None:
        """Takes a measured pose of base_link in the map.

        Raises:
            PoseError: Its covariance has no full rank.
        """
        self._localizer.take_absolute(pose)

    # -------------------------------------------------------------------------------------- walls

    def add_known(self, walls: Walls) -> None:
        """Takes further known walls, in the map."""
        self._known = walls if self._known is None else Walls.joined([self._known, walls])
        self._localizer.take_known(self._known)

    def take_view(self, scan: Scan, disparity: Float32, camera: StereoCamera) -> None:
        """Finds walls in a view of the head.

        Args:
            scan: What the robot made of it.
            disparity: The view's [px], shape (height, width).
            camera: The head.
        """
        self._walls.take_people(scan)
        self._use(self._walls.in_view, disparity, scan.stamp_ns, camera)

    def take_laser(self, scan: LaserScan, mounting: Mounting) -> None:
        """Finds walls in a scan of a laser scanner; errors as those of `WallFinder.in_laser`."""
        self._use(self._walls.in_laser, scan, mounting, self._localizer.odometry_at)

    def take_range(self, measured: SonarRange, mounting: Mounting) -> None:
        """Finds walls in the ranges of sonars; errors as those of `WallFinder.in_range`."""
        self._use(self._walls.in_range, measured, mounting, self._localizer.odometry_at)

    def _use(self, find: Callable[..., SeenWalls | None], *measured: Any) -> None:
        if not self.has_begun:
            return
        seen = find(*measured, self._localizer.mates_at)
        if seen is not None and len(seen.walls):
            self._localizer.take_walls(seen)


@dataclass
class PoseIntake:
    """Which of the poses that a robot hears go out: in the map, in order, at most so many a second.

    Attributes:
        config: What brings them to the map, and their rate.
        frame_in_map: Says where a frame is in the map, for poses in it where
            `config.map_from_odom` does not; None: nothing does.
        last: The last pose that went out, in the map; None before the first.
    """

    config: cfg.PoseInput
    frame_in_map: Callable[[str], Pose] | None = None
    last: Pose | None = None
    _rate: RateLimit = field(default_factory=RateLimit)
    _order: StampOrder = field(default_factory=StampOrder)

    def __call__(self, pose: Pose, frame_id: str) -> Pose | None:
        """Takes a pose.

        Args:
            pose: The pose as it came.
            frame_id: Its frame.

        Returns:
            The pose in the map; None if it is too early after the last one.

        Raises:
            PoseError: Its frame is not known in the map, or it is not newer than the last one.
        """
        pose = self._in_map(pose, frame_id.lstrip("/"))
        newest_ns = self._order.newest_ns
        order = self._order.take(pose.stamp_ns)
        if order is Order.LATE:
            raise PoseError(f"stamp is {pose.stamp_ns} ns; wanted: newer than {newest_ns} ns")
        if order is Order.RESTART or newest_ns is None:
            self._rate.reset()
        if not self._rate.lets_through(pose.stamp_ns, self.config.max_rate):
            return None
        self.last = pose
        return pose

    def reset(self) -> None:
        """Takes any stamp next."""
        self._order.reset()
        self.last = None

    def _in_map(self, pose: Pose, frame_id: str) -> Pose:
        if frame_id == self.config.map_frame:
            return pose
        if not self.config.map_from_odom:
            why = ""
            if self.frame_in_map is not None:
                try:
                    return self.frame_in_map(frame_id) @ pose
                except PoseError as err:
                    why = f"; {err}"
            raise PoseError(
                f"frame_id is {frame_id!r}; wanted: {self.config.map_frame!r}, or the parameter "
                f"pose.map_from_odom (x, y, yaw of that frame in the map){why}"
            )
        x, y, yaw = self.config.map_from_odom
        return Pose(pose.stamp_ns, x, y, yaw) @ pose
