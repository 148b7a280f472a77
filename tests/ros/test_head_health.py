"""robot_node reports a head that is not where it is configured to be, or that is blind."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from ros.harness import OK, WARN, Peer, Team
from ros.recording import Recording, stamp_of
from ros.robot_peer import MutableView, RobotPeer

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
TILTED = 0.0524  # 3 degrees


@pytest.fixture(scope="module", params=["default", "paper"])
def robot(
    request: pytest.FixtureRequest, team: Team, peer: Peer, recording: Recording
) -> RobotPeer:
    """A robot whose head is level, with either method."""
    name = f"robot_{request.param}"
    params = {"bodies.search": "false"} if request.param == "paper" else {}
    made = RobotPeer(
        peer, team.start("robot_node", namespace=f"/{name}", params=params), recording, name
    )
    made.warm_up()
    return made


class Views:
    """Sends views whose stamps are as far apart as is asked for, one answered after the other."""

    def __init__(self, robot: RobotPeer) -> None:
        self.robot = robot
        self.stamp_ns = robot.now()

    def send(self, count: int, *, apart_s: float = 2.0, black: str = "") -> None:
        for number in range(count):
            self.stamp_ns += round(apart_s * SECOND)
            view: MutableView = self.robot.view(self.stamp_ns, of="robot_a", frame=number % 15)
            if black:
                image = view[black][0]
                image.data = np.full(len(image.data), 2, dtype=np.uint8).tobytes()
            self.robot.send(view)
            self.robot.points_at(stamp_of(view["left"][0]))
        # Whatever comes next is later, also for the robot.
        self.robot._last_ns = self.stamp_ns


@pytest.fixture(scope="module")
def views(robot: RobotPeer) -> Views:
    return Views(robot)


def test_correctly_mounted_head_that_sees_is_ok(robot: RobotPeer, views: Views) -> None:
    views.send(6)
    mounting = robot.until_finding("mounting", lambda f: "by_the_floor" in f.values)
    assert (mounting.level, mounting.message) == (OK, "ok")
    height = re.match(r"height ([\d.]+) m", mounting.values["by_the_floor"])
    assert height is not None
    assert float(height[1]) == pytest.approx(1.0, abs=0.05)
    head = robot.until_finding("head", lambda f: f.level == OK)
    assert float(head.values["valid_pixels"]) > 0.5
    assert float(head.values["right_mean"]) > 50


def test_mounting_that_is_three_degrees_off_is_reported(robot: RobotPeer, views: Views) -> None:
    """Here the configuration is changed, not the head."""
    robot.peer.must_set(robot.node, mounting__pitch=TILTED)
    views.send(6)
    finding = robot.until_finding("mounting", lambda f: f.level == WARN)
    assert finding.message.startswith("the head has moved: by the floor height 1.0")
    assert "configured: height 1.00 m, pitch 3.0 deg, roll 0.0 deg" in finding.message
    assert f"mrs calibrate --robot {robot.namespace}" in finding.message
    robot.peer.must_set(robot.node, mounting__pitch=0.0)
    views.send(6)
    robot.until_finding("mounting", lambda f: (f.level, f.message) == (OK, "ok"))


def test_floor_watch_can_be_switched_off(robot: RobotPeer, views: Views) -> None:
    robot.peer.must_set(robot.node, mounting__pitch=TILTED, floor__watch=False)
    views.send(6)
    finding = robot.until_finding("mounting", lambda f: "not watched" in f.message)
    assert finding.level == OK
    robot.peer.must_set(robot.node, mounting__pitch=0.0, floor__watch=True)


@pytest.mark.parametrize("camera", ["right", "left"])
def test_covered_lens_is_reported_with_its_camera(
    robot: RobotPeer, views: Views, camera: str
) -> None:
    views.send(6, apart_s=0.1)
    robot.until_finding("head", lambda f: f.level == OK)
    views.send(6, apart_s=0.1, black=camera)
    finding = robot.until_finding("head", lambda f: f.level == WARN)
    assert f"{camera} image is black (mean 2 of 255)" in finding.message
    assert "lens" in finding.message
    views.send(6, apart_s=0.1)
    robot.until_finding("head", lambda f: (f.level, f.message) == (OK, "ok"))


def test_least_share_of_disparities_takes_effect(robot: RobotPeer, views: Views) -> None:
    robot.peer.must_set(robot.node, sight__min_valid=1.0)
    views.send(6, apart_s=0.1)
    finding = robot.until_finding("head", lambda f: f.level == WARN)
    assert "of the pixels have a disparity (sight.min_valid: 100%)" in finding.message
    robot.peer.must_set(robot.node, sight__min_valid=0.25)
    views.send(6, apart_s=0.1)
    robot.until_finding("head", lambda f: (f.level, f.message) == (OK, "ok"))


def test_views_before_a_jump_back_of_stamps_do_not_count(robot: RobotPeer, views: Views) -> None:
    """As in a bag that loops: one view is enough for a head that was blind."""
    views.send(6, apart_s=0.1, black="left")
    robot.until_finding("head", lambda f: f.level == WARN)
    views.stamp_ns -= 100 * SECOND
    begins_ns = views.stamp_ns

    def answered() -> bool:
        views.stamp_ns += SECOND // 10
        robot.send(robot.view(views.stamp_ns, of="robot_a"))
        robot.peer.spin(0.3)
        return begins_ns < stamp_of(robot.points[-1]) <= views.stamp_ns

    robot.peer.until(answered, lambda: robot.log)
    finding = robot.peer.next_findings(robot.node)[robot.node]["head"]
    assert (finding.level, finding.message) == (OK, "ok")
    robot._last_ns = views.stamp_ns


def test_calibrate_measures_a_running_head(robot: RobotPeer, peer: Peer, tmp_path: Path) -> None:
    """The command runs as a process of its own, on the images that the robot receives."""
    command = [sys.executable, "-m", "mrs_tools", "calibrate", "-r", robot.namespace, "-d", "6"]
    out, err = tmp_path / "out", tmp_path / "err"
    with out.open("wb") as to_out, err.open("wb") as to_err:
        process = subprocess.Popen(command, stdout=to_out, stderr=to_err, env={**os.environ})
        frame = 0

        def ended() -> bool:
            nonlocal frame
            frame += 1
            robot.send(robot.view(of="robot_a", frame=frame % 15))
            peer.spin(0.1)
            return process.poll() is not None

        try:
            peer.until(ended, "mrs calibrate ends", 120.0)
        finally:
            process.kill()
            process.wait()
    assert process.returncode == 0, err.read_text()
    section = yaml.safe_load(out.read_text())[f"/{robot.namespace}/robot_node"]
    mounting = section["ros__parameters"]["mounting"]
    assert mounting["height"] == pytest.approx(1.0, abs=0.03)
    assert mounting["pitch"] == pytest.approx(0.0, abs=0.012)
    assert mounting["roll"] == pytest.approx(0.0, abs=0.012)


def test_waiting_images_that_do_not_fit_count_against_the_image_topic(
    team: Team, peer: Peer, recording: Recording
) -> None:
    """Not against the camera_info that came last, which is as correct as the others."""
    node = team.start("robot_node", namespace="/robot_wide")
    robot = RobotPeer(peer, node, recording, "robot_wide")
    peer.until_active(node.name)
    view = robot.view()
    for camera in ("left", "right"):
        robot.send_image(camera, view[camera][0])
    for camera in ("left", "right"):
        robot.until_finding(f"{camera}/image_rect", lambda f: f.count("received") == 1)
    for camera in ("left", "right"):
        info = view[camera][1]
        info.width += 8
        robot.send_info(camera, info)
        robot.until_finding(f"{camera}/camera_info", lambda f: f.count("received") == 1)
    finding = robot.until_finding("left/image_rect", lambda f: f.count("dropped") == 1)
    assert finding.values["dropped.ImageError"] == "1"
    assert "wanted as in camera_info" in node.log
    for camera in ("left", "right"):
        assert robot.until_finding(f"{camera}/camera_info", lambda f: True).count("dropped") == 0
