"""The guide_node under test, and a world for it: people who follow, bases that obey `cmd_vel`."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped, Twist, TwistStamped
from mrs_people_msgs.action import GuideTour
from mrs_people_msgs.msg import Group, GuideStatus, People, Person, RobotScan, TourStop
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile

from mrs_ros.qos import MAP, POSES
from ros.harness import Peer
from ros.planner_peer import pose_of
from ros.recording import set_stamp, stamp_of

#: Periods of poses and of people [s].
POSES_S, PEOPLE_S = 0.05, 0.2
#: People walk at up to this speed [m/s] up to this distance of the first robot [m].
SPEED, BEHIND = 1.2, 1.3


class Command(NamedTuple):
    """A velocity that a robot was sent: speed, rate of turn, stamp."""

    robot: str
    v: float
    w: float
    sent_ns: int


class GuideWorld:
    """People who follow the first robot, and robots whose bases obey `cmd_vel`.

    Args:
        peer: A node on the domain; the world lives while it spins.
        namespace: Of all topics, with a slash at both ends.
        places: x, y [m] and yaw [rad] of each robot, by name; the first leads.
        people: Their places [m], shape (n, 2).
        bases: The robots whose bases are there; None: all.
        stamped: Whether bases take TwistStamped, or Twist.

    Attributes:
        commands: What the robots were sent.
        speaks: What of it is published: poses, people.
        last_people_ns: When people were published last, by `time.time_ns`.
    """

    def __init__(
        self,
        peer: Peer,
        namespace: str,
        places: dict[str, tuple[float, float, float]],
        people: Sequence[tuple[float, float]],
        *,
        bases: Sequence[str] | None = None,
        stamped: bool = False,
        speaks: Sequence[str] = ("poses", "people"),
    ) -> None:
        self._stamped = stamped
        self.peer, self.namespace = peer, namespace
        self.places = {robot: np.array(place, dtype=float) for robot, place in places.items()}
        self.people: Any = np.array(people, dtype=float).reshape(-1, 2)
        self.velocity: Any = np.zeros_like(self.people)
        self.speaks = set(speaks)
        self.last_people_ns = 0
        self.commands: list[Command] = []
        self._twists = dict.fromkeys(places, (0.0, 0.0))
        node = peer.node
        self._poses = {
            robot: node.create_publisher(
                PoseWithCovarianceStamped, f"{namespace}{robot}/pose", POSES
            )
            for robot in places
        }
        self._people = node.create_publisher(People, f"{namespace}tracked_people", 10)
        self.map = node.create_publisher(OccupancyGrid, f"{namespace}map", MAP)
        self.path = node.create_publisher(Path, f"{namespace}tour_path", 10)
        self._bases: list[Any] = []
        for robot in places if bases is None else bases:
            self.give_base(robot)
        self.statuses: list[GuideStatus] = peer.hear(GuideStatus, f"{namespace}guide_status")
        self.client = ActionClient(node, GuideTour, f"{namespace}guide_tour")
        self._told_s = 0.0
        self._timer = node.create_timer(POSES_S, self._tick)

    def give_base(self, robot: str) -> None:
        """Subscribes to a robot's `cmd_vel`."""

        def take(message: Any) -> None:
            twist, sent_ns = message, 0
            if self._stamped:
                assert message.header.frame_id == f"{robot}/base_link"
                twist, sent_ns = message.twist, stamp_of(message)
            self.commands.append(Command(robot, twist.linear.x, twist.angular.z, sent_ns))
            self._twists[robot] = twist.linear.x, twist.angular.z

        kind = TwistStamped if self._stamped else Twist
        topic = f"{self.namespace}{robot}/cmd_vel"
        depth = QoSProfile(depth=1000)  # a peer that is late misses nothing
        self._bases.append(self.peer.node.create_subscription(kind, topic, take, depth))

    def give_nav2(self, robot: str) -> tuple[list[Any], list[Any], list[Any]]:
        """Plays a robot's Nav2: goals that start it, goals that move, requests to cancel."""
        prefix, cancelled = f"{self.namespace}{robot}", []
        starts = self.peer.hear(PoseStamped, f"{prefix}/goal_pose")
        updates = self.peer.hear(PoseStamped, f"{prefix}/goal_update")

        def cancel(request: Any, response: Any) -> Any:
            cancelled.append(request)
            return response

        name = f"{prefix}/navigate_to_pose/_action/cancel_goal"
        self.peer.node.create_service(CancelGoal, name, cancel)
        return starts, updates, cancelled

    def close(self) -> None:
        """Ends the world, and a tour in it."""
        node = self.peer.node
        self.path.publish(Path())
        self.peer.spin(0.1)
        node.destroy_timer(self._timer)
        self.client.destroy()
        for publisher in (*self._poses.values(), self._people, self.map, self.path):
            node.destroy_publisher(publisher)
        for subscription in self._bases:
            node.destroy_subscription(subscription)

    # ---- physics ----

    def _tick(self) -> None:
        for robot, place in self.places.items():
            v, w = self._twists[robot]
            place += POSES_S * np.array([v * math.cos(place[2]), v * math.sin(place[2]), w])
        leader = next(iter(self.places.values()))[:2]
        to_leader = leader - self.people
        away = np.linalg.norm(to_leader, axis=1, keepdims=True)
        self.velocity = to_leader / away * np.clip(2.0 * (away - BEHIND), 0.0, SPEED)
        self.people = self.people + POSES_S * self.velocity
        now = time.time_ns()
        if "poses" in self.speaks:
            for robot, place in self.places.items():
                self._poses[robot].publish(pose_of(now, *place))
        if "people" in self.speaks and time.monotonic() >= self._told_s:
            self._told_s = time.monotonic() + PEOPLE_S
            self.last_people_ns = now
            self._people.publish(people_of(now, self.people, self.velocity, list(self.places)))

    # ---- tours ----

    def ask(
        self, goal: GuideTour.Goal, feedback: list[GuideStatus] | None = None
    ) -> tuple[Any, Any]:
        """Asks for a tour: the goal's handle, and the future of its result."""
        self.peer.until(self.client.server_is_ready, "no action guide_tour")

        def take(message: Any) -> None:
            if feedback is not None:
                feedback.append(message.feedback.status)

        sent = self.client.send_goal_async(goal, feedback_callback=take)
        self.peer.until(sent.done, "the goal is not answered")
        handle = sent.result()
        assert handle is not None
        return handle, handle.get_result_async() if handle.accepted else None

    def start(
        self, goal: GuideTour.Goal, feedback: list[GuideStatus] | None = None
    ) -> tuple[Any, Any]:
        """Asks for a tour until it begins: the node may not have heard of this world yet."""
        while True:
            count = len(self.statuses)
            handle, future = self.ask(goal, feedback)
            if future is None:  # others asked too often
                self.peer.spin(0.2)
                continue
            self.peer.until(
                lambda f=future, n=count: f.done() or len(self.statuses) > n,  # type: ignore[misc]
                "no answer",
            )
            if not future.done():
                return handle, future
            reason = future.result().result.message
            assert "nothing c" in reason or "nobody" in reason, reason

    def refused(self, goal: GuideTour.Goal) -> str:
        """Asks for a tour that is aborted at once; its message."""
        _, future = self.ask(goal)
        while future is None:  # it was asked too often
            self.peer.spin(0.2)
            _, future = self.ask(goal)
        self.peer.until(future.done, "no result")
        assert future.result().status == GoalStatus.STATUS_ABORTED
        assert not future.result().result.finished
        return str(future.result().result.message)

    def last_commands(self, robot: str, count: int) -> list[tuple[float, float]]:
        """The last velocities that a robot was sent."""
        return [(one.v, one.w) for one in self.commands if one.robot == robot][-count:]


def people_of(stamp_ns: int, places: Any, velocities: Any, robots: Sequence[str]) -> People:
    """People with ids from 1 on, as one group.

    Args:
        stamp_ns: Stamp [ns].
        places: Where they are [m], shape (n, 2).
        velocities: [m/s], shape (n, 2).
        robots: Those that see them.
    """
    message = People()
    message.header.frame_id = "map"
    set_stamp(message, stamp_ns)
    message.scans = [RobotScan(robot=robot, stamp=message.header.stamp) for robot in robots]
    for number, (place, velocity) in enumerate(zip(places, velocities, strict=True), start=1):
        person = Person(id=number, height=1.7, sigma=0.1, robots=list(robots))
        person.pose.pose.position = Point(x=float(place[0]), y=float(place[1]))
        person.velocity.twist.linear.x = float(velocity[0])
        person.velocity.twist.linear.y = float(velocity[1])
        message.persons.append(person)
    if len(places):
        centre = np.mean(places, axis=0)
        group = Group(id=1, size=len(places), members=range(1, len(places) + 1))
        group.centre.pose.position = Point(x=float(centre[0]), y=float(centre[1]))
        message.groups.append(group)
    return message


def goal_of(
    *points: tuple[float, float],
    stops: Sequence[tuple[str, tuple[float, float], int]] = (),
    name: str = "hall",
    frame_id: str = "map",
) -> GuideTour.Goal:
    """A goal of the action."""
    goal = GuideTour.Goal(name=name, path=path_of(*points, frame_id=frame_id))
    for stop, (x, y), wait in stops:
        made = TourStop(name=stop, position=Point(x=x, y=y))
        made.wait.sec = wait
        goal.stops.append(made)
    return goal


def path_of(*points: tuple[float, float], frame_id: str = "map") -> Path:
    """A path through places."""
    path = Path()
    path.header.frame_id = frame_id
    for x, y in points:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = float(x), float(y)
        path.poses.append(pose)
    return path


def map_of(
    width_m: float, height_m: float, walls: Sequence[tuple[float, float, float, float]]
) -> OccupancyGrid:
    """A map from (-5, -5) on, free but for boxes (x0, y0, x1, y1) [m]."""
    resolution = 0.1
    data = np.zeros((round(height_m / resolution), round(width_m / resolution)), np.int8)
    for x0, y0, x1, y1 in walls:
        columns = slice(round((x0 + 5) / resolution), round((x1 + 5) / resolution))
        rows = slice(round((y0 + 5) / resolution), round((y1 + 5) / resolution))
        data[rows, columns] = 100
    grid = OccupancyGrid()
    grid.header.frame_id = "map"
    grid.info.resolution = resolution
    grid.info.height, grid.info.width = data.shape
    grid.info.origin.position.x = grid.info.origin.position.y = -5.0
    grid.info.origin.orientation.w = 1.0
    grid.data = data.reshape(-1).tolist()
    return grid
