"""Localization of the robots of a bag, as their nodes do it, in one process.

Messages between robots arrive at once and are not lost. Sonars and laser scanners need their
mountings in the configuration: TF of the bag is not used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from mrs_people_loc import messages
from mrs_people_loc.arrays import Float
from mrs_people_loc.clocks import RateLimit
from mrs_people_loc.config import PlannerConfig, RobotConfig
from mrs_people_loc.localization.known_walls import read_walls
from mrs_people_loc.localization.laser_walls import walls_of_laser
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.people_in_view import people_in
from mrs_people_loc.localization.relative_poses import RelativePoses
from mrs_people_loc.localization.seen_people import people_by_robot
from mrs_people_loc.localization.shared import SeenWalls
from mrs_people_loc.localization.sonar_walls import SonarWalls
from mrs_people_loc.localization.stereo_walls import StereoWalls
from mrs_people_loc.planner import People
from mrs_people_loc.robot import Stages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.poses import Pose


class RobotLocalization:
    """Where one robot is, from its odometry, its views and its range sensors.

    Args:
        robot: Its name.
        config: Its configuration.

    Attributes:
        localizer: The estimate; None: there was no odometry yet.
        handlers: By topic, what takes its messages.

    Raises:
        ConfigError: The file of known walls cannot be read.
    """

    def __init__(self, robot: str, config: RobotConfig) -> None:
        self.localizer: Localizer | None = None
        self.handlers: dict[str, Callable[[Any], None]] = {}
        self.rate = RateLimit()
        self._robot, self._config = robot, config
        self._known = read_walls(config.walls.file) if config.walls.file else None
        self._stereo: StereoWalls | None = None
        self._sonar = SonarWalls()
        self._people: Float = np.empty((0, 2))
        walls = config.walls
        if walls.laser and walls.laser_mounting:
            self.handlers[f"/{robot}/scan"] = self._on_laser
        for k, sonar in enumerate(walls.sonars if walls.sonar_mountings else ()):
            topic = sonar if sonar.startswith("/") else f"/{robot}/{sonar}"
            self.handlers[topic] = partial(self._on_range, k)

    def take_odometry(self, pose: Pose) -> Pose:
        """base_link in the map, from its pose in the odometry's frame.

        Raises:
            PoseError: The stamp is not newer than the last one.
        """
        x, y, yaw = self._config.pose.map_from_odom or (0.0, 0.0, 0.0)
        if self.localizer is None:
            self.localizer = Localizer(self._robot, self._config.localization, self._known)
        return self.localizer.take_odometry(Pose(pose.stamp_ns, x, y, yaw) @ pose)

    def take_view(self, stages: Stages, camera: StereoCamera) -> None:
        """Finds walls in a view of the head."""
        self._people = people_in(stages.scan)
        if self.localizer is None or not self._config.walls.stereo:
            return
        if self._stereo is None or self._stereo.camera is not camera:
            self._stereo = StereoWalls(camera)
        self._take(self._stereo.step(stages.disparity, stages.scan.stamp_ns, self._people))

    def _on_laser(self, message: Any) -> None:
        scan, config = messages.read_laser_scan(message), self._config.walls
        x, y, yaw = config.laser_mounting
        walls = walls_of_laser(
            scan.ranges,
            scan.angles,
            sigma=config.laser_sigma,
            max_range=scan.max_range,
            mounting=(x, y, yaw),
            people=self._people,
        )
        self._take(SeenWalls(scan.stamp_ns, walls))

    def _on_range(self, index: int, message: Any) -> None:
        measured = messages.read_range(message)
        if self.localizer is None:
            return
        x, y, yaw = self._config.walls.sonar_mountings[3 * index : 3 * index + 3]
        seen = self._sonar.take(
            measured, (x, y, yaw), self.localizer.odometry_at(measured.stamp_ns)
        )
        if seen is not None:
            self._take(seen)

    def _take(self, seen: SeenWalls) -> None:
        if self.localizer is not None and len(seen.walls):
            self.localizer.take_walls(seen)


class TeamLocalization:
    """The robots of a team that hear each other, and the planner, which measures relative poses.

    Args:
        robots: By name, those that localize.
        configs: Their configurations.
    """

    def __init__(
        self, robots: Mapping[str, RobotLocalization], configs: Mapping[str, RobotConfig]
    ) -> None:
        self._robots, self._configs = robots, configs
        self._relative = RelativePoses()

    def share(self, robot: str, now_ns: int) -> None:
        """A robot that has new odometry tells the others where it is, if it is time."""
        mine = self._robots.get(robot)
        if mine is None or mine.localizer is None:
            return
        told = mine.localizer.share()
        rate = self._configs[robot].localization.share_rate
        if not mine.rate.lets_through(told.odometry.stamp_ns, rate):
            return
        for name, other in self._robots.items():
            if name != robot and other.localizer is not None:
                other.localizer.take_teammate(told, now_ns)

    def measure(self, people: People, config: PlannerConfig) -> None:
        """Takes an interval of the planner: where robots are to each other, by their people."""
        if not self._robots:
            return
        seen = people_by_robot(people.fused, people.poses, config)
        poses = {name: pose.relative_to_team() for name, pose in people.poses.items()}
        for relative in self._relative.step(seen, poses):
            for robot in self._robots.values():
                if robot.localizer is not None:
                    robot.localizer.take_relative(relative)


def localizes(config: RobotConfig) -> bool:
    """Whether a robot's odometry in a frame of its own is dead reckoning that can be corrected."""
    run, pose = config.localization.run, config.pose
    known = bool(pose.map_from_odom or config.localization.start)
    return run != "never" and pose.source == "odom" and known
