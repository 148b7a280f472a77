"""Localization of the robots of a bag, as their nodes do it, in one process.

Messages between robots arrive at once and are not lost. Sonars and laser scanners need their
mountings in the configuration: TF of the bag is not used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mrs_people_loc import messages
from mrs_people_loc.config import PlannerConfig, WallSensors
from mrs_people_loc.localization.people.relative_poses import RelativePoses
from mrs_people_loc.localization.people.seen_people import people_in
from mrs_people_loc.localization.robot_localization import RobotLocalization
from mrs_people_loc.localization.walls.finder import Mounting
from mrs_people_loc.planner import People
from mrs_people_loc.team.intervals import Closed
from mrs_people_loc.team.masking import Walls
from mrs_people_loc.team.quarantine import Quarantine


def range_handlers(
    robot: str, localization: RobotLocalization, walls: WallSensors
) -> dict[str, Callable[[Any], None]]:
    """What takes the messages of a robot's range sensors, by topic.

    Args:
        robot: Its name.
        localization: What finds walls in them.
        walls: Its sensors; those without mountings are left out.
    """
    handlers: dict[str, Callable[[Any], None]] = {}
    if walls.laser and walls.laser_mounting:
        x, y, yaw = walls.laser_mounting

        def on_laser(message: Any) -> None:
            localization.take_laser(messages.read_laser_scan(message), (x, y, yaw))

        handlers[f"/{robot}/scan"] = on_laser
    for k, sonar in enumerate(walls.sonars if walls.sonar_mountings else ()):
        x, y, yaw = walls.sonar_mountings[3 * k : 3 * k + 3]

        def on_range(message: Any, mounting: Mounting = (x, y, yaw)) -> None:
            localization.take_range(messages.read_range(message), mounting)

        handlers[sonar if sonar.startswith("/") else f"/{robot}/{sonar}"] = on_range
    return handlers


class TeamLocalization:
    """The robots of a team that hear each other, and the planner, which measures relative poses.

    Args:
        robots: By name, those that localize.

    Attributes:
        quarantine: What they told.
    """

    def __init__(self, robots: Mapping[str, RobotLocalization]) -> None:
        self._robots = robots
        self._relative = RelativePoses()
        self.quarantine = Quarantine()

    def share(self, robot: str, now_ns: int) -> None:
        """A robot that has new odometry tells the others where it is, if it is time [ns]."""
        mine = self._robots.get(robot)
        told = None if mine is None else mine.share()
        if told is None:
            return
        self.quarantine.hear(told.robot, told.lost, told.doubted, now_ns)
        for name, other in self._robots.items():
            if name != robot:
                other.take_teammate(told)

    def measure(
        self,
        closed: Closed,
        people: People | None,
        config: PlannerConfig,
        walls: Walls | None = None,
    ) -> None:
        """Takes an interval: where robots are to each other, by their people.

        Args:
            closed: The interval.
            people: Whom the planner found; None: all of its scans are of robots in quarantine.
            config: What is human.
            walls: What hides people, where it is known.
        """
        if not self._robots or not (closed.scans or closed.apart):
            return
        seen = people_in(closed, () if people is None else people.everybody, config)
        measured = self._relative.step(seen, closed.everywhere, closed.quarantined, walls)
        self.quarantine.compare(self._relative.fits, closed.time_ns)
        for relative in measured:
            for robot in self._robots.values():
                robot.take_relative(relative)
