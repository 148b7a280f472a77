"""A robot without odometry: its pose is a parameter, valid at the stamp of every scan."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mrs_people_msgs.msg import People
from rosgraph_msgs.msg import Clock

from ros.harness import ERROR, OK, Peer, Team
from ros.recording import Recording, stamp_of
from ros.robot_peer import RobotPeer

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
PLACE = (1.5, -2.0, math.pi / 2)
PARAMETERS = {
    "pose.source": "static",
    "pose.static": str(list(PLACE)),
    "pose.sigmas": "[0.1, 0.2, 0.03]",
}


@pytest.fixture(scope="module")
def robot(team: Team, peer: Peer, recording: Recording) -> RobotPeer:
    process = team.start("robot_node", namespace="/robot_a", params=PARAMETERS)
    return RobotPeer(peer, process, recording)


@pytest.fixture(scope="module")
def people(robot: RobotPeer, team: Team, peer: Peer) -> list[Any]:
    """What a planner says that waits for this robot, and would wait long for a pose."""
    team.start("planner_node", params={"robots": "[robot_a]", "interval.max_wait": "5.0"})
    heard = peer.hear(People, "/tracked_people")
    robot.warm_up(pose=False)

    def reported() -> bool:
        robot.send(robot.view())
        peer.spin(0.1)
        return bool(heard)

    peer.until(reported, "people")
    return heard


def _planar(message: Any) -> tuple[float, float, float]:
    position, q = message.pose.pose.position, message.pose.pose.orientation
    return position.x, position.y, 2.0 * math.atan2(q.z, q.w)


def test_static_pose_is_published_before_the_first_scan(robot: RobotPeer) -> None:
    """Others may have it in view, whether its cameras work or not."""
    robot.peer.until_active(robot.node)
    before = robot.now()
    robot.peer.until(lambda: robot.poses and stamp_of(robot.poses[-1]) > before, "poses")
    assert robot.points == []
    pose = robot.poses[-1]
    assert pose.header.frame_id == "map"
    assert _planar(pose) == pytest.approx(PLACE)
    wanted = np.zeros((6, 6))
    wanted[[0, 1, 5], [0, 1, 5]] = 0.01, 0.04, 0.0009
    np.testing.assert_allclose(np.reshape(pose.pose.covariance, (6, 6)), wanted)
    stamps = [stamp_of(pose) for pose in robot.poses]
    assert (np.diff(stamps) > 0).all()
    assert robot.until_finding("pose", lambda f: f.level == OK).values["x"] == "1.500"
    assert not {"odom", "pose_in"} & {t.split("/")[-1] for t in robot.peer.heard_by(robot.node)}


def test_every_scan_has_a_static_pose_and_no_interval_waits(
    robot: RobotPeer, people: list[Any]
) -> None:
    """Also scans with old stamps, as of a recording without simulated time."""
    for start_ns in (robot.now(), 1_700_000_000 * SECOND, robot.now()):
        stamps = itertools.count(start_ns, SECOND // 10)

        def used(stamps: Iterator[int] = stamps, start_ns: int = start_ns) -> bool:
            robot.send(robot.view(next(stamps)))
            robot.peer.spin(0.1)
            return any(0 <= stamp_of(reported) - start_ns < 1000 * SECOND for reported in people)

        robot.peer.until(used, "people of these stamps")  # one that jumps is not believed at once
        # One after the other: of what comes while a node is at work, it keeps the newest only.
        sent = [next(stamps) for _ in range(3)]
        for stamp_ns in sent:
            robot.send(robot.view(stamp_ns))
            robot.peer.until(lambda s=stamp_ns: s in map(stamp_of, people), "people of each scan")  # type: ignore[misc]
        for stamp_ns in sent:
            assert _planar(robot.pose_at(stamp_ns)) == pytest.approx(PLACE)
            reported = next(m for m in people if stamp_of(m) == stamp_ns)
            assert [scan.robot for scan in reported.scans] == ["robot_a"]
            assert _planar(reported.scans[0]) == pytest.approx(PLACE)
    finding = robot.peer.until_finding(
        "/planner_node", "robot robot_a", lambda f: "age_s" in f.values
    )
    assert finding.count("dropped.no_pose") == 0


def test_changed_static_pose_takes_effect(robot: RobotPeer) -> None:
    robot.peer.must_set(robot.node, pose__static=[3.0, 4.0, -0.5])
    view = robot.view()
    robot.send(view)
    assert _planar(robot.pose_at(stamp_of(view["left"][0]))) == pytest.approx((3.0, 4.0, -0.5))
    (result,) = robot.peer.set(robot.node, pose__static=[])
    assert not result.successful
    assert result.reason == (
        "pose.source is static but pose.static is empty; allowed: x, y [m] and yaw [rad] of "
        "base_link in the map"
    )
    robot.peer.must_set(robot.node, pose__static=list(PLACE))


def test_static_poses_follow_simulated_time(team: Team, peer: Peer, recording: Recording) -> None:
    params = {**PARAMETERS, "use_sim_time": "true"}
    robot = RobotPeer(
        peer, team.start("robot_node", namespace="/robot_s", params=params), recording, "robot_s"
    )
    peer.until_active(robot.node)
    peer.until_finding(robot.node, "pose", lambda f: f.level == ERROR)
    assert robot.poses == []  # there is no time yet
    clock = Clock()
    for now in (100, 200, 150):  # and it may jump back
        clock.clock.sec = now
        peer.send("/clock", clock)
        robot.pose_at(now * SECOND)
