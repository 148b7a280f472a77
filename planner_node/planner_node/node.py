"""The planner's node: gathers scans and poses, calls `Planner`, publishes."""

from __future__ import annotations

import math
import threading
from collections import deque
from functools import partial

from geometry_msgs.msg import PointStamped, PoseArray, PoseWithCovarianceStamped
from mrs_people_msgs.msg import People as PeopleMessage
from nav_msgs.msg import OccupancyGrid
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mrs_people_loc import messages
from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import PoseError
from mrs_people_loc.health.agreement import Agreement
from mrs_people_loc.health.findings import Code
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.team import masking
from mrs_people_loc.team.intervals import Closed, IntervalCollector, say_offset
from mrs_ros import convert
from mrs_ros.diagnostics import (
    ERROR,
    LOG_PERIOD_S,
    OK,
    OLD_STAMP_S,
    STALE,
    WARN,
    Finding,
    Growth,
    Throttle,
    recording_hint,
)
from mrs_ros.managed_node import ManagedNode
from mrs_ros.network import node_of
from mrs_ros.qos import POSES, STREAM

#: As map_server publishes: the last map, also for who comes later than it.
MAP_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_POINTS = "sensor_msgs/msg/PointCloud2"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
#: How often `max_wait` is looked at, and the graph for new robots [s].
_TICK_S, _DISCOVERY_S = 0.01, 0.2
#: A robot that was discovered has left when nobody has published its topics for so long [s].
_LEFT_S = 30.0
#: What is drawn of where people were: so many seconds [ns], a place every now and then [ns].
_TRAIL_NS, _TRAIL_STEP_NS = 10_000_000_000, 250_000_000
#: A robot that delivers less than this share of the scans expected of it is reported.
_LEAST_RATE = 0.5
#: Robots of one team that are farther apart [m] are not where their poses say.
_FAR_APART_M = 1000.0

#: Why scans are left out lately.
_LEFT_OUT = {
    "no_pose": "no pose near their stamps",
    "too_old": "older than the newest by more than interval.max_scan_age",
}


def _load() -> None:
    """Loads what the method uses of SciPy, which takes as long as all else before the start.

    The method would do so itself with the first interval, and that would be late.
    """
    import scipy.optimize
    import scipy.spatial  # noqa: F401


class PlannerNode(ManagedNode):
    """Scans and poses of all robots in, people out."""

    def __init__(self) -> None:
        super().__init__("planner_node", PlannerConfig)
        # The node is on the network now, and meets the robots meanwhile.
        threading.Thread(target=_load, name="load").start()

    # ---- life cycle ----

    def set_up(self) -> None:
        """Makes the publishers."""
        # Also who follows people stays, from one configuration to the next: ids never repeat.
        self._planner = getattr(self, "_planner", None) or Planner(self.config)
        self._planner.config = self.config
        self._planner.take_grid(None)
        self._grid: masking.OccupancyGrid | None = None
        self._trails: dict[int, deque[tuple[int, float, float]]] = {}
        self._collector = IntervalCollector(self.config.interval, self.config.robots)
        self._robots: list[str] = []
        self._result: People | None = None
        self._intervals = 0
        self._left_out_log = Throttle(LOG_PERIOD_S)
        self._losses: dict[str, Growth] = {}
        self._agreement = Agreement()
        self._compared_ns: int | None = None
        self._people = self.offer(PeopleMessage, "people", 10)
        self._people_poses = self.offer(PoseArray, "people_poses", 10)
        self._group_centroid = self.offer(PointStamped, "group_centroid", 10)
        self._short_term_map = self.offer(PointCloud2, "short_term_map", 2)
        self._events = self.offer(String, "events", 10)
        self._markers = self.offer(MarkerArray, "markers", 2)

    def start(self) -> None:
        """Listens to the robots, and for robots."""
        if self.config.masking.occupancy_grid:
            self.listen(OccupancyGrid, "map", self._on_map, MAP_QOS, once=True)
        for robot in self.config.robots:
            self._add_robot(robot)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers_made = [self.create_timer(_TICK_S, self._close, clock=steady)]
        if not self.config.robots:
            self._timers_made.append(self.create_timer(_DISCOVERY_S, self._discover, clock=steady))

    def stop(self) -> None:
        """Forgets what waits."""
        for timer in getattr(self, "_timers_made", []):
            self.destroy_timer(timer)
        self._timers_made = []
        self._robots = []
        self._collector = IntervalCollector(self.config.interval, self.config.robots)

    def jumped_back(self) -> None:
        """Everybody is new."""
        self._collector.begin_anew()
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Forgets what was found: the time, or the stamps of all robots, jumped back."""
        self._planner.begin_anew()
        self._trails.clear()
        self._agreement = Agreement()
        self._result = None
        self._events.publish(String(data="the time jumped back: everybody is new"))

    def changed(self, config: PlannerConfig) -> None:
        """Takes new parameters from the next interval on."""
        if self._configured:
            self._planner.config = config
            self._planner.take_grid(self._grid)
            self._collector.config = config.interval

    # ---- robots ----

    def _discover(self) -> None:
        """A robot is a namespace, under the planner's own, that publishes `points` and `pose`."""
        own = self.get_namespace().rstrip("/") + "/"
        topics = dict(self.get_topic_names_and_types())
        self._let_go()
        for name, types in topics.items():
            namespace, _, last = name.rpartition("/")
            robot = namespace.removeprefix(own)
            if last != "points" or _POINTS not in types or not namespace.startswith(own):
                continue
            if robot in self._robots or _POSE not in topics.get(f"{namespace}/pose", []):
                continue
            if self.count_publishers(name) and self.count_publishers(f"{namespace}/pose"):
                self.get_logger().warning(
                    f"found {robot}, and takes it for one of the team, as any namespace that "
                    "publishes `points` and `pose`; to take only your own, list them in "
                    f"`robots: [{', '.join([*self._robots, robot])}]`"
                )
                self._add_robot(robot)

    def _add_robot(self, robot: str) -> None:
        self._robots.append(robot)
        self.listen(PointCloud2, f"{robot}/points", partial(self._on_points, robot), STREAM)
        self.listen(
            PoseWithCovarianceStamped, f"{robot}/pose", partial(self._on_pose, robot), POSES
        )

    def _let_go(self) -> None:
        """Listens no more to robots that have left."""
        for robot in list(self._robots):
            heard = [self.inputs[f"{robot}/{topic}"] for topic in ("points", "pose")]
            if all(one.silent_s > _LEFT_S and not one.publishers for one in heard):
                self.get_logger().info(f"{robot} has left")
                self._robots.remove(robot)
                for reason in (*_LEFT_OUT, "jumps"):
                    self._losses.pop(f"{robot} {reason}", None)
                for one in heard:
                    self.end(one)

    def _base_frame(self, robot: str) -> str:
        return f"{self.resolve_topic_name(robot).strip('/')}/base_link"

    # ---- walls ----

    def _on_map(self, message: OccupancyGrid) -> None:
        self._grid = messages.read_occupancy_grid(message, self.config.map_frame)
        self._planner.take_grid(self._grid)

    # ---- intervals ----

    def _on_points(self, robot: str, message: PointCloud2) -> None:
        scan = messages.read_scan(message, robot, self._base_frame(robot))
        self._collector.add_scan(scan, self._now_ns())
        self._close()

    def _on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        if message.header.frame_id != self.config.map_frame:
            raise PoseError(
                f"frame_id is {message.header.frame_id!r}; wanted: {self.config.map_frame!r}"
            )
        self._collector.add_pose(robot, messages.read_pose(message), self._now_ns())
        self._close()

    def _close(self) -> None:
        closed = self._collector.close(self._now_ns())
        if closed is None:
            return
        for robot, reason in closed.left_out.items():
            if self._left_out_log.lets_through(robot):
                self.get_logger().warning(f"{robot}: scan left out: {reason}")
        if closed.scans:
            self._run(closed)

    def _run(self, closed: Closed) -> None:
        back_ns = 0 if self._result is None else self._result.stamp_ns - closed.time_ns
        if back_ns > RESET_NS:
            back = f"the stamps of all robots jumped back by {back_ns / 1e9:.1f} s"
            self.get_logger().warning(f"{back}; starting anew: everybody is new")
            self._begin_anew()
        result = self._planner.step(closed.scans, closed.all_poses, closed.time_ns)
        self._result = result
        self._intervals += 1
        frame = self.config.map_frame
        self._people.publish(convert.people(result, frame))
        self._people_poses.publish(convert.people_poses(result, frame))
        centroid = convert.group_centroid(result, frame)
        if centroid is not None:
            self._group_centroid.publish(centroid)
        for event in result.events:
            self.get_logger().info(event)
            self._events.publish(String(data=event))
        self._keep_trails(result)
        if self._short_term_map.get_subscription_count():
            self._short_term_map.publish(convert.short_term_map(result, frame))
        if self._markers.get_subscription_count():
            sigmas = self.config.human.circle_sigmas
            ways = {who: [(x, y) for _, x, y in way] for who, way in self._trails.items()}
            self._markers.publish(convert.markers(result, frame, sigmas, ways))

    def _keep_trails(self, result: People) -> None:
        """Where everybody was in the last seconds."""
        now_ns = result.stamp_ns
        for person in result.persons:
            if person.id:
                way = self._trails.setdefault(person.id, deque())
                if len(way) > 1 and way[-1][0] - way[-2][0] < _TRAIL_STEP_NS:
                    way.pop()
                way.append((now_ns, float(person.position[0]), float(person.position[1])))
        for who, way in list(self._trails.items()):
            while way and now_ns - way[0][0] > _TRAIL_NS:
                way.popleft()
            if not way:
                del self._trails[who]

    # ---- diagnostics ----

    def findings(self) -> list[Finding]:
        """The intervals, and each robot."""
        result = self._result
        if result is not None and result.stamp_ns != self._compared_ns:
            self._compared_ns = result.stamp_ns
            self._agreement.add(result.fused, result.poses, self.config)
        robots = (self._robot_finding(robot) for robot in self._robots)
        return [self._people_finding(), self._interval_finding(), *robots]

    def waits_for(self) -> str:
        """The robots."""
        if not self.config.robots:
            return "robots: any namespace that publishes `points` and `pose`"
        return f"`points` and `pose` of {', '.join(self.config.robots)}"

    def _people_finding(self) -> Finding:
        """Whether this planner is the only one."""
        topic = self.resolve_topic_name("people")
        if self.count_publishers(topic) > 1:
            publishers = self.get_publishers_info_by_topic(topic)
            names = sorted(map(node_of, publishers))
            text = (
                f"{len(names)} publishers on {topic}: {', '.join(names)}; another planner, or a "
                "replay of what one said, is at work in this ROS domain: end it, or give it a "
                "namespace or a ROS_DOMAIN_ID of its own; or one was killed some seconds ago"
            )
            return Finding("people", ERROR, text, {}, Code.TWO_PUBLISHERS)
        return Finding("people", OK, "ok")

    def _interval_finding(self) -> Finding:
        result = self._result
        if not self._robots:
            wanted = "no robot yet: no namespace publishes both `points` and `pose`"
            return Finding("intervals", STALE, wanted, {"intervals": 0}, Code.NO_ROBOT)
        if result is None:
            return Finding(
                "intervals", STALE, "no interval yet", {"intervals": 0}, Code.NO_INTERVAL
            )
        values: dict[str, object] = {
            "intervals": self._intervals,
            "robots": ", ".join(result.poses),
            "people": len(result.persons),
            "cells": len(result.fused),
            "clusters": len(result.clusters),
            "clusters_too_wide": result.too_wide,
            "coasting": sum(person.coasting for person in result.persons),
            "groups": len(result.groups),
            "stragglers": sum(len(group.stragglers) for group in result.groups),
            "times_back": self._planner.tracker.jumps_back,
            "turned_away": self._planner.tracker.turned_away,
            **{f"{stage}_ms": f"{ms:.2f}" for stage, ms in result.times_ms.items()},
        }
        return Finding("intervals", OK, "ok", values)

    def _robot_finding(self, robot: str) -> Finding:
        state, now_ns = self._collector.robot(robot), self._now_ns()
        name = f"robot {robot}"
        rate_hz = self.inputs[f"{robot}/points"].rate_hz
        values: dict[str, object] = {
            "scan_hz": f"{rate_hz:.1f}",
            "pose_hz": f"{self.inputs[f'{robot}/pose'].rate_hz:.1f}",
            "poses_held": len(state.poses),
            "stamp_resets": state.order.resets + state.poses.resets,
            "pose_jumps": state.poses.jumps,
            **{f"dropped.{reason}": count for reason, count in state.dropped.items()},
        }
        topic = self.resolve_topic_name(f"{robot}/points")
        publishers = self.count_publishers(topic)
        if publishers > 1:
            text = (
                f"{publishers} publishers on {topic}: two robots share a name, rename one; "
                "or one was killed some seconds ago"
            )
            return Finding(name, ERROR, text, values, Code.TWO_PUBLISHERS)
        offset_ns = state.clock.at(now_ns)
        if offset_ns is not None:
            values["clock_offset_s"] = f"{offset_ns / 1e9:.3f}"
        if state.used_ns is None:
            return Finding(name, STALE, "no scan used yet", values, Code.NO_SCAN)
        age_s = (now_ns - state.used_ns) / 1e9
        values["age_s"] = f"{age_s:.3f}"
        if not len(state.poses):
            text = f"scans but no pose on {robot}/pose"
            return Finding(name, ERROR, text, values, Code.NO_POSE)
        astray_ns = self._collector.clocks_astray(now_ns).get(robot)
        allowed = f"allowed by interval.max_clock_offset: {self.config.interval.max_clock_offset:g}"
        if astray_ns is not None:
            text = (
                f"its clock is {say_offset(astray_ns)} the others': its scans are left out; "
                f"{allowed} s; synchronize the clocks (chrony or NTP on every machine)"
            )
            if astray_ns < 0:
                text += ", or see what keeps its messages back so long"
            return Finding(name, ERROR, text, values, Code.CLOCK_ASTRAY)
        # How old its last scan has become since it came says nothing of its clock.
        silent_s = (now_ns - (state.heard_ns or now_ns)) / 1e9
        if silent_s > OLD_STAMP_S:
            return Finding(name, WARN, f"no scan for {silent_s:.1f} s", values, Code.SCAN_SILENT)
        if offset_ns and abs(offset_ns) > self.config.interval.max_clock_offset * 1e9:
            text = f"stamps are {say_offset(offset_ns)} this machine's clock; {allowed} s"
            return Finding(name, WARN, text + recording_hint(self), values, Code.STAMPS_OFF)
        for reason, text in _LEFT_OUT.items():
            lost = state.dropped[reason]
            if self._losses.setdefault(f"{robot} {reason}", Growth()).lately(lost):
                code = Code(f"left_out_{reason}")
                return Finding(name, WARN, f"{lost} scans left out: {text}", values, code)
        strange = self._strange_pose(robot)
        if strange:
            return Finding(name, WARN, strange, values, Code.STRANGE_POSE)
        misplaced = self._agreement.misplaced.get(robot)
        if misplaced is not None:
            move, turn = misplaced.move, math.degrees(misplaced.turn)
            text = (
                f"its people are not where the others see them ({misplaced.agreed:.0%} agree); "
                f"moved by ({move[0]:.2f}, {move[1]:.2f}) m in {self.config.map_frame} and turned "
                f"by {turn:.0f} degrees {misplaced.would_agree:.0%} would: check its pose "
                "(localization, pose.map_from_odom) and the mounting of its head"
            )
            return Finding(name, WARN, text, values, Code.MISPLACED)
        expected_hz = self._expected_rate_hz()
        if expected_hz > 1.0 and 0 < rate_hz < _LEAST_RATE * expected_hz:
            text = f"{rate_hz:.1f} scans per second; expected: {expected_hz:.1f}"
            return Finding(name, WARN, text, values, Code.SLOW)
        return Finding(name, OK, "ok", values)

    def _strange_pose(self, robot: str) -> str:
        """What is strange about a robot's poses, in words; empty: nothing."""
        poses = self._collector.robot(robot).poses
        lately = self._losses.setdefault(f"{robot} jumps", Growth()).lately(poses.jumps)
        apart_m, newest = self._collector.apart_m(robot), poses.newest
        if apart_m is not None and newest is not None and apart_m > _FAR_APART_M:
            return (
                f"its pose is ({newest.x:.2f}, {newest.y:.2f}) m, {apart_m / 1e3:.1f} km from the "
                f"nearest other robot: is it in {self.config.map_frame}, the frame of the others?"
            )
        if lately and poses.last_jump is not None:
            one, other = poses.last_jump
            seconds = (other.stamp_ns - one.stamp_ns) / 1e9
            return (
                f"its pose jumped from ({one.x:.2f}, {one.y:.2f}) m to "
                f"({other.x:.2f}, {other.y:.2f}) m in {seconds:.2f} s "
                f"({poses.jumps} jumps so far): "
                "its localization was lost or put right, or something else publishes its pose, too"
            )
        return ""

    def _expected_rate_hz(self) -> float:
        """Scans per second that are expected of each robot."""
        rates = (self.inputs[f"{robot}/points"].rate_hz for robot in self._robots)
        return float(self.config.interval.scan_rate or max(rates))
