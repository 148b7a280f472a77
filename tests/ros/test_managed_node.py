"""What managed nodes make of their clock, and what they forget."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.time import Time

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.health.findings import WARN, Code, Finding
from mrs_people_loc.team.poses import Pose
from mrs_ros.managed_node import ManagedNode
from planner_node.node import PlannerNode
from ros.harness import Peer


class Timed(ManagedNode):
    """Says that its stamps are off, and counts how often time jumped back."""

    def __init__(self) -> None:
        super().__init__("timed", PlannerConfig)
        self.jumps = 0

    def jumped_back(self) -> None:
        self.jumps += 1

    def findings(self) -> list[Finding]:
        return [Finding("scan", WARN, "stamps are off", code=Code.STAMPS_OFF)]

    def at(self, seconds: float) -> None:
        """Sets what `/clock` says."""
        clock = self.get_clock()
        assert isinstance(clock, ROSClock)
        clock.set_ros_time_override(
            Time(nanoseconds=round(seconds * 1e9), clock_type=ClockType.ROS_TIME)
        )

    def code(self) -> Code | None:
        (found,) = (finding for finding in self._report() if finding.name == "scan")
        return found.code


@pytest.fixture
def node(domain: int) -> Iterator[Timed]:
    rclpy.init(args=["--ros-args", "-r", "__ns:=/test", "-p", "use_sim_time:=true"])
    made = Timed()
    assert made.trigger_configure() == TransitionCallbackReturn.SUCCESS
    yield made
    made.destroy_node()
    rclpy.shutdown()


def test_without_clock_no_stamp_is_early_or_late(node: Timed) -> None:
    node.trigger_activate()
    assert node.code() is Code.NO_CLOCK
    node.at(5.0)
    assert node.code() is Code.STAMPS_OFF


def test_only_an_active_node_begins_anew_when_clock_is_set_back(node: Timed) -> None:
    node.at(20.0)
    node.at(10.0)
    assert node.jumps == 0
    node.trigger_activate()
    node.at(9.5)  # up to a second is no jump
    assert node.jumps == 0
    node.at(5.0)
    assert node.jumps == 1
    node.trigger_deactivate()
    node.at(1.0)
    assert node.jumps == 1


def test_planner_forgets_the_poses_of_before_it_was_deactivated(domain: int) -> None:
    rclpy.init(args=["--ros-args", "-r", "__ns:=/paused"])
    node = PlannerNode()
    try:
        node.trigger_configure()
        node.trigger_activate()
        node._collector.add_pose("robot_a", Pose(1, 0.0, 0.0, 0.0), 1)
        node.trigger_deactivate()
        node.trigger_activate()
        assert len(node._collector.robot("robot_a").poses) == 0
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_nobody_sees_a_destroyed_node(domain: int, peer: Peer) -> None:
    topic = "/gone/planner_node/transition_event"
    rclpy.init(args=["--ros-args", "-r", "__ns:=/gone"])
    node = PlannerNode()
    try:
        peer.until(lambda: peer.node.count_publishers(topic), f"no {topic}")
    finally:
        node.destroy_node()
        rclpy.shutdown()
    peer.until(lambda: not peer.node.count_publishers(topic), f"{topic} is still there")
