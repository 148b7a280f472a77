"""The base of a robot that drives straight on: python base.py ROBOT BEGAN_NS; or planner BEGAN_NS.

The odometry drifts: 2 % of the way and 1 mrad per metre. The first robot knows where it is by
absolute poses. A line of JSON on each of the robot's poses tells how far it is from the truth.
`planner` says where the robots really are to each other, as the planner does by people.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import sys
import time
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from mrs_people_msgs.msg import RelativePoses
from nav_msgs.msg import Odometry
from rclpy.node import Node

from mrs_people_loc.localization.shared import RelativePose
from mrs_people_loc.messages import read_pose
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_ros.qos import POSES, TEAM

SPEED = 0.4
#: Where each drives along x: y [m].
LANES = {"robot_a": 0.0, "robot_b": 1.5, "robot_c": -1.5}
RELATIVE_HZ, ABSOLUTE_HZ, ODOMETRY_HZ = 3.0, 2.0, 20.0


def way_at(stamp_ns: int) -> float:
    """What a robot has driven at a time [m]."""
    return SPEED * (stamp_ns - int(sys.argv[2])) / 1e9


def truth(robot: str, stamp_ns: int) -> Pose:
    return Pose(stamp_ns, way_at(stamp_ns), LANES[robot], 0.0)


class Base:
    """Odometry of a robot, absolute poses of the first one; prints how wrong its poses are."""

    def __init__(self, node: Node, robot: str) -> None:
        self._node, self._robot = node, robot
        self._odom = node.create_publisher(Odometry, f"{robot}/odom", POSES)
        node.create_subscription(PoseWithCovarianceStamped, f"{robot}/pose", self._on_pose, POSES)
        node.create_timer(1.0 / ODOMETRY_HZ, self._drive)
        if robot == "robot_a":
            topic = f"{robot}/pose_in"
            self._absolute = node.create_publisher(PoseWithCovarianceStamped, topic, POSES)
            node.create_timer(1.0 / ABSOLUTE_HZ, self._tell)

    def _drive(self) -> None:
        stamp_ns = time.time_ns()
        way, lane = way_at(stamp_ns), LANES[self._robot]
        place = Pose(stamp_ns, 1.02 * way, lane + 0.0005 * way**2, 0.001 * way)
        message = Odometry(child_frame_id="base_link", pose=convert.pose_with_covariance(place))
        message.header = convert.header(stamp_ns, f"{self._robot}/odom")
        self._odom.publish(message)

    def _tell(self) -> None:
        at = truth(self._robot, time.time_ns())
        told = Pose(at.stamp_ns, at.x, at.y, at.yaw, np.diag([0.02**2, 0.02**2, 0.01**2]))
        self._absolute.publish(convert.pose_stamped(told, "map"))

    def _on_pose(self, message: Any) -> None:
        pose = read_pose(message)
        at = truth(self._robot, pose.stamp_ns)
        off = math.hypot(pose.x - at.x, pose.y - at.y)
        sigma = math.sqrt(pose.covariance[0, 0] + pose.covariance[1, 1])
        print(json.dumps({"at": time.monotonic(), "off": off, "sigma": sigma}), flush=True)


def tell_relative(node: Node) -> None:
    """Says where the robots are to each other."""
    publisher = node.create_publisher(RelativePoses, "relative_poses", TEAM)
    rng = np.random.default_rng(1)
    sigmas = np.array([0.03, 0.03, 0.01])

    def tell() -> None:
        stamp_ns = time.time_ns() - 100_000_000
        measured = [
            RelativePose(
                one,
                stamp_ns,
                other,
                stamp_ns,
                np.array([0.0, LANES[other] - LANES[one], 0.0]) + rng.normal(0.0, sigmas),
                np.diag(sigmas**2),
            )
            for one, other in itertools.combinations(LANES, 2)
        ]
        publisher.publish(convert.relative_poses(stamp_ns, "map", measured))

    node.create_timer(1.0 / RELATIVE_HZ, tell)


def main() -> None:
    """Runs until it is ended."""
    what, _ = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node(f"base_of_{what}")
    if what == "planner":
        tell_relative(node)
    else:
        Base(node, what)
    with contextlib.suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
