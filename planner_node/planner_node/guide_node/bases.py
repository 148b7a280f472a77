"""How robots are driven: by velocities, or by goals for Nav2."""

from __future__ import annotations

import threading
from collections.abc import Container, Iterable, Mapping
from functools import partial
from typing import Any

from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from rclpy.duration import Duration
from rclpy.qos import QoSProfile

from mrs_people_loc.guiding.drive import Velocity
from mrs_people_loc.guiding.guidance import Post
from mrs_people_loc.guiding.progress import Progress
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_ros.managed_node import ManagedNode

#: Zero velocity is repeated so often after a tour; then others may drive.
_ZEROS = 10
#: What was sent last is waited for so long before a publisher is destroyed [s].
_ACKNOWLEDGED_S = 0.2
#: Only the newest velocity or goal counts.
_COMMANDS = QoSProfile(depth=1)


class Velocities:
    """Drives robots by `<robot>/cmd_vel`, or by the `cmd_vel_guide` of a collision monitor.

    Another thread may `drive` and `keep_standing`.

    Args:
        node: The guide's node.
        stamped: Whether messages are TwistStamped, or Twist.

    Attributes:
        robots: Names of those of the last tour.
    """

    topics = ("cmd_vel", "cmd_vel_guide")

    def __init__(self, node: ManagedNode, *, stamped: bool) -> None:
        self._node = node
        self._type: Any = TwistStamped if stamped else Twist
        self._publishers: dict[str, tuple[str, Any]] = {}  # with their topics
        self.robots: tuple[str, ...] = ()
        self._zeros = 0
        self._is_driven = False
        self._lock = threading.Lock()

    def publishes(self, robot: str, topic: str) -> bool:
        """Whether a robot's commands are published here on one of the topics."""
        return robot in self._publishers and self._publishers[robot][0] == topic

    def begin(self, robots: Iterable[str], monitored: Container[str] = ()) -> None:
        """Takes the robots of a tour, and those of them that a monitor drives.

        A robot that is driven another way from now on gets zero at last on the old one.
        """
        with self._lock:
            self.robots, self._zeros, self._is_driven = tuple(robots), 0, True
            topics = {robot: self.topics[robot in monitored] for robot in self.robots}
            for robot, (topic, publisher) in list(self._publishers.items()):
                if topics.get(robot) != topic:
                    if robot in topics:
                        publisher.publish(self._message(robot, (0.0, 0.0)))
                    self._node.destroy_lifecycle_publisher(publisher)
                    del self._publishers[robot]
            for robot in topics.keys() - self._publishers.keys():
                topic = topics[robot]
                publisher = self._node.offer(self._type, f"{robot}/{topic}", _COMMANDS)
                self._publishers[robot] = topic, publisher

    def drive(self, velocities: Mapping[str, Velocity]) -> None:
        """Sends velocities, unless the tour has ended; robots without one stand."""
        with self._lock:
            if self._is_driven:
                self._send(velocities)

    def _send(self, velocities: Mapping[str, Velocity]) -> None:
        for robot in self.robots:
            message = self._message(robot, velocities.get(robot, (0.0, 0.0)))
            self._publishers[robot][1].publish(message)

    def _message(self, robot: str, velocity: Velocity) -> Any:
        frame_id = f"{self._node.resolve_topic_name(robot).strip('/')}/base_link"
        now_ns = self._node.get_clock().now().nanoseconds
        return convert.velocity(self._type, velocity, now_ns, frame_id)

    def send(self, posts: Mapping[str, Post], poses: Mapping[str, Pose]) -> None:
        """Does nothing: robots are driven to their posts by velocities."""

    def stop(self, poses: Mapping[str, Pose]) -> None:
        """Sends zero now; `keep_standing` repeats it for a while."""
        with self._lock:
            self._zeros, self._is_driven = _ZEROS, False
            self._send({})

    def keep_standing(self, *, always: bool) -> None:
        """Called at the rate of velocities without a tour; always: robots are stopped."""
        with self._lock:
            if self._zeros or always:
                self._zeros = max(self._zeros - 1, 0)
                self._send({})

    def finish(self) -> None:
        """Waits until the last velocities have arrived, before the publishers are destroyed."""
        for robot in self.robots:
            self._publishers[robot][1].wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED_S))


class Goals:
    """Gives robots with Nav2 their goals.

    `<robot>/goal_pose` starts Nav2's navigator, `<robot>/goal_update` moves its goal: its
    GoalUpdater takes goals whose stamps are later than the one before.

    Args:
        node: The guide's node.
        frame_id: The frame of goals: the common one.

    Attributes:
        robots: Names of those of the last tour.
    """

    topics = ("goal_update",)

    def __init__(self, node: ManagedNode, frame_id: str) -> None:
        self._node = node
        self._frame_id = frame_id
        self._publishers: dict[str, tuple[Any, Any, Any]] = {}
        self.robots: tuple[str, ...] = ()
        self._started: dict[str, Progress] = {}  # of the robots for which Nav2 was started
        self._last_ns = 0

    def publishes(self, robot: str, topic: str) -> bool:
        """Whether a robot's goals are published here."""
        return robot in self._publishers

    def begin(self, robots: Iterable[str], monitored: Container[str] = ()) -> None:
        """Takes the robots of a tour."""
        self.robots = tuple(robots)
        self._started.clear()
        for robot in set(self._publishers) - set(self.robots):
            update, start, cancel = self._publishers.pop(robot)
            self._node.destroy_lifecycle_publisher(update)
            self._node.destroy_lifecycle_publisher(start)
            self._node.destroy_client(cancel)
        for robot in self.robots:
            if robot not in self._publishers:
                self._publishers[robot] = self._offer(robot)

    def _offer(self, robot: str) -> tuple[Any, Any, Any]:
        update, start = (
            self._node.offer(PoseStamped, f"{robot}/{topic}", _COMMANDS)
            for topic in (*self.topics, "goal_pose")
        )
        name = f"{robot}/navigate_to_pose/_action/cancel_goal"
        cancel = self._node.create_client(CancelGoal, name)
        self._node.until_cleanup(partial(self._node.destroy_client, cancel))
        return update, start, cancel

    def drive(self, velocities: Mapping[str, Velocity]) -> None:
        """Does nothing: Nav2 drives."""

    def send(self, posts: Mapping[str, Post], poses: Mapping[str, Pose]) -> None:
        """Moves goals to posts; of robots without one, to where these are, so that they stand."""
        for robot in self.robots:
            post, pose = posts.get(robot), poses.get(robot)
            if pose is not None and post is not None:
                self._move(robot, Pose(0, float(post.xy[0]), float(post.xy[1]), post.yaw), pose)
            elif pose is not None and robot in self._started:
                self._move(robot, pose, pose)

    def stop(self, poses: Mapping[str, Pose]) -> None:
        """Ends the navigation of all robots."""
        self.send({}, poses)
        for robot in self._started:
            # No id and no time: all goals.
            self._publishers[robot][2].call_async(CancelGoal.Request())
        self._started.clear()

    def keep_standing(self, *, always: bool) -> None:
        """Does nothing: navigation has ended."""

    def finish(self) -> None:
        """Waits until the last goals have arrived, before the publishers are destroyed."""
        for robot in self.robots:
            self._publishers[robot][0].wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED_S))

    def _move(self, robot: str, goal: Pose, pose: Pose) -> None:
        """Moves the goal of a robot at a pose; starts Nav2 at first, and where it is stuck."""
        update, start, _ = self._publishers[robot]
        message = PoseStamped()
        message.header = convert.header(self._stamp(), self._frame_id)
        message.pose = convert.pose_with_covariance(goal).pose
        if self._is_to_start(robot, goal, pose):
            start.publish(message)
            message.header = convert.header(self._stamp(), self._frame_id)
        update.publish(message)

    def _is_to_start(self, robot: str, goal: Pose, pose: Pose) -> bool:
        """Whether Nav2 has no goal yet, or the robot does not go there."""
        now_ns = self._stamp()
        if robot in self._started:
            return self._started[robot].is_stuck(goal, pose, now_ns)
        self._started[robot] = Progress(pose, now_ns)
        return True

    def _stamp(self) -> int:
        """Now, and later than before [ns]."""
        now_ns = int(self._node.get_clock().now().nanoseconds)
        self._last_ns = max(now_ns, self._last_ns + 1)
        return self._last_ns
