"""Reads ROS messages into the core's types, and checks them.

Only the messages' attributes are used, which are the same in rclpy's and in rosbags' classes, so
nodes and offline tools read, and refuse, the same. Every error names the field, what was got and
what is wanted; the caller adds the topic.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.errors import (
    CameraError,
    GridError,
    ImageError,
    PoseError,
    RangeError,
    ScanError,
    StampError,
)
from mrs_people_loc.geometry import wrap_angle, yaw_from_quaternion
from mrs_people_loc.localization.ranges import LaserScan, SonarRange
from mrs_people_loc.localization.shared import Odometry, RelativePose, SeenWalls, TeamPose
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE, Cells, Scan
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose

if TYPE_CHECKING:
    from mrs_people_loc.sensing.images import Gray

Message = Any

#: Image encodings that are read: channels, and the name of OpenCV's conversion to grey. Those that
#: name no colours are OpenCV's own, whose order is blue, green, red.
ENCODINGS = {
    "mono8": (1, ""),
    "bgr8": (3, "COLOR_BGR2GRAY"),
    "rgb8": (3, "COLOR_RGB2GRAY"),
    "bgra8": (4, "COLOR_BGRA2GRAY"),
    "rgba8": (4, "COLOR_RGBA2GRAY"),
    "8UC1": (1, ""),
    "8UC3": (3, "COLOR_BGR2GRAY"),
}

#: PointField's datatypes (sensor_msgs/PointField).
_POINT_FIELD_TYPES = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}

#: A quaternion's length may differ from 1 by this much (float32 sources round).
_QUATERNION_TOLERANCE = 1e-2
#: Greatest coordinate of a pose [m]: any in the world, also where it counts from the equator: half
#: the way round it is 20,040 km.
_MAX_COORDINATE_M = 2.1e7
#: A greater variance than this [m^2, rad^2] means "unknown" (as DBL_MAX does), as this one does.
_MAX_VARIANCE = 1e12
#: More than any robot sends (`bodies.max_count`), and more than a planner has time for.
_MAX_BODIES = 100
_MAX_CELLS = 10_000
#: More walls, or absolute poses, than one robot measures in the time that a message covers.
_MAX_WALLS, _MAX_ABSOLUTE = 200, 100
#: What a message of the team repeats is of the seconds around its own stamp [ns].
_MAX_REPEATED_NS = 5_000_000_000
#: Longest name of a robot: that of a topic in DDS.
_MAX_NAME = 255
#: base_link stands upright; a pose that leans by more is in some other frame [rad].
_MAX_TILT = math.radians(30.0)


def stamp_ns_of(stamp: Message) -> int:
    """Time of a builtin_interfaces/Time [ns]."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def read_stamp(message: Message) -> int:
    """Time of a message of a sensor [ns].

    Raises:
        StampError: It is 0: its sender sets none.
    """
    stamp_ns = stamp_ns_of(message.header.stamp)
    if stamp_ns == 0:
        raise StampError(
            "stamp is 0: its sender sets none, and without stamps images find no pair and scans no "
            "pose; let the driver set them (or, with use_sim_time, start /clock before it)"
        )
    return stamp_ns


def read_camera_info(message: Message) -> CameraModel:
    """Reads sensor_msgs/CameraInfo.

    Raises:
        CameraError: A value cannot be used.
    """
    binning = (int(message.binning_x), int(message.binning_y))
    if binning not in ((0, 0), (1, 1)):
        raise CameraError(f"binning is {binning[0]}x{binning[1]}; allowed: none")
    roi = message.roi
    if int(roi.width) not in (0, int(message.width)) or int(roi.height) not in (
        0,
        int(message.height),
    ):
        raise CameraError(f"roi is {roi.width}x{roi.height}; allowed: none or the full image")
    return CameraModel(
        width=int(message.width),
        height=int(message.height),
        k=_matrix(message, "k", (3, 3)),
        d=tuple(float(value) for value in message.d),
        r=_matrix(message, "r", (3, 3)),
        p=_matrix(message, "p", (3, 4)),
        distortion_model=str(message.distortion_model),
    )


def _matrix(message: Message, name: str, shape: tuple[int, int]) -> Float:
    values = np.array(getattr(message, name), dtype=np.float64)
    if values.size != shape[0] * shape[1]:
        raise CameraError(f"{name} has {values.size} values; wanted: {shape[0] * shape[1]}")
    return values.reshape(shape)


def read_image(message: Message) -> Gray:
    """Reads sensor_msgs/Image as grey, uint8, shape (height, width).

    Raises:
        ImageError: The encoding is not one of `ENCODINGS`, or sizes and data do not fit.
    """
    height, width, step = int(message.height), int(message.width), int(message.step)
    if message.encoding not in ENCODINGS:
        raise ImageError(f"encoding is {message.encoding!r}; allowed: {', '.join(ENCODINGS)}")
    channels, conversion = ENCODINGS[message.encoding]
    if height == 0 or width == 0:
        raise ImageError(f"image is {width}x{height}; wanted: more than 0x0")
    if step < width * channels:
        raise ImageError(
            f"step is {step} bytes; wanted for {message.encoding} at width {width}: "
            f"at least {width * channels}"
        )
    data = np.frombuffer(message.data, dtype=np.uint8)
    if data.size != step * height:
        raise ImageError(f"data has {data.size} bytes; wanted: step * height = {step * height}")
    rows = data.reshape(height, step)[:, : width * channels]
    if not conversion:
        return np.ascontiguousarray(rows)
    import cv2  # here: a planner does without it, and is there sooner

    return cv2.cvtColor(rows.reshape(height, width, channels), getattr(cv2, conversion))  # type: ignore[return-value]


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
    return _pose(read_stamp(message), message.pose)


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


def _pose(stamp_ns: int, with_covariance: Message) -> Pose:
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
    if max(abs(position.x), abs(position.y)) > _MAX_COORDINATE_M:
        raise PoseError(
            f"position is ({position.x:g}, {position.y:g}) m; wanted: within {_MAX_COORDINATE_M:g}"
        )
    norm = math.hypot(q.x, q.y, q.z, q.w)
    if abs(norm - 1.0) > _QUATERNION_TOLERANCE:
        raise PoseError(f"orientation has length {norm:.4g}; wanted: a quaternion of length 1")
    x, y, z, w = (value / norm for value in (q.x, q.y, q.z, q.w))
    tilt = math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))
    if tilt > _MAX_TILT:
        raise PoseError(
            f"pose leans by {tilt:.2f} rad; allowed: {_MAX_TILT:.2f} "
            "(base_link is upright on the floor, not a camera frame)"
        )
    yaw = yaw_from_quaternion(x, y, z, w)
    covariance = np.clip(covariance, -_MAX_VARIANCE, _MAX_VARIANCE)
    return Pose(stamp_ns, float(position.x), float(position.y), yaw, covariance)


def read_people_scans(message: Message) -> dict[str, Pose]:
    """Reads which scans a mrs_people_msgs/People was made from.

    Returns:
        By robot, the pose at its scan's stamp as the planner used it (`Pose.stamp_ns` is the
        scan's stamp).

    Raises:
        PoseError: A pose cannot be used.
    """
    return {scan.robot: _pose(stamp_ns_of(scan.stamp), scan.pose) for scan in message.scans}


def read_scan(message: Message, robot: str, frame_id: str | None = None) -> Scan:
    """Reads a scan from sensor_msgs/PointCloud2, taking fields by name.

    Args:
        message: The message.
        robot: Name of the robot that sent it.
        frame_id: The frame it must be in; None: `<robot>/base_link`.

    Raises:
        ScanError: The frame, a field, the layout or a value is wrong.
    """
    wanted_frame = f"{robot}/base_link" if frame_id is None else frame_id
    if message.header.frame_id != wanted_frame:
        raise ScanError(f"frame_id is {message.header.frame_id!r}; wanted: {wanted_frame!r}")
    if message.is_bigendian:
        raise ScanError("is_bigendian is true; wanted: little-endian data")
    records = _records(message)
    with np.errstate(over="ignore", invalid="ignore"):  # what float32 cannot hold is refused as inf
        cells = Cells.from_records(records)
    bodies = len(np.unique(cells.body[cells.body > 0]))
    if bodies > _MAX_BODIES:
        raise ScanError(f"scan has {bodies} bodies; allowed: up to {_MAX_BODIES}")
    for name in ("sigma_range", "sigma_across"):
        if (getattr(cells, name)[cells.body > 0] <= 0).any():
            raise ScanError(f"{name} of a body is 0 or less; wanted: more than 0")
    return Scan(robot, stamp_ns_of(message.header.stamp), cells)


def _records(message: Message) -> NDArray[np.void]:
    """The cells of a PointCloud2 as records, with the fields of `CELL_DTYPE` or `BODY_DTYPE`.

    Raises:
        ScanError: A field, the layout or a count is wrong.
    """
    fields = {field.name: field for field in message.fields}
    # Either a plain scan or one of bodies, which has all of these.
    of_bodies = "body" in fields
    dtype = BODY_DTYPE if of_bodies else CELL_DTYPE
    names = dtype.names or ()
    point_step, row_step = int(message.point_step), int(message.row_step)
    formats, offsets = _formats_and_offsets(fields, names, point_step)
    width, height = int(message.width), int(message.height)
    if row_step < width * point_step:
        raise ScanError(f"row_step is {row_step}; wanted: at least {width * point_step}")
    data = np.frombuffer(message.data, dtype=np.uint8)
    if data.size != row_step * height:
        raise ScanError(
            f"data has {data.size} bytes; wanted: row_step * height = {row_step * height}"
        )
    if width * height > _MAX_CELLS:
        raise ScanError(f"scan has {width * height} cells; allowed: up to {_MAX_CELLS}")
    if width * height == 0:
        return np.empty(0, dtype)
    layout = np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": point_step}
    )
    rows = np.ascontiguousarray(data.reshape(height, row_step)[:, : width * point_step])
    records = rows.reshape(-1).view(layout)
    for name in ("count", "body") if of_bodies else ("count",):
        numbers = records[name]
        if numbers.dtype.kind == "f" and not np.isfinite(numbers).all():
            raise ScanError(f"{name} is NaN or infinite")
        if (numbers < 0).any() or (numbers >= 2**32).any():
            raise ScanError(f"{name} is negative or too large; wanted: uint32")
    return records


def _formats_and_offsets(
    fields: Mapping[str, Message], names: tuple[str, ...], point_step: int
) -> tuple[list[str], list[int]]:
    """NumPy formats of the named fields of a PointCloud2, and their first bytes in a point.

    Raises:
        ScanError: One is missing, is no single number, or does not fit into a point.
    """
    missing = [name for name in names if name not in fields]
    if missing:
        raise ScanError(
            f"fields are missing: {', '.join(missing)}; got: {', '.join(fields) or 'none'}; "
            f"wanted: {', '.join(names)}"
        )
    formats, offsets = [], []
    for name in names:
        field = fields[name]
        code = _POINT_FIELD_TYPES.get(int(field.datatype))
        if code is None or int(field.count) != 1:
            raise ScanError(
                f"field {name} has datatype {field.datatype} and count {field.count}; "
                "wanted: one number"
            )
        end = int(field.offset) + np.dtype(code).itemsize
        if end > point_step:
            raise ScanError(f"field {name} ends at byte {end}; point_step is {point_step}")
        formats.append(code)
        offsets.append(int(field.offset))
    return formats, offsets


def read_occupancy_grid(message: Message, map_frame: str) -> OccupancyGrid:
    """Reads nav_msgs/OccupancyGrid.

    Args:
        message: The message.
        map_frame: The frame that it must be in: the common one.

    Raises:
        GridError: The frame, a size or a value is wrong, or the grid does not lie level.
    """
    if message.header.frame_id.lstrip("/") != map_frame:
        raise GridError(f"frame_id is {message.header.frame_id!r}; wanted: {map_frame!r}")
    info = message.info
    width, height = int(info.width), int(info.height)
    data = np.asarray(message.data)
    if data.size != width * height or not data.size:
        raise GridError(
            f"data has {data.size} cells; wanted: width * height = {width} * {height}, more than 0"
        )
    if data.dtype != np.int8:  # a plain list
        if not np.isin(data, np.arange(-128, 128)).all():
            raise GridError("data holds what is no int8; wanted: -1, or 0 to 100")
        data = data.astype(np.int8)
    position, q = info.origin.position, info.origin.orientation
    values = (q.x, q.y, q.z, q.w)
    norm = math.hypot(*values)
    if not abs(norm - 1.0) <= _QUATERNION_TOLERANCE:
        raise GridError(f"origin has an orientation of length {norm:.4g}; wanted: a quaternion, 1")
    if math.hypot(q.x, q.y) > _QUATERNION_TOLERANCE:
        raise GridError(f"origin's orientation is {values}; wanted: a level grid, turned about z")
    return OccupancyGrid(
        resolution=float(info.resolution),
        x=float(position.x),
        y=float(position.y),
        yaw=yaw_from_quaternion(*values),
        data=data.reshape(height, width),
    )


def read_range(message: Message) -> SonarRange:
    """Reads sensor_msgs/Range.

    Raises:
        RangeError: A limit of the sensor cannot be used.
        StampError: Its stamp is 0.
    """
    return SonarRange(
        stamp_ns=read_stamp(message),
        frame_id=str(message.header.frame_id).lstrip("/"),
        field_of_view=float(message.field_of_view),
        min_range=float(message.min_range),
        max_range=float(message.max_range),
        range=float(message.range),
        variance=float(getattr(message, "variance", 0.0)),  # not before Iron
    )


def read_laser_scan(message: Message) -> LaserScan:
    """Reads sensor_msgs/LaserScan, with its rays from right to left.

    Raises:
        RangeError: A limit, an angle or the number of ranges cannot be used.
        StampError: Its stamp is 0.
    """
    first, step = float(message.angle_min), float(message.angle_increment)
    low, high = float(message.range_min), float(message.range_max)
    if not (math.isfinite(first) and math.isfinite(step) and step != 0.0):
        raise RangeError(
            f"angle_min is {first} and angle_increment {step} rad; wanted: finite, and a step that "
            "is not 0"
        )
    if not low >= 0.0:  # NaN compares false
        raise RangeError(f"range_min is {low} m; wanted: at least 0")
    with np.errstate(over="ignore", invalid="ignore"):  # any bits may come as float32
        ranges = np.array(message.ranges, dtype=np.float64)
        measured = (ranges >= low) & (ranges <= high)
        angles: Float = first + step * np.arange(len(ranges), dtype=np.float64)
    order = slice(None, None, 1 if step > 0 else -1)
    return LaserScan(
        stamp_ns=read_stamp(message),
        frame_id=str(message.header.frame_id).lstrip("/"),
        max_range=high,
        angles=angles[order],
        ranges=np.where(measured | (ranges == np.inf), ranges, np.nan)[order],  # REP 117
    )


def read_team_pose(message: Message, map_frame: str) -> TeamPose:
    """Reads mrs_people_msgs/TeamPose.

    Args:
        message: The message.
        map_frame: The frame that its poses must be in: the common one.

    Raises:
        PoseError: A frame, a name, a pose, a wall or a covariance cannot be used.
        StampError: A stamp is 0.
    """
    pose = _pose_in(map_frame, message)
    values = (message.odometry_x, message.odometry_y, message.odometry_yaw)
    variances = (message.position_variance, message.heading_variance)
    if not np.isfinite((*values, *variances)).all() or max(map(abs, values)) > _MAX_COORDINATE_M:
        raise PoseError(
            f"odometry is {values} with variances {variances}; wanted: finite, within "
            f"{_MAX_COORDINATE_M:g}"
        )
    if not 0.0 <= min(variances) <= max(variances) <= _MAX_VARIANCE:
        raise PoseError(
            f"variances of odometry are {variances}; wanted: from 0 to {_MAX_VARIANCE:g}"
        )
    count = len(message.absolute)
    if count > _MAX_ABSOLUTE:
        raise PoseError(f"message has {count} absolute poses; allowed: up to {_MAX_ABSOLUTE}")
    absolute = tuple(_pose_in(map_frame, one) for one in message.absolute)
    for one in absolute:
        _check_near(one.stamp_ns, pose.stamp_ns, "an absolute pose")
    x, y, yaw = map(float, values)
    odometry = Odometry(pose.stamp_ns, x, y, wrap_angle(yaw), *map(float, variances))
    walls = _seen_walls(message.walls, pose.stamp_ns)
    in_team = _covariance(message.covariance_in_team, "pose in the team")
    pose = dataclasses.replace(pose, in_team=in_team)
    return TeamPose(_robot_name(message.robot), pose, odometry, walls, absolute)


def _pose_in(map_frame: str, message: Message) -> Pose:
    """A pose in the map with a usable covariance."""
    if message.header.frame_id != map_frame:
        raise PoseError(f"frame_id is {message.header.frame_id!r}; wanted: {map_frame!r}")
    pose = _pose(read_stamp(message), message.pose)
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
    ok = bool((magnitudes <= _MAX_VARIANCE).all())  # NaN compares false
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
    if not np.isfinite(lines).all() or (np.abs(lines) > _MAX_COORDINATE_M).any():
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


def read_relative_poses(message: Message) -> tuple[RelativePose, ...]:
    """Reads mrs_people_msgs/RelativePoses.

    Raises:
        PoseError: A name, a value or a covariance cannot be used.
        StampError: Its stamp is 0.
    """
    of_message_ns = read_stamp(message)
    return tuple(_relative_pose(one, of_message_ns) for one in message.poses)


def _relative_pose(message: Message, of_message_ns: int) -> RelativePose:
    robot, other = _robot_name(message.robot), _robot_name(message.other)
    if robot == other:
        raise PoseError(f"{robot} has a pose relative to itself; wanted: two robots")
    stamps = stamp_ns_of(message.stamp), stamp_ns_of(message.other_stamp)
    for stamp_ns in stamps:
        _check_near(stamp_ns, of_message_ns, "a relative pose")
    values = np.array([message.x, message.y, message.yaw], np.float64)
    if not np.isfinite(values).all() or (np.abs(values) > _MAX_COORDINATE_M).any():
        raise PoseError(f"a relative pose is {values.tolist()}; wanted: finite numbers")
    covariance = _covariance(message.covariance, "a relative pose", positive=True)
    values[2] = wrap_angle(values[2])
    return RelativePose(robot, stamps[0], other, stamps[1], values, covariance)
