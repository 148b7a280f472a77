"""A robot's sonars and laser scanner on a tour without rendering, and the walls found by them.

Ranges are simulated as for bags (`sensors.range_sensors`), and go through the code of the nodes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.config import WallSensors
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.walls import NOBODY, SeenWalls
from mrs_people_loc.localization.walls.finder import WallFinder
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.scan import Scan
from mrs_people_sim.light.sensing import BODY
from mrs_people_sim.scene import Scene
from mrs_people_sim.sensors.range_sensors import laser_angles, laser_ranges, sonar_ranges

Rng = np.random.Generator


class RangeSensors:
    """The sonars and the laser scanner of a robot.

    Args:
        scene: Says what the robot has.
        robot: Its name.
        walls: Both ends of the walls around it [m], shape (m, 2, 2).
        rng: Source of randomness.
    """

    def __init__(self, scene: Scene, robot: str, walls: NDArray, rng: Rng) -> None:
        self._sonars, self._laser = scene.sonars.get(robot, ()), scene.lasers.get(robot)
        self._segments, self._rng = walls.reshape(-1, 4), rng
        self._finder = WallFinder(WallSensors())

    def take_people(self, people: Scan) -> None:
        """Takes the people whom the robot sees; no wall is found in them."""
        self._finder.take_people(people)

    def by_sonar(
        self, pose: NDArray, bodies: NDArray, odometry: Odometry, mates: NDArray = NOBODY
    ) -> Iterator[SeenWalls]:
        """The walls that are found when the sonars fire, now and then.

        Args:
            pose: The robot's true x, y [m] and yaw [rad], shape (3,).
            bodies: Where people and other robots are [m], shape (n, 2).
            odometry: Its dead reckoning, at the time of the ranges.
            mates: Where it believes other robots to be (`Localizer.mates_at`).
        """
        circles = _circles(bodies)
        ranges = sonar_ranges(self._segments, circles, pose.tolist(), self._sonars, self._rng)
        for sonar, measured in zip(self._sonars, ranges.tolist(), strict=True):
            limits = sonar.field_of_view, sonar.min_range, sonar.max_range
            echo = SonarRange(odometry.stamp_ns, "", *limits, measured)
            mounting = sonar.x, sonar.y, sonar.yaw
            seen = self._finder.in_range(echo, mounting, lambda _: odometry, lambda _: mates)
            if seen is not None:
                yield seen

    def by_laser(
        self, pose: NDArray, bodies: NDArray, odometry: Odometry, mates: NDArray = NOBODY
    ) -> Iterator[SeenWalls]:
        """The walls that are found in a scan of the laser scanner, if there is one.

        The arguments are those of `by_sonar`.
        """
        if self._laser is None:
            return
        laser = self._laser
        ranges = laser_ranges(self._segments, _circles(bodies), pose.tolist(), laser, self._rng)
        scan = LaserScan(odometry.stamp_ns, "", laser.max_range, laser_angles(laser), ranges)
        mounting = laser.x, laser.y, laser.yaw
        seen = self._finder.in_laser(scan, mounting, lambda _: odometry, lambda _: mates)
        if seen is not None:
            yield seen


def _circles(bodies: NDArray) -> NDArray:
    return np.column_stack([bodies, np.full(len(bodies), BODY)])
