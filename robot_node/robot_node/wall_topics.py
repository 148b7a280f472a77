"""Topics in which localization sees walls: laser scans, ranges of sonars, and the map."""

from __future__ import annotations

from functools import partial

from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan, Range

from mrs_people_loc import messages
from mrs_people_loc.config import WallSensors
from mrs_people_loc.health.sonars import SonarWatch
from mrs_people_loc.localization.robot_localization import RobotLocalization
from mrs_people_loc.localization.walls.finder import Mounting
from mrs_people_loc.localization.walls.known import read_walls, walls_of_grid
from mrs_ros import tf
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import MAP, STREAM, TEAM


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
        base_frame: Its base_link.
        frames: Looks frames up in TF.
        localization: Takes what comes.

    Attributes:
        sonars: Knows which sonars are dead.
    """

    def __init__(
        self,
        node: ManagedNode,
        base_frame: str,
        frames: tf.FrameListener,
        localization: RobotLocalization,
    ) -> None:
        self._node = node
        self._base_frame = base_frame
        self._frames = frames
        self._localization = localization
        self._mountings: dict[str, Mounting] = {}
        self._has_map = False
        self.sonars = SonarWatch()

    def start(self, team: str) -> None:
        """Subscribes to sensors and to the map.

        Args:
            team: The team's namespace, where the map is.
        """
        node, config = self._node, self._node.config.walls
        space = str(node.get_namespace()).rstrip("/")
        # Full names: `scan` and others are subjects of findings already.
        if config.laser:
            node.listen(LaserScan, f"{space}/scan", self._on_laser, STREAM)
        for k, sonar in enumerate(config.sonars):
            topic = sonar if sonar.startswith("/") else f"{space}/{sonar}"
            given = config.sonar_mountings[3 * k : 3 * k + 3]
            node.listen(Range, topic, partial(self._on_range, topic, given), TEAM)
        if config.occupancy_grid:
            node.listen(OccupancyGrid, f"{team}/map", self._on_map, MAP, once=True)

    def _on_laser(self, message: LaserScan) -> None:
        scan, given = messages.read_laser_scan(message), self._node.config.walls.laser_mounting
        if self._localization.has_begun:
            self._localization.take_laser(scan, self._mounting(scan.frame_id, given))

    def _on_range(self, topic: str, given: tuple[float, ...], message: Range) -> None:
        measured = messages.read_range(message)
        if self._localization.has_begun:
            self.sonars.take(topic, measured, self._localization.way)
            mounting = self._mounting(measured.frame_id, given)
            self._localization.take_range(measured, mounting)

    def _mounting(self, frame_id: str, given: tuple[float, ...]) -> Mounting:
        """Where a sensor is in base_link: as configured, or by TF.

        Raises:
            PoseError: TF does not have it.
        """
        if given:
            x, y, yaw = given
            return x, y, yaw
        if frame_id not in self._mountings:
            pose = self._frames.pose(self._base_frame, frame_id)
            self._mountings[frame_id] = pose.x, pose.y, pose.yaw
        return self._mountings[frame_id]

    def _on_map(self, message: OccupancyGrid) -> None:
        config = self._node.config
        grid = messages.read_occupancy_grid(message, config.pose.map_frame)
        if not self._has_map:
            self._has_map = True
            occupied_from = config.walls.occupied_from
            self._localization.add_known(walls_of_grid(grid, occupied_from=occupied_from))
