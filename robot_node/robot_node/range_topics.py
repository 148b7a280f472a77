"""The laser scanner and the sonars of a robot, subscribed once for all that use them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sensor_msgs.msg import LaserScan as LaserScanMessage
from sensor_msgs.msg import Range

from mrs_people_loc import messages
from mrs_people_loc.localization.walls.finder import Mounting
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_ros import tf
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import STREAM, TEAM


class RangeTopics:
    """Takes scans and ranges, and gives them to their users with where the sensor is.

    Args:
        node: The robot's node; its section `walls` says which sensors there are.
        base_frame: Its base_link.
        frames: Looks frames up in TF.

    Attributes:
        on_laser: Called for each scan.
        on_range: Called with the topic for each range of a sonar.
    """

    def __init__(self, node: ManagedNode, base_frame: str, frames: tf.FrameListener) -> None:
        self._node, self._base_frame, self._frames = node, base_frame, frames
        self._mountings: dict[str, Mounting] = {}
        self.on_laser: list[Callable[[LaserScan, Mounting], None]] = []
        self.on_range: list[Callable[[str, SonarRange, Mounting], None]] = []

    def start(self) -> None:
        """Subscribes, unless it has."""
        node, config = self._node, self._node.config.walls
        space = str(node.get_namespace()).rstrip("/")
        # Full names: `scan` and others are subjects of findings already.
        if config.laser and f"{space}/scan" not in node.inputs:
            node.listen(LaserScanMessage, f"{space}/scan", self._on_laser, STREAM)
        for k, sonar in enumerate(config.sonars):
            topic = sonar if sonar.startswith("/") else f"{space}/{sonar}"
            given = config.sonar_mountings[3 * k : 3 * k + 3]
            if topic not in node.inputs:
                node.listen(Range, topic, partial(self._on_range, topic, given), TEAM)

    def _on_laser(self, message: LaserScanMessage) -> None:
        scan, given = messages.read_laser_scan(message), self._node.config.walls.laser_mounting
        mounting = self._mounting(scan.frame_id, given)
        for take in self.on_laser:
            take(scan, mounting)

    def _on_range(self, topic: str, given: tuple[float, ...], message: Range) -> None:
        measured = messages.read_range(message)
        mounting = self._mounting(measured.frame_id, given)
        for take in self.on_range:
            take(topic, measured, mounting)

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
