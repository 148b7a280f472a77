"""The guide's node: people, poses, a map and tours in; velocities or goals of the robots out."""

from __future__ import annotations

import contextlib
import gc
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, Twist, TwistStamped
from mrs_people_msgs.msg import People
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from mrs_people_loc import messages
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.config.parameters import check_robots
from mrs_people_loc.errors import AheadError, PeopleError, PoseError, SizeError, TourError
from mrs_people_loc.guiding.guidance import Guidance, State
from mrs_people_loc.guiding.tour import Tour
from mrs_people_loc.guiding.tour_control import Ends, Now, TourControl
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.guide import (
    of_guides,
    of_monitors,
    of_others,
    of_tour,
    of_tour_robots,
    of_walls,
)
from mrs_people_loc.team.poses import Pose
from mrs_ros.managed_node import ManagedNode
from mrs_ros.network import node_of
from mrs_ros.qos import MAP, POSES, STREAM
from planner_node.guide_node.action import End, TourAction
from planner_node.guide_node.bases import Goals, Velocities
from planner_node.guide_node.beat import Beat
from planner_node.guide_node.outputs import Outputs
from planner_node.loading import load_scipy

#: Period of steps, and of velocities: those may be 70 ms late and come within 100 ms [s].
_PERIOD_S, _VELOCITIES_S = 0.05, 0.03
#: Larger messages are refused unread: about 400 people, a path of 1,000 poses [bytes].
_MOST_BYTES = {People: 320_000, Path: 128_000, PoseWithCovarianceStamped: 4_000}
#: Larger maps are refused: 200 by 200 m with cells of 5 cm. To refuse them unread would copy them
#: once more, and nothing else runs meanwhile [bytes].
_MOST_OF_MAP = 17_000_000
#: Robots whose poses are heard, at most.
_MOST_ROBOTS = 16
#: At the end of the process the result of a tour gets this long to get out [s].
_LAST_S = 0.2


class GuideNode(ManagedNode):
    """Guides a group along a tour."""

    def __init__(self) -> None:
        self._is_ending = False
        self._stopped = ""  # by whom at the last cleanup, ...
        self._driven: tuple[str, ...] = ()  # ... and whose robots
        super().__init__("guide_node", GuideConfig)
        load_scipy()

    # ---- parameters and life cycle ----

    def set_up(self) -> None:
        """Makes the publishers and the action's server."""
        config: GuideConfig = self.config
        self._outputs = Outputs(self)
        bases: Velocities | Goals = (
            Goals(self, config.map_frame)
            if config.drive == "nav2"
            else Velocities(self, stamped=config.base.stamped)
        )
        # So that they are found before a tour; those who are stopped stay so.
        bases.begin((self._stopped and self._driven) or config.robots)
        self._bases, self._control = bases, TourControl(config, bases, self)
        self._control.stopped = self._stopped
        self.until_cleanup(self._keep_stop)
        self._action = TourAction(self, self._begin_goal, self._cancel)
        self.until_cleanup(self._action.destroy)
        self.serve(Trigger, "stop", self._on_stop)
        self.serve(Trigger, "release", self._on_release)
        self._failure = ""
        self._maps = ThreadPoolExecutor(1, "maps")
        self._map: tuple[OccupancyGrid, Future[Any]] | None = None
        self.until_cleanup(partial(self._maps.shutdown, wait=False, cancel_futures=True))

    def start(self) -> None:
        """Subscribes to people, the map, tours and the robots that are known."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(_PERIOD_S, self._tick, clock=steady)
        self._beat = Beat(_VELOCITIES_S, self._drive)
        self._take(People, self.config.people_topic, self._on_people, STREAM)
        self.listen(OccupancyGrid, "map", self._on_map, MAP, any_number=True)
        for topic, take in (("stop", self._on_stop_topic), ("attended", self._on_attended)):
            self.listen(Empty, topic, take, QoSProfile(depth=1), once=True, any_number=True)
        self._take(Path, "tour_path", self._on_path, QoSProfile(depth=1), any_number=True)
        for robot in self.config.robots:
            self._hear(robot, any_number=False)

    def waits_for(self) -> str:
        """What a tour needs."""
        return f"{self.resolve_topic_name(self.config.people_topic)}, and a tour"

    def stop(self) -> None:
        """Ends the tour: the robots stand."""
        try:
            self._control.end("guide_node was deactivated", last=True)
        finally:
            self._beat.close()
            self.destroy_timer(self._timer)
            self._control.forget()

    def destroy_node(self) -> None:
        """Lets the robots stand before the node is destroyed."""
        self._is_ending = True
        if self.is_active:
            self._control.end("guide_node has ended", last=True)
            self._halt()
            executor, began_s = self.executor if self._action.is_busy else None, time.monotonic()
            with contextlib.suppress(Exception):  # the node may end by an error in there
                while executor and time.monotonic() < began_s + _LAST_S:
                    executor.spin_once(timeout_sec=_PERIOD_S)
        super().destroy_node()

    def changed(self, config: GuideConfig) -> None:
        """Takes new parameters at once; another list of robots from the next tour on."""
        if self.is_active:
            for robot in config.robots:
                self._hear(robot, any_number=False)
        if self.is_configured:
            self._guarded(partial(self._control.configure, config, self._now()))

    def jumped_back(self) -> None:
        """Ends the tour: nobody knows where the people are now."""
        self._control.end("the time jumped back")
        self._control.forget()

    # ---- inputs ----

    def _take(self, kind: type, topic: str, take: Any, qos: QoSProfile, **how: Any) -> None:
        self.listen(kind, topic, take, qos, most_bytes=_MOST_BYTES[kind], **how)

    def _hear(self, robot: str, *, any_number: bool) -> None:
        topic = f"{robot}/pose"
        heard = sum(name.endswith("/pose") for name in self.inputs)
        if topic not in self.inputs and heard < _MOST_ROBOTS:
            take = partial(self._on_pose, robot)
            self._take(PoseWithCovarianceStamped, topic, take, POSES, any_number=any_number)

    def _on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        if message.header.frame_id != self.config.map_frame:
            raise PoseError(
                f"frame_id is {message.header.frame_id!r}; wanted: {self.config.map_frame!r}"
            )
        self._control.take_pose(robot, messages.read_pose(message), self._now())

    def _on_people(self, message: People) -> None:
        stamp_ns = messages.read_stamp(message)
        persons, groups = messages.read_people(message, self.config.map_frame)
        scans = {scan.robot: messages.stamp_ns_of(scan.stamp) for scan in message.scans}
        robots = tuple(scan.robot for scan in message.scans)
        if len(robots) > _MOST_ROBOTS:
            raise PeopleError(f"has scans of {len(robots)} robots; allowed: {_MOST_ROBOTS}")
        check_robots("robots", robots)
        for robot in robots:
            self._hear(robot, any_number=True)
        take = self._control.take_people
        apart = tuple(message.quarantined)
        self._guarded(partial(take, stamp_ns, persons, groups, scans, self._now(), apart))
        self._hear_monitors()

    def _on_map(self, message: OccupancyGrid) -> None:
        """Has the free floor of a map found beside the steps of a tour; the newest map counts."""
        size = len(message.data) + len(message.header.frame_id)
        if size > _MOST_OF_MAP:
            raise SizeError(f"cells and frame_id have {size} bytes; allowed: {_MOST_OF_MAP}")
        grid = messages.read_occupancy_grid(message, self.config.map_frame)
        if self._map is not None:
            self._map[1].cancel()
        self._map = grid, self._maps.submit(self._control.space_by, grid)
        self._take_map()

    def _take_map(self) -> None:
        if self._map is not None and (self._control.guide is None or self._map[1].done()):
            (grid, made), self._map = self._map, None
            found = made.result() if made.done() else None
            self._control.take_grid(grid, found, self._now())

    def _now(self) -> Now:
        """The time; ages are counted by one that nobody sets back, or by `/clock`."""
        simulated = self.get_parameter("use_sim_time").value
        stamp_ns = self._now_ns()
        return Now(stamp_ns if simulated else time.monotonic_ns(), stamp_ns, time.monotonic())

    def _on_path(self, message: Path) -> None:
        if not message.poses:
            self._cancel()
            return
        self._control.check_is_free()
        self._begin_tour(messages.read_tour_path(message, self.config.map_frame))

    # ---- a stop that holds ----

    def _keep_stop(self) -> None:
        self._stopped, self._driven = self._control.stopped, self._bases.robots

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._control.stop("stopped by a call of the service", self._now())
        response.success, response.message = True, self._control.stopped
        return response

    def _on_release(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = bool(self._control.stopped)
        response.message = "released" if response.success else "the robots are not stopped"
        self._control.release(self._now())
        return response

    def _on_stop_topic(self, _: Empty) -> None:
        topic = self.resolve_topic_name("stop")
        names = set(map(node_of, self.get_publishers_info_by_topic(topic)))
        known = sorted(name for name in names if "_UNKNOWN_" not in name)  # not discovered yet
        who = " or ".join(known) or "somebody"
        self._control.stop(f"stopped by {who} on {topic}", self._now())

    def _on_attended(self, _: Empty) -> None:
        self._control.attend(self._now())

    # ---- tours ----

    def _begin_goal(self, goal: Any) -> None:
        self._control.check_is_free()
        tour = messages.read_tour_goal(goal, self.config.map_frame)
        self._begin_tour(tour, attended=bool(goal.attended))

    def _begin_tour(self, tour: Tour, *, attended: bool = False) -> None:
        """Begins a tour.

        Raises:
            TourError: Something is wrong with it, or with the team.
        """
        if self._is_ending:
            raise TourError("guide_node is ending")
        self._take_map()
        guide = self._control.begin(tour, self._now(), attended=attended)
        self._hear_monitors()
        self.get_logger().info(f"tour {guide.tour.name!r} with {', '.join(guide.config.robots)}")

    def _hear_monitors(self) -> None:
        """Hears what collision monitors make of velocities."""
        kind = TwistStamped if self.config.base.stamped else Twist
        topics = {robot: f"{robot}/cmd_vel" for robot in self._control.monitored}
        for robot, topic in topics.items():
            if topic not in self.inputs:
                take = partial(self._on_driven, robot)
                self.listen(kind, topic, take, QoSProfile(depth=1), once=True, any_number=True)

    def _on_driven(self, robot: str, message: Twist | TwistStamped) -> None:
        twist = message if isinstance(message, Twist) else message.twist
        self._control.take_driven(robot, (twist.linear.x, twist.angular.z))

    def _cancel(self) -> None:
        self._control.end()

    def _tick(self) -> None:
        """Goes on with a tour between messages."""
        if not self.is_active:  # the timer had fired before it was destroyed
            return
        self._guarded(self._take_map)
        self._guarded(partial(self._control.tick, self._now()))
        if self._failure:
            failure, self._failure = self._failure, ""
            self._control.end(failure)

    def _drive(self) -> None:
        """Drives the robots, in a thread of its own; where that fails, `_tick` ends the tour."""
        try:
            self._control.drive(self._now)
        except Exception as err:
            self.get_logger().error(traceback.format_exc())
            self._failure = f"error in guide_node: {err!r}"

    def _guarded(self, work: Callable[[], None]) -> None:
        """Works; the tour ends if that fails.

        Raises:
            AheadError: A message was of the future.
        """
        try:
            work()
        except AheadError:
            raise
        except Exception as err:
            self.get_logger().error(traceback.format_exc())
            self._control.end(f"error in guide_node: {err!r}")

    # ---- for the control, see `Host` ----

    def publish(self, tour: Tour | None, guidance: Guidance, poses: Mapping[str, Pose]) -> None:
        """Publishes how a tour goes on, to the client of the action, too; or that there is none."""
        self._action.tell(self._outputs.publish(tour, guidance, poses, self.config.map_frame))

    def say(self, event: str) -> None:
        """Publishes a sentence on `events`."""
        self._outputs.say(event)

    def ended(self, message: str, *, finished: bool, lost: Sequence[int]) -> None:
        """Gives the goal of the action its result."""
        self._action.end(End(finished, message, lost))

    def people(self) -> Ends:
        """Of the people."""
        return Ends(self.resolve_topic_name(self.config.people_topic))

    def pose(self, robot: str) -> Ends:
        """Of a robot's poses."""
        return Ends(self.resolve_topic_name(f"{robot}/pose"))

    def commands(self, robot: str) -> Ends:
        """Of a robot's commands; without the publishers of this node and of its monitors."""
        bases, own, drivers = self._bases, self.get_fully_qualified_name(), []
        base, *guided = (self.resolve_topic_name(f"{robot}/{topic}") for topic in bases.topics)
        listeners = [
            one.node_name
            for one in self.get_subscriptions_info_by_topic(base)
            if node_of(one) != own
        ]
        monitors = [node_of(one) for t in guided for one in self.get_subscriptions_info_by_topic(t)]
        for topic, name in zip(bases.topics, (base, *guided), strict=True):
            names = list(map(node_of, self.get_publishers_info_by_topic(name)))
            if bases.publishes(robot, topic) and own in names:
                names.remove(own)  # another guide_node may have the same name
            drivers += [one for one in names if one not in monitors]
        return Ends(base, sorted(drivers), listeners, monitors)

    def guides(self) -> Ends:
        """Of `guide_status`."""
        topic = self.resolve_topic_name("guide_status")
        return Ends(topic, sorted(map(node_of, self.get_publishers_info_by_topic(topic))))

    # ---- diagnostics ----

    def observe(self) -> None:
        """Collects garbage, where that is left to the node; on a tour what is new only."""
        if not gc.isenabled():
            gc.collect(1 if self._control.guide is not None else 2)

    def findings(self) -> list[Finding]:
        """Other guides, the map, the tour, and each robot of it."""
        ends, guide = self.guides(), self._control.guide
        guides = of_guides(ends.topic, ends.publishers)
        is_known = self._control.grid is not None
        walls = of_walls(self.resolve_topic_name("map"), is_known=is_known)
        if guide is None:
            stopped = self._control.stopped
            idle = Guidance(0, State.STOPPED if stopped else State.IDLE, stopped)
            return [guides, walls, of_tour("", idle)]
        others = {robot: self.commands(robot).publishers for robot in guide.config.robots}
        return [
            guides,
            walls,
            of_tour(guide.tour.name, guide.guidance, guide.avoided),
            of_others(others),
            of_monitors(self._control.unmonitored),
            *of_tour_robots(guide.guidance, guide.off_posts()),
        ]
