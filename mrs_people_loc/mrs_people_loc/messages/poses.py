"""Poses, transforms, and with which poses the planner placed scans."""

from __future__ import annotations

import math

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import PoseError
from mrs_people_loc.geometry import yaw_from_quaternion
from mrs_people_loc.messages.stamps import Message, read_stamp, stamp_ns_of
from mrs_people_loc.team.poses import Pose

#: A quaternion's length may differ from 1 by this much (float32 sources round).
QUATERNION_TOLERANCE = 1e-2
#: Greatest coordinate of a pose [m]: any in the world, also where it counts from the equator: half
#: the way round it is 20,040 km.
MAX_COORDINATE_M = 2.1e7
#: A greater variance than this [m^2, rad^2] means "unknown" (as DBL_MAX does), as this one does.
MAX_VARIANCE = 1e12
#: base_link stands upright; a pose that leans by more is in some other frame [rad].
_MAX_TILT = math.radians(30.0)


def read_pose(message: Message, base_frame: str | None = None) -> Pose:
    """Reads the pose of a PoseWithCovarianceStamped or Odometry (in its header's frame).

    Args:
        message: The message.
        base_frame: `<robot>/base_link`. Odometry must be of it, or of `base_footprint` (REP 120),
            which is the same to a planar pose; the robot's name may be left out, as may be all of
            the name (drivers differ). None: whatever it is of.

    Raises:
        PoseError: It is the pose of something else, a value is not finite, the quaternion is none,
            or the robot does not stand.
        StampError: Its stamp is 0.
    """
    child = getattr(message, "child_frame_id", "")  # only odometry has one
    if base_frame is not None and child:
        footprint = base_frame.removesuffix("base_link") + "base_footprint"
        if child.lstrip("/") not in (base_frame, footprint, "base_link", "base_footprint"):
            raise PoseError(
                f"child_frame_id is {child!r}; wanted: {base_frame!r} "
                "(or base_footprint; the robot's name may be left out)"
            )
    return pose_of(read_stamp(message), message.pose)


def read_transform(message: Message, sigmas: tuple[float, ...] = ()) -> Pose:
    """Reads a geometry_msgs/TransformStamped as the pose of its child in its parent's frame.

    Args:
        message: The message.
        sigmas: Standard deviations of x, y [m] and yaw [rad]; empty: exact.

    Raises:
        PoseError: As `read_pose`.
    """
    transform, planar = message.transform, np.diag(np.square(sigmas or (0.0, 0.0, 0.0)))
    return _planar_pose(
        stamp_ns_of(message.header.stamp), transform.translation, transform.rotation, planar
    )


def pose_of(stamp_ns: int, with_covariance: Message) -> Pose:
    """A geometry_msgs/PoseWithCovariance as a pose at a time, checked as by `read_pose`."""
    pose = with_covariance.pose
    covariance = np.array(with_covariance.covariance, dtype=np.float64)
    if covariance.size != 36:
        raise PoseError(f"covariance has {covariance.size} values; wanted: 36")
    planar = covariance.reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
    return _planar_pose(stamp_ns, pose.position, pose.orientation, planar)


def _planar_pose(stamp_ns: int, position: Message, q: Message, covariance: Float) -> Pose:
    values = [position.x, position.y, position.z, q.x, q.y, q.z, q.w]
    if not np.isfinite(values).all():
        raise PoseError(
            "pose holds NaN or infinite values: position "
            f"({position.x}, {position.y}, {position.z}), orientation ({q.x}, {q.y}, {q.z}, {q.w})"
        )
    if max(abs(position.x), abs(position.y)) > MAX_COORDINATE_M:
        raise PoseError(
            f"position is ({position.x:g}, {position.y:g}) m; wanted: within {MAX_COORDINATE_M:g}"
        )
    norm = math.hypot(q.x, q.y, q.z, q.w)
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        raise PoseError(f"orientation has length {norm:.4g}; wanted: a quaternion of length 1")
    x, y, z, w = (value / norm for value in (q.x, q.y, q.z, q.w))
    tilt = math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))
    if tilt > _MAX_TILT:
        raise PoseError(
            f"pose leans by {tilt:.2f} rad; allowed: {_MAX_TILT:.2f} "
            "(base_link is upright on the floor, not a camera frame)"
        )
    yaw = yaw_from_quaternion(x, y, z, w)
    covariance = np.clip(covariance, -MAX_VARIANCE, MAX_VARIANCE)
    return Pose(stamp_ns, float(position.x), float(position.y), yaw, covariance)


def read_people_scans(message: Message) -> dict[str, Pose]:
    """Reads which scans a mrs_people_msgs/People was made from.

    Returns:
        By robot, the pose at its scan's stamp as the planner used it (`Pose.stamp_ns` is the
        scan's stamp).

    Raises:
        PoseError: A pose cannot be used.
    """
    return {scan.robot: pose_of(stamp_ns_of(scan.stamp), scan.pose) for scan in message.scans}
