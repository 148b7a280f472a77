"""A running team as the source of `mrs view`."""

from __future__ import annotations

import io
import math
import queue
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any

from mrs_people_loc import messages
from mrs_people_loc.config import PEOPLE_TOPICS
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.tour import Tour
from mrs_tools.live.people_table import follow_clock
from mrs_tools.plain import plain
from mrs_tools.view import health, protocol
from mrs_tools.view.live_tours import LiveTours
from mrs_tools.view.pictures import grid_of
from mrs_tools.view.protocol import (
    CommandError,
    Control,
    Look,
    Publish,
    ReleaseRobots,
    StartTour,
    StopRobots,
)
from mrs_tools.view.robot_views import HeadSettings, RobotViews
from mrs_tools.view.state import HeadView, TeamState

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.node import Node

#: What viewers ask for is taken up this often [s].
_TICK_S = 0.05
#: Without people, a state is sent this often [s].
_IDLE_S = 0.4
#: Walls and map are sent at most this often, and walls of a robot that says no more are kept [s].
_MAP_S, _WALLS_S = 2.0, 5.0
#: Robots that have been gone for longer are forgotten [s].
_FORGET_S = 600.0
#: The team's nodes are looked at this often [s].
_HEALTH_S = 1.0
#: A team that was started only now is well for so long, or until people have come for so long [s].
_START_S, _SETTLE_S = 60.0, 3.0
_POINTS = "sensor_msgs/msg/PointCloud2"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_PEOPLE = "mrs_people_msgs/msg/People"


class LiveSource:
    """A running team.

    Args:
        namespace: The planner's.
        control: Whether viewers may start and cancel tours.
        tours: Those that they may start, by name.
        starting: Whether the team starts only now: until people come, its nodes lack all kinds of
            things, which are no troubles.
    """

    def __init__(
        self,
        namespace: str = "",
        *,
        control: bool = False,
        tours: Mapping[str, Tour] | None = None,
        starting: bool = False,
    ) -> None:
        self._namespace, self._may_control, self._tours = namespace, control, dict(tours or {})
        self._starting = starting
        self._stack = ExitStack()
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self._team: _Team | None = None
        self._live_tours: LiveTours | None = None
        self._title = "live"

    def hello(self) -> protocol.Hello:
        """What is shown."""
        return protocol.Hello(
            type="hello",
            version=protocol.VERSION,
            mode="live",
            title=self._title,
            control=self._may_control,
            bag=None,
            tours=list(self._tours),
        )

    def start(self, publish: Publish) -> None:
        """Joins the ROS domain, and begins to listen."""
        from mrs_tools.tool_node import node

        listening = self._stack.enter_context(node("mrs_view", namespace=self._namespace))
        context = listening.context
        looking = self._stack.enter_context(
            node("mrs_view_health", context, namespace=self._namespace)
        )
        domain = f"ROS domain {context.get_domain_id()}"
        self._title = f"{domain}, {self._namespace}" if self._namespace else domain
        self._team = _Team(listening, publish)
        self._live_tours = LiveTours(self._namespace, context, publish, self._team.now_s)
        watch = _Watch(looking, self._team, publish, starting=self._starting)
        for name, made, step in (
            ("listen", listening, lambda spin: spin()),
            ("health", looking, watch.step),
        ):
            thread = threading.Thread(
                target=self._run, args=[name, made, step, publish], name=f"view {name}", daemon=True
            )
            self._threads.append(thread)
            thread.start()

    def look(self, wanted: Look) -> None:
        """Takes what viewers look at."""
        if self._team is not None:
            self._team.do(partial(self._team.views.look, wanted))

    def control(self, command: Control) -> str:
        """Starts or cancels a tour; stops robots at once, or releases them."""
        assert self._live_tours is not None
        assert self._team is not None
        if isinstance(command, StopRobots):
            return self._team.stop_robots()
        if isinstance(command, ReleaseRobots):
            return self._live_tours.release()
        if isinstance(command, StartTour):
            return self._live_tours.start(self._tours[command.name])
        return self._live_tours.cancel()

    def close(self) -> None:
        """Leaves the ROS domain; a tour that was started here is cancelled."""
        if self._live_tours is not None:
            self._live_tours.close()
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._stack.close()

    def _run(
        self, name: str, node: Node, step: Callable[[Callable[[], None]], None], publish: Publish
    ) -> None:
        """Lets a node work until the end; what goes wrong is printed, and told to viewers."""
        executor = make_executor(node.context)
        executor.add_node(node)
        try:
            while not self._stop.is_set():
                step(lambda: executor.spin_once(timeout_sec=0.1))
        except Exception as err:
            traceback.print_exc()
            text = f"its thread {name!r} has failed: {err}"
            finding = _own_finding("error", text, "end mrs view and start it again")
            publish(health.health_of([], [finding]))
        finally:
            executor.shutdown()


def make_executor(context: Context) -> Any:
    """The executor of a node: rclpy's experimental one of events, or its usual one without that."""
    from rclpy.executors import SingleThreadedExecutor

    try:
        from rclpy.experimental import EventsExecutor

        return EventsExecutor(context=context)
    except (ImportError, io.UnsupportedOperation):  # it wants a stderr that is a file, too
        return SingleThreadedExecutor(context=context)


class _Team:
    """What is heard of a team; used in the thread of its node, `do` apart.

    Args:
        node: The ROS node to listen with.
        publish: Takes what there is to show.

    Attributes:
        views: What robots see.
        refused: By topic whose last message was refused: why.
        people_since_s: When the first people came, by the steady clock [s]; inf: none have.
    """

    def __init__(self, node: Node, publish: Publish) -> None:
        from mrs_people_msgs.msg import GuideStatus, People
        from nav_msgs.msg import OccupancyGrid
        from rclpy.clock import Clock
        from rclpy.clock_type import ClockType
        from std_msgs.msg import Empty, String
        from visualization_msgs.msg import MarkerArray

        from mrs_ros.qos import MAP

        self._node, self._publish = node, publish
        self._state = TeamState()
        self.views = RobotViews(node, publish, self.now_s)
        self.refused: dict[str, str] = {}
        self.people_since_s = math.inf
        self._todo: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._there_s: dict[str, float] = {}  # when robots were there last, by the steady clock
        self._raw_poses: dict[str, bytes] = {}
        self._pose_subscriptions: dict[str, Any] = {}
        self._infos: dict[str, Any] = {}
        self._reaches: dict[str, float] = {}
        self._stated_s = self._mapped_s = 0.0
        self._grid: protocol.Grid | None = None
        self._walls: dict[str, tuple[float, list[list[float]]]] = {}
        self._map: protocol.Map | None = None
        self._people_type = People
        self._people_topics: set[str] = set()
        self._hear_people(node.resolve_topic_name(PEOPLE_TOPICS[0]))
        self._stops = node.create_publisher(Empty, "stop", 1)
        self._stop_type = Empty
        node.create_subscription(String, "events", self._on_event, 10)
        node.create_subscription(GuideStatus, "guide_status", self._on_status, 10)
        node.create_subscription(OccupancyGrid, "map", self._on_map, MAP)
        node.create_subscription(MarkerArray, "walls", self._on_walls, 10)
        follow_clock(node)
        node.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def now_s(self) -> float:
        """The ROS time [s]."""
        return float(self._node.get_clock().now().nanoseconds / 1e9)

    # ---- from other threads ----

    def do(self, work: Callable[[], object]) -> None:
        """Lets something be done in the node's thread, in a moment."""
        self._todo.put(work)

    def stop_robots(self) -> str:
        """Lets the robots of the guide stand.

        Raises:
            CommandError: There is no guide_node.
        """
        if not self._stops.get_subscription_count():
            raise CommandError("there is no guide_node; stop the robots yourself")
        self._stops.publish(self._stop_type())
        return "guide_node is told to stop the robots"

    # ---- who is there ----

    def take_robots(self, robots: frozenset[str], people_topics: frozenset[str]) -> None:
        """Subscribes to robots that have come, and to people under other names.

        Robots that have been gone for `_FORGET_S` are forgotten; until then it is shown where they
        were.
        """
        from geometry_msgs.msg import PoseWithCovarianceStamped

        from mrs_ros.qos import POSES

        for topic in people_topics - self._people_topics:
            self._hear_people(topic)
        now_s = time.monotonic()
        self._there_s |= dict.fromkeys(robots, now_s)
        gone = {robot for robot, last_s in self._there_s.items() if now_s - last_s > _FORGET_S}
        self.views.robots = (self.views.robots | robots) - gone
        for robot in gone:
            self._forget(robot)
        for robot in robots - self._pose_subscriptions.keys():
            # Bytes: of up to 100 a second, those that are shown are decoded.
            self._pose_subscriptions[robot] = self._node.create_subscription(
                PoseWithCovarianceStamped,
                f"{robot}/pose",
                partial(self._raw_poses.__setitem__, robot),
                POSES,
                raw=True,
            )

    def _forget(self, robot: str) -> None:
        for subscriptions in (self._pose_subscriptions, self._infos):
            if robot in subscriptions:
                self._node.destroy_subscription(subscriptions.pop(robot))
        by_robot: tuple[dict[str, Any], ...] = (
            self._there_s, self._raw_poses, self._reaches, self.views.heads,
        )  # fmt: skip
        for known in by_robot:
            known.pop(robot, None)
        self._state.forget_robot(robot)

    def take_head(self, robot: str, settings: HeadSettings, reach: float) -> None:
        """Takes what a robot's node says of its head; the calibration is listened for, once."""
        from sensor_msgs.msg import CameraInfo

        from mrs_ros.qos import STREAM

        self.views.heads[robot] = settings
        before = self._state.heads.get(robot)
        if robot in self._infos or (before is not None and before.reach == reach):
            return
        self._reaches[robot] = reach
        self._infos[robot] = self._node.create_subscription(
            CameraInfo, f"{robot}/left/camera_info", partial(self._on_info, robot), STREAM
        )

    def take_notes(self, notes: Mapping[str, str]) -> None:
        """Takes which robots are not well."""
        self._state.notes = notes

    def _hear_people(self, topic: str) -> None:
        self._people_topics.add(topic)
        self._node.create_subscription(self._people_type, topic, self._on_people, 10)

    # ---- what comes ----

    def _on_people(self, message: Any) -> None:
        with _Refusing(self.refused, "people"):
            self._state.take_people(message, time.monotonic())
            self.people_since_s = min(self.people_since_s, time.monotonic())
            self._send_state()
            self.views.cells(
                messages.stamp_ns_of(message.header.stamp), messages.read_people_scans(message)
            )

    def _on_event(self, message: Any) -> None:
        text = plain(message.data)[:500]
        self._publish(protocol.Event(type="event", t=round(self.now_s(), 3), text=text))

    def _on_status(self, message: Any) -> None:
        self._state.take_status(message, time.monotonic())

    def _on_info(self, robot: str, message: Any) -> None:
        subscription = self._infos.pop(robot, None)
        if subscription is None:
            return
        self._node.destroy_subscription(subscription)
        with _Refusing(self.refused, f"{robot}/left/camera_info"):
            camera = messages.read_camera_info(message)
            yaw = self.views.heads[robot].mounting.yaw
            self._state.heads[robot] = HeadView.of(camera, self._reaches[robot], yaw)

    def _on_map(self, message: Any) -> None:
        with _Refusing(self.refused, "map"):
            frame = message.header.frame_id.lstrip("/")
            self._grid = grid_of(messages.read_occupancy_grid(message, frame))

    def _on_walls(self, message: Any) -> None:
        for marker in message.markers:
            ends = [(round(point.x, 2), round(point.y, 2)) for point in marker.points]
            pairs = zip(ends[::2], ends[1::2], strict=False)
            self._walls[marker.ns] = time.monotonic(), [[*one, *other] for one, other in pairs]

    # ---- what goes out ----

    def _tick(self) -> None:
        while not self._todo.empty():
            self._todo.get()()
        self.views.update()
        now_s = time.monotonic()
        if now_s - self._stated_s > _IDLE_S:
            self._send_state()
        if now_s - self._mapped_s > _MAP_S:
            self._mapped_s = now_s
            self._send_map(now_s)

    def _send_state(self) -> None:
        self._stated_s = time.monotonic()
        self._decode_poses()
        self._publish(self._state.state(time.monotonic()))

    def _decode_poses(self) -> None:
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from rclpy.serialization import deserialize_message

        while self._raw_poses:
            robot, data = self._raw_poses.popitem()
            with _Refusing(self.refused, f"{robot}/pose"):
                pose = deserialize_message(data, PoseWithCovarianceStamped)
                self._state.take_pose(robot, pose, time.monotonic())

    def _send_map(self, now_s: float) -> None:
        self._walls = {
            robot: entry for robot, entry in self._walls.items() if now_s - entry[0] < _WALLS_S
        }
        walls = [wall for robot in sorted(self._walls) for wall in self._walls[robot][1]]
        made = protocol.Map(type="map", walls=walls, grid=self._grid)
        if made != self._map:
            self._map = made
            self._publish(made)


class _Refusing:
    """Notes under a topic's name that a message is refused, and why; or that one is not."""

    def __init__(self, refused: dict[str, str], topic: str) -> None:
        self._refused, self._topic = refused, topic

    def __enter__(self) -> None:
        """Nothing."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        """Takes errors of this project."""
        if isinstance(error, PeopleLocError):
            self._refused[self._topic] = str(error)
            return True
        self._refused.pop(self._topic, None)
        return False


class _Watch:
    """Looks for robots, asks them for their heads, and says how everybody is."""

    def __init__(self, node: Node, team: _Team, publish: Publish, *, starting: bool) -> None:
        self._node, self._team, self._publish = node, team, publish
        self._health = health.HealthWatch(node)
        self._began_s = time.monotonic()
        self._started_s = self._began_s + _START_S if starting else 0.0
        self._last: protocol.Health | None = None
        self._asked_s: dict[str, float] = {}

    def step(self, spin: Callable[[], None]) -> None:
        """Looks once, for about a second."""
        end_s = time.monotonic() + _HEALTH_S
        while time.monotonic() < end_s:
            spin()
        robots = self._find()
        for robot in robots:
            self._ask_head(robot, spin)
        now_s = time.monotonic()
        if now_s < min(self._started_s, self._team.people_since_s + _SETTLE_S):
            self._tell(protocol.starting("The team starts."))
            return
        if now_s - self._began_s < 2.5:  # not everybody can have reported
            return
        checks = self._health.look(spin)
        notes = health.notes_of_robots(checks, self._node.get_namespace())
        self._team.do(partial(self._team.take_notes, notes))
        own = [
            _own_finding("warning", f"a message on {topic} is refused: {why}", "")
            for topic, why in sorted(dict(self._team.refused).items())
        ]
        self._tell(health.health_of(checks, own))

    def _tell(self, found: protocol.Health) -> None:
        if found != self._last:
            self._last = found
            self._publish(found)

    def _find(self) -> frozenset[str]:
        """The robots: namespaces with `points` and `pose`, as the planner discovers them."""
        own = self._node.get_namespace().rstrip("/") + "/"
        topics = dict(self._node.get_topic_names_and_types())
        namespaces = (name.removesuffix("/points") for name in topics if name.endswith("/points"))
        robots = frozenset(
            namespace.removeprefix(own)
            for namespace in namespaces
            if namespace.startswith(own)
            and _POINTS in topics[f"{namespace}/points"]
            and self._node.count_publishers(f"{namespace}/points")
            and _POSE in topics.get(f"{namespace}/pose", [])
        )
        people = frozenset(
            topic
            for topic in map(self._node.resolve_topic_name, PEOPLE_TOPICS)
            if _PEOPLE in topics.get(topic, [])
        )
        self._team.do(partial(self._team.take_robots, robots, people))
        return robots

    def _ask_head(self, robot: str, spin: Callable[[], None]) -> None:
        """Asks a robot's node for its head, again from time to time."""
        now_s = time.monotonic()
        service = self._node.resolve_service_name(f"{robot}/robot_node/get_parameters")
        if now_s - self._asked_s.get(robot, -60.0) < 30.0 or not self._has_service(service):
            return
        self._asked_s[robot] = now_s
        head = health.ask_head(self._node, robot, spin)
        if head is not None:
            rectified, reach, mounting = head
            settings = HeadSettings(rectified, mounting)
            self._team.do(partial(self._team.take_head, robot, settings, reach))

    def _has_service(self, name: str) -> bool:
        return any(name == one for one, _ in self._node.get_service_names_and_types())


def _own_finding(level: protocol.Level, text: str, advice: str) -> protocol.Finding:
    return protocol.Finding(level=level, subject="mrs view", text=text, advice=advice, follows=[])
