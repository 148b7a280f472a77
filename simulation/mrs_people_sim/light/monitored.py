"""The collision monitor of a robot on a tour without rendering, and what its sensors see."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.config import CollisionMonitoring
from mrs_people_loc.guiding.collision_monitor import CollisionMonitor, Verdict
from mrs_people_loc.guiding.drive import Velocity
from mrs_people_loc.guiding.obstacles import (
    BEARINGS,
    OBSTACLE_TUNING,
    SECTORS,
    ObstacleScan,
    SonarObstacles,
    obstacles_of_laser,
)
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_sim.light.sensing import BODY, HEAD, LightHead
from mrs_people_sim.scene import Scene
from mrs_people_sim.sensors.range_sensors import cast, laser_angles, laser_ranges, sonar_ranges
from mrs_people_sim.sensors.wheels import Wheels

Rng = np.random.Generator

#: Sonars fire, the laser scanner turns and the head looks at each so many steps of the world.
_RANGES, _VIEW = 2, 4
#: What they see comes so many steps later.
_RANGES_LATE, _VIEW_LATE = 1, 3
#: A head matches nothing that is nearer [m].
_NEAREST = 0.7
_CONFIG = CollisionMonitoring()


class MonitoredBase:
    """Sensors, monitor and base of a robot.

    Args:
        scene: Says what sonars and laser scanner the robot has.
        robot: Its name.
        solid: Both ends of the sides of all that is solid [m], shape (n, 2, 2).
        looks_back: Whether its head does.
        head: What that sees.
        config: Of the monitor.
    """

    def __init__(
        self,
        scene: Scene,
        robot: str,
        solid: NDArray,
        *,
        looks_back: bool,
        head: LightHead = HEAD,
        config: CollisionMonitoring = _CONFIG,
    ) -> None:
        self._sonars, self._laser = scene.sonars.get(robot, ()), scene.lasers.get(robot)
        self._segments, self._monitor = solid.reshape(-1, 4), CollisionMonitor(config)
        self._rng = np.random.default_rng([scene.seed, 61, list(scene.robots).index(robot)])
        turned = BEARINGS - (np.pi if looks_back else 0.0)
        self._looks = np.cos(turned) > np.cos(head.half_view)
        self._echoes = [SonarObstacles() for _ in self._sonars]
        self._underway: deque[tuple[int, str, ObstacleScan, float]] = deque()
        self._step = 0

    def drive(self, wanted: Velocity, wheels: Wheels, bodies: NDArray) -> Verdict:
        """Commands the base as far as nothing is in the way; called at each step of the world.

        Args:
            wanted: What it is told to drive with.
            wheels: The base.
            bodies: Where people and other robots are [m], shape (n, 2).
        """
        now_s, step = wheels.time, self._step
        circles = np.column_stack([bodies, np.full(len(bodies), BODY)])
        if step % _RANGES == 0:
            self._measure(wheels.pose, circles, now_s)
        if step % _VIEW == 0:
            view = self._view(wheels.pose, circles)
            self._underway.append((step + _VIEW_LATE, "head", view, now_s))
        for late in [one for one in self._underway if one[0] <= step]:
            self._underway.remove(late)
            self._monitor.take_scan(*late[1:], now_s)
        said = wheels.odometry()
        self._monitor.take_odometry(said.x, said.y, said.yaw, now_s)
        self._step += 1
        verdict = self._monitor.step(wanted, now_s)
        wheels.command(*verdict.velocity)
        return verdict

    def _measure(self, pose: NDArray, circles: NDArray, now_s: float) -> None:
        """Ranges of the sonars, and a scan of the laser scanner."""
        stamp_ns, due, place = 1 + round(now_s * 1e9), self._step + _RANGES_LATE, pose.tolist()
        ranges = sonar_ranges(self._segments, circles, place, self._sonars, self._rng)
        for k, (sonar, measured) in enumerate(zip(self._sonars, ranges.tolist(), strict=True)):
            limits = sonar.field_of_view, sonar.min_range, sonar.max_range
            echo = SonarRange(stamp_ns, "", *limits, measured)
            scan, age_s = self._echoes[k](echo, (sonar.x, sonar.y, sonar.yaw))
            self._underway.append((due, f"sonar_{k}", scan, now_s - age_s))
        if self._laser is not None:
            laser = self._laser
            found = laser_ranges(self._segments, circles, place, laser, self._rng)
            angles = laser_angles(laser)
            swept = LaserScan(stamp_ns, "", laser.max_range, angles, found, 0.0, laser.min_range)
            scan = obstacles_of_laser(swept, (laser.x, laser.y, laser.yaw))
            self._underway.append((due, "scan", scan, now_s))

    def _view(self, pose: NDArray, circles: NDArray) -> ObstacleScan:
        """What the head sees: nothing past what is too near for it."""
        angles = pose[2] + BEARINGS[self._looks]
        rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        away = cast(pose[:2], rays, self._segments, circles)
        ranges, seen = np.full(SECTORS, np.inf), self._looks.copy()
        seen[self._looks] = away >= _NEAREST
        reach = OBSTACLE_TUNING.reach
        ranges[self._looks] = np.where((away >= _NEAREST) & (away <= reach), away, np.inf)
        return ObstacleScan(0.0, 0.0, ranges, seen, self._looks, reach)
