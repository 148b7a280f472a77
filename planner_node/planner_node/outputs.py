"""What the planner publishes of an interval."""

from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import PointStamped, PoseArray
from mrs_people_msgs.msg import People as PeopleMessage
from mrs_people_msgs.msg import RelativePoses
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.localization.shared import TeamMeasurement
from mrs_people_loc.planner import People
from mrs_ros import convert
from mrs_ros.managed_node import ManagedNode
from mrs_ros.markers import Trails, markers
from mrs_ros.qos import TEAM


class Outputs:
    """The planner's publishers.

    Args:
        node: The planner's node.
    """

    def __init__(self, node: ManagedNode) -> None:
        self._node = node
        self._trails = Trails()
        self._people = node.offer(PeopleMessage, node.config.people_topic, 10)
        self._people_poses = node.offer(PoseArray, "people_poses", 10)
        self._group_centroid = node.offer(PointStamped, "group_centroid", 10)
        self._short_term_map = node.offer(PointCloud2, "short_term_map", 2)
        self._events = node.offer(String, "events", 10)
        self._markers = node.offer(MarkerArray, "markers", 2)
        self._relative_poses = node.offer(RelativePoses, "relative_poses", TEAM)

    @property
    def wants_relative_poses(self) -> bool:
        """Whether anybody subscribes to `relative_poses`."""
        return bool(self._relative_poses.get_subscription_count())

    def publish_relative_poses(
        self, stamp_ns: int, measured: Sequence[TeamMeasurement], config: PlannerConfig
    ) -> None:
        """Publishes where robots are to each other; `stamp_ns` is that of the interval."""
        message = convert.relative_poses(stamp_ns, config.map_frame, measured)
        self._relative_poses.publish(message)

    def reset(self) -> None:
        """Forgets the trails; publishes on `events` that everybody is new."""
        self._trails = Trails()
        self._events.publish(String(data="the time jumped back: everybody is new"))

    def publish_event(self, event: str) -> None:
        """Publishes a sentence on `events`, and logs it."""
        self._node.get_logger().info(event)
        self._events.publish(String(data=event))

    def publish(self, result: People, config: PlannerConfig) -> None:
        """Publishes an interval; the map and the markers only while somebody subscribes."""
        frame = config.map_frame
        self._people.publish(convert.people(result, frame))
        self._people_poses.publish(convert.people_poses(result, frame))
        centroid = convert.group_centroid(result, frame)
        if centroid is not None:
            self._group_centroid.publish(centroid)
        for event in result.events:
            self.publish_event(event)
        if self._short_term_map.get_subscription_count():
            self._short_term_map.publish(convert.short_term_map(result, frame))
        self._trails.add(result)
        if self._markers.get_subscription_count():
            drawn = markers(result, frame, config.human.circle_sigmas, self._trails.places())
            self._markers.publish(drawn)
