"""Nodes at work: of streams they keep only the newest message, small images take one thread."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import pytest
import rclpy

from mrs_ros.managed_node import ManagedNode
from planner_node.node import PlannerNode
from robot_node.node import RobotNode
from ros.harness import Peer
from ros.planner_peer import PlayedRobot, pose_of
from ros.recording import Recording, stamp_of
from ros.robot_peer import RobotPeer


@pytest.fixture
def node(request: pytest.FixtureRequest, domain: int) -> Iterator[ManagedNode]:
    """A node in this process: it is at work as long as the test lets it."""
    kind, *params = request.param
    rclpy.init(args=["--ros-args", "-r", "__ns:=/busy", *params])
    try:
        made: ManagedNode = kind()
        made.trigger_configure()
        made.trigger_activate()
        yield made
        made.destroy_node()
    finally:
        rclpy.shutdown()


def taken(node: ManagedNode, topics: list[str]) -> list[int]:
    """How many messages of each topic the node takes that wait for it."""
    before = [node.inputs[topic].reception.received for topic in topics]
    for _ in range(40):
        rclpy.spin_once(node, timeout_sec=0.01)
    return [
        node.inputs[topic].reception.received - n for topic, n in zip(topics, before, strict=True)
    ]


@pytest.mark.parametrize("node", [(RobotNode,)], indirect=True)
def test_newest_of_the_waiting_images_are_used(
    node: ManagedNode, peer: Peer, recording: Recording
) -> None:
    robot = RobotPeer(peer, None, recording, "busy")
    topics = [
        f"{camera}/{kind}" for camera in ("left", "right") for kind in ("camera_info", "image_rect")
    ]

    def one_of_three() -> bool:
        """Again until it is so: the first ones meet no connection, or arrive too late."""
        views = [robot.view() for _ in range(3)]
        poses = [robot.odometry() for _ in range(3)]
        for view, pose in zip(views, poses, strict=True):
            robot.send(view)
            robot.send_pose(pose)
        peer.spin(0.2)
        counts = taken(node, [*topics, "odom"])
        peer.spin(0.2)
        stamps = [stamp_of(view["left"][0]) for view in views]
        made = [stamp for stamp in map(stamp_of, robot.points) if stamp in stamps]
        return counts == [1, 1, 1, 1, 3] and made == stamps[-1:]

    peer.until(one_of_three, "a scan of the last of three views, and only that")


@pytest.mark.parametrize("node", [(RobotNode,)], indirect=True)
def test_small_images_are_processed_by_one_thread(
    node: ManagedNode, peer: Peer, recording: Recording
) -> None:
    robot = RobotPeer(peer, None, recording, "busy")
    before = cv2.getNumThreads()
    cv2.setNumThreads(3)

    def is_one() -> bool:
        robot.send(robot.view())
        peer.spin(0.1)
        rclpy.spin_once(node, timeout_sec=0.01)
        return cv2.getNumThreads() == 1

    try:
        peer.until(is_one, "one thread")
    finally:
        cv2.setNumThreads(before)


@pytest.mark.parametrize("node", [(PlannerNode, "-p", "robots:=[robot_a]")], indirect=True)
def test_newest_of_the_waiting_scans_is_used(node: ManagedNode, peer: Peer) -> None:
    robot = PlayedRobot(peer, "busy/robot_a", (0.0, 0.0, 0.0))
    clock = node.get_clock()

    def one_of_three() -> bool:
        for _ in range(3):
            stamp_ns = clock.now().nanoseconds
            robot.send_pose(pose_of(stamp_ns, *robot.place))
            robot.send_points(robot.scan(stamp_ns))
        peer.spin(0.2)
        return taken(node, ["robot_a/points", "robot_a/pose"]) == [1, 3]

    peer.until(one_of_three, "the last of three scans, and all poses")
