"""The guide's node in this process, step by step, by a clock of the test's own."""

from __future__ import annotations

import time
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
from mrs_people_loc.health.findings import OK, Code
from mrs_people_loc.team.poses import Pose
from planner_node.guide_node.bases import Goals
from planner_node.guide_node.node import GuideNode
from ros.guide_peer import goal_of, map_of, path_of, people_of
from ros.planner_peer import pose_of

PLACES = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (-3.5, 0.0, 0.0)}
#: When the tour begins [s].
START = 100.0


class Bases:
    """What the robots are told."""

    topic = "cmd_vel"

    def __init__(self) -> None:
        self.velocities: Mapping[str, tuple[float, float]] = {}
        self.stops = self.kept = 0
        self.posts: Mapping[str, Any] = {}

    def publishers_of(self, robot: str) -> int:
        return 0

    def begin(self, robots: Any) -> None:
        pass

    def drive(self, velocities: Mapping[str, tuple[float, float]]) -> None:
        self.velocities = velocities

    def send(self, posts: Mapping[str, Any], poses: Any) -> None:
        self.posts = posts

    def stop(self, poses: Any) -> None:
        self.stops += 1

    def keep_standing(self) -> None:
        self.kept += 1

    def finish(self) -> None:
        pass


class Stepped(GuideNode):
    """The node, with bases that only listen."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[Any] = []
        self.listeners = ["base"]
        self.drivers: list[str] = []
        self.now_s = 0.0

    def set_up(self) -> None:
        super().set_up()
        self.bases = Bases()
        self._bases: Any = self.bases
        self._outputs.publish = self._tell  # type: ignore[method-assign]

    def _tell(self, tour: Any, guidance: Any, poses: Any, frame_id: str) -> Any:
        self.told.append(guidance)

    def get_subscriptions_info_by_topic(self, *_: Any, **__: Any) -> Any:
        return [SimpleNamespace(node_name=name) for name in self.listeners]

    def get_publishers_info_by_topic(self, *_: Any, **__: Any) -> Any:
        return [SimpleNamespace(node_name=name, node_namespace="/") for name in self.drivers]

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


def test_robots_stand_once_people_are_as_old_as_allowed_and_go_on_after(node: Stepped) -> None:
    assert drives(node)
    while round(node.now_s / 0.05) % 4:  # people came just now
        node.run(0.05)
    node.run(0.4, people=False)
    assert drives(node)
    assert node.is_told(State.LEADING)
    node.run(0.05, people=False)
    assert not drives(node)  # it would be too late with the next velocity
    node.run(0.05, people=False)
    assert node.is_told(State.HALTED)
    assert "no people have come for 0.50 s" in node.told[-1].reason
    node.run(1.0, people=False)
    assert sum(told.state == State.HALTED for told in node.told) == 1
    node.run(1.0)
    assert drives(node)
    assert not node.is_told(State.HALTED)


def test_error_in_a_step_ends_the_tour_and_not_the_node(
    node: Stepped, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise ZeroDivisionError("on purpose")

    assert node._underway is not None
    monkeypatch.setattr(node._underway.running, "velocities", fail)
    node._tick()
    assert node._underway is None
    assert node.bases.stops == 1
    assert node.is_told(State.CANCELLED)
    assert "on purpose" in node.told[-1].reason
    assert node.is_active
    node.hear()
    node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_tour_ends_when_the_time_jumps_back(node: Stepped) -> None:
    node.at(START - 50.0)
    assert node._underway is None
    assert node.bases.stops == 1
    with pytest.raises(TourError, match="nothing comes on /steps/tracked_people"):
        node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_tour_is_refused_where_people_and_the_clock_have_stopped(
    node: Stepped, monkeypatch: pytest.MonkeyPatch
) -> None:
    node._cancel()
    assert (node.told[-1].state, node.told[-1].reason) == (State.CANCELLED, "")
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + 4.0)
    monkeypatch.setattr("planner_node.guide_node.node.time", clock)
    with pytest.raises(TourError, match=r"nothing came on /steps/tracked_people for 4\.\d s"):
        node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))
    node.hear()
    node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_parameters_take_effect_on_a_tour_but_for_its_robots(node: Stepped) -> None:
    def set_to(name: str, value: Any) -> bool:
        return bool(node.set_parameters([Parameter(name, value=value)])[0].successful)

    assert set_to("pace.speed", 0.1)
    assert set_to("robots", ["robot_b"])
    assert not set_to("drive", "nav2")
    assert node._underway is not None
    assert node._underway.running.config.pace.speed == 0.1
    assert node._underway.running.config.robots == tuple(PLACES)


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
    node.trigger_shutdown()
    kept = node.bases.kept
    node._tick()
    assert node.bases.kept == kept


def test_people_without_ids_are_named(node: Stepped) -> None:
    node._cancel()
    message = people_of(round(node.now_s * 1e9) + 1, [(-1.5, 0.0)], [(0.0, 0.0)], list(PLACES))
    message.persons[0].id = 0
    node._on_people(message)
    with pytest.raises(TourError, match=r"/steps/tracked_people have no ids; .*tracking.enabled"):
        node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_robots_of_a_tour_are_those_in_use_lately(node: Stepped) -> None:
    """One interval without the scan of a robot does not keep it out; more of them do."""
    node._cancel()
    for wanted in (("robot_a", "robot_b"), ("robot_a",)):
        now_ns = round(node.now_s * 1e9) + 1
        node._on_people(people_of(now_ns, [(-1.5, 0.0)], [(0.0, 0.0)], ["robot_a"]))
        node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))
        assert node._underway is not None
        assert node._underway.running.robots == wanted
        node._cancel()
        node.at(node.now_s + 3.0)
        node._on_pose("robot_a", pose_of(round(node.now_s * 1e9), *PLACES["robot_a"]))


def test_recorder_is_no_base(node: Stepped) -> None:
    node._cancel()
    node.listeners = ["mrs_record_17", "rosbag2_recorder"]
    with pytest.raises(TourError, match="nobody subscribes to /steps/robot_a/cmd_vel"):
        node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))
    node.listeners.append("base")
    node._begin_goal(goal_of((0.0, 0.0), (10.0, 0.0)))


def test_late_pose_is_not_used(node: Stepped) -> None:
    node.at(node.now_s + 0.05)
    now_ns = round(node.now_s * 1e9)
    node._on_pose("robot_a", pose_of(now_ns, 1.0, 0.0, 0.0))
    node._on_pose("robot_a", pose_of(now_ns - 10**8, 5.0, 0.0, 0.0))
    assert node._underway is not None
    assert node._underway.running.poses()["robot_a"].x == 1.0


def test_walls_that_come_on_a_tour_are_avoided(node: Stepped) -> None:
    assert node._underway is not None
    running = node._underway.running
    node._on_map(map_of(20.0, 10.0, [(1.0, -5.0, 1.5, 5.0)]))
    walls = running.space
    assert float(walls.clearance(PLACES["robot_a"][:2])) == pytest.approx(1.0, abs=0.1)
    node._on_map(map_of(20.0, 10.0, [(1.0, -5.0, 1.5, 5.0)]))
    assert running.space is walls, "the same map costs nothing"


def test_robots_stand_while_a_new_map_has_a_wall_on_the_way(node: Stepped) -> None:
    assert drives(node)
    node._on_map(map_of(20.0, 10.0, [(4.0, -5.0, 4.5, 5.0)]))
    node.run(1.0)
    assert not drives(node)
    assert node.is_told(State.HALTED)
    assert node.told[-1].reason.startswith("by the new map the way passes through a wall at (4.")
    node._on_map(map_of(20.0, 10.0, []))
    node.run(1.0)
    assert drives(node)
    assert not node.is_told(State.HALTED)


def test_value_from_which_cells_are_walls_takes_effect_on_a_tour(node: Stepped) -> None:
    grid = map_of(20.0, 10.0, [(4.0, -5.0, 4.5, 5.0)])
    grid.data = [min(value, 40) for value in grid.data]
    node._on_map(grid)
    assert not node.is_told(State.HALTED)
    node.set_parameters([Parameter("safety.occupied_from", value=30)])
    assert node.is_told(State.HALTED)


@pytest.mark.parametrize("is_steady", [False, True])
def test_clock_that_is_set_back_keeps_no_robot_going(
    node: Stepped, monkeypatch: pytest.MonkeyPatch, is_steady: bool
) -> None:
    """By less than what counts as a jump, and nothing comes any more."""
    if is_steady:
        node._forget()
        steady = iter(range(10**15, 2 * 10**15, 50_000_000 // 4))
        monkeypatch.setattr(node, "_time_ns", lambda: next(steady))
        node.hear()
        node.run(1.0)
        node._tick()
    assert drives(node)
    node.at(node.now_s - 0.9)
    for _ in range(40):
        node._tick()
    assert not drives(node)


def test_robot_whose_clock_is_ahead_is_missed_all_the_same(node: Stepped) -> None:
    ahead_ns = round((node.now_s + 20.0) * 1e9)
    node._on_pose("robot_b", pose_of(ahead_ns, *PLACES["robot_b"]))
    for _ in range(20):
        node.at(node.now_s + 0.15)
        now_ns = round(node.now_s * 1e9)
        node._on_pose("robot_a", pose_of(now_ns, *PLACES["robot_a"]))
        node._on_people(people_of(now_ns, [(-1.5, 0.0)], [(0.0, 0.0)], list(PLACES)))
    assert list(node.told[-1].faults) == ["robot_b"]


def test_robot_whose_base_is_gone_takes_no_part(node: Stepped) -> None:
    node.listeners = ["mrs_record_17"]
    node.run(1.5)
    assert "nobody subscribes to /steps/robot_a/cmd_vel" in node.told[-1].faults["robot_a"]
    assert node.is_told(State.HALTED)
    node.listeners = ["base"]
    node.run(1.5)
    assert not node.told[-1].faults


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


def test_goals_of_robots_with_outdated_poses_stay_where_these_are(node: Stepped) -> None:
    assert set(node.bases.posts) == set(PLACES)
    for _ in range(3):
        node.at(node.now_s + 0.2)
        now_ns = round(node.now_s * 1e9)
        node._on_pose("robot_a", pose_of(now_ns, *PLACES["robot_a"]))
        node._on_people(people_of(now_ns, [(-1.5, 0.0)], [(0.0, 0.0)], list(PLACES)))
    assert set(node.bases.posts) == {"robot_a"}
    node.run(0.6, people=False)
    assert node.bases.posts == {}
    assert node.is_told(State.HALTED)


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
    assert goals.publishers_of("robot_a") == 0
    assert node.count_publishers("/steps/robot_a/goal_update") == 0
