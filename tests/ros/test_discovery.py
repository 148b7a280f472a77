"""planner_node without a list of robots discovers them as they appear, and nothing else."""

from __future__ import annotations

import time

import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from mrs_people_msgs.msg import People
from sensor_msgs.msg import PointCloud2

from ros.harness import ERROR, OK, STALE, Peer, Team, holds
from ros.planner_peer import PlannerPeer, PlayedRobot, places, pose_of, robots_in
from ros.recording import stamp_of

SOMEBODY = (2.0, 1.0)


@pytest.fixture(scope="module")
def planner(team: Team, peer: Peer) -> PlannerPeer:
    """Would wait very long for a robot, if it knew of one."""
    patient = {"interval.max_wait": "5.0", "interval.robot_timeout": "60.0"}
    made = PlannerPeer(peer, team.start("planner_node", params=patient))
    peer.until_active(made.node)
    return made


@pytest.fixture(scope="module")
def robot(planner: PlannerPeer, peer: Peer) -> PlayedRobot:
    """The first robot; what is no robot was there before it."""
    peer.publisher(PointCloud2, "/lidar/points")
    peer.publisher(PointCloud2, "/camera/depth/points")
    peer.publisher(PoseStamped, "/camera/depth/pose")  # of another type
    peer.publisher(PoseWithCovarianceStamped, "/localizer/pose")  # without points
    peer.publisher(PointCloud2, "/robot_x/debug/cloud")
    peer.publisher(PoseWithCovarianceStamped, "/robot_x/pose")
    assert planner.process.alive
    text = "no robot yet: no namespace publishes both `points` and `pose`"
    finding = planner.until_finding("intervals", lambda f: f.level == STALE)
    assert finding.message == text
    made = PlayedRobot(peer, "robot_a", (0.0, 0.0, 0.0))
    made.announce()
    return made


def _answer(planner: PlannerPeer, *robots: PlayedRobot) -> None:
    """Sends scans until one interval holds all of these robots."""

    sent: set[int] = set()
    names = sorted(robot.name for robot in robots)

    def answered() -> bool:
        stamp_ns = planner.now()
        sent.add(stamp_ns)
        for robot in robots:
            robot.send(stamp_ns, SOMEBODY)
        for _ in range(20):
            planner.peer.spin(0.02)
            last = planner.people[-1] if planner.people else None
            if last and stamp_of(last) in sent and robots_in(last) == names:
                assert places(last) == [SOMEBODY]
                return True
        return False

    planner.peer.until(answered, lambda: planner.process.log)


def test_robot_is_found_when_it_appears(planner: PlannerPeer, robot: PlayedRobot) -> None:
    _answer(planner, robot)
    log = planner.process.log
    assert holds(log, [r"WARN.*found robot_a, and takes it for .*`robots: \[robot_a\]`"]), log


def test_single_robot_is_not_waited_for(planner: PlannerPeer, robot: PlayedRobot) -> None:
    """The answer takes less than `max_wait`, nine times of ten on a busy machine."""
    took_s = []
    for _ in range(10):
        stamp_ns = planner.now()
        began = time.monotonic()
        robot.send(stamp_ns, SOMEBODY)
        assert robots_in(planner.people_at(stamp_ns)) == ["robot_a"]
        took_s.append(time.monotonic() - began)
    print(f"answered after {', '.join(f'{took:.3f}' for took in sorted(took_s))} s")
    assert sorted(took_s)[-2] < 4.0


def test_topics_of_no_robot_are_ignored(planner: PlannerPeer, robot: PlayedRobot) -> None:
    """The other topics were there before the robot that was found."""
    _answer(planner, robot)
    wanted = {"/robot_a/points", "/robot_a/pose", "/team_poses"}
    planner.peer.until(  # the graph lags behind what is heard
        lambda: set(planner.peer.heard_by(planner.node)) == wanted,
        lambda: planner.peer.heard_by(planner.node),
    )
    findings = planner.peer.next_findings(planner.node)[planner.node]
    assert sorted(findings) == [
        "intervals",
        "people",
        "robot robot_a",
        "robot_a/points",
        "robot_a/pose",
        "state",
        "team_poses",
    ]


def test_robot_in_a_nested_namespace_joins(planner: PlannerPeer, robot: PlayedRobot) -> None:
    nested = PlayedRobot(planner.peer, "site/floor_2/robot_n", (4.0, 3.0, -2.5))
    nested.announce()
    # Scans of one frame that come before and after the interval's end shall not pair with others.
    planner.peer.must_set(planner.node, interval__max_wait=0.2)
    _answer(planner, robot, nested)
    assert list(planner.people[-1].persons[0].robots) == ["robot_a", "site/floor_2/robot_n"]
    assert "found site/floor_2/robot_n" in planner.process.log
    assert "`robots: [robot_a, site/floor_2/robot_n]`" in planner.process.log
    planner.peer.must_set(planner.node, interval__robot_timeout=0.2)  # it leaves again


def test_robot_without_a_pose_is_reported(planner: PlannerPeer, robot: PlayedRobot) -> None:
    """It advertises `pose` but publishes none: its scans cannot be placed, those of others are."""
    lost = PlayedRobot(planner.peer, "robot_l", (0.0, 0.0, 0.0))
    lost.announce()

    def named() -> bool:
        stamp_ns = planner.now()
        lost.send_points(lost.scan(stamp_ns, (5.0, 5.0)))
        robot.send(stamp_ns, SOMEBODY)
        message = planner.people_at(stamp_ns)
        assert robots_in(message) == ["robot_a"]
        assert places(message) == [SOMEBODY]
        finding = planner.peer.findings(planner.node).get("robot robot_l")
        return finding is not None and finding.message == "scans but no pose on robot_l/pose"

    planner.peer.until(named, lambda: planner.peer.findings(planner.node))
    finding = planner.peer.findings(planner.node)["robot robot_l"]
    assert finding.level == ERROR
    assert finding.count("dropped.no_pose") > 0
    assert "robot_l: scan left out: no pose has arrived" in planner.process.log
    text = r"no data on /robot_l/pose for \d+ s; publishers: 1"
    planner.until_finding("robot_l/pose", lambda f: holds(f.message, [text]))
    lost.send_pose(pose_of(planner.now(), *lost.place))
    planner.until_finding("robot robot_l", lambda f: f.level != ERROR)


def test_robot_that_left_and_came_back_joins_again(
    planner: PlannerPeer, robot: PlayedRobot
) -> None:
    """A new process of the same name: its publishers replace those before."""
    planner.peer.must_set(planner.node, interval__max_wait=5.0, interval__robot_timeout=60.0)
    for topic in ("points", "pose"):
        planner.peer.silence(f"/{robot.name}/{topic}")
    text = r"no data on /robot_a/points for \d+ s; publishers: 0"
    planner.until_finding("robot_a/points", lambda f: holds(f.message, [text]))
    planner.peer.must_set(planner.node, interval__robot_timeout=1.0)
    robot.announce()
    _answer(planner, robot)


def test_second_planner_is_reported(planner: PlannerPeer) -> None:
    planner.peer.publisher(People, "/tracked_people")
    finding = planner.until_finding("people", lambda f: f.level == ERROR)
    wanted = r"2 publishers on /tracked_people: /peer, /planner_node; another .* ROS_DOMAIN_ID"
    assert holds(finding.message, [wanted])
    assert "2 publishers on /tracked_people" in planner.process.log
    planner.peer.silence("/tracked_people")
    planner.until_finding("people", lambda f: f.level == OK)
