"""The guide's node: people, poses, a map and tours in; velocities or goals of the robots out."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from mrs_people_msgs.msg import People
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile

from mrs_people_loc import messages
from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.config.parameters import check_robots
from mrs_people_loc.errors import PeopleError, PoseError, TourError
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Guidance, Post, State
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.steering import Steering
from mrs_people_loc.guiding.tour import Tour, check_tour
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.guide import of_others, of_tour, of_tour_robots, of_walls
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.masking import OccupancyGrid as Grid
from mrs_people_loc.team.poses import Pose
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import MAP, POSES, STREAM
from planner_node.guide_node.action import End, TourAction
from planner_node.guide_node.bases import Goals, Velocities
from planner_node.guide_node.outputs import Outputs

#: Period of velocities; of goals while there are no people; of looking for who else drives [s].
_PERIOD_S, _GOALS_S, _LOOK_S = 0.05, 0.2, 1.0
#: Robots of a tour, and robots whose poses are heard, at most.
_MOST_GUIDES, _MOST_ROBOTS = 4, 16
#: Nodes that subscribe to everything, and are no base.
_RECORDERS = ("mrs_record", "rosbag2_recorder")
#: At the end of the process the result of a tour gets this long to get out [s].
_LAST_S = 0.2


@dataclasses.dataclass
class _Underway:
    """A tour under way, and how it last was.

    Attributes:
        guidance: The last one.
        begun_ns: When it began, by `GuideNode._time_ns` [ns].
        people_ns: Stamp of the last people [ns].
        sent_ns: When goals were moved last, by `_time_ns` [ns].
        looked_ns: When it was looked for who else drives, likewise [ns].
        misfit: Why the map does not fit the tour; empty: it does.
    """

    tour: Tour
    guide: Guide
    steering: Steering
    guidance: Guidance
    begun_ns: int
    people_ns: int
    sent_ns: int = 0
    looked_ns: int = 0
    misfit: str = ""


class GuideNode(ManagedNode):
    """Guides a group along a tour."""

    def __init__(self) -> None:
        self._is_ending = False
        super().__init__("guide_node", GuideConfig)

    # ---- parameters and life cycle ----

    def set_up(self) -> None:
        """Makes the publishers and the action's server."""
        config: GuideConfig = self.config
        self._grid: Grid | None = None
        self._underway: _Underway | None = None
        # With stamps by `_time_ns`, and when it came by it [ns].
        self._poses: dict[str, tuple[Pose, int]] = {}
        self._people_came_ns: int | None = None
        self._have_ids = True
        self._used_ns: dict[str, int] = {}  # when a scan of a robot was used last
        self._outputs = Outputs(self)
        self._bases: Velocities | Goals = (
            Goals(self, config.map_frame)
            if config.drive == "nav2"
            else Velocities(self, stamped=config.base.stamped)
        )
        self._bases.begin(config.robots)  # so that they are found before a tour
        self._action = TourAction(self, self._begin_goal, self._cancel)
        self.until_cleanup(self._action.destroy)

    def start(self) -> None:
        """Subscribes to people, the map, tours and the robots that are known."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(_PERIOD_S, self._tick, clock=steady)
        self.listen(People, self.config.people_topic, self._on_people, STREAM)
        self.listen(OccupancyGrid, "map", self._on_map, MAP, any_number=True)
        self.listen(Path, "tour_path", self._on_path, QoSProfile(depth=1), any_number=True)
        for robot in self.config.robots:
            self._hear(robot, any_number=False)

    def waits_for(self) -> str:
        """What a tour needs."""
        return f"{self.resolve_topic_name(self.config.people_topic)}, and a tour"

    def stop(self) -> None:
        """Ends the tour: the robots stand."""
        self._end_tour("guide_node was deactivated", last=True)
        self.destroy_timer(self._timer)
        self._forget()

    def destroy_node(self) -> None:
        """Lets the robots stand before the node is destroyed."""
        self._is_ending = True
        if self.is_active and self._underway is not None:
            self._end_tour("guide_node has ended", last=True)
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
        if self.is_configured and self._underway is not None:
            underway, guide = self._underway, self._underway.guide
            before = guide.config.safety
            config = dataclasses.replace(config, robots=underway.steering.robots)
            guide.config = underway.steering.config = config
            if config.safety.occupied_from != before.occupied_from:
                self._guarded(partial(self._take_walls, underway))

    def jumped_back(self) -> None:
        """Ends the tour: nobody knows where the people are now."""
        self._end_tour("the time jumped back")
        self._forget()

    def _forget(self) -> None:
        self._poses.clear()
        self._used_ns.clear()
        self._people_came_ns = None

    # ---- inputs ----

    def _hear(self, robot: str, *, any_number: bool) -> None:
        topic = f"{robot}/pose"
        heard = sum(name.endswith("/pose") for name in self.inputs)
        if topic not in self.inputs and heard < _MOST_ROBOTS:
            take = partial(self._on_pose, robot)
            self.listen(PoseWithCovarianceStamped, topic, take, POSES, any_number=any_number)

    def _on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        if message.header.frame_id != self.config.map_frame:
            raise PoseError(
                f"frame_id is {message.header.frame_id!r}; wanted: {self.config.map_frame!r}"
            )
        pose, now_ns = messages.read_pose(message), self._time_ns()
        pose = dataclasses.replace(pose, stamp_ns=self._in_time(pose.stamp_ns, now_ns))
        before = self._poses.get(robot)
        if before is not None and 0 <= before[0].stamp_ns - pose.stamp_ns < RESET_NS:
            return  # it comes late
        self._poses[robot] = pose, now_ns
        if self._underway is not None:
            self._underway.steering.take_pose(robot, pose, now_ns)

    def _on_people(self, message: People) -> None:
        stamp_ns = messages.read_stamp(message)
        persons, groups = messages.read_people(message, self.config.map_frame)
        robots = tuple(scan.robot for scan in message.scans)
        if len(robots) > _MOST_ROBOTS:
            raise PeopleError(f"has scans of {len(robots)} robots; allowed: {_MOST_ROBOTS}")
        check_robots("robots", robots)
        self._people_came_ns = self._time_ns()
        self._have_ids = not persons or any(person.id for person in persons)
        for robot in robots:
            self._hear(robot, any_number=True)
            self._used_ns[robot] = self._people_came_ns
        self._guarded(lambda: self._step(stamp_ns, persons, groups))

    def _on_map(self, message: OccupancyGrid) -> None:
        grid = messages.read_occupancy_grid(message, self.config.map_frame)
        before, self._grid = self._grid, grid
        underway = self._underway
        if underway is None or (before is not None and _are_same(before, grid)):
            return

        self._guarded(partial(self._take_walls, underway))

    def _take_walls(self, underway: _Underway) -> None:
        """Takes another map; the robots stand while the tour is not possible by it."""
        safety, misfit = underway.guide.config.safety, ""
        space = self._space(underway.tour, safety.occupied_from)
        underway.guide.space = underway.steering.space = space
        try:
            check_tour(underway.tour, space, safety.wall_distance)
        except TourError as err:
            misfit = f"by the new map {err}"
        if misfit and misfit != underway.misfit:
            self._stand(underway, misfit)
        underway.misfit = misfit

    # ---- time ----

    def _time_ns(self) -> int:
        """Time that nobody sets back by which ages are counted, or that of `/clock` [ns]."""
        simulated = self.get_parameter("use_sim_time").value
        return self._now_ns() if simulated else time.monotonic_ns()

    def _in_time(self, stamp_ns: int, now_ns: int) -> int:
        """A stamp by `_time_ns` [ns], which is `now_ns`; at the latest that."""
        return now_ns - max(self._now_ns() - stamp_ns, 0)

    def _on_path(self, message: Path) -> None:
        if not message.poses:
            self._cancel()
            return
        self._begin_tour(messages.read_tour_path(message, self.config.map_frame))

    # ---- tours ----

    def _begin_goal(self, goal: Any) -> None:
        self._begin_tour(messages.read_tour_goal(goal, self.config.map_frame))

    def _begin_tour(self, tour: Tour) -> None:
        """Begins a tour.

        Raises:
            TourError: Something is wrong with it, or with the team.
        """
        if self._is_ending:
            raise TourError("guide_node is ending")
        if self._underway is not None:
            raise TourError(f"the tour {self._underway.tour.name!r} is under way; cancel it first")
        tour = dataclasses.replace(tour, name=tour.name or "tour")
        robots = self._check_team()
        config = dataclasses.replace(self.config, robots=robots)
        space = self._space(tour, config.safety.occupied_from)
        check_tour(tour, space, config.safety.wall_distance)
        guide, steering = Guide(config, space), Steering(config, space, robots)
        for robot, (pose, came_ns) in self._poses.items():
            steering.take_pose(robot, pose, came_ns)
        guide.begin(tour)
        self._bases.begin(robots)
        stamp_ns = self._now_ns()
        first = Guidance(stamp_ns, State.GATHERING)
        self._underway = _Underway(tour, guide, steering, first, self._time_ns(), stamp_ns)
        self.get_logger().info(f"tour {tour.name!r} with {', '.join(robots)}")
        if self._grid is None:
            self._outputs.say("there is no map: the robots keep off no walls")

    def _check_team(self) -> tuple[str, ...]:
        """The robots of a tour that begins now.

        Raises:
            TourError: There are no people or robots, or a robot cannot take part.
        """
        safety, now_ns = self.config.safety, self._time_ns()
        people = self.resolve_topic_name(self.config.people_topic)
        if self._people_came_ns is None:
            raise TourError(f"nothing comes on {people}; is the planner running?")
        silent_s = (now_ns - self._people_came_ns) / 1e9
        if silent_s > safety.robot_timeout:
            raise TourError(f"nothing came on {people} for {silent_s:.1f} s; start the planner")
        if not self._have_ids:
            raise TourError(f"people on {people} have no ids; set tracking.enabled of the planner")
        robots: tuple[str, ...] = self.config.robots or self._robots_in_use(now_ns)
        if not 1 <= len(robots) <= _MOST_GUIDES:
            named = ", ".join(robots) or "the planner uses no robot's scans"
            raise TourError(
                f"robots of the tour: {named}; allowed: 1 to {_MOST_GUIDES}, by the parameter "
                "`robots`"
            )
        leader = self.config.leader
        if leader and leader not in robots:
            raise TourError(f"leader is {leader!r}; allowed: {', '.join(robots)}")
        for robot in robots:
            self._check_robot(robot, now_ns)
        return robots

    def _robots_in_use(self, now_ns: int) -> tuple[str, ...]:
        """Robots whose scans the planner has used lately."""
        oldest_ns = now_ns - round(self.config.safety.robot_timeout * 1e9)
        return tuple(sorted(robot for robot, used in self._used_ns.items() if used >= oldest_ns))

    def _check_robot(self, robot: str, now_ns: int) -> None:
        pose = self._poses.get(robot)
        topic = self.resolve_topic_name(f"{robot}/pose")
        if pose is None:
            raise TourError(f"{robot} has no pose: nothing comes on {topic}")
        age_s, timeout = (now_ns - pose[0].stamp_ns) / 1e9, self.config.safety.robot_timeout
        if age_s > timeout:
            raise TourError(
                f"{robot}: the pose on {topic} is {age_s:.1f} s old; allowed: {timeout:g} s"
            )
        fault = self._fault_of_base(robot)
        if fault:
            raise TourError(f"{robot} {fault}")
        others = self._other_drivers(robot)
        if others:
            base = self.resolve_topic_name(f"{robot}/{self._bases.topic}")
            raise TourError(f"{robot} is driven by others: {', '.join(others)} on {base}; end them")

    def _fault_of_base(self, robot: str) -> str:
        """Why a robot cannot be driven; empty: it can."""
        base = self.resolve_topic_name(f"{robot}/{self._bases.topic}")
        listeners = self.get_subscriptions_info_by_topic(base)
        if all(one.node_name.startswith(_RECORDERS) for one in listeners):
            return f"has no base: nobody subscribes to {base}"
        return ""

    def _other_drivers(self, robot: str) -> list[str]:
        """Full names of the nodes that publish a robot's commands, besides this one."""
        base = self.resolve_topic_name(f"{robot}/{self._bases.topic}")
        names = [
            f"{one.node_namespace.rstrip('/')}/{one.node_name}"
            for one in self.get_publishers_info_by_topic(base)
        ]
        own = self.get_fully_qualified_name()
        for _ in range(min(self._bases.publishers_of(robot), names.count(own))):
            names.remove(own)  # another guide_node may have the same name
        return sorted(names)

    def _space(self, tour: Tour, occupied_from: int) -> FreeSpace:
        if self._grid is None:
            return FreeSpace.unbounded()
        return FreeSpace(self._grid, occupied_from=occupied_from, around=tour.points)

    def _cancel(self) -> None:
        self._end_tour("cancelled")

    def _end_tour(self, message: str, *, finished: bool = False, last: bool = False) -> None:
        """Ends the tour under way, if there is one: the robots stand.

        Args:
            message: Why, in words.
            finished: Whether the group is at the end.
            last: Whether nothing is published after it: what stops the robots is waited for.
        """
        underway, self._underway = self._underway, None
        if underway is None:
            return
        self._bases.stop(underway.steering.poses())
        if last:
            self._bases.finish()
        state = State.FINISHED if finished else State.CANCELLED
        guidance = dataclasses.replace(
            underway.guidance, state=state, reason=message, speed=0.0, posts={}
        )
        self._publish(underway, guidance)
        if not finished:
            self._outputs.say(f"the tour {underway.tour.name} has ended: {message}")
        self._action.end(End(finished, message, guidance.lost))

    # ---- step ----

    def _step(self, stamp_ns: int, persons: tuple[Person, ...], groups: tuple[Group, ...]) -> None:
        """Takes the people of an interval."""
        underway = self._underway
        if underway is None:
            return
        steering, guide, now_ns = underway.steering, underway.guide, self._time_ns()
        underway.people_ns, in_time_ns = stamp_ns, self._in_time(stamp_ns, now_ns)
        steering.take_people(persons, in_time_ns, now_ns)
        if underway.misfit:
            return
        if now_ns - underway.looked_ns >= _LOOK_S * 1e9:
            faults = {robot: self._fault_of_base(robot) for robot in steering.robots}
            guide.faults = {robot: fault for robot, fault in faults.items() if fault}
            underway.looked_ns = now_ns
        guidance = guide.step(persons, groups, steering.poses(), in_time_ns)
        if not underway.guide.is_running:
            underway.guidance, finished = guidance, guidance.state == State.FINISHED
            self._end_tour(guidance.reason or "the group is at the end", finished=finished)
            return
        self._publish(underway, guidance)
        steering.take_posts(guidance.posts)
        self._move_goals(underway, guidance.posts, now_ns)

    def _move_goals(self, underway: _Underway, posts: Mapping[str, Post], now_ns: int) -> None:
        """Moves goals to posts, or to where robots are whose poses are outdated."""
        steering, timeout = underway.steering, self.config.safety.pose_timeout
        fresh = {r: p for r, p in posts.items() if steering.pose_age_s(r, now_ns) < timeout}
        self._bases.send(fresh, steering.poses())
        underway.sent_ns = now_ns

    def _stand(self, underway: _Underway, reason: str) -> None:
        """The robots stand until people come again, or another map."""
        self._publish(underway, underway.guide.halt(reason))
        underway.steering.take_posts({})
        self._move_goals(underway, {}, self._time_ns())

    def _tick(self) -> None:
        """Drives the robots."""
        if not self.is_active:
            return  # the timer had fired before it was destroyed
        if self._underway is None:
            self._bases.keep_standing()
        else:
            self._guarded(partial(self._drive, self._underway))

    def _drive(self, underway: _Underway) -> None:
        steering, now_ns = underway.steering, self._time_ns()
        timeout = self.config.safety.people_timeout
        age_s = min(steering.people_age_s(now_ns), (now_ns - underway.begun_ns) / 1e9)
        if age_s >= timeout and underway.guidance.state != State.HALTED:
            reason = f"no people have come for {age_s:.2f} s; allowed: {timeout:g} s"
            self._stand(underway, reason)
        elif now_ns - underway.sent_ns >= _GOALS_S * 1e9:
            halted = underway.guidance.state == State.HALTED
            self._move_goals(underway, {} if halted else underway.guidance.posts, now_ns)
        self._bases.drive(steering.step(now_ns))

    def _publish(self, underway: _Underway, guidance: Guidance) -> None:
        guidance = dataclasses.replace(guidance, stamp_ns=underway.people_ns)
        underway.guidance = dataclasses.replace(guidance, events=())  # they are published once
        poses, frame_id = underway.steering.poses(), self.config.map_frame
        self._action.tell(self._outputs.publish(underway.tour, guidance, poses, frame_id))

    def _guarded(self, work: Callable[[], None]) -> None:
        """Works; the tour ends if that fails."""
        try:
            work()
        except Exception as err:
            self.get_logger().error(traceback.format_exc())
            self._end_tour(f"error in guide_node: {err!r}")

    # ---- diagnostics ----

    def findings(self) -> list[Finding]:
        """The map, the tour, and each robot of it."""
        walls = of_walls(self.resolve_topic_name("map"), is_known=self._grid is not None)
        if self._underway is None:
            return [walls, of_tour("", Guidance(0, State.IDLE))]
        guidance, poses = self._underway.guidance, self._underway.steering.poses()
        distances = {
            robot: math.dist(post.xy, (poses[robot].x, poses[robot].y))
            for robot, post in guidance.posts.items()
            if robot in poses
        }
        steering = self._underway.steering
        tour = of_tour(self._underway.tour.name, guidance, steering.kept_off)
        others = {robot: self._other_drivers(robot) for robot in steering.robots}
        return [walls, tour, of_others(others), *of_tour_robots(guidance, distances)]


def _are_same(one: Grid, other: Grid) -> bool:
    places = [(grid.resolution, grid.x, grid.y, grid.yaw) for grid in (one, other)]
    return places[0] == places[1] and np.array_equal(one.data, other.data)
