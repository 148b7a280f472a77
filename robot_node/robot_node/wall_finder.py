"""Walls for localization: from views of the head, laser scans, sonars, files and maps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan, Range

from mrs_people_loc import messages
from mrs_people_loc.arrays import Float
from mrs_people_loc.config import RobotConfig, WallSensors
from mrs_people_loc.localization.known_walls import read_walls, walls_of_grid
from mrs_people_loc.localization.laser_walls import walls_of_laser
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.people_in_view import people_in
from mrs_people_loc.localization.shared import SeenWalls
from mrs_people_loc.localization.sonar_walls import SonarWalls
from mrs_people_loc.localization.stereo_walls import StereoWalls
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.robot import Stages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.poses import Pose
from mrs_ros import tf
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import MAP, STREAM, TEAM

#: Where a sensor is in base_link: x, y [m], yaw [rad].
Mounting = tuple[float, float, float]
#: The people of a view are left out of laser scans for so long [ns].
_PEOPLE_FOR_NS = 500_000_000
_NO_PEOPLE: Float = np.empty((0, 2))


def check(config: WallSensors) -> None:
    """Checks that known walls can be read, and that mountings are given or can be had from TF.

    Raises:
        ConfigError: They cannot.
    """
    known_walls(config)
    if config.laser and not config.laser_mounting:
        tf.require("tf2_ros", "walls.laser_mounting is empty; allowed here: x, y, yaw")
    if config.sonars and not config.sonar_mountings:
        tf.require("tf2_ros", "walls.sonar_mountings is empty; allowed here: x, y, yaw of each")


def known_walls(config: WallSensors) -> Walls | None:
    """The walls of the configured file; None: there is none.

    Raises:
        ConfigError: It cannot be read.
    """
    return read_walls(config.file) if config.file else None


class WallFinder:
    """Finds walls for the localization of a robot.

    Args:
        node: The robot's node.
        base_frame: Its base_link.
        look_up: Says where a frame (the second) is in another one, by TF.
        take_known: Takes the walls of the map.
    """

    def __init__(
        self,
        node: ManagedNode,
        base_frame: str,
        look_up: Callable[[str, str], Pose],
        take_known: Callable[[Walls], None],
    ) -> None:
        self._node = node
        self._base_frame = base_frame
        self._look_up = look_up
        self._take_known = take_known
        self._config: RobotConfig = node.config
        self._localizer: Localizer | None = None
        self._stereo: StereoWalls | None = None
        self._sonar = SonarWalls()
        self._people = 0, _NO_PEOPLE
        self._mountings: dict[str, Mounting] = {}
        self._has_map = False

    def start(self, team: str) -> None:
        """Subscribes to sensors and to the map.

        Args:
            team: The team's namespace, where the map is.
        """
        node, config = self._node, self._config.walls
        space = str(node.get_namespace()).rstrip("/")
        # Full names: `scan` and others are subjects of findings already.
        if config.laser:
            node.listen(LaserScan, f"{space}/scan", self._on_laser, STREAM)
        for k, sonar in enumerate(config.sonars):
            topic = sonar if sonar.startswith("/") else f"{space}/{sonar}"
            node.listen(Range, topic, partial(self._on_range, k), TEAM)
        if config.occupancy_grid:
            node.listen(OccupancyGrid, f"{team}/map", self._on_map, MAP, once=True)

    def begin_anew(self, localizer: Localizer | None) -> None:
        """Forgets what was seen; finds walls for a new localizer, or for none."""
        self._localizer = localizer
        self._sonar = SonarWalls()
        self._people = 0, _NO_PEOPLE

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters."""
        self._config = config

    def take_view(self, stages: Stages, camera: StereoCamera) -> None:
        """Takes a view of the head, after its people were found."""
        scan = stages.scan
        people = people_in(scan)
        self._people = scan.stamp_ns, people
        if self._localizer is None or not self._config.walls.stereo:
            return
        if self._stereo is None or self._stereo.camera is not camera:
            self._stereo = StereoWalls(camera)
        self._take(self._stereo.step(stages.disparity, scan.stamp_ns, people))

    def _take(self, seen: SeenWalls) -> None:
        if self._localizer is not None and len(seen.walls):
            self._localizer.take_walls(seen)

    def _on_laser(self, message: LaserScan) -> None:
        scan, config = messages.read_laser_scan(message), self._config.walls
        if self._localizer is None:
            return
        stamp_ns, people = self._people
        if abs(scan.stamp_ns - stamp_ns) > _PEOPLE_FOR_NS:
            people = _NO_PEOPLE
        walls = walls_of_laser(
            scan.ranges,
            scan.angles,
            sigma=config.laser_sigma,
            max_range=scan.max_range,
            mounting=self._mounting(scan.frame_id, config.laser_mounting),
            people=people,
        )
        self._take(SeenWalls(scan.stamp_ns, walls))

    def _on_range(self, index: int, message: Range) -> None:
        measured = messages.read_range(message)
        if self._localizer is None:
            return
        given = self._config.walls.sonar_mountings[3 * index : 3 * index + 3]
        mounting = self._mounting(measured.frame_id, given)
        odometry = self._localizer.odometry_at(measured.stamp_ns)
        seen = self._sonar.take(measured, mounting, odometry)
        if seen is not None:
            self._take(seen)

    def _mounting(self, frame_id: str, given: tuple[float, ...]) -> Mounting:
        """Where a sensor is in base_link: as configured, or by TF.

        Raises:
            PoseError: TF does not have it.
        """
        if given:
            x, y, yaw = given
            return x, y, yaw
        if frame_id not in self._mountings:
            pose = self._look_up(self._base_frame, frame_id)
            self._mountings[frame_id] = pose.x, pose.y, pose.yaw
        return self._mountings[frame_id]

    def _on_map(self, message: OccupancyGrid) -> None:
        grid = messages.read_occupancy_grid(message, self._config.pose.map_frame)
        if not self._has_map:
            self._has_map = True
            occupied_from = self._config.walls.occupied_from
            self._take_known(walls_of_grid(grid, occupied_from=occupied_from))
