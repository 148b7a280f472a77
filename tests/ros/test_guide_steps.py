"""The guide's node in this process, step by step, by a clock of the test's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rclpy.time import Time

from mrs_people_loc.errors import ConfigError, PoseError, TourError
from mrs_people_loc.guiding.guidance import Post, Role, State
from mrs_people_loc.guiding.tour_control import TourControl
from mrs_people_loc.health.findings import OK, Code
from mrs_people_loc.team.poses import Pose
from planner_node.guide_node.bases import Goals
from planner_node.guide_node.node import GuideNode
from ros.guide_peer import goal_of, path_of, people_of
from ros.planner_peer import pose_of

PLACES = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (-3.5, 0.0, 0.0)}
#: When the tour begins [s].
START = 100.0


class Bases:
    """What the robots are told."""

    topics = ("cmd_vel", "cmd_vel_guide")

    def __init__(self) -> None:
        self.velocities: Mapping[str, tuple[float, float]] = {}
        self.stops = self.kept = 0
        self.posts: Mapping[str, Any] = {}

    def publishes(self, robot: str, topic: str) -> bool:
        return False

    def begin(self, robots: Any, monitored: Any = ()) -> None:
        pass

    def drive(self, velocities: Mapping[str, tuple[float, float]]) -> None:
        self.velocities = velocities

    def send(self, posts: Mapping[str, Any], poses: Any) -> None:
        self.posts = posts

    def stop(self, poses: Any) -> None:
        self.stops += 1

    def keep_standing(self, *, always: bool) -> None:
        self.kept += 1

    def finish(self) -> None:
        pass


def _at(topic: str, names: list[str]) -> Any:
    """Who is at a topic; nobody is a collision monitor."""
    found = [] if topic.endswith("cmd_vel_guide") else names
    return [SimpleNamespace(node_name=name, node_namespace="/") for name in found]


class Stepped(GuideNode):
    """The node, with bases that only listen."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[Any] = []
        self.listeners = ["base"]
        self.drivers: list[str] = []
        self.now_s = 0.0

    def start(self) -> None:
        super().start()
        self._beat.close()  # the test drives

    def set_up(self) -> None:
        super().set_up()
        self.bases = Bases()
        self._bases: Any = self.bases
        self._control = TourControl(self.config, self.bases, self)
        self._outputs.publish = self._tell  # type: ignore[method-assign]

    def _tell(self, tour: Any, guidance: Any, poses: Any, frame_id: str) -> Any:
        self.told.append(guidance)

    def get_subscriptions_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> Any:
        return _at(topic_name, self.listeners)

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> Any:
        return _at(topic_name, self.drivers)

    def at(self, seconds: float) -> None:
        """Sets what `/clock` says."""
        clock = self.get_clock()
        assert isinstance(clock, ROSClock)
        self.now_s = seconds
        now = Time(nanoseconds=round(seconds * 1e9), clock_type=ClockType.ROS_TIME)
        clock.set_ros_time_override(now)

    def hear(self, *, people: bool = True) -> None:
        """Poses of all robots, and people, of now."""
        now_ns = round(self.now_s * 1e9)
        for robot, place in PLACES.items():
            self._on_pose(robot, pose_of(now_ns, *place))
        if people:
            places = [(-1.5, 0.0), (-1.5, 0.6)]
            self._on_people(people_of(now_ns, places, [(0.0, 0.0)] * 2, list(PLACES)))

    def run(self, seconds: float, *, people: bool = True) -> None:
        """Poses and people come five times a second."""
        end = self.now_s + seconds
        while self.now_s < end - 1e-6:
            self.at(self.now_s + 0.05)
            if round(self.now_s / 0.05) % 4 == 0:
                self.hear(people=people)
            self._tick()
            self._drive()

    def is_told(self, state: State) -> bool:
        return self.told[-1].state == state


@pytest.fixture
def node(domain: int) -> Iterator[Stepped]:
    rclpy.init(args=["--ros-args", "-r", "__ns:=/steps", "-p", "use_sim_time:=true"])
    made = Stepped()
    made.at(START)
    made.trigger_configure()
    made.trigger_activate()
    made.hear()
    made._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))
    made.run(4.0)
    assert made.is_told(State.LEADING)
    yield made
    made.destroy_node()
    rclpy.shutdown()


def drives(node: Stepped) -> bool:
    return any(v or w for v, w in node.bases.velocities.values())


def test_error_in_a_step_ends_the_tour_and_not_the_node(
    node: Stepped, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise ZeroDivisionError("on purpose")

    assert node._control.guide is not None
    monkeypatch.setattr(node._control.guide, "velocities", fail)
    node._drive()
    node._tick()
    assert node._control.guide is None
    assert node.bases.stops == 1
    assert node.is_told(State.CANCELLED)
    assert "on purpose" in node.told[-1].reason
    assert node.is_active
    node.hear()
    node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_tour_ends_when_the_time_jumps_back(node: Stepped) -> None:
    node.at(START - 50.0)
    assert node._control.guide is None
    assert node.bases.stops == 1
    with pytest.raises(TourError, match="nothing comes on /steps/tracked_people"):
        node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_parameters_take_effect_on_a_tour_but_for_its_robots(node: Stepped) -> None:
    def set_to(name: str, value: Any) -> bool:
        return bool(node.set_parameters([Parameter(name, value=value)])[0].successful)

    assert set_to("pace.speed", 0.1)
    assert set_to("robots", ["robot_b"])
    assert not set_to("drive", "nav2")
    assert node._control.guide is not None
    assert node._control.guide.config.pace.speed == 0.1
    assert node._control.guide.config.robots == tuple(PLACES)


def test_messages_that_cannot_be_used_are_refused(node: Stepped) -> None:
    now_ns = round(node.now_s * 1e9)
    with pytest.raises(ConfigError, match="robots has 'no name'"):
        node._on_people(people_of(now_ns, [], [], ["no name"]))
    with pytest.raises(PoseError, match="frame_id is 'odom'; wanted: 'map'"):
        node._on_pose("robot_a", pose_of(now_ns, 1.0, 0.0, 0.0, frame_id="odom"))
    with pytest.raises(TourError, match="'hall' is under way"):
        node._on_path(path_of((0.0, 0.0), (4.0, 0.0)))


def test_timer_that_fires_late_sends_nothing(node: Stepped) -> None:
    """An event may be under way when the timer is destroyed, and then the publishers are, too."""
    guide = node._control.guide
    node.trigger_shutdown()
    told, node._control.guide = len(node.told), guide
    node.at(node.now_s + 5.0)
    node._tick()
    assert len(node.told) == told


def test_robots_that_others_drive_are_refused_and_reported(node: Stepped) -> None:
    assert node.findings()[3].level == OK
    node.drivers = ["teleop"]
    assert node.findings()[3].code == Code.DRIVEN_BY_OTHERS
    node._cancel()
    node.hear()
    with pytest.raises(TourError, match=r"robot_a is driven by others: /teleop on /steps/robot_a"):
        node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_no_tour_begins_while_the_node_ends(node: Stepped) -> None:
    node._cancel()
    node._is_ending = True
    with pytest.raises(TourError, match="guide_node is ending"):
        node._on_path(path_of((0.0, 0.0), (4.0, 0.0)))


def test_nav2_is_started_again_for_a_robot_that_does_not_go_to_its_goal(
    node: Stepped, monkeypatch: pytest.MonkeyPatch
) -> None:
    goals = Goals(node, "map")
    goals.begin(["robot_a"])
    starts: list[float] = []
    _, start, _ = goals._publishers["robot_a"]
    monkeypatch.setattr(start, "publish", lambda _: starts.append(node.now_s))
    post = Post(Role.LEADER, np.array([4.0, 0.0]), 0.0, 0.6)
    begun, x = node.now_s, 0.0
    while node.now_s < begun + 13.5:
        x += 0.1 if node.now_s < begun + 3.0 else 0.0  # then it stands, 2.5 m from its goal
        goals.send({"robot_a": post}, {"robot_a": Pose(0, x, 0.0, 0.0)})
        node.at(node.now_s + 0.2)
    assert [at - begun for at in starts] == pytest.approx([0.0, 8.0, 13.0], abs=0.5)
    goals.begin(["robot_b"])
    assert not goals.publishes("robot_a", "goal_update")
    assert node.count_publishers("/steps/robot_a/goal_update") == 0
