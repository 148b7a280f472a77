"""The collision monitor of robot_node over real DDS: what is in the way stops a robot."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Twist
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image, LaserScan, Range
from std_msgs.msg import Bool

from core.conftest import Head, Rectangle
from mrs_people_loc.health.findings import Code
from mrs_ros.qos import STREAM
from ros.harness import WARN, Finding, NodeProcess, Peer, Team
from ros.recording import set_stamp

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

NAME = "robot_a"
NODE = f"/{NAME}/robot_node"
#: The robot has stopped within this after something has come into its way [s].
BOUND_S = 1.0


class Driver:
    """Sends commands and scans at the rates of real ones, and hears what the base is told.

    Attributes:
        wanted: Speed and turn that are commanded; None: nothing is.
        ahead: Distance of a wall ahead of the scanner [m]; None: there are no scans.
    """

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.wanted: tuple[float, float] | None = None
        self.ahead: float | None = 5.0
        self.driven: list[tuple[float, float, float]] = []
        node = peer.node
        depth = QoSProfile(depth=10)
        self._commands = node.create_publisher(Twist, f"/{NAME}/cmd_vel_guide", depth)
        self._scans = node.create_publisher(LaserScan, f"/{NAME}/scan", STREAM)
        node.create_subscription(Twist, f"/{NAME}/cmd_vel", self._take, depth)
        node.create_timer(0.05, self._command)
        node.create_timer(0.1, self._scan)

    def _take(self, message: Twist) -> None:
        self.driven.append((time.monotonic(), message.linear.x, message.angular.z))

    def _command(self) -> None:
        if self.wanted is not None:
            message = Twist()
            message.linear.x, message.angular.z = self.wanted
            self._commands.publish(message)

    def _scan(self) -> None:
        if self.ahead is None:
            return
        angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)
        away = self.ahead / np.maximum(np.cos(angles), 1e-3)
        ranges = np.where(away < 10.0, away, np.inf)
        message = LaserScan(
            angle_min=float(angles[0]), angle_increment=float(angles[1] - angles[0]),
            range_min=0.05, range_max=10.0, ranges=ranges.astype(np.float32).tolist(),
        )  # fmt: skip
        message.header.frame_id = f"{NAME}/laser"
        set_stamp(message, time.time_ns())
        self._scans.publish(message)

    @property
    def last(self) -> tuple[float, float]:
        """The last velocity."""
        return self.driven[-1][1:] if self.driven else (np.nan, np.nan)

    def until_speed(self, low: float, high: float, what: Any) -> None:
        self.peer.until(lambda: low <= self.last[0] <= high, lambda: f"{what()}; {self.last}")

    def until_code(self, code: Code) -> Finding:
        def wanted(finding: Finding) -> bool:
            return finding.level == WARN and finding.values["code"] == code

        return self.peer.until_finding(NODE, "collision_monitor", wanted)


@pytest.fixture(scope="module")
def process(team: Team) -> NodeProcess:
    params = {"walls.laser": "true", "walls.laser_mounting": "[0.0, 0.0, 0.0]"}
    return team.start("robot_node", namespace=f"/{NAME}", params=params)


@pytest.fixture(scope="module")
def driver(peer: Peer, process: NodeProcess) -> Driver:
    peer.until_active(NODE)
    return Driver(peer)


def test_way_that_is_free_is_driven_and_what_is_in_it_stops_the_robot(
    driver: Driver, process: NodeProcess
) -> None:
    peer, log = driver.peer, lambda: process.log
    assert f"/{NAME}/cmd_vel" not in peer.published_by(NODE), "published before it is asked for"
    driver.wanted = (0.5, 0.1)
    driver.until_speed(0.5, 0.5, log)
    assert driver.last == (0.5, 0.1)
    peer.until_finding(NODE, "collision_monitor", lambda f: f.values.get("action") == "passes")

    driver.ahead = 0.75  # 0.3 m are left, a quarter of a metre a second
    driver.until_speed(0.1, 0.26, log)
    driver.ahead = 0.4
    began_s = time.monotonic()
    driver.until_speed(0.0, 0.0, log)
    assert time.monotonic() - began_s < BOUND_S
    assert driver.last[1] == 0.1, "it may turn"
    found = driver.until_code(Code.OBSTRUCTED)
    assert "ahead is something, by scan" in found.message

    driver.wanted = (-0.3, 0.0)
    driver.until_speed(-0.3, -0.3, log)
    driver.wanted, driver.ahead = (0.5, 0.0), 5.0
    driver.until_speed(0.5, 0.5, log)


def test_silent_scanner_stops_the_robot(driver: Driver, process: NodeProcess) -> None:
    driver.wanted, driver.ahead = (0.5, 0.0), 5.0
    driver.until_speed(0.5, 0.5, lambda: process.log)
    driver.ahead = None
    driver.until_speed(0.0, 0.0, lambda: process.log)
    found = driver.until_code(Code.MONITOR_FAILS)
    assert "nothing has come of scan" in found.message
    driver.ahead = 5.0
    driver.until_speed(0.5, 0.5, lambda: process.log)


def test_bumper_stops_the_robot(driver: Driver, process: NodeProcess) -> None:
    driver.wanted, driver.ahead = (0.5, 0.3), 5.0
    driver.until_speed(0.5, 0.5, lambda: process.log)
    driver.peer.send(f"/{NAME}/bumper", Bool(data=True))
    driver.until_speed(0.0, 0.0, lambda: process.log)
    assert driver.last == (0.0, 0.0)
    driver.peer.send(f"/{NAME}/bumper", Bool(data=False))
    driver.until_speed(0.5, 0.5, lambda: process.log)


def test_robot_stands_once_commands_stay_away_and_then_nothing_is_sent(
    driver: Driver, process: NodeProcess
) -> None:
    driver.wanted, driver.ahead = (0.5, 0.0), 5.0
    driver.until_speed(0.5, 0.5, lambda: process.log)
    driver.wanted = None
    began_s = time.monotonic()
    driver.until_speed(0.0, 0.0, lambda: process.log)
    assert time.monotonic() - began_s < BOUND_S
    driver.peer.spin(1.0)
    count = len(driver.driven)
    driver.peer.spin(0.5)
    assert len(driver.driven) == count


def test_robot_stands_when_the_node_is_deactivated_or_ended(
    driver: Driver, process: NodeProcess
) -> None:
    driver.wanted, driver.ahead = (0.5, 0.0), 5.0
    driver.until_speed(0.5, 0.5, lambda: process.log)
    assert driver.peer.change_state(NODE, "deactivate")
    driver.until_speed(0.0, 0.0, lambda: process.log)
    assert driver.peer.change_state(NODE, "activate")
    driver.until_speed(0.5, 0.5, lambda: process.log)
    process.stop()
    driver.until_speed(0.0, 0.0, lambda: process.log)


@pytest.mark.parametrize("space", ["", "/robot_s"])
def test_configured_sonar_has_to_deliver_and_not_of_the_future(
    team: Team, peer: Peer, space: str
) -> None:
    params = {"walls.sonars": "[sonar/left]", "walls.sonar_mountings": "[0.2, 0.0, 0.0]"}
    process = team.start("robot_node", namespace=space or "/", params=params)
    node = f"{space}/robot_node"
    peer.until_active(node)
    driven: list[Twist] = peer.hear(Twist, f"{space}/cmd_vel")
    command, measured = Twist(), Range(field_of_view=0.5, min_range=0.1, max_range=4.0, range=3.9)
    command.linear.x = 0.5

    def is_driven(speed: float, ahead_s: float | None) -> bool:
        for _ in range(4):
            if ahead_s is not None:
                set_stamp(measured, time.time_ns() + round(ahead_s * 1e9))
                peer.send(f"{space}/sonar/left", measured)
            peer.send(f"{space}/cmd_vel_guide", command)
            peer.spin(0.04)
        return bool(driven) and driven[-1].linear.x == speed

    def is_said(part: str, speed: float, ahead_s: float | None) -> bool:
        found = peer.findings(node).get("collision_monitor")
        return is_driven(speed, ahead_s) and found is not None and part in found.message

    def log() -> str:
        return f"{driven[-1:]}; {process.log}"

    for ahead_s, speed, part in (
        (None, 0.0, "nothing has come of sonar/left yet"),
        (0.0, 0.1, "no sensor sees where it drives"),
        (5.0, 0.0, "sonar/left has stamps 5.0 s ahead of the clock"),
    ):
        peer.until(partial(is_said, part, speed, ahead_s), log)
    process.stop()


def test_body_before_the_head_stops_the_robot(team: Team, peer: Peer) -> None:
    """Images of a room and of somebody in it, through the node's own stereo matching."""
    params = {"collision_monitor.stop_distance": "0.6"}
    process = team.start("robot_node", namespace="/robot_h", params=params)
    peer.until_active("/robot_h/robot_node")
    centre, positions = (79.5, 59.5), {"left": (0.0, 0.0), "right": (0.0996, 0.0)}
    head = Head(centres=dict.fromkeys(positions, centre), positions=positions)
    room = [
        Rectangle((-9, -9, 0), (18, 0, 0), (0, 18, 0), grain=0.1),
        Rectangle((5, -5, 0), (0, 10, 0), (0, 0, 2.8), seed=2),
    ]
    body = Rectangle((0.8, -0.22, 0), (0, 0.44, 0), (0, 0, 1.7), seed=5, grain=0.04)
    scenes: tuple[tuple[Rectangle, ...], ...] = ((), (body,))
    views = {things: head.draw(*room, *things)[0] for things in scenes}
    driven: list[Twist] = peer.hear(Twist, "/robot_h/cmd_vel")
    command = Twist()
    command.linear.x = 0.5

    def shows(things: tuple[Rectangle, ...], low: float, high: float) -> bool:
        stamp_ns = time.time_ns()
        for camera in positions:
            model = head.model(camera)
            info = CameraInfo(width=160, height=120, p=model.p.ravel(), k=model.k.ravel())
            info.r = np.eye(3).ravel()
            grey = getattr(views[things], camera)
            image = Image(width=160, height=120, step=160, encoding="mono8", data=grey.tobytes())
            for topic, message in (("camera_info", info), ("image_rect", image)):
                message.header.frame_id = f"robot_h/{camera}_camera_optical"
                set_stamp(message, stamp_ns)
                peer.send(f"/robot_h/{camera}/{topic}", message)
        for _ in range(4):
            peer.send("/robot_h/cmd_vel_guide", command)
            peer.spin(0.04)
        return bool(driven) and low <= driven[-1].linear.x <= high

    log = lambda: f"{driven[-1:]}; {process.log}"  # noqa: E731
    peer.until(lambda: shows((), 0.1, 0.1), log)
    peer.until(lambda: shows((body,), 0.0, 0.0), log)
    peer.until(lambda: shows((), 0.1, 0.1), log)
