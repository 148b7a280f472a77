"""What robots tell each other survives the way over ROS messages."""

from __future__ import annotations

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from mrs_people_loc import messages
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.shared import RelativePose, StandingPeople, TeamPose
from mrs_people_loc.localization.walls import SeenWalls, Walls
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert

STAMP_NS = 1_700_000_000_123_456_789
COVARIANCE = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.003], [0.002, -0.003, 0.01]])


def walls_at(stamp_ns: int, count: int) -> SeenWalls:
    k = np.arange(1.0, count + 1)
    covariance = np.array([[0.01, 0.002], [0.002, 0.001]]) * k[:, None, None]
    extent = np.stack([-k, 2.0 * k], axis=1)
    return SeenWalls(
        stamp_ns, Walls(k, 0.5 * k, covariance, extent, np.stack([k > 1, k > 2], axis=1))
    )


def pose(stamp_ns: int = STAMP_NS) -> Pose:
    return Pose(stamp_ns, 1.5, -2.5, 0.75, COVARIANCE)


def test_team_pose_is_read_as_it_was_told() -> None:
    odometry = Odometry(STAMP_NS, 3.0, -4.0, 0.5, 0.25, 0.125)
    seen = (walls_at(STAMP_NS - 200_000_000, 2), walls_at(STAMP_NS - 50_000_000, 3))
    told = TeamPose("robot_a", pose(), odometry, seen, (pose(STAMP_NS - 10),), True, ("robot_c",))
    message = convert.team_pose(told, "map")
    message = deserialize_message(serialize_message(message), type(message))
    read = messages.read_team_pose(message, "map")
    assert (read.robot, read.odometry) == ("robot_a", odometry)
    assert (message.status, read.lost, read.doubted) == (message.LOST, True, ("robot_c",))
    for got, wanted in ((read.pose, told.pose), (read.absolute[0], told.absolute[0])):
        assert got.stamp_ns == wanted.stamp_ns
        np.testing.assert_allclose((got.x, got.y, got.yaw), (1.5, -2.5, 0.75), atol=1e-12)
        np.testing.assert_array_equal(got.covariance, COVARIANCE)
    assert [one.stamp_ns for one in read.walls] == [one.stamp_ns for one in seen]
    for got_walls, wanted_walls in zip(read.walls, seen, strict=True):
        for name, values in vars(wanted_walls.walls).items():
            np.testing.assert_array_equal(getattr(got_walls.walls, name), values, err_msg=name)


def test_relative_poses_are_read_as_they_were_measured() -> None:
    measured = RelativePose(
        "robot_a", STAMP_NS - 100, "robot_b", STAMP_NS - 200, np.array([1.0, -2.0, 0.5]), COVARIANCE
    )
    stand = StandingPeople(
        "robot_b", STAMP_NS, np.array([(1.0, 2.0), (3.0, 4.0)]), np.array([COVARIANCE[:2, :2]] * 2)
    )
    message = convert.relative_poses(STAMP_NS, "map", [measured, stand])
    assert message.header.frame_id == "map"
    message = deserialize_message(serialize_message(message), type(message))
    read, people = messages.read_relative_poses(message)
    assert isinstance(people, StandingPeople)
    assert (people.robot, people.stamp_ns) == ("robot_b", STAMP_NS)
    np.testing.assert_array_equal(people.xy, stand.xy)
    np.testing.assert_array_equal(people.covariance, stand.covariance)
    assert isinstance(read, RelativePose)
    assert (read.robot, read.stamp_ns) == ("robot_a", STAMP_NS - 100)
    assert (read.other, read.other_stamp_ns) == ("robot_b", STAMP_NS - 200)
    np.testing.assert_array_equal(read.pose, measured.pose)
    np.testing.assert_array_equal(read.covariance, COVARIANCE)
