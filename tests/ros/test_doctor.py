"""`mrs doctor` with real nodes over DDS (its sentences: tests/tools/diagnosis).

Nodes are processes whose inputs are missing or wrong; the cause must be on top, and below it what
follows from it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest
from mrs_people_msgs.msg import People
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image
from std_msgs.msg import String

from mrs_tools.diagnosis.diagnose import Check, diagnose
from mrs_tools.diagnosis.facts import ERROR, OK
from mrs_tools.diagnosis.look import look
from ros.harness import DEADLINE_S, Finding, Peer, Team
from ros.harness import ERROR as ERROR_LEVEL
from ros.recording import Recording, set_stamp
from ros.robot_peer import MutableView, RobotPeer

pytestmark = pytest.mark.slow

ROBOT, PLANNER = "/robot_a/robot_node", "/planner_node"


def doctor() -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mrs_tools", "doctor", "--duration", "5"]
    return subprocess.run(command, capture_output=True, text=True, timeout=90)


def looked(peer: Peer, meanwhile: Callable[[], object] = lambda: None) -> list[Check]:
    """What the doctor says after a look of a good second, in which something goes on."""

    def spin() -> None:
        meanwhile()
        peer.spin(0.1)

    return [c for c in diagnose(look(peer.node, 1.2, spin)) if c.level != OK]


def until_said(
    peer: Peer,
    wanted: Callable[[list[Check]], bool],
    meanwhile: Callable[[], object] = lambda: None,
) -> list[Check]:
    """Looks again and again: the machine may be busy."""
    end = time.monotonic() + DEADLINE_S
    while True:
        checks = looked(peer, meanwhile)
        if wanted(checks):
            return checks
        assert time.monotonic() < end, "\n".join(map(str, checks))


def text_about(checks: list[Check], subject: str) -> str:
    check = about(checks, subject)
    return "" if check is None else check.text


def about(checks: list[Check], subject: str) -> Check | None:
    return next((check for check in checks if check.subject == subject), None)


def test_empty_network_is_an_error(domain: int) -> None:
    printed = doctor()
    assert printed.returncode == 1, printed.stderr
    assert f"no robot_node and no planner_node in ROS domain {domain}" in printed.stdout


# --- robot_a, whose camera does all that cameras do ----------------------------------------------


@pytest.fixture(scope="module")
def robot(team: Team, peer: Peer, recording: Recording) -> RobotPeer:
    """A robot and its planner at work."""
    team.start("planner_node", params={"robots": "[robot_a]"})
    process = team.start("robot_node", namespace="/robot_a")
    made = RobotPeer(peer, process, recording)
    peer.until_active(PLANNER, ROBOT)
    return made


def test_missing_inputs_and_a_wrong_type_are_reported(robot: RobotPeer, domain: int) -> None:
    """No images or odometry are published, and a subscriber has the wrong type for `people`."""
    stranger = Peer(domain, "stranger")
    try:
        stranger.hear(String, "/tracked_people")
        robot.until_finding("odom", lambda f: f.level == ERROR_LEVEL)
        lines = (
            "error  /tracked_people: 2 types, which never connect: mrs_people_msgs/msg/People "
            "(/planner_node publishes); std_msgs/msg/String (/stranger subscribes)",
            "/robot_a/robot_node: odom: no data on /robot_a/odom for",
            "-> start what publishes it, or remap it",
            "so: /planner_node: robot robot_a: no scan used yet",
        )
        for _ in range(3):  # it looks for so long and no longer, and the machine may be busy
            printed = doctor()
            assert printed.returncode == 1, printed.stderr
            if all(line in printed.stdout for line in lines):
                return
        raise AssertionError(printed.stdout)
    finally:
        stranger.close()


def test_publishers_of_two_types_are_not_taken_for_two_planners(
    robot: RobotPeer, domain: int
) -> None:
    stranger = Peer(domain, "stranger")
    try:
        stranger.publisher(String, "/tracked_people")
        checks = until_said(robot.peer, lambda c: "String" in text_about(c, "/tracked_people"))
        said = [check for check in checks if check.subject == "/tracked_people"]
        assert [check.text for check in said] == [
            "2 types, which never connect: mrs_people_msgs/msg/People (/planner_node publishes); "
            "std_msgs/msg/String (/stranger publishes)"
        ]
        robot.peer.until_finding(PLANNER, "people", lambda f: f.values.get("code") == "wrong_type")
    finally:
        stranger.close()


def camera(robot: RobotPeer, change: Callable[[MutableView], object]) -> Callable[[], None]:
    """A camera and odometry that go on, with every view changed."""

    def send() -> None:
        view = robot.view()
        change(view)
        robot.send(view)
        robot.send_pose(robot.odometry())

    return send


def test_raw_images_without_rectified_ones_name_the_parameter(robot: RobotPeer) -> None:
    """The driver does not rectify: the parameter for that is named."""
    subject, raw = f"{ROBOT}: left/image_rect", "/robot_a/left/image_raw"
    robot.peer.publisher(Image, raw)
    try:
        words = f"{raw} is published: set images.rectified: false"
        until_said(robot.peer, lambda reported: words in text_about(reported, subject))
    finally:
        robot.peer.silence(raw)


def sixteen_bit(view: MutableView) -> None:
    for image, _ in view.values():
        image.encoding, image.step = "16UC1", 2 * image.width
        image.data = np.zeros(image.step * image.height, np.uint8).tobytes()


def half_size(view: MutableView) -> None:
    for _, info in view.values():
        info.width, info.height = info.width // 2, info.height // 2
        for matrix, index in ((info.k, 2), (info.k, 5), (info.p, 2), (info.p, 6)):
            matrix[index] /= 2


def unstamped(view: MutableView) -> None:
    for image, info in view.values():
        set_stamp(image, 0)
        set_stamp(info, 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (sixteen_bit, "encoding is '16UC1'; allowed: mono8"),
        (half_size, "image is 160x120; wanted as in camera_info: 80x60"),
        (unstamped, "stamp is 0: its sender sets none"),
    ],
)
def test_refused_images_are_the_cause_and_the_rest_follows(
    robot: RobotPeer, change: Callable[[MutableView], None], words: str
) -> None:
    """The planner's missing data follows from that, and is not blamed on the network."""
    subjects = [f"{ROBOT}: {side}/image_rect" for side in ("left", "right")]

    def complete(reported: list[Check]) -> bool:
        first = about(reported, subjects[0])
        return all(words in text_about(reported, subject) for subject in subjects) and (
            "robot_a/points" in str(first and first.follows)
        )

    reported = until_said(robot.peer, complete, camera(robot, change))
    errors = [check for check in reported if check.level == ERROR]
    assert [check.subject for check in errors] == subjects
    assert "all of the last" in errors[-1].text
    assert not any("firewall" in check.advice for check in reported)


def test_stopped_camera_is_not_taken_for_a_wrong_clock(robot: RobotPeer) -> None:
    robot.warm_up()

    def wanted(reported: list[Check]) -> bool:
        images = about(reported, f"{ROBOT}: left/image_rect")
        return images is not None and "robot robot_a" in str(images.follows)

    # Odometry goes on, so the robot is heard of.
    reported = until_said(robot.peer, wanted, lambda: robot.send_pose(robot.odometry()))
    printed = str(reported)
    assert "behind" not in printed
    images = about(reported, f"{ROBOT}: left/image_rect")
    assert images is not None
    assert "no data on /robot_a/left/image_rect for" in images.text
    assert "no scan for" in str(images.follows)
    robot_finding = robot.peer.findings(ROBOT)["scan"]
    assert robot_finding.values["code"] == "scan_silent"


def test_two_publishers_of_odometry_are_named(robot: RobotPeer, domain: int) -> None:
    """With the names of their nodes, as for `points`."""
    other = Peer(domain, "other_base")
    try:
        publisher = other.publisher(Odometry, "/robot_a/odom")

        def both() -> None:
            robot.send_pose(robot.odometry())
            publisher.publish(robot.odometry())

        def reported(finding: Finding) -> bool:
            return finding.values.get("code") == "two_publishers"

        both()
        robot.peer.until_finding(ROBOT, "odom", reported)
        checks = until_said(
            robot.peer, lambda c: "publishers on" in text_about(c, f"{ROBOT}: odom"), both
        )
        check = about(checks, f"{ROBOT}: odom")
        assert check is not None
        assert check.level == ERROR
        assert "2 publishers on /robot_a/odom: /other_base, /peer; one is wanted" in check.text
    finally:
        other.close()


def test_inactive_and_surplus_nodes_are_reported(robot: RobotPeer, team: Team, domain: int) -> None:
    """Nodes that wait or were shut down are not reported as hanging; duplicates are named."""
    peer = robot.peer
    team.start("robot_node", namespace="/robot_b", params={"autostart": "false"})
    team.start("robot_node")
    second = Peer(domain, "planner_two")
    viewers = [Peer(domain, f"mrs_people_{number}") for number in (11, 22)]
    try:
        second.publisher(People, "/tracked_people")
        peer.until(lambda: peer.state("/robot_b/robot_node") == "unconfigured", "robot_b waits")
        assert peer.change_state(ROBOT, "shutdown")
        nodes = ("/robot_b/robot_node", ROBOT, "/robot_node", "/tracked_people")

        def settled(reported: list[Check]) -> bool:
            """Whether each node has started or ended, and all others have noticed."""
            waits, ended, lone, people = (text_about(reported, node) for node in nodes)
            return (
                waits.startswith("is unconfigured: receives and sends nothing")
                and ended.startswith("is finalized: it was shut down")
                and "robot_a/points" in str(reported)
                and "without a namespace" in lone
                and "reports nothing" not in str(reported)
                and bool(people)
            )

        reported = until_said(peer, settled)
        checks = {check.subject: check for check in reported}
        waits, ended, _, people = (checks[node] for node in nodes)
        assert "ros2 lifecycle set /robot_b/robot_node configure" in waits.advice
        assert "/planner_node: robot_a/points" in str(ended.follows)
        assert "hang" not in str([waits.advice, ended.advice])
        assert people.text == "2 nodes publish it: /planner_node, /planner_two"

        found: list[Check] = []

        def viewed() -> bool:
            found[:] = diagnose(look(peer.node, 0.5, lambda: peer.spin(0.1)))
            return found[-1].text == "2 run: /mrs_people_11, /mrs_people_22"

        peer.until(viewed, lambda: f"the last check does not name the viewers: {found}")
    finally:
        for one in (second, *viewers):
            one.close()
