"""TF, where it is installed: frames are published with tf2_msgs and looked up with tf2_ros."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from mrs_people_loc import messages
from mrs_people_loc.errors import ConfigError, PoseError
from mrs_people_loc.team.poses import Pose

#: As tf2_ros' broadcasters have it.
_TF_QOS = QoSProfile(depth=100)
_STATIC_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def installed(package: str) -> bool:
    """Whether one of TF's packages, `tf2_msgs` or `tf2_ros`, is installed."""
    return importlib.util.find_spec(package) is not None


def require(package: str, what: str) -> None:
    """Checks that one of TF's packages is installed.

    Args:
        package: `tf2_msgs` or `tf2_ros`.
        what: What needs it, and what else is allowed: "pose.source is tf; allowed here: odom".

    Raises:
        ConfigError: It is not.
    """
    if not installed(package):
        subject, _, allowed = what.partition("; ")
        raise ConfigError(
            f"{subject}; needs {package}, which is not installed: sudo apt install "
            f"ros-jazzy-{package.replace('_', '-')}; {allowed}"
        )


class FramePublisher:
    """Publishes frames on `/tf` and `/tf_static`.

    Args:
        offer: Makes a publisher of message type, topic and quality of service.
    """

    def __init__(self, offer: Callable[[Any, str, QoSProfile], Any]) -> None:
        self._message: Any = importlib.import_module("tf2_msgs.msg").TFMessage
        self._moving = offer(self._message, "/tf", _TF_QOS)
        self._fixed = offer(self._message, "/tf_static", _STATIC_QOS)

    def moving(self, *transforms: TransformStamped) -> None:
        """Publishes where frames are at their stamps."""
        self._moving.publish(self._message(transforms=transforms))

    def fixed(self, *transforms: TransformStamped) -> None:
        """Publishes all fixed frames: late subscribers get only the last message."""
        self._fixed.publish(self._message(transforms=transforms))


class FrameListener:
    """Looks frames up; it receives them from the first look-up on, until it is destroyed.

    Args:
        node: The node that subscribes.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._tf2_ros: Any = None
        self._buffer: Any = None

    def _start(self) -> None:
        self._tf2_ros = importlib.import_module("tf2_ros")
        self._buffer = self._tf2_ros.Buffer(node=self._node)
        # Its own way to forget when time jumps back fails in some releases; `clear` does that.
        self._buffer.jump_handle.unregister()
        self._listener = self._tf2_ros.TransformListener(self._buffer, self._node)

    def destroy(self) -> None:
        """Ends the subscriptions; the next look-up begins again."""
        if self._buffer is not None:
            self._listener.unregister()
            self._node.destroy_service(self._buffer.srv)
            self._buffer = None

    def clear(self) -> None:
        """Forgets all frames: the time was set back."""
        if self._buffer is not None:
            self._buffer.clear()

    def pose(self, parent: str, child: str, sigmas: tuple[float, ...] = ()) -> Pose:
        """The newest pose of a frame in another one.

        Args:
            parent: The frame it is given in.
            child: The frame that is asked for.
            sigmas: Standard deviations that it gets: x, y [m] and yaw [rad]; empty: exact.

        Returns:
            The pose; with stamp 0 if it holds at any time.

        Raises:
            PoseError: TF does not have it, or it is no pose on the floor.
        """
        if self._buffer is None:
            self._start()
        try:
            found = self._buffer.lookup_transform(parent, child, Time())
        except self._tf2_ros.TransformException as err:
            raise PoseError(f"TF has no {parent} -> {child}: {err}") from err
        try:
            return messages.read_transform(found, sigmas)
        except PoseError as err:
            raise PoseError(f"TF {parent} -> {child}: {err}") from err
