"""The planner's node: gathers scans and poses, calls `Planner`, publishes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from mrs_people_msgs.msg import People as PeopleMessage
from mrs_people_msgs.msg import TeamPose
from nav_msgs.msg import OccupancyGrid
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.timer import Timer
from sensor_msgs.msg import PointCloud2

from mrs_people_loc import messages
from mrs_people_loc.clocks import RESET_NS, RateLimit
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import PoseError
from mrs_people_loc.health.agreement import Agreement
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.team import (
    LEFT_OUT,
    MemberState,
    of_intervals,
    of_member,
    of_people,
)
from mrs_people_loc.localization.people.relative_poses import RelativePoses
from mrs_people_loc.localization.people.seen_people import people_in
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.team.intervals import Closed, IntervalCollector
from mrs_people_loc.team.masking import OccupancyGrid as Grid
from mrs_people_loc.team.quarantine import Quarantine
from mrs_ros.diagnostics import LOG_PERIOD_S, Growth, Throttle, recording_hint, type_name
from mrs_ros.managed_node import ManagedNode
from mrs_ros.network import node_of
from mrs_ros.qos import MAP, TEAM
from planner_node.loading import load_scipy
from planner_node.others.publishing import Others
from planner_node.outputs import Outputs
from planner_node.roster import Roster

#: Periods of checking `max_wait`, and the graph for new robots [s].
_TICK_S, _DISCOVERY_S = 0.01, 0.2
#: Covariances relative to the team are taken at this rate per robot [Hz].
_TEAM_RATE_HZ = 10.0
#: What is counted of a robot's poses, beside the scans that were left out (`LEFT_OUT`).
_JUMPS = "jumps"


class PlannerNode(ManagedNode):
    """Scans and poses of all robots in, people out."""

    def __init__(self) -> None:
        super().__init__("planner_node", PlannerConfig)
        # Kept from one configuration of the node to the next: ids never repeat.
        self._planner = Planner(self.config)
        load_scipy()  # the node is on the network now, and discovers the robots meanwhile

    # ---- parameters and life cycle ----

    def set_up(self) -> None:
        """Makes the publishers."""
        self._grid: Grid | None = None
        self._take_config(self.config)
        self._collector = IntervalCollector(self.config.interval, self.config.robots)
        self._roster = Roster(self, self._on_points, self._on_pose)
        self._own_timers: list[Timer] = []
        self._result: People | None = None
        self._intervals = 0
        self._left_out_log = Throttle(LOG_PERIOD_S)
        self._losses: dict[str, dict[str, Growth]] = {}
        self._agreement = Agreement()
        self._team_rates: dict[str, RateLimit] = {}
        self._relative_poses = RelativePoses()
        self._quarantine = Quarantine()
        self._compared_ns: int | None = None
        self._outputs = Outputs(self)
        self._others = Others(self)

    def start(self) -> None:
        """Subscribes to the robots, and looks for more."""
        self.listen(TeamPose, "team_poses", self._on_team_pose, TEAM, any_number=True)
        if self.config.masking.occupancy_grid or self._others.needs_map:
            self.listen(OccupancyGrid, "map", self._on_map, MAP, once=True)
        for robot in self.config.robots:
            self._roster.add(robot)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._own_timers.append(self.create_timer(_TICK_S, self._step, clock=steady))
        if not self.config.robots:
            self._own_timers.append(self.create_timer(_DISCOVERY_S, self._discover, clock=steady))
        self._others.start()

    def stop(self) -> None:
        """Forgets the robots, and what waits for an interval."""
        while self._own_timers:
            self.destroy_timer(self._own_timers.pop())
        self._others.stop()
        self._roster = Roster(self, self._on_points, self._on_pose)
        self._losses.clear()
        self._collector = IntervalCollector(self.config.interval, self.config.robots)

    def changed(self, config: PlannerConfig) -> None:
        """Takes new parameters from the next interval on."""
        if self.is_configured:
            self._take_config(config)
            self._collector.config = config.interval

    def _take_config(self, config: PlannerConfig) -> None:
        self._planner.config = config
        self._planner.take_grid(self._grid if config.masking.occupancy_grid else None)

    def waits_for(self) -> str:
        """The robots."""
        if not self.config.robots:
            return "robots: any namespace that publishes `points` and `pose`"
        return f"`points` and `pose` of {', '.join(self.config.robots)}"

    def jumped_back(self) -> None:
        """Begins again: everybody gets a new id."""
        self._collector.reset()
        self._quarantine.reset()
        self._reset()

    def _reset(self) -> None:
        """Forgets what was found: the time, or the stamps of all robots, jumped back."""
        self._planner.reset()
        self._agreement = Agreement()
        self._relative_poses.reset()
        self._result = None
        self._outputs.reset()

    # ---- inputs ----

    def _discover(self) -> None:
        for robot in self._roster.drop_absent():
            self._losses.pop(robot, None)
        self._roster.discover()

    def _on_points(self, robot: str, message: PointCloud2) -> None:
        base_frame = f"{self.resolve_topic_name(robot).strip('/')}/base_link"
        scan = messages.read_scan(message, robot, base_frame)
        self._collector.add_scan(scan, self._now_ns())
        self._step()

    def _on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        if message.header.frame_id != self.config.map_frame:
            raise PoseError(
                f"frame_id is {message.header.frame_id!r}; wanted: {self.config.map_frame!r}"
            )
        self._collector.add_pose(robot, messages.read_pose(message), self._now_ns())
        self._step()

    def _on_team_pose(self, message: TeamPose) -> None:
        rate = self._team_rates.setdefault(message.robot, RateLimit())
        if not rate.lets_through(messages.read_stamp(message), _TEAM_RATE_HZ):
            return
        told = messages.read_team_pose(message, self.config.map_frame)
        pose, in_team = told.pose, told.pose.in_team
        assert in_team is not None
        # Equal: it hears nobody, or its pose is not estimated.
        if not np.array_equal(in_team, pose.covariance):
            self._collector.add_covariance_in_team(told.robot, pose.stamp_ns, in_team)
        self._quarantine.hear(told.robot, told.lost, told.doubted, self._now_ns())

    def _on_map(self, message: OccupancyGrid) -> None:
        self._grid = messages.read_occupancy_grid(message, self.config.map_frame)
        self._others.take_map(message, self._grid)
        self._take_config(self.config)

    # ---- step ----

    def _step(self) -> None:
        """Closes the interval if it is complete or has waited for long enough, and publishes it."""
        now_ns = self._now_ns()
        closed = self._collector.close(now_ns, self._quarantine.at(now_ns))
        for event in self._quarantine.events():
            self._outputs.publish_event(event)
        if closed is None:
            return
        for robot, reason in closed.left_out.items():
            if self._left_out_log.lets_through(robot):
                self.get_logger().warning(f"{robot}: scan left out: {reason}")
        if closed.scans:
            self._check_order(closed)
            result = self._planner.step(closed.scans, closed.all_poses, closed.time_ns)
            self._result = dataclasses.replace(result, quarantined=closed.quarantined)
            self._intervals += 1
            self._outputs.publish(self._result, self.config)
            self._others.publish(self._result)
        self._measure_robots(closed)

    def _measure_robots(self, closed: Closed) -> None:
        """Publishes where robots are to each other, by the people whom both see, if any listens."""
        if self._outputs.wants_relative_poses and (closed.scans or closed.apart):
            persons = self._result.everybody if self._result is not None and closed.scans else ()
            measured = self._relative_poses.step(
                people_in(closed, persons, self.config),
                closed.everywhere,
                closed.quarantined,
                self._planner.walls,
            )
            self._quarantine.compare(self._relative_poses.fits, self._now_ns())
            if measured:
                self._outputs.publish_relative_poses(closed.time_ns, measured, self.config)

    def _check_order(self, closed: Closed) -> None:
        back_ns = 0 if self._result is None else self._result.stamp_ns - closed.time_ns
        if back_ns > RESET_NS:
            back = f"the stamps of all robots jumped back by {back_ns / 1e9:.1f} s"
            self.get_logger().warning(f"{back}; starting over: everybody is new")
            self._reset()

    # ---- diagnostics ----

    def observe(self) -> None:
        """Compares the robots with each other, and counts what is lost of each."""
        result = self._result
        if result is not None and result.stamp_ns != self._compared_ns:
            self._compared_ns = result.stamp_ns
            self._agreement.add(result.fused, result.poses, self.config)
        for robot in self._roster.robots:
            losses = self._losses.setdefault(
                robot, {name: Growth() for name in (*LEFT_OUT, _JUMPS)}
            )
            state = self._collector.robot(robot)
            for reason in LEFT_OUT:
                losses[reason].update(state.dropped[reason])
            losses[_JUMPS].update(state.poses.jumps)

    def findings(self) -> list[Finding]:
        """The other planners, the intervals, and each robot."""
        topic = self.resolve_topic_name(self.config.people_topic)
        several = self.count_publishers(topic) > 1
        ends = self.get_publishers_info_by_topic(topic) if several else ()
        publishers = [(node_of(end), end.topic_type) for end in ends]
        figures = {} if self._result is None else self._figures(self._result)
        return [
            of_people(topic, type_name(PeopleMessage), publishers),
            of_intervals(self._roster.robots, self._intervals, figures),
            *map(of_member, self._members()),
        ]

    def _figures(self, result: People) -> dict[str, object]:
        return {
            "robots": ", ".join(result.poses),
            "people": len(result.persons),
            "cells": len(result.fused),
            "clusters": len(result.clusters),
            "clusters_too_wide": result.too_wide,
            "coasting": sum(person.coasting for person in result.persons),
            "hidden": len(result.hidden),
            "groups": len(result.groups),
            "stragglers": sum(len(group.stragglers) for group in result.groups),
            "times_back": self._planner.tracker.jumps_back,
            "turned_away": self._planner.tracker.turned_away,
            **{f"{stage}_ms": f"{ms:.2f}" for stage, ms in result.times_ms.items()},
        }

    def _members(self) -> Iterator[MemberState]:
        robots, now_ns, interval = self._roster.robots, self._now_ns(), self.config.interval
        rates_hz = {robot: self._roster.input(robot, "points").rate_hz for robot in robots}
        astray_ns = self._collector.clocks_astray(now_ns)
        quarantined, doubts = self._quarantine.at(now_ns), self._quarantine.doubts(now_ns)
        for robot in robots:
            state, losses = self._collector.robot(robot), self._losses[robot]
            topic = self.resolve_topic_name(f"{robot}/points")
            yield MemberState(
                robot=robot,
                points_topic=topic,
                points_publishers=self.count_publishers(topic),
                scan_hz=rates_hz[robot],
                expected_hz=interval.scan_rate or max(rates_hz.values()),
                pose_hz=self._roster.input(robot, "pose").rate_hz,
                poses_held=len(state.poses),
                stamp_resets=state.order.resets + state.poses.resets,
                dropped=state.dropped,
                left_out_lately=frozenset(reason for reason in LEFT_OUT if losses[reason].lately),
                age_s=None if state.used_ns is None else (now_ns - state.used_ns) / 1e9,
                silent_s=(now_ns - (state.heard_ns or now_ns)) / 1e9,
                clock_offset_ns=state.clock.at(now_ns),
                clock_astray_ns=astray_ns.get(robot),
                max_clock_offset_s=interval.max_clock_offset,
                remedy=recording_hint(self),
                pose=state.poses.newest,
                apart_m=self._collector.apart_m(robot),
                pose_jumps=state.poses.jumps,
                last_jump=state.poses.last_jump if losses[_JUMPS].lately else None,
                quarantined=quarantined.get(robot, ""),
                doubted_by=doubts.get(robot, ()),
                misplaced=self._agreement.misplaced.get(robot),
                map_frame=self.config.map_frame,
            )
