"""STAND-IN for tf2_ros, for tests where it cannot be installed; never part of what is shipped.

It has what `mrs_ros.tf` uses of the real one (Jazzy), by the same names: a buffer that answers with
the newest time at which the whole chain is known, which is 0 if all of it is static; a listener;
the errors. Frames only down from the parent, no interpolation, no look-up at another time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage


class TransformException(Exception):  # noqa: N818 - the real one's name
    """Root of tf2's errors."""


class LookupException(TransformException):
    """A frame is not known."""


class Buffer:
    """What was heard last of each frame."""

    def __init__(self, *, node: Node) -> None:
        self._heard: dict[str, tuple[TransformStamped, bool]] = {}
        self.srv = node.create_service(Empty, "tf2_frames", lambda request, response: response)
        threshold = JumpThreshold(
            min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True
        )
        self.jump_handle = node.get_clock().create_jump_callback(
            threshold, post_callback=lambda jump: self.clear()
        )

    def clear(self) -> None:
        """Forgets what moves."""
        self._heard = {child: known for child, known in self._heard.items() if known[1]}

    def set(self, message: TFMessage, *, static: bool) -> None:
        """Takes what was heard."""
        for transform in message.transforms:
            self._heard[transform.child_frame_id] = transform, static

    def lookup_transform(self, target: str, source: str, when: Time) -> TransformStamped:
        """Where `source` is in `target`."""
        assert when == Time()
        matrix, frame = np.eye(4), source
        stamps: list[Any] = []
        while frame != target:
            if frame not in self._heard:
                raise LookupException(f'"{frame}" is not connected to "{target}"')
            found, static = self._heard[frame]
            matrix = _matrix(found.transform) @ matrix
            frame = found.header.frame_id
            if not static:
                stamps.append(found.header.stamp)
        made = TransformStamped(child_frame_id=source)
        made.header.frame_id = target
        if stamps:
            made.header.stamp = min(stamps, key=lambda stamp: (stamp.sec, stamp.nanosec))
        (x, y, z), turn = matrix[:3, 3].tolist(), made.transform.rotation
        made.transform.translation.x, made.transform.translation.y = x, y
        made.transform.translation.z = z
        yaw = np.arctan2(matrix[1, 0], matrix[0, 0])  # all frames of the tests stand upright
        turn.z, turn.w = float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
        return made


class TransformListener:
    """Feeds a buffer from `/tf` and `/tf_static`."""

    def __init__(self, buffer: Buffer, node: Node) -> None:
        self._node = node
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._subscriptions = [
            node.create_subscription(TFMessage, "/tf", lambda m: buffer.set(m, static=False), 100),
            node.create_subscription(
                TFMessage, "/tf_static", lambda m: buffer.set(m, static=True), latched
            ),
        ]

    def unregister(self) -> None:
        """Ends hearing."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)


def _matrix(transform: Any) -> np.ndarray:
    q, place = transform.rotation, transform.translation
    yaw = 2.0 * np.arctan2(q.z, q.w)
    made = np.eye(4)
    made[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    made[:3, 3] = place.x, place.y, place.z
    return made
