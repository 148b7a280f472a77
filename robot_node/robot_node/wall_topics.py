"""What localization sees walls in: laser scans, ranges of sonars, and the map."""

from __future__ import annotations

from nav_msgs.msg import OccupancyGrid

from mrs_people_loc import messages
from mrs_people_loc.config import WallSensors
from mrs_people_loc.health.sonars import SonarWatch
from mrs_people_loc.localization.robot_localization import RobotLocalization
from mrs_people_loc.localization.walls.finder import Mounting
from mrs_people_loc.localization.walls.known import read_walls, walls_of_grid
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_ros import tf
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import MAP
from robot_node.range_topics import RangeTopics


def check(config: WallSensors) -> None:
    """Checks that known walls can be read, and that mountings are given or can be had from TF.

    Raises:
        ConfigError: They cannot.
    """
    if config.file:
        read_walls(config.file)
    if config.laser and not config.laser_mounting:
        tf.require("tf2_ros", "walls.laser_mounting is empty; allowed here: x, y, yaw")
    if config.sonars and not config.sonar_mountings:
        tf.require("tf2_ros", "walls.sonar_mountings is empty; allowed here: x, y, yaw of each")


class WallTopics:
    """Subscribes for the localization of a robot.

    Args:
        node: The robot's node.
        ranges: Its range sensors.
        localization: Takes what comes.

    Attributes:
        sonars: Knows which sonars are dead.
    """

    def __init__(
        self, node: ManagedNode, ranges: RangeTopics, localization: RobotLocalization
    ) -> None:
        self._node, self._ranges, self._localization = node, ranges, localization
        self._has_map = False
        self.sonars = SonarWatch()
        ranges.on_laser.append(self._take_laser)
        ranges.on_range.append(self._take_range)

    def start(self, team: str) -> None:
        """Subscribes to sensors and to the map.

        Args:
            team: The team's namespace, where the map is.
        """
        self._ranges.start()
        if self._node.config.walls.occupancy_grid:
            self._node.listen(OccupancyGrid, f"{team}/map", self._on_map, MAP, once=True)

    def _take_laser(self, scan: LaserScan, mounting: Mounting) -> None:
        if self._localization.has_begun:
            self._localization.take_laser(scan, mounting)

    def _take_range(self, topic: str, measured: SonarRange, mounting: Mounting) -> None:
        if self._localization.has_begun:
            self.sonars.take(topic, measured, self._localization.way)
            self._localization.take_range(measured, mounting)

    def _on_map(self, message: OccupancyGrid) -> None:
        config = self._node.config
        grid = messages.read_occupancy_grid(message, config.pose.map_frame)
        if not self._has_map:
            self._has_map = True
            occupied_from = config.walls.occupied_from
            self._localization.add_known(walls_of_grid(grid, occupied_from=occupied_from))
