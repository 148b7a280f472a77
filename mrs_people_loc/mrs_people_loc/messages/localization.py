"""What a team shares about where its robots are."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.errors import PoseError
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.shared import (
    RelativePose,
    StandingPeople,
    TeamMeasurement,
    TeamPose,
)
from mrs_people_loc.localization.walls import SeenWalls, Walls
from mrs_people_loc.messages.poses import MAX_COORDINATE_M, MAX_VARIANCE, pose_of
from mrs_people_loc.messages.stamps import Message, read_stamp, stamp_ns_of
from mrs_people_loc.team.poses import Pose

#: More walls, or absolute poses, than one robot measures in the time that a message covers.
_MAX_WALLS, _MAX_ABSOLUTE = 200, 100
#: More people than all robots of a team see at once.
_MAX_STANDING = 1000
#: More team-mates than a robot has.
_MAX_DOUBTED = 100
#: Value of `status` of a robot that knows where it is; it is lost with any other, also one that is
#: not known here: its pose is then not relied on.
_PLACED = 0
#: What a message of the team repeats is of the seconds around its own stamp [ns].
_MAX_REPEATED_NS = 5_000_000_000
#: Longest name of a robot: that of a topic in DDS.
_MAX_NAME = 255


def read_team_pose(message: Message, map_frame: str) -> TeamPose:
    """Reads mrs_people_msgs/TeamPose.

    Args:
        message: The message.
        map_frame: The frame that its poses must be in: the common one.

    Raises:
        PoseError: A frame, a name, a pose, a wall or a covariance cannot be used, or there are too
            many.
        StampError: A stamp is 0.
    """
    pose = _pose_in(map_frame, message)
    values = (message.odometry_x, message.odometry_y, message.odometry_yaw)
    variances = (message.position_variance, message.heading_variance)
    if not np.isfinite((*values, *variances)).all() or max(map(abs, values)) > MAX_COORDINATE_M:
        raise PoseError(
            f"odometry is {values} with variances {variances}; wanted: finite, within "
            f"{MAX_COORDINATE_M:g}"
        )
    if not 0.0 <= min(variances) <= max(variances) <= MAX_VARIANCE:
        raise PoseError(
            f"variances of odometry are {variances}; wanted: from 0 to {MAX_VARIANCE:g}"
        )
    count = len(message.absolute)
    if count > _MAX_ABSOLUTE:
        raise PoseError(f"message has {count} absolute poses; allowed: up to {_MAX_ABSOLUTE}")
    if len(message.doubted) > _MAX_DOUBTED:
        raise PoseError(f"message doubts {len(message.doubted)} robots; allowed: {_MAX_DOUBTED}")
    absolute = tuple(_pose_in(map_frame, one) for one in message.absolute)
    for one in absolute:
        _check_near(one.stamp_ns, pose.stamp_ns, "an absolute pose")
    x, y, yaw = map(float, values)
    odometry = Odometry(pose.stamp_ns, x, y, wrap_angle(yaw), *map(float, variances))
    walls = _seen_walls(message.walls, pose.stamp_ns)
    in_team = _covariance(message.covariance_in_team, "pose in the team")
    pose = dataclasses.replace(pose, in_team=in_team)
    lost, doubted = message.status != _PLACED, tuple(map(_robot_name, message.doubted))
    return TeamPose(_robot_name(message.robot), pose, odometry, walls, absolute, lost, doubted)


def _pose_in(map_frame: str, message: Message) -> Pose:
    """A pose in the map with a usable covariance."""
    if message.header.frame_id != map_frame:
        raise PoseError(f"frame_id is {message.header.frame_id!r}; wanted: {map_frame!r}")
    pose = pose_of(read_stamp(message), message.pose)
    _check_covariances(pose.covariance[None], "pose")
    return pose


def _robot_name(name: object) -> str:
    text = str(name)
    if not 0 < len(text) <= _MAX_NAME:
        raise PoseError(f"a robot's name has {len(text)} characters; wanted: 1 to {_MAX_NAME}")
    return text


def _check_near(stamp_ns: int, of_message_ns: int, what: str) -> None:
    away_s = (stamp_ns - of_message_ns) / 1e9
    if abs(away_s) > _MAX_REPEATED_NS / 1e9:
        raise PoseError(
            f"stamp of {what} is {away_s:.3f} s from that of the message; "
            f"allowed: {_MAX_REPEATED_NS / 1e9:g} s"
        )


def _covariance(values: Sequence[float], what: str, *, positive: bool = False) -> Float:
    """A covariance of x, y, yaw from its 9 values, shape (3, 3); see `_check_covariances`."""
    covariance = np.array(values, np.float64)
    if covariance.size != 9:
        raise PoseError(f"covariance of {what} has {covariance.size} values; wanted: 9")
    covariance = covariance.reshape(3, 3)
    _check_covariances(covariance[None], what, positive=positive)
    return covariance


def _check_covariances(covariances: Float, what: str, *, positive: bool = False) -> None:
    """Checks covariances, shape (n, k, k).

    Args:
        covariances: The covariances.
        what: Whose they are.
        positive: Whether they must be invertible.

    Raises:
        PoseError: One is no covariance.
    """
    magnitudes = np.abs(covariances)
    ok = bool((magnitudes <= MAX_VARIANCE).all())  # NaN compares false
    if ok and len(covariances):
        transposed = covariances.transpose(0, 2, 1)
        difference = np.abs(covariances - transposed)
        least, *_, greatest = np.linalg.eigvalsh(0.5 * (covariances + transposed)).T
        enough = least > 0.0 if positive else least >= -1e-9 * np.abs(greatest)
        ok = bool((difference <= 1e-6 * magnitudes + 1e-12).all() and enough.all())
    if not ok:
        kind = "positive definite" if positive else "positive semidefinite"
        raise PoseError(
            f"covariance of {what} is no covariance (finite, symmetric, {kind}): "
            f"{covariances.tolist()}"
        )


def _seen_walls(walls: Sequence[Message], of_message_ns: int) -> tuple[SeenWalls, ...]:
    """Walls by their stamps, in the order of these."""
    if len(walls) > _MAX_WALLS:
        raise PoseError(f"message has {len(walls)} walls; allowed: up to {_MAX_WALLS}")
    if not walls:
        return ()
    in_order = sorted(walls, key=lambda wall: stamp_ns_of(wall.stamp))
    stamps = [stamp_ns_of(wall.stamp) for wall in in_order]
    for stamp_ns in (stamps[0], stamps[-1]):
        _check_near(stamp_ns, of_message_ns, "a wall")
    lines = np.array([(w.distance, w.bearing, w.from_m, w.to_m) for w in in_order], np.float64)
    triples = np.array([np.asarray(w.covariance) for w in in_order], np.float64)
    ends: Bool = np.array([(bool(w.ends_at_from), bool(w.ends_at_to)) for w in in_order])
    if not np.isfinite(lines).all() or (np.abs(lines) > MAX_COORDINATE_M).any():
        raise PoseError(f"a wall holds NaN, infinite or huge values: {lines.tolist()}")
    distance, bearing, begins, reaches = lines.T
    if (distance < 0.0).any() or (begins > reaches).any():
        raise PoseError(
            "a wall has a negative distance, or ends before it begins: distance, bearing, from, "
            f"to: {lines.tolist()}"
        )
    covariance = triples[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    _check_covariances(covariance, "a wall", positive=True)
    turned = np.array([wrap_angle(angle) for angle in bearing])
    made = Walls(distance, turned, covariance, lines[:, 2:], ends)
    found, at = [], 0
    for stamp_ns, same in itertools.groupby(stamps):
        end = at + len(list(same))
        found.append(SeenWalls(stamp_ns, made.select(slice(at, end))))
        at = end
    return tuple(found)


def read_relative_poses(message: Message) -> tuple[TeamMeasurement, ...]:
    """Reads mrs_people_msgs/RelativePoses.

    Raises:
        PoseError: A name, a value or a covariance cannot be used.
        StampError: Its stamp is 0.
    """
    of_message_ns = read_stamp(message)
    return (
        *(_relative_pose(one, of_message_ns) for one in message.poses),
        *_standing_people(message.standing, of_message_ns),
    )


def _standing_people(people: Sequence[Message], of_message_ns: int) -> Iterator[StandingPeople]:
    """By robot and stamp, the people who stand."""
    if len(people) > _MAX_STANDING:
        raise PoseError(f"message has {len(people)} people; allowed: up to {_MAX_STANDING}")
    sights: dict[tuple[str, int], list[Message]] = {}
    for one in people:
        sights.setdefault((_robot_name(one.robot), stamp_ns_of(one.stamp)), []).append(one)
    for (robot, stamp_ns), seen in sights.items():
        _check_near(stamp_ns, of_message_ns, "a person who stands")
        xy = np.array([(one.x, one.y) for one in seen], np.float64)
        if not np.isfinite(xy).all() or (np.abs(xy) > MAX_COORDINATE_M).any():
            raise PoseError(f"people who stand are at {xy.tolist()}; wanted: finite numbers")
        triples = np.array([np.asarray(one.covariance) for one in seen], np.float64)
        covariance = triples[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        _check_covariances(covariance, "a person who stands", positive=True)
        inflated = max(_inflated(one) for one in seen)
        yield StandingPeople(robot, stamp_ns, xy, covariance, inflated)


def _inflated(message: Message) -> float:
    """How many times larger a covariance is than that of a single measurement."""
    inflated = float(message.inflated) or 1.0
    if not 1.0 <= inflated <= MAX_VARIANCE:
        raise PoseError(f"inflated is {inflated}; wanted: 0, or from 1 to {MAX_VARIANCE:g}")
    return inflated


def _relative_pose(message: Message, of_message_ns: int) -> RelativePose:
    robot, other = _robot_name(message.robot), _robot_name(message.other)
    if robot == other:
        raise PoseError(f"{robot} has a pose relative to itself; wanted: two robots")
    stamps = stamp_ns_of(message.stamp), stamp_ns_of(message.other_stamp)
    for stamp_ns in stamps:
        _check_near(stamp_ns, of_message_ns, "a relative pose")
    values = np.array([message.x, message.y, message.yaw], np.float64)
    if not np.isfinite(values).all() or (np.abs(values) > MAX_COORDINATE_M).any():
        raise PoseError(f"a relative pose is {values.tolist()}; wanted: finite numbers")
    covariance = _covariance(message.covariance, "a relative pose", positive=True)
    values[2] = wrap_angle(values[2])
    inflated = _inflated(message)
    return RelativePose(robot, stamps[0], other, stamps[1], values, covariance, inflated)
