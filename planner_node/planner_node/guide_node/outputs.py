"""What the guide publishes of a tour, besides the robots' commands."""

from __future__ import annotations

from collections.abc import Mapping

from mrs_people_msgs.msg import GuideStatus
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mrs_people_loc.guiding.guidance import Guidance
from mrs_people_loc.guiding.tour import Tour
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_ros.managed_node import ManagedNode
from mrs_ros.markers import tour_markers


class Outputs:
    """The guide's publishers.

    Args:
        node: The guide's node.
    """

    def __init__(self, node: ManagedNode) -> None:
        self._node = node
        self._status = node.offer(GuideStatus, "guide_status", 10)
        self._events = node.offer(String, "events", 10)
        self._markers = node.offer(MarkerArray, "guide_markers", 2)

    def publish(
        self, tour: Tour | None, guidance: Guidance, poses: Mapping[str, Pose], frame_id: str
    ) -> GuideStatus:
        """Publishes how a tour goes on, or that there is none; markers only if somebody subscribes.

        Returns:
            The message on `guide_status`.
        """
        status = convert.guide_status("" if tour is None else tour.name, guidance, poses, frame_id)
        self._status.publish(status)
        for event in guidance.events:
            self.say(event)
        if tour is not None and self._markers.get_subscription_count():
            self._markers.publish(tour_markers(tour, guidance, frame_id))
        return status

    def say(self, event: str) -> None:
        """Publishes a sentence on `events`, and logs it."""
        self._node.get_logger().info(event)
        self._events.publish(String(data=event))
