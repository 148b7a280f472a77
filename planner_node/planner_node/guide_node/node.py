"""The guide's node: people, poses, a map and tours in; velocities or goals of the robots out."""

from __future__ import annotations

import contextlib
import dataclasses
import time
import traceback
from collections.abc import Callable
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
from mrs_people_loc.guiding.guidance import Guidance, State
from mrs_people_loc.guiding.running_tour import RunningTour
from mrs_people_loc.guiding.tour import Tour
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.guide import (
    of_guides,
    of_others,
    of_tour,
    of_tour_robots,
    of_walls,
    second_guide,
)
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.masking import OccupancyGrid as Grid
from mrs_people_loc.team.poses import Pose
from mrs_ros.managed_node import ManagedNode
from mrs_ros.network import node_of
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
    """A tour under way.

    Attributes:
        running: The tour.
        people_ns: Stamp of the last people [ns].
        sent_ns: When goals were moved last, by `GuideNode._time_ns` [ns].
        looked_ns: When it was looked for who else drives, likewise [ns].
    """

    running: RunningTour
    people_ns: int
    sent_ns: int = 0
    looked_ns: int = 0


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
        # By `time.monotonic`: `/clock` may stand still, which ages nothing.
        self._people_came_s: float | None = None
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
            running = self._underway.running
            before, running.config = running.config.safety, config
            if config.safety.occupied_from != before.occupied_from:
                self._guarded(partial(self._take_walls, self._underway))

    def jumped_back(self) -> None:
        """Ends the tour: nobody knows where the people are now."""
        self._end_tour("the time jumped back")
        self._forget()

    def _forget(self) -> None:
        self._poses.clear()
        self._used_ns.clear()
        self._people_came_s = None

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
            self._underway.running.take_pose(robot, pose, now_ns)

    def _on_people(self, message: People) -> None:
        stamp_ns = messages.read_stamp(message)
        persons, groups = messages.read_people(message, self.config.map_frame)
        robots = tuple(scan.robot for scan in message.scans)
        if len(robots) > _MOST_ROBOTS:
            raise PeopleError(f"has scans of {len(robots)} robots; allowed: {_MOST_ROBOTS}")
        check_robots("robots", robots)
        self._people_came_s, now_ns = time.monotonic(), self._time_ns()
        self._have_ids = not persons or any(person.id for person in persons)
        for robot in robots:
            self._hear(robot, any_number=True)
            self._used_ns[robot] = now_ns
        self._guarded(lambda: self._step(stamp_ns, persons, groups))

    def _on_map(self, message: OccupancyGrid) -> None:
        grid = messages.read_occupancy_grid(message, self.config.map_frame)
        before, self._grid = self._grid, grid
        underway = self._underway
        if underway is None or (before is not None and _are_same(before, grid)):
            return

        self._guarded(partial(self._take_walls, underway))

    def _take_walls(self, underway: _Underway) -> None:
        """Takes another map."""
        running = underway.running
        space = self._space(running.tour, running.config.safety.occupied_from)
        self._take_guidance(underway, running.take_space(space))

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
            name = self._underway.running.tour.name
            raise TourError(f"the tour {name!r} is under way; cancel it first")
        tour = dataclasses.replace(tour, name=tour.name or "tour")
        robots = self._check_team()
        config = dataclasses.replace(self.config, robots=robots)
        space = self._space(tour, config.safety.occupied_from)
        running = RunningTour(tour, config, space, self._time_ns())
        for robot, (pose, came_ns) in self._poses.items():
            running.take_pose(robot, pose, came_ns)
        self._bases.begin(robots)
        self._underway = _Underway(running, self._now_ns())
        self.get_logger().info(f"tour {tour.name!r} with {', '.join(robots)}")
        if self._grid is None:
            self._outputs.say("there is no map: the robots do not keep clear of walls")

    def _check_team(self) -> tuple[str, ...]:
        """The robots of a tour that begins now.

        Raises:
            TourError: There is another guide, there are no people or robots, or a robot cannot take
                part.
        """
        safety, now_ns = self.config.safety, self._time_ns()
        topic, guides = self._guides()
        if len(guides) > 1:
            raise TourError(second_guide(topic, guides))
        people = self.resolve_topic_name(self.config.people_topic)
        if self._people_came_s is None:
            raise TourError(f"nothing comes on {people}; is the planner running?")
        silent_s = time.monotonic() - self._people_came_s
        if silent_s > safety.robot_timeout:
            raise TourError(f"nothing came on {people} for {silent_s:.1f} s; `mrs doctor` says why")
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
        names = list(map(node_of, self.get_publishers_info_by_topic(base)))
        own = self.get_fully_qualified_name()
        for _ in range(min(self._bases.publishers_of(robot), names.count(own))):
            names.remove(own)  # another guide_node may have the same name
        return sorted(names)

    def _guides(self) -> tuple[str, list[str]]:
        """Full names of `guide_status` and of the nodes that publish it, this one included."""
        topic = self.resolve_topic_name("guide_status")
        return topic, sorted(map(node_of, self.get_publishers_info_by_topic(topic)))

    def _space(self, tour: Tour, occupied_from: int) -> FreeSpace:
        if self._grid is None:
            return FreeSpace.unbounded()
        return FreeSpace(self._grid, occupied_from=occupied_from, around=tour.points)

    def _cancel(self) -> None:
        self._end_tour("cancelled")

    def _end_tour(
        self,
        message: str,
        *,
        finished: bool = False,
        last: bool = False,
        events: tuple[str, ...] = (),
    ) -> None:
        """Ends the tour under way, if there is one: the robots stand.

        Args:
            message: Why, in words.
            finished: Whether the group is at the end.
            last: Whether nothing is published after it: what stops the robots is waited for.
            events: What has happened before, in sentences.
        """
        underway, self._underway = self._underway, None
        if underway is None:
            return
        running = underway.running
        self._bases.stop(running.poses())
        if last:
            self._bases.finish()
        state = State.FINISHED if finished else State.CANCELLED
        reason = "" if message == state.name.lower() else message
        guidance = dataclasses.replace(
            running.guidance, state=state, reason=reason, speed=0.0, posts={}, events=events
        )
        self._publish(underway, guidance)
        if not finished:
            self._outputs.say(f"the tour {running.tour.name} has ended: {message}")
        self._action.end(End(finished, message, guidance.lost))

    # ---- step ----

    def _step(self, stamp_ns: int, persons: tuple[Person, ...], groups: tuple[Group, ...]) -> None:
        """Takes the people of an interval."""
        underway = self._underway
        if underway is None:
            return
        running, now_ns = underway.running, self._time_ns()
        underway.people_ns = stamp_ns
        if now_ns - underway.looked_ns >= _LOOK_S * 1e9:
            faults = {robot: self._fault_of_base(robot) for robot in running.robots}
            running.faults = {robot: fault for robot, fault in faults.items() if fault}
            underway.looked_ns = now_ns
        in_time_ns = self._in_time(stamp_ns, now_ns)
        self._take_guidance(underway, running.take_people(persons, groups, in_time_ns, now_ns))

    def _take_guidance(self, underway: _Underway, guidance: Guidance | None) -> None:
        """Publishes how a tour goes on, if that has changed, and moves goals; ends one that has."""
        if guidance is None:
            return
        if underway.running.is_running:
            self._publish(underway, guidance)
            self._move_goals(underway)
        else:
            finished = guidance.state == State.FINISHED
            message = guidance.reason or "the group is at the end"
            self._end_tour(message, finished=finished, events=guidance.events)

    def _move_goals(self, underway: _Underway) -> None:
        """Moves goals to posts, or to where robots are whose poses are outdated."""
        now_ns = self._time_ns()
        self._bases.send(underway.running.goals(now_ns), underway.running.poses())
        underway.sent_ns = now_ns

    def _tick(self) -> None:
        """Drives the robots."""
        if not self.is_active:
            return  # the timer had fired before it was destroyed
        if self._underway is None:
            self._bases.keep_standing()
        else:
            self._guarded(partial(self._drive, self._underway))

    def _drive(self, underway: _Underway) -> None:
        now_ns = self._time_ns()
        self._take_guidance(underway, underway.running.check_age(now_ns))
        if now_ns - underway.sent_ns >= _GOALS_S * 1e9:
            self._move_goals(underway)
        self._bases.drive(underway.running.velocities(now_ns))

    def _publish(self, underway: _Underway, guidance: Guidance) -> None:
        guidance = dataclasses.replace(guidance, stamp_ns=underway.people_ns)
        running, frame_id = underway.running, self.config.map_frame
        self._action.tell(self._outputs.publish(running.tour, guidance, running.poses(), frame_id))

    def _guarded(self, work: Callable[[], None]) -> None:
        """Works; the tour ends if that fails."""
        try:
            work()
        except Exception as err:
            self.get_logger().error(traceback.format_exc())
            self._end_tour(f"error in guide_node: {err!r}")

    # ---- diagnostics ----

    def findings(self) -> list[Finding]:
        """Other guides, the map, the tour, and each robot of it."""
        guides = of_guides(*self._guides())
        walls = of_walls(self.resolve_topic_name("map"), is_known=self._grid is not None)
        if self._underway is None:
            return [guides, walls, of_tour("", Guidance(0, State.IDLE))]
        running = self._underway.running
        others = {robot: self._other_drivers(robot) for robot in running.robots}
        return [
            guides,
            walls,
            of_tour(running.tour.name, running.guidance, running.avoided),
            of_others(others),
            *of_tour_robots(running.guidance, running.off_posts()),
        ]


def _are_same(one: Grid, other: Grid) -> bool:
    places = [(grid.resolution, grid.x, grid.y, grid.yaw) for grid in (one, other)]
    return places[0] == places[1] and np.array_equal(one.data, other.data)
