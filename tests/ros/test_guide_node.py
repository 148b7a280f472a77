"""guide_node: tours by action and by path, what it refuses, and when the robots stand."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from mrs_people_msgs.msg import GuideStatus
from rclpy.qos import QoSProfile
from std_msgs.msg import Empty, String
from std_srvs.srv import Trigger

from machine import nine_of_ten
from mrs_ros.network import node_of
from ros.guide_peer import GuideWorld, goal_of, map_of, path_of
from ros.harness import ERROR, OK, WARN, NodeProcess, Peer, Team

pytestmark = pytest.mark.slow

#: A tour in seconds: fast robots, which may find each other's way quickly.
FAST = {
    "pace.speed": "1.5",
    "base.max_speed": "1.5",
    "base.acceleration": "2.0",
    "looks_back": "[robot_a]",
}
#: On a machine that is busy with other things, people and poses come late.
PATIENT = {"safety.people_timeout": "3.0", "safety.pose_timeout": "3.0"}
#: As shipped.
PEOPLE_TIMEOUT_S = 0.5
STAND = (0.0, 0.0)
PLACES = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (-3.5, 0.0, 0.0)}
PEOPLE = [(-1.5, 0.0), (-1.5, 0.6)]
AHEAD = goal_of((0.0, 0.0), (3.0, 0.0))


@pytest.fixture(scope="module")
def guide(team: Team) -> NodeProcess:
    """The node that is asked for tours; it halts as shipped."""
    return team.start("guide_node", params=FAST | {"base.stamped": "true"})


@pytest.fixture(scope="module")
def doomed(team: Team) -> NodeProcess:
    """A node that is ended in the middle of a tour."""
    return team.start("guide_node", namespace="/doomed", params=FAST | PATIENT)


@pytest.fixture(scope="module")
def nav2(team: Team) -> NodeProcess:
    """A node that drives robots by Nav2."""
    params = FAST | PATIENT | {"drive": "nav2", "robots": "[robot_a]"}
    return team.start("guide_node", namespace="/nav2", params=params)


@pytest.fixture
def make_world(
    peer: Peer, guide: NodeProcess, doomed: NodeProcess, nav2: NodeProcess
) -> Iterator[Callable[..., GuideWorld]]:
    made: list[GuideWorld] = []

    def make(namespace: str = "/", **how: Any) -> GuideWorld:
        how = {"places": PLACES, "people": PEOPLE, "stamped": namespace == "/"} | how
        world = GuideWorld(peer, namespace, **how)
        made.append(world)
        peer.until_active(f"{namespace}guide_node")
        return world

    yield make
    for world in made:
        world.close()


def _until_standing(world: GuideWorld) -> None:
    """Waits for the last command, which may come after the result."""

    def last() -> list[list[tuple[float, float]]]:
        return [world.last_commands(robot, 1) for robot in PLACES]

    world.peer.until(lambda: last() == [[STAND]] * len(PLACES), last)


def _is_driven(world: GuideWorld, *robots: str) -> bool:
    """Whether one of these robots, or any, is told to drive or turn."""
    last = [one for robot in robots or PLACES for one in world.last_commands(robot, 3)]
    return any(abs(v) + abs(w) > 0.2 for v, w in last)


def _status(world: GuideWorld) -> Any:
    return world.statuses[-1] if world.statuses else None


def test_group_is_guided_to_the_end_though_the_planner_fails_on_the_way(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world()
    peer = world.peer
    feedback: list[GuideStatus] = []
    goal = goal_of((0.0, 0.0), (2.2, 0.0), stops=[("Foyer", (0.5, 0.5), 0)])
    _, result = world.start(goal, feedback)
    for robot in PLACES:
        peer.until(lambda r=robot: _is_driven(world, r), lambda: guide.log)  # type: ignore[misc]

    world.speaks.remove("people")
    peer.until(lambda: _status(world).state == GuideStatus.HALTED, lambda: guide.log)
    assert "people" in _status(world).reason
    peer.spin(0.5)
    assert world.last_commands("robot_a", 5) == world.last_commands("robot_b", 5) == [STAND] * 5

    world.speaks.add("people")
    peer.until(result.done, lambda: guide.log)
    assert result.result().status == GoalStatus.STATUS_SUCCEEDED
    assert result.result().result.finished
    states = [state for state, _ in itertools.groupby(status.state for status in feedback)]
    assert states[0] == GuideStatus.GATHERING
    assert states[-1] == GuideStatus.FINISHED
    assert {GuideStatus.LEADING, GuideStatus.AT_STOP, GuideStatus.HALTED} <= set(states)
    assert {s.stop for s in feedback if s.state == GuideStatus.AT_STOP} == {"Foyer"}
    assert feedback[-1].way == pytest.approx(feedback[-1].length, abs=2.5)
    assert world.places["robot_a"][:2] == pytest.approx((2.2, 0.0), abs=0.6)
    # A joystick may drive after it.
    peer.spin(1.0)
    count = len(world.commands)
    peer.spin(0.5)
    assert len(world.commands) == count
    assert world.last_commands("robot_b", 3) == [STAND] * 3


@pytest.mark.alone
def test_robots_stand_in_time_once_people_stop_coming(
    make_world: Callable[..., GuideWorld], guide: NodeProcess, show: Callable[[str], None]
) -> None:
    world = make_world()
    _, result = world.start(goal_of((0.0, 0.0), (30.0, 0.0)))

    def moved_s() -> float:
        """For how long robots move after the last people [s]."""
        world.peer.until(lambda: _is_driven(world), lambda: guide.log)
        world.speaks.remove("people")
        last_ns = world.last_people_ns
        world.peer.until(lambda: _status(world).state == GuideStatus.HALTED, lambda: guide.log)
        world.peer.spin(0.3)
        world.speaks.add("people")
        moved = (one.sent_ns for one in world.commands if (one.v, one.w) != STAND)
        return (max(moved) - last_ns) / 1e9

    what = "people stop: the last velocity of a robot"
    nine_of_ten(moved_s, PEOPLE_TIMEOUT_S, what, show=show)
    assert not result.done()


def test_cancelled_tour_stops_the_robots_at_once(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world()
    handle, result = world.start(AHEAD)
    world.peer.until(lambda: _is_driven(world), lambda: guide.log)
    assert handle.status == GoalStatus.STATUS_EXECUTING
    second = world.refused(goal_of((0.0, 0.0), (2.0, 0.0), name="another"))
    assert second == "the tour 'hall' is under way; cancel it first"
    handle.cancel_goal_async()
    world.peer.until(result.done, lambda: guide.log)
    # What was sent before the result may come after it.
    world.peer.spin(0.05)
    _until_standing(world)
    assert result.result().status == GoalStatus.STATUS_CANCELED
    assert not result.result().result.finished
    assert _status(world).state == GuideStatus.CANCELLED


def test_stop_holds_until_it_is_released_though_tours_come(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world()
    peer = world.peer
    handle, result = world.start(AHEAD)
    peer.until(lambda: _is_driven(world), lambda: guide.log)
    stops = peer.publisher(Empty, "/stop", QoSProfile(depth=1))
    peer.until(stops.get_subscription_count, "nobody listens to stop")
    stops.publish(Empty())
    peer.until(lambda: _status(world).state == GuideStatus.STOPPED, lambda: guide.log)
    _until_standing(world)
    who = peer.node.get_fully_qualified_name(), "somebody"  # a name may be discovered later
    assert _status(world).reason in [f"stopped by {one} on /stop" for one in who]
    world.commands.clear()
    peer.spin(1.0)
    assert {(one.v, one.w) for one in world.commands} == {STAND}
    assert all(len(world.last_commands(robot, 99)) > 12 for robot in PLACES), "33 Hz"
    # It outlives the tour, and no other one begins.
    handle.cancel_goal_async()
    peer.until(result.done, lambda: guide.log)
    assert world.refused(AHEAD).endswith("release the robots first: mrs tour release")
    peer.spin(1.0)
    world.commands.clear()
    peer.spin(0.5)
    assert {(one.v, one.w) for one in world.commands} == {STAND}
    found = peer.until_finding("/guide_node", "tour", lambda f: f.level == WARN)
    assert found.values["code"] == "tour_stopped"
    assert peer.call(Trigger, "/release", Trigger.Request()).success
    assert not peer.call(Trigger, "/release", Trigger.Request()).success
    world.start(AHEAD)
    peer.until(lambda: _is_driven(world), lambda: guide.log)
    # And a tour that was stopped goes on.
    assert peer.call(Trigger, "/stop", Trigger.Request()).success
    _until_standing(world)
    assert peer.call(Trigger, "/release", Trigger.Request()).success
    peer.until(lambda: _is_driven(world), lambda: guide.log)


def test_stop_outlives_a_cleanup(make_world: Callable[..., GuideWorld], guide: NodeProcess) -> None:
    """Whoever manages the node does not release robots."""
    world = make_world()
    peer = world.peer
    _, result = world.start(AHEAD)
    peer.until(lambda: _is_driven(world), lambda: guide.log)
    assert peer.call(Trigger, "/stop", Trigger.Request()).success
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        assert peer.change_state("/guide_node", transition)
    peer.until(result.done, lambda: guide.log)
    world.commands.clear()
    peer.spin(1.0)
    assert {(one.v, one.w) for one in world.commands} == {STAND}
    assert {one.robot for one in world.commands} == set(PLACES), "those of the last tour"
    assert world.refused(AHEAD).endswith("release the robots first: mrs tour release")
    assert peer.call(Trigger, "/release", Trigger.Request()).success


def test_mrs_tour_stop_and_release(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world()
    world.start(AHEAD)
    world.peer.until(lambda: _is_driven(world), lambda: guide.log)
    for request, says in (("stop", "stopped by"), ("release", "released")):
        with subprocess.Popen(
            [sys.executable, "-m", "mrs_tools", "tour", request], stdout=subprocess.PIPE, text=True
        ) as asking:
            world.peer.until(lambda a=asking: a.poll() is not None, "no answer")  # type: ignore[misc]
            assert asking.returncode == 0
            assert asking.stdout is not None
            assert asking.stdout.read().startswith(says)
        if request == "stop":
            _until_standing(world)
    world.peer.until(lambda: _is_driven(world), lambda: guide.log)


def test_attended_tour_ends_with_its_client(
    make_world: Callable[..., GuideWorld], guide: NodeProcess, tmp_path: Path
) -> None:
    world = make_world()
    file = tmp_path / "hall.yaml"
    file.write_text("points: [[0, 0], [30, 0]]\n")
    command = [sys.executable, "-m", "mrs_tools", "tour", str(file), "--attended"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as tour:
        world.peer.until(lambda: _is_driven(world), lambda: guide.log)
        world.peer.spin(3.0)
        assert _status(world).state != GuideStatus.CANCELLED
        tour.kill()
    began_s = time.monotonic()
    world.peer.until(lambda: _status(world).state == GuideStatus.CANCELLED, lambda: guide.log)
    assert time.monotonic() - began_s < 4.0
    assert _status(world).reason == "its client has been silent for 2 s"
    _until_standing(world)


def test_path_starts_a_tour_and_an_empty_one_cancels_it(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world()
    peer = world.peer
    peer.until(world.path.get_subscription_count, "nobody listens to tour_path")
    peer.spin(0.5)
    world.path.publish(path_of((0.0, 0.0), (1.0, 0.0), (3.0, 0.0)))
    peer.until(lambda: _is_driven(world), lambda: guide.log)
    assert _status(world).tour == "tour"
    world.path.publish(path_of())
    peer.until(lambda: _status(world).state == GuideStatus.CANCELLED, lambda: guide.log)
    world.path.publish(path_of((0.0, 0.0), (3.0, 0.0), frame_id="odom"))
    counted = "dropped.TourError"
    peer.until_finding("/guide_node", "tour_path", lambda f: f.values.get(counted) == "1")


def test_deactivated_node_lets_the_robots_stand(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world()
    _, result = world.start(AHEAD)
    world.peer.until(lambda: _is_driven(world), lambda: guide.log)
    assert world.peer.change_state("/guide_node", "deactivate")
    world.peer.until(result.done, lambda: guide.log)
    assert result.result().status == GoalStatus.STATUS_ABORTED
    assert result.result().result.message == "guide_node was deactivated"
    _until_standing(world)
    handle, _ = world.ask(AHEAD)
    assert not handle.accepted
    assert world.peer.change_state("/guide_node", "activate")


def test_second_guide_is_named_and_no_tour_begins_beside_it(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world()
    peer = world.peer
    second = peer.node.create_publisher(GuideStatus, "/guide_status", 10)
    found = peer.until_finding("/guide_node", "guides", lambda f: f.level == ERROR)
    names = ", ".join(sorted(["/guide_node", peer.node.get_fully_qualified_name()]))
    both = f"2 publishers on /guide_status: {names}; another guide_node"
    assert found.message.startswith(both)
    assert world.refused(AHEAD).startswith(both)
    peer.node.destroy_publisher(second)
    peer.until_finding("/guide_node", "guides", lambda f: f.level == OK)


def test_bad_goals_are_refused_before_anything_moves(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    world = make_world(bases=["robot_a"], speaks=())
    peer = world.peer
    for transition in ("deactivate", "activate"):  # it forgets whom it has heard
        assert peer.change_state("/guide_node", transition)
    assert world.refused(AHEAD) == "nothing comes on /tracked_people; is the planner running?"
    world.speaks.add("people")
    peer.until(lambda: "/robot_b/pose" in peer.heard_by("/guide_node"), lambda: guide.log)
    no_pose = "robot_a has no pose: nothing comes on /robot_a/pose"
    peer.until(lambda: world.refused(AHEAD) == no_pose, lambda: guide.log)
    world.speaks.add("poses")
    no_base = "robot_b has no base: nobody subscribes to /robot_b/cmd_vel"
    peer.until(lambda: world.refused(AHEAD) == no_base, lambda: world.refused(AHEAD))
    world.give_base("robot_b")
    world.map.publish(map_of(20.0, 10.0, [(2.0, -5.0, 2.5, 5.0)]))
    wall = "the way passes through a wall at (2."
    peer.until(lambda: wall in world.refused(AHEAD), lambda: world.refused(AHEAD))
    for goal, reason in (
        (goal_of((0.0, 0.0)), "a tour needs at least two points"),
        (
            goal_of((0.0, 0.0), (1.5, 0.0), frame_id="odom"),
            "frame_id of the path is 'odom'; wanted: 'map'",
        ),
        (
            goal_of((0.0, 0.0), (1.5, 0.0), stops=[("Foyer", (1.0, 4.0), 1)]),
            "stop 'Foyer' is 4.0 m from the way; allowed: 2 m",
        ),
    ):
        assert reason in world.refused(goal)
    assert {(one.v, one.w) for one in world.commands} <= {STAND}
    world.map.publish(map_of(20.0, 10.0, []))


def test_robots_stand_when_the_node_is_ended(
    make_world: Callable[..., GuideWorld], doomed: NodeProcess
) -> None:
    world = make_world("/doomed/")
    _, result = world.start(AHEAD)
    world.peer.until(lambda: _is_driven(world), lambda: doomed.log)
    doomed.process.send_signal(signal.SIGTERM)
    world.peer.until(lambda: not doomed.alive, lambda: doomed.log)
    assert doomed.exit_code() == 0, doomed.log
    world.peer.spin(0.2)
    _until_standing(world)
    assert result.done(), doomed.log
    assert result.result().result.message == "guide_node has ended"


def test_robots_are_driven_through_their_collision_monitors(
    make_world: Callable[..., GuideWorld], guide: NodeProcess, team: Team
) -> None:
    """The chain: guide_node, the monitor of robot_a's robot_node, its base; robot_b has none."""
    params = {"collision_monitor.stamped": "true", "collision_monitor.crawl": "0.05"}
    robot = team.start("robot_node", namespace="/robot_a", params=params)
    world = make_world()
    peer = world.peer
    peer.until_active("/robot_a/robot_node")
    peer.until(lambda: "/robot_a/cmd_vel_guide" in peer.heard_by("/robot_a/robot_node"), "")
    events = peer.hear(String, "/events")
    handle, result = world.start(AHEAD)
    peer.until(lambda: _is_driven(world, "robot_b"), lambda: guide.log)
    # On a busy machine the guide may discover the monitor later than this test does.
    alone = "no collision monitor: only tracked people and the map stop robot_b"
    found = peer.until_finding("/guide_node", "monitors", lambda f: f.message == alone)
    assert (found.level, found.values["code"]) == (WARN, "no_monitor")
    assert any("no collision monitor" in event.data for event in events)
    world.commands.clear()

    def speeds() -> list[float]:
        return [speed for speed, _ in world.last_commands("robot_a", len(world.commands))]

    peer.until(lambda: 0.05 in speeds(), lambda: f"{speeds()[-5:]} {guide.log} {robot.log}")
    assert max(speeds()) == 0.05
    names = {node_of(one) for one in peer.node.get_publishers_info_by_topic("/robot_a/cmd_vel")}
    assert names == {"/robot_a/robot_node"}, "it sees nothing, and crawls"
    assert peer.findings("/guide_node")["commands"].level == OK, "it is no other driver"

    robot.stop()
    gone = "nobody subscribes to /robot_a/cmd_vel_guide"
    peer.until(lambda: any(gone in post.fault for post in _status(world).posts), lambda: guide.log)
    handle.cancel_goal_async()
    peer.until(result.done, lambda: guide.log)


def test_nav2_gets_one_start_and_then_goals_with_later_and_later_stamps(
    make_world: Callable[..., GuideWorld], nav2: NodeProcess
) -> None:
    world = make_world("/nav2/", places={"robot_a": PLACES["robot_a"]}, bases=[])
    lacks = "robot_a has no base: nobody subscribes to /nav2/robot_a/goal_update"
    world.peer.until(lambda: world.refused(AHEAD) == lacks, lambda: world.refused(AHEAD))
    starts, updates, cancelled = world.give_nav2("robot_a")
    handle, result = world.start(AHEAD)
    world.peer.until(lambda: len(updates) > 15, lambda: nav2.log)
    assert len(starts) == 1
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in [*starts, *updates]]
    assert stamps == sorted(set(stamps))
    assert {m.header.frame_id for m in updates} == {"map"}
    # It leads on while its goal moves on.
    world.peer.until(lambda: updates[-1].pose.position.x > 0.3, lambda: nav2.log)
    handle.cancel_goal_async()
    world.peer.until(result.done, lambda: nav2.log)
    world.peer.until(lambda: cancelled, lambda: nav2.log)
    assert list(cancelled[0].goal_info.goal_id.uuid) == [0] * 16, "all goals"
    assert updates[-1].pose.position.x == pytest.approx(world.places["robot_a"][0])
    assert {(one.v, one.w) for one in world.commands} <= {STAND}


def test_mrs_tour_is_cancelled_by_ctrl_c(
    make_world: Callable[..., GuideWorld], guide: NodeProcess, domain: int, tmp_path: Path
) -> None:
    world = make_world()
    file = tmp_path / "hall.yaml"
    file.write_text("points: [[0, 0], [3, 0]]\nstops: [{name: Foyer, at: [1, 0.5]}]\n")
    with subprocess.Popen(
        [sys.executable, "-m", "mrs_tools", "tour", str(file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as tour:
        world.peer.until(lambda: _is_driven(world), lambda: guide.log)
        tour.send_signal(signal.SIGINT)
        world.peer.until(lambda: tour.poll() is not None, "mrs tour does not end")
        assert tour.stdout is not None
        reported = tour.stdout.read()
    assert tour.returncode == 130, reported
    assert "gathering; sees" in reported
    assert reported.endswith("cancelled\n")
    assert (_status(world).tour, _status(world).stop) == ("hall", "Foyer")
    _until_standing(world)


def test_guide_that_waits_for_a_tour_complains_of_nothing(
    make_world: Callable[..., GuideWorld],
) -> None:
    world = make_world()
    world.map.publish(map_of(20.0, 10.0, []))

    def well() -> bool:
        found = world.peer.next_findings("/guide_node")["/guide_node"]
        return all(finding.level == OK for finding in found.values())

    world.peer.until(well, lambda: world.peer.findings("/guide_node"))


def test_node_that_is_shut_down_on_a_tour_lets_the_robots_stand(
    make_world: Callable[..., GuideWorld], guide: NodeProcess
) -> None:
    """By the lifecycle transition: the publishers are destroyed at once."""
    world = make_world()
    world.start(AHEAD)
    world.peer.until(lambda: _is_driven(world), lambda: guide.log)
    assert world.peer.change_state("/guide_node", "shutdown")
    assert world.peer.state("/guide_node") == "finalized"
    _until_standing(world)
    guide.stop()
