"""Robots and planners are killed, restarted, join and leave; the others keep running."""

from __future__ import annotations

import copy
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
from mrs_people_msgs.msg import People

from mrs_people_loc.messages import stamp_ns_of
from ros.harness import ERROR, STALE, WARN, Peer, Team, holds
from ros.life import ROBOTS, Life, kill
from ros.planner_peer import PlannerPeer, PlayedRobot, places, pose_of, robots_in
from ros.recording import Recording, stamp_of

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
#: The recorded cylinders stand in one place all the time, and one of them looks like a doubtful
#: person only: its place counts against it in the end, after 15 s here, which is not what is tried.
STANDING = {"tracking.static_score": "0.0"}


@pytest.fixture(scope="module")
def life(team: Team, domain: int, recording: Recording) -> Iterator[Life]:
    """Only the planner runs at first, and looks for robots."""
    peer = Peer(domain)
    planner = team.start("planner_node", params=STANDING)
    peer.until_active(planner.name)
    own = copy.deepcopy(recording)  # its stamps are changed
    yield Life(peer, team, own, planner, peer.hear(People, "/tracked_people"))
    peer.close()


def test_planner_waits_while_there_is_no_robot(life: Life) -> None:
    finding = life.peer.until_finding("/planner_node", "intervals", lambda f: f.level == STALE)
    assert finding.message.startswith("no robot yet")
    assert life.people == []


def test_robots_join_one_after_another(life: Life) -> None:
    for number, robot in enumerate(ROBOTS):
        life.start(robot)
        life.until_seen_by(*ROBOTS[: number + 1])
    life.until(lambda: len(life.people[-1].persons) == 5, "all five people")


def test_late_scans_of_a_resumed_robot_are_in_no_interval(life: Life) -> None:
    """What it was working on when it was stopped is seconds old when it arrives."""
    life.until_seen_by(*ROBOTS)
    first = len(life.people)
    for _ in range(2):
        os.kill(life.robots["robot_b"].process.pid, signal.SIGSTOP)
        try:
            for _ in range(20):
                life.feed()
        finally:
            os.kill(life.robots["robot_b"].process.pid, signal.SIGCONT)
        life.until_seen_by(*ROBOTS)
    since = life.people[first:]
    assert len(since) > 20
    stamps = [stamp_of(message) for message in since]
    assert stamps == sorted(stamps)
    oldest = max(stamp_of(m) - min(stamp_ns_of(scan.stamp) for scan in m.scans) for m in since)
    assert oldest <= 250_000_000  # interval.max_scan_age
    assert all(len(message.persons) <= 5 for message in since)


def test_team_goes_on_without_a_killed_robot_until_it_returns(life: Life) -> None:
    before = life.people[-1]
    kill(life.robots["robot_b"])
    life.until_seen_by("robot_a", "robot_c")
    kept = np.array(places(life.people[-1])).reshape(-1, 2)
    for person in before.persons:
        if set(person.robots) - {"robot_b"}:  # somebody else saw them
            position = person.pose.pose.position
            assert np.hypot(*(kept - (position.x, position.y)).T).min() < 0.5
    text = [r"no data on /robot_b/points for \d+ s; publishers: \d"]
    life.until(
        lambda: holds(_message(life, "robot_b/points"), text), "the diagnostics name the robot"
    )
    life.start("robot_b")
    life.until_seen_by(*ROBOTS)


def _message(life: Life, name: str) -> str:
    finding = life.peer.findings("/planner_node").get(name)
    return finding.message if finding and finding.level == ERROR else ""


@pytest.mark.parametrize(
    ("node", "loaded"),
    [
        ("planner_node.node", set()),
        ("planner_node.guide_node.node", {"cv2"}),
        ("robot_node.node", {"cv2"}),
    ],
)
def test_node_is_on_the_network_before_its_libraries_are_loaded(
    node: str, loaded: set[str]
) -> None:
    """The slowest libraries are loaded during discovery, or not at all; no tool ever is."""
    slow = "{'cv2', 'matplotlib', 'mrs_tools', 'rich', 'rosbags', 'scipy', 'typer'}"
    code = f"import sys, {node}; print(*{slow} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == loaded


def test_planner_that_was_killed_works_again_after_a_restart(life: Life) -> None:
    kill(life.planner)
    life.planner = life.team.start("planner_node", params=STANDING)
    life.until_seen_by(*ROBOTS)
    life.until(lambda: len(life.people[-1].persons) == 5, "all five people")


def test_planner_unsubscribes_from_a_robot_that_has_left(life: Life) -> None:
    life.robots["robot_c"].stop()
    life.until_seen_by("robot_a", "robot_b")
    assert life.planner.alive


# --- clocks, and many robots: these are played ----------------------------------------------------


@pytest.fixture(scope="module")
def planner(team: Team, peer: Peer) -> PlannerPeer:
    made = PlannerPeer(peer, team.start("planner_node", namespace="/played"), "/played/")
    peer.until_active(made.node)
    return made


@pytest.fixture(scope="module")
def eight(planner: PlannerPeer) -> list[PlayedRobot]:
    """Eight robots in a circle around somebody."""
    angles = [number * math.pi / 4 for number in range(8)]
    robots = [
        PlayedRobot(
            planner.peer,
            f"played/robot_{number}",
            (2 + 3 * math.cos(a), 1 + 3 * math.sin(a), a + math.pi),
        )
        for number, a in enumerate(angles)
    ]
    for robot in robots:
        robot.announce()
    return robots


def play(
    planner: PlannerPeer,
    robots: list[PlayedRobot],
    ahead_s: dict[int, float] | None = None,
    people: tuple[tuple[float, float], ...] = ((2.0, 1.0),),
    moved: dict[int, float] | None = None,
) -> list[str]:
    """Sends what each robot sees now; who the last interval is of.

    By robot, what its clock is ahead by, and how far in x it is from where it says.
    """
    for number, robot in enumerate(robots):
        stamp_ns = time.time_ns() + round((ahead_s or {}).get(number, 0.0) * SECOND)
        x, y, yaw = robot.place
        pose = pose_of(stamp_ns, x + (moved or {}).get(number, 0.0), y, yaw)
        robot.peer.publisher(type(pose), f"/{robot.name}/pose").publish(pose)
        scan = robot.scan(stamp_ns, *people)
        robot.peer.publisher(type(scan), f"/{robot.name}/points").publish(scan)
    planner.peer.spin(0.1)
    return robots_in(planner.people[-1]) if planner.people else []


def test_eight_robots_see_one_person(planner: PlannerPeer, eight: list[PlayedRobot]) -> None:
    names = [f"robot_{number}" for number in range(8)]
    planner.peer.until(lambda: play(planner, eight) == names, lambda: planner.process.log)
    (person,) = planner.people[-1].persons
    assert list(person.robots) == names
    assert places(planner.people[-1]) == [(2.0, 1.0)]


@pytest.mark.parametrize(
    ("ahead_s", "wanted"),
    [
        (3.0, r"its clock is [23]\.\d+ s ahead of the others': its scans are left out"),
        (-3.0, r"its clock is [23]\.\d+ s behind the others': its scans are left out"),
        (0.5, r"its clock is 0\.[345]\d+ s ahead of the others': its scans are left out"),
    ],
)
def test_robot_with_a_wrong_clock_is_reported_and_left_out(
    planner: PlannerPeer, eight: list[PlayedRobot], ahead_s: float, wanted: str
) -> None:
    names = [f"robot_{number}" for number in range(8)]
    others = [*names[:3], *names[4:]]
    off = {3: ahead_s}
    planner.peer.until(lambda: play(planner, eight, off) == others, lambda: planner.process.log)

    def named() -> bool:
        play(planner, eight, off)
        finding = planner.peer.findings(planner.node).get("robot robot_3")
        return finding is not None and finding.level == ERROR and holds(finding.message, [wanted])

    planner.peer.until(named, lambda: planner.peer.findings(planner.node).get("robot robot_3"))
    assert planner.peer.findings(planner.node)["robot robot_3"].count("dropped.clock_offset") > 0
    # The others are not harmed, and it is back as soon as its clock is right.
    assert places(planner.people[-1]) == [(2.0, 1.0)]
    planner.peer.until(lambda: play(planner, eight) == names, lambda: planner.process.log)


def test_robot_with_a_wrong_pose_is_reported(
    planner: PlannerPeer, eight: list[PlayedRobot]
) -> None:
    people = ((2.0, 1.0), (2.9, 1.4), (1.2, 0.1))

    def named() -> bool:
        play(planner, eight, people=people, moved={5: 0.6})
        finding = planner.peer.findings(planner.node).get("robot robot_5")
        return finding is not None and finding.level == WARN and "moved by" in finding.message

    planner.peer.until(named, lambda: planner.peer.findings(planner.node).get("robot robot_5"))
    findings = planner.peer.findings(planner.node)
    assert holds(findings["robot robot_5"].message, [r"moved by \(-0\.[56]\d, -?0\.0\d\) m in map"])
    assert not [n for n in range(8) if n != 5 and "moved" in findings[f"robot robot_{n}"].message]
