"""`mrs doctor` as a process, looking at real ones (its words: tests/tools/test_doctor.py)."""

from __future__ import annotations

import subprocess
import sys

import pytest
from std_msgs.msg import String

from ros.harness import ERROR, Peer, Team

ROBOT, PLANNER = "/robot_a/robot_node", "/planner_node"


def doctor() -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mrs_tools", "doctor", "--duration", "5"]
    return subprocess.run(command, capture_output=True, text=True, timeout=90)


def test_an_empty_network(domain: int) -> None:
    told = doctor()
    assert told.returncode == 1, told.stderr
    assert f"no robot_node and no planner_node in ROS domain {domain}" in told.stdout


@pytest.mark.timeout(300)
def test_a_robot_without_cameras_and_a_stranger(team: Team, peer: Peer) -> None:
    """Nobody sends images or odometry, and somebody hears `people` as what it is not."""
    team.start("planner_node", params={"robots": "[robot_a]"})
    team.start("robot_node", namespace="/robot_a")
    peer.hear(String, "/people")
    peer.until_active(PLANNER, ROBOT)
    peer.until_finding(ROBOT, "odom", lambda f: f.level == ERROR)
    lines = (
        "error  /people: /planner_node publishes it and /peer subscribes: "
        "mrs_people_msgs/msg/People, std_msgs/msg/String",
        "/robot_a/robot_node: odom: no data on /robot_a/odom for",
        "-> start what publishes it, or remap it",
        "waiting  /planner_node: robot robot_a: no scan used yet",
    )
    for _ in range(3):  # it looks for so long and no longer, and the machine may be busy
        told = doctor()
        assert told.returncode == 1, told.stderr
        if all(line in told.stdout for line in lines):
            return
    raise AssertionError(told.stdout)
