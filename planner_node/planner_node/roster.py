"""The robots that the planner subscribes to: as listed in `robots`, or discovered."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import PointCloud2

from mrs_ros.diagnostics import Input
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import POSES, STREAM

_POINTS = "sensor_msgs/msg/PointCloud2"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
#: A discovered robot has left when its topics had no publisher for this long [s].
_LEFT_S = 30.0


class Roster:
    """The robots, and their topics `points` and `pose`.

    Args:
        node: The planner's node.
        on_points: Takes a robot's name and a message on its `points`.
        on_pose: Likewise, on its `pose`.

    Attributes:
        robots: Their names.
    """

    def __init__(
        self,
        node: ManagedNode,
        on_points: Callable[[str, PointCloud2], None],
        on_pose: Callable[[str, PoseWithCovarianceStamped], None],
    ) -> None:
        self.robots: list[str] = []
        self._node = node
        self._topics: dict[str, tuple[Any, Callable[[str, Any], None], Any]] = {
            "points": (PointCloud2, on_points, STREAM),
            "pose": (PoseWithCovarianceStamped, on_pose, POSES),
        }

    def add(self, robot: str) -> None:
        """Subscribes to a robot."""
        self.robots.append(robot)
        for topic, (kind, callback, qos) in self._topics.items():
            self._node.listen(kind, f"{robot}/{topic}", partial(callback, robot), qos)

    def input(self, robot: str, topic: str) -> Input:
        """The input of a robot's `points` or `pose`."""
        return self._node.inputs[f"{robot}/{topic}"]

    def discover(self) -> None:
        """Adds every namespace under the planner's own that publishes `points` and `pose`."""
        own = self._node.get_namespace().rstrip("/") + "/"
        topics = dict(self._node.get_topic_names_and_types())
        for name, types in topics.items():
            namespace, _, last = name.rpartition("/")
            robot = namespace.removeprefix(own)
            if last != "points" or _POINTS not in types or not namespace.startswith(own):
                continue
            if robot in self.robots or _POSE not in topics.get(f"{namespace}/pose", []):
                continue
            if all(self._node.count_publishers(f"{namespace}/{topic}") for topic in self._topics):
                self._node.get_logger().warning(
                    f"found {robot}, and takes it for one of the team, as any namespace that "
                    "publishes `points` and `pose`; to take only your own, list them in "
                    f"`robots: [{', '.join([*self.robots, robot])}]`"
                )
                self.add(robot)

    def drop_absent(self) -> list[str]:
        """Ends the subscriptions to robots that have left.

        Returns:
            Their names.
        """
        left = []
        for robot in list(self.robots):
            inputs = [self.input(robot, topic) for topic in self._topics]
            if all(one.silent_s > _LEFT_S and not one.publishers for one in inputs):
                self._node.get_logger().info(f"{robot} has left")
                self.robots.remove(robot)
                for one in inputs:
                    self._node.end(one)
                left.append(robot)
        return left
