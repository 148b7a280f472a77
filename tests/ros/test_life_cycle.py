"""Managed nodes start by themselves or by lifecycle transitions, and end cleanly."""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass

import pytest
from lifecycle_msgs.msg import Transition
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, PointCloud2

from mrs_people_loc.config import RobotConfig
from mrs_ros import tf
from ros.harness import STALE, NodeProcess, Peer, Team, holds
from ros.planner_peer import PlannerPeer, PlayedRobot, places, robots_in
from ros.recording import DEFAULTS, Recording, stamp_of
from ros.robot_peer import RobotPeer

pytestmark = pytest.mark.slow

SOMEBODY = (2.0, 1.0)
#: "A few seconds", on a machine that is busy with other things [s].
SOON_S = 20.0


@dataclass(frozen=True)
class End:
    """A node that is to end: how it is started, its state then, and the signals that it gets."""

    executable: str
    autostart: str
    state: str
    signals: tuple[signal.Signals, ...]


ENDS = {
    "robot": End("robot_node", "true", "active", (signal.SIGTERM,)),
    "terminal": End("robot_node", "true", "active", (signal.SIGHUP, signal.SIGHUP)),
    "planner": End("planner_node", "true", "active", (signal.SIGINT, signal.SIGINT)),
    "unconfigured": End("robot_node", "false", "unconfigured", (signal.SIGINT, signal.SIGTERM)),
    "final": End("planner_node", "true", "active", (signal.SIGINT,)),
    "never": End("robot_node", "false", "unconfigured", (signal.SIGINT,)),
}


@pytest.fixture(scope="module")
def doomed(team: Team) -> dict[str, NodeProcess]:
    """The nodes that are to end."""
    return {
        name: team.start(end.executable, namespace=f"/{name}", params={"autostart": end.autostart})
        for name, end in ENDS.items()
    }


@pytest.fixture(scope="module")
def robot(team: Team, peer: Peer, recording: Recording) -> RobotPeer:
    process = team.start("robot_node", namespace="/robot_a", params={"autostart": "false"})
    return RobotPeer(peer, process, recording)


@pytest.fixture(scope="module")
def planner(team: Team, peer: Peer) -> PlannerPeer:
    params = {"autostart": "false", "robots": "[robot_p]"}
    return PlannerPeer(peer, team.start("planner_node", params=params))


@pytest.fixture(scope="module", autouse=True)
def _all_at_once(robot: RobotPeer, planner: PlannerPeer, doomed: dict[str, NodeProcess]) -> None:
    """Processes start beside each other."""


ROBOT_TOPICS = {
    "/diagnostics",
    "/robot_a/points",
    "/robot_a/pose",
    "/robot_a/obstacles",
    "/team_poses",
    "/walls",
    *(f"/robot_a/debug/{stage}" for stage in ("disparity", "cloud", "cropped", "foreground")),
    *(("/tf", "/tf_static") if tf.installed("tf2_msgs") else ()),
}
ROBOT_INPUTS = {
    "/robot_a/odom",
    *(f"/robot_a/{name}" for name in ("cmd_vel_guide", "bumper", "base_fault")),
    *(f"/robot_a/{c}/{t}" for c in ("left", "right") for t in ("image_rect", "camera_info")),
}


def test_robot_follows_lifecycle_transitions(robot: RobotPeer) -> None:
    peer, node = robot.peer, robot.node
    assert peer.state(node) == "unconfigured"
    assert peer.published_by(node) == {}
    assert not peer.change_state(node, "activate"), "not from here"
    assert peer.state(node) == "unconfigured"
    # By its id alone, as Nav2's lifecycle manager asks.
    assert not peer.change_state(node, Transition.TRANSITION_ACTIVATE), "not from here either"
    assert peer.state(node) == "unconfigured"
    assert robot.process is not None
    assert holds(robot.process.log, [r"3 is asked for in the state unconfigured; .*1 \(configure"])

    assert peer.change_state(node, "configure")
    assert peer.state(node) == "inactive"
    _until_topics(peer, node, ROBOT_TOPICS, set())

    assert peer.change_state(node, Transition.TRANSITION_ACTIVATE)
    assert peer.state(node) == "active"
    _until_topics(peer, node, ROBOT_TOPICS, ROBOT_INPUTS)
    robot.warm_up()
    first = robot.view()
    robot.check(DEFAULTS, first)

    assert peer.change_state(node, "deactivate")
    assert peer.state(node) == "inactive"
    _until_topics(peer, node, ROBOT_TOPICS, set())
    # Inputs that nobody listens to are no errors.
    finding = peer.until_finding(node, "state", lambda f: f.level == STALE)
    assert finding.message.startswith("inactive")
    assert set(peer.next_findings(node)[node]) == {"state"}
    unheard = robot.view()
    for camera in ("left", "right"):
        peer.publisher(Image, f"/robot_a/{camera}/image_rect").publish(unheard[camera][0])
    odometry = robot.odometry()
    peer.publisher(Odometry, "/robot_a/odom").publish(odometry)

    assert peer.change_state(node, "activate")
    robot.warm_up()
    robot.check(DEFAULTS)
    assert stamp_of(unheard["left"][0]) not in {stamp_of(m) for m in robot.points}
    assert stamp_of(odometry) not in {stamp_of(m) for m in robot.poses}


def _until_topics(peer: Peer, node: str, offered: set[str], heard: set[str]) -> None:
    """Waits until the graph shows exactly this; it lags behind the node by a moment."""

    def now() -> tuple[set[str], set[str]]:
        return set(peer.published_by(node)), set(peer.heard_by(node))

    peer.until(lambda: now() == (offered, heard), lambda: f"{now()}; wanted: {offered}, {heard}")


def test_robot_forgets_its_past_at_cleanup(robot: RobotPeer) -> None:
    peer, node = robot.peer, robot.node
    for _ in range(20):
        robot.check(DEFAULTS)
    before = robot.until_finding("scan", lambda f: f.count("frames") >= 20).count("frames")
    assert peer.change_state(node, "deactivate")
    assert peer.change_state(node, "cleanup")
    assert peer.state(node) == "unconfigured"
    _until_topics(peer, node, set(), set())
    # Parameters that are not live are taken here.
    peer.must_set(node, images__top=True, bodies__min_extent=0.5)
    sent, heard = robot.views_sent, len(robot.points)
    assert peer.change_state(node, "configure")
    assert peer.change_state(node, "activate")
    robot.warm_up(top=True)
    config = RobotConfig.from_mapping({"images.top": True, "bodies.min_extent": 0.5}, base=DEFAULTS)
    robot.check(config)
    finding = peer.next_findings(node)[node]["scan"]
    assert len(robot.points) - heard <= finding.count("frames") <= robot.views_sent - sent
    assert finding.count("frames") != before + len(robot.points) - heard
    # And back again.
    peer.reconfigure(node, images__top=False, bodies__min_extent=0.35)
    robot.warm_up()
    robot.check(DEFAULTS)


PLANNER_TOPICS = {
    "/diagnostics",
    "/tracked_people",
    "/people_poses",
    "/group_centroid",
    "/events",
    "/short_term_map",
    "/relative_poses",
    "/markers",
}


def test_planner_follows_lifecycle_transitions(planner: PlannerPeer) -> None:
    peer, node = planner.peer, planner.node
    played = PlayedRobot(peer, "robot_p", (0.0, 0.0, 0.0))
    inputs = {"/robot_p/points", "/robot_p/pose", "/team_poses"}
    assert peer.state(node) == "unconfigured"
    assert peer.published_by(node) == {}
    for _ in range(2):
        assert peer.change_state(node, "configure")
        _until_topics(peer, node, PLANNER_TOPICS, set())
        assert peer.change_state(node, "activate")
        _until_topics(peer, node, PLANNER_TOPICS, inputs)
        _until_answer(planner, played)

        assert peer.change_state(node, "deactivate")
        _until_topics(peer, node, PLANNER_TOPICS, set())
        unheard = planner.now()
        played.announce()
        peer.publisher(PointCloud2, "/robot_p/points").publish(played.scan(unheard, SOMEBODY))
        assert peer.change_state(node, "activate")
        _until_answer(planner, played)
        assert unheard not in {stamp_of(message) for message in planner.people}

        assert peer.change_state(node, "deactivate")
        assert peer.change_state(node, "cleanup")
        assert peer.state(node) == "unconfigured"
        _until_topics(peer, node, set(), set())
    assert peer.change_state(node, "configure")
    assert peer.change_state(node, "activate")
    _until_answer(planner, played)


def _until_answer(planner: PlannerPeer, played: PlayedRobot) -> None:
    count = len(planner.people)

    def answered() -> bool:
        played.send(planner.now(), SOMEBODY)
        planner.peer.spin(0.1)
        return len(planner.people) > count

    planner.peer.until(answered, lambda: planner.process.log)
    assert robots_in(planner.people[-1]) == ["robot_p"]
    assert places(planner.people[-1]) == [SOMEBODY]


def _keep_busy(robot: RobotPeer, planner: PlannerPeer, played: PlayedRobot) -> None:
    for _ in range(5):
        view = robot.view()
        robot.send(view)
        robot.send_pose(robot.odometry())
        played.send(planner.now(), SOMEBODY)


def test_busy_nodes_end_cleanly_on_a_signal(robot: RobotPeer, planner: PlannerPeer) -> None:
    """Ctrl-C and SIGTERM while messages come in: exit code 0, no traceback, soon."""
    assert robot.process is not None
    played = PlayedRobot(robot.peer, "robot_p", (0.0, 0.0, 0.0))
    _keep_busy(robot, planner, played)
    assert robot.process.stop(signal.SIGINT) < SOON_S
    assert planner.process.stop(signal.SIGTERM) < SOON_S


@pytest.mark.parametrize("name", ["robot", "terminal", "planner", "unconfigured"])
def test_nodes_end_cleanly_on_every_signal(
    doomed: dict[str, NodeProcess], peer: Peer, name: str
) -> None:
    """Also with a second one while they end, as `ros2 launch` sends it."""
    process, end = doomed[name], ENDS[name]
    peer.until(lambda: peer.state(process.name) == end.state, f"{name} is not {end.state}")
    began = time.monotonic()
    for number in end.signals:  # it may have ended before the last one
        process.process.send_signal(number)
    assert process.exit_code() == 0, process.log
    assert time.monotonic() - began < SOON_S
    assert "Traceback" not in process.log


def test_finalized_node_runs_until_a_signal(doomed: dict[str, NodeProcess], peer: Peer) -> None:
    """The transition `shutdown` finalizes the node; the process ends with a signal."""
    process = doomed["final"]
    peer.until_active(process.name)
    assert peer.change_state(process.name, "shutdown")
    assert peer.state(process.name) == "finalized"
    _until_topics(peer, process.name, set(), set())
    assert process.stop() < SOON_S


def test_unconfigured_node_can_be_shut_down(doomed: dict[str, NodeProcess], peer: Peer) -> None:
    process = doomed["never"]
    peer.until(lambda: peer.state(process.name) == "unconfigured", "it does not start")
    assert peer.change_state(process.name, "shutdown")
    assert peer.state(process.name) == "finalized"
    assert not peer.change_state(process.name, Transition.TRANSITION_CONFIGURE)
    assert process.stop() < SOON_S


def test_starting_node_logs_its_name_and_what_it_waits_for(
    doomed: dict[str, NodeProcess],
) -> None:
    """All of them have ended by now."""
    reported = {name: doomed[name].log for name in ENDS}
    assert holds(
        reported["robot"],
        [r"/robot/robot_node: active; waits for /robot/left/camera_info, .*odom\n"],
    )
    assert "/planner/planner_node: active; waits for robots: any namespace" in reported["planner"]
    assert holds(
        reported["unconfigured"],
        [r"unconfigured, .* `ros2 lifecycle set /unconfigured/robot_node configure`"],
    )
    for log in reported.values():
        assert log.count("active; waits") + log.count("unconfigured, for") == 1, log
