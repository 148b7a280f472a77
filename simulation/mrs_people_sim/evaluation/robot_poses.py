"""Poses of robots in a bag: the true ones, those that robots sent, and their odometry."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.geometry import rotation_2d, yaw_from_quaternion
from mrs_people_loc.messages import read_pose, stamp_ns_of
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.scoring.poses import PoseTrack, relative_to
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.truth import true_pose_topic

_TRUE = "geometry_msgs/msg/PoseStamped"
_SENT = "geometry_msgs/msg/PoseWithCovarianceStamped"
_ODOMETRY = "nav_msgs/msg/Odometry"


def named_robots(bag: BagReader) -> list[str]:
    """Robots whose true pose is in a bag."""
    names = [topic.split("/")[2] for topic in bag.topics if topic.count("/") == 3]
    return sorted({name for name in names if true_pose_topic(name) in bag.topics})


def read_true_poses(bag: BagReader, robots: Iterable[str]) -> dict[str, PoseTrack]:
    """By robot, its true poses in `map`; robots without any are left out.

    Raises:
        BagError: A topic has another type, or a message is no pose.
    """
    return _read(bag, {true_pose_topic(name): name for name in robots}, _TRUE, _stamped)


def read_sent_poses(bag: BagReader, robots: Iterable[str]) -> dict[str, PoseTrack]:
    """By robot, what it said on `<robot>/pose`; likewise."""
    return _read(bag, {f"/{name}/pose": name for name in robots}, _SENT, read_pose)


def read_odometry(bag: BagReader, robots: Iterable[str]) -> dict[str, PoseTrack]:
    """By robot, its `<robot>/odom`, in its own frame; likewise."""
    topics = {f"/{name}/odom": name for name in robots}
    there = {t: n for t, n in topics.items() if t in bag.topics and bag.topics[t].type == _ODOMETRY}
    return _read(bag, there, _ODOMETRY, read_pose)


def _read(bag: BagReader, topics: dict[str, str], kind: str, read: Any) -> dict[str, PoseTrack]:
    topics = {topic: name for topic, name in topics.items() if topic in bag.topics}
    for topic in topics:
        if bag.topics[topic].type != kind:
            raise BagError(f"{bag.path}: {topic} is {bag.topics[topic].type}; allowed: {kind}")
    poses: dict[str, list[Pose]] = {}
    for topic, _, message in bag.decoded([*topics]) if topics else ():
        try:
            poses.setdefault(topics[topic], []).append(read(message))
        except PeopleLocError as err:
            raise BagError(f"{bag.path}: {topic}: {err}") from err
    return {name: PoseTrack.build(some) for name, some in poses.items()}


def _stamped(message: Any) -> Pose:
    """A PoseStamped."""
    at, turn = message.pose.position, message.pose.orientation
    yaw = yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)
    return Pose(stamp_ns_of(message.header.stamp), at.x, at.y, yaw)


def placed_at_start(odometry: PoseTrack, estimated: PoseTrack) -> PoseTrack | None:
    """Odometry in the map, if it began where a robot's first estimated pose is.

    Args:
        odometry: In a frame of its own.
        estimated: In the map.

    Returns:
        The odometry from there on, without covariances; None: it has nothing at that time.
    """
    if not len(estimated):
        return None
    (begin,) = odometry.at(estimated.stamps_ns[:1])
    if not np.isfinite(begin).all():
        return None
    later = odometry.select(odometry.stamps_ns >= estimated.stamps_ns[0])
    moved = relative_to(np.tile(begin, (len(later), 1)), later.poses)
    x, y, yaw = estimated.poses[0]
    places = moved[:, :2] @ rotation_2d(yaw).T + (x, y)
    poses = np.column_stack([places, moved[:, 2] + yaw])
    return PoseTrack(later.stamps_ns, poses, np.zeros((len(later), 3, 3)))
