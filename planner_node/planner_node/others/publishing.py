"""The publishers of people in messages of other packages."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any

from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.timer import Timer
from std_msgs.msg import Header

from mrs_people_loc.config import PEOPLE_TOPICS, PlannerConfig
from mrs_people_loc.people import Group, Person
from mrs_people_loc.planner import People
from mrs_people_loc.team.masking import OccupancyGrid as Grid
from mrs_ros import convert, tf
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import MAP
from planner_node.others import costmap, detections, social
from planner_node.others.frames import person_frames
from planner_node.others.hri import Humans

#: Silence of the planner is looked for so often, where there is no people_costmap [s].
_LOOK_S = 0.5

_Publish = Callable[[Header, Sequence[Person], Sequence[Group]], None]


class Others:
    """People in messages of other packages, those that are wanted and installed.

    What keeps the last message for ever shall not keep people who are gone: when the planner stops
    or has no interval for `interval.robot_timeout`, nobody is published once.

    Args:
        node: The planner's node.

    Raises:
        ConfigError: Frames are wanted, and tf2_msgs is not installed.
    """

    def __init__(self, node: ManagedNode) -> None:
        self._node = node
        self._config: PlannerConfig = node.config
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._last: tuple[Sequence[Person], int] = (), 0  # with when it came, by _steady [ns]
        self._timer: Timer | None = None
        self._map: tuple[MapMetaData, Grid] | None = None
        self._lacks_map = False
        self._made: list[_Publish] = []
        self._costmap: Any = None
        self._absent: list[str] = []  # packages that are wanted
        self._make()
        if self._absent:
            self._say(f"not installed, so not published: {', '.join(self._absent)}")

    @property
    def needs_map(self) -> bool:
        """Whether the map is of use here."""
        return self._costmap is not None

    def start(self) -> None:
        """Begins to publish at a rate, and to look for silence."""
        if self._costmap is not None or self._made:
            rate = self._config.outputs.costmap_rate
            period_s = 1.0 / rate if self._costmap is not None else _LOOK_S
            self._timer = self._node.create_timer(period_s, self._tick, clock=self._steady)

    def stop(self) -> None:
        """Publishes that nobody is there, and no more."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None
        self._publish_nobody()

    def take_map(self, message: OccupancyGrid, grid: Grid) -> None:
        """Takes the map, as it came and as it was read."""
        self._map = message.info, grid

    def publish(self, result: People) -> None:
        """Publishes an interval."""
        self._last = result.persons, self._steady.now().nanoseconds
        if self._made:
            header = convert.header(result.stamp_ns, self._config.map_frame)
            for publish in self._made:
                publish(header, result.persons, result.groups)

    def _make(self) -> None:
        wanted = self._config.outputs
        if wanted.people_msgs and self._config.people_topic == PEOPLE_TOPICS[1]:
            self._say("people_topic is people, so people_msgs/People is not published")
        elif wanted.people_msgs:
            self._offer("people_msgs", "People", PEOPLE_TOPICS[1], social.people)
        if wanted.vision_msgs:
            topic = "people_detections"
            self._offer("vision_msgs", "Detection3DArray", topic, detections.detections)
        if wanted.hri_msgs and (messages := self._messages("hri_msgs", "REP 155 on /humans")):
            self._made.append(Humans(self._node, messages).publish)
        if wanted.person_frames:
            tf.require("tf2_msgs", "outputs.person_frames is true; allowed here: false")
            frames = tf.FramePublisher(self._node.offer)
            self._made.append(
                lambda header, persons, _: frames.moving(*person_frames(header, persons))
            )
        if wanted.people_costmap:
            self._costmap = self._node.offer(OccupancyGrid, "people_costmap", MAP)

    def _offer(
        self, package: str, kind: str, topic: str, converted: Callable[[Header, Any, Any], Any]
    ) -> None:
        """Makes the publisher of a message with all people, if its package is installed."""
        what = f"{package}/{kind} on {self._node.resolve_topic_name(topic)}"
        if messages := self._messages(package, what):
            publisher = self._node.offer(getattr(messages, kind), topic, 10)
            self._made.append(
                lambda header, persons, _: publisher.publish(converted(header, persons, messages))
            )

    def _messages(self, package: str, what: str) -> Any:
        """A package's messages; None if it is not installed."""
        try:
            messages = importlib.import_module(f"{package}.msg")
        except ImportError:
            self._absent.append(package)
            return None
        self._say(f"also published: {what}")
        return messages

    def _say(self, text: str) -> None:
        self._node.get_logger().info(text)

    def _tick(self) -> None:
        persons, came_ns = self._last
        silent_s = (self._steady.now().nanoseconds - came_ns) / 1e9
        if persons and silent_s > self._config.interval.robot_timeout:
            self._publish_nobody()
        if self._costmap is not None and self._costmap.get_subscription_count():
            self._publish_costmap()

    def _publish_nobody(self) -> None:
        self._last = (), 0
        for publish in self._made:
            publish(self._header_of_now(), (), ())

    def _publish_costmap(self) -> None:
        if self._map is not None:
            grid = costmap.occupancy_grid(self._header_of_now(), *self._map, self._last[0])
            self._costmap.publish(grid)
        elif not self._lacks_map:
            self._lacks_map = True
            topic = self._node.resolve_topic_name("map")
            self._node.get_logger().warning(f"no people_costmap yet: nothing came on {topic}")

    def _header_of_now(self) -> Header:
        now_ns = self._node.get_clock().now().nanoseconds
        return convert.header(now_ns, self._config.map_frame)
