"""The core's results as ROS messages."""

from __future__ import annotations

import array
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Twist,
    TwistStamped,
    TwistWithCovariance,
    Vector3,
)
from geometry_msgs.msg import Pose as RosPose
from mrs_people_msgs.action import GuideTour
from mrs_people_msgs.msg import Group as GroupMessage
from mrs_people_msgs.msg import (
    GuideStatus,
    RelativePoses,
    RobotPost,
    RobotScan,
    TourStop,
    Wall,
)
from mrs_people_msgs.msg import HiddenPerson as HiddenPersonMessage
from mrs_people_msgs.msg import People as PeopleMessage
from mrs_people_msgs.msg import Person as PersonMessage
from mrs_people_msgs.msg import RelativePose as RelativePoseMessage
from mrs_people_msgs.msg import StandingPerson as StandingPersonMessage
from mrs_people_msgs.msg import TeamPose as TeamPoseMessage
from nav_msgs.msg import Path
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from mrs_people_loc.config import Disparity, Mounting
from mrs_people_loc.geometry import quaternion_from_rotation, quaternion_from_yaw
from mrs_people_loc.guiding.guidance import Guidance, Post
from mrs_people_loc.localization.shared import (
    RelativePose,
    StandingPeople,
    TeamMeasurement,
    TeamPose,
)
from mrs_people_loc.localization.walls import SeenWalls
from mrs_people_loc.people import Group, Person
from mrs_people_loc.planner import People
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera, robot_from_optical
from mrs_people_loc.team.poses import Pose

if TYPE_CHECKING:
    from mrs_people_loc.guiding.tour import Tour  # which loads OpenCV

_FIELD_TYPES = {"f4": PointField.FLOAT32, "u4": PointField.UINT32, "i4": PointField.INT32}
#: Variance of a heading that nothing is known of: uniform over the circle [rad^2].
_ANY_HEADING = (2.0 * math.pi) ** 2 / 12.0


def header(stamp_ns: int, frame_id: str) -> Header:
    """A header.

    Args:
        stamp_ns: Stamp [ns].
        frame_id: Frame.
    """
    return Header(stamp=time(stamp_ns), frame_id=frame_id)


def time(stamp_ns: int) -> Time:
    """A time [ns] as a message."""
    return Time(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)


def cloud(stamp_ns: int, frame_id: str, records: np.ndarray) -> PointCloud2:
    """A structured array of shape (n,) as a PointCloud2 with its fields."""
    dtype = records.dtype
    fields = [
        PointField(name=name, offset=entry[1], datatype=_FIELD_TYPES[entry[0].str[1:]], count=1)
        for name, entry in (dtype.fields or {}).items()
    ]
    message = PointCloud2(
        header=header(stamp_ns, frame_id),
        height=1,
        width=len(records),
        fields=fields,
        is_bigendian=False,
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * len(records),
        is_dense=True,
    )
    message.data = _data(records)
    return message


def points(scan: Scan, frame_id: str) -> PointCloud2:
    """A scan as the message on `points`."""
    return cloud(scan.stamp_ns, frame_id, scan.cells.to_records())


def xyz_cloud(stamp_ns: int, frame_id: str, xyz: np.ndarray) -> PointCloud2:
    """Points of shape (n, 3) [m] as a PointCloud2."""
    records = np.empty(len(xyz), np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")]))
    for axis, name in enumerate("xyz"):
        records[name] = xyz[:, axis]
    return cloud(stamp_ns, frame_id, records)


def velocity(
    kind: type[Twist] | type[TwistStamped],
    wanted: tuple[float, float],
    stamp_ns: int,
    frame_id: str,
) -> Twist | TwistStamped:
    """A command of speed ahead [m/s] and rate of turn [rad/s], of either type."""
    twist = Twist()
    twist.linear.x, twist.angular.z = wanted
    if kind is Twist:
        return twist
    return TwistStamped(header=header(stamp_ns, frame_id), twist=twist)


def disparity(
    source: Header, values: np.ndarray, camera: StereoCamera, config: Disparity
) -> DisparityImage:
    """A disparity image as stereo_image_proc publishes it: -1 where there is no value.

    Args:
        source: Header of the left image.
        values: [px], float32, shape (height, width), NaN where there is none.
        camera: The head.
        config: Its matching parameters.
    """
    height, width = values.shape
    message = DisparityImage(header=source)
    message.image = Image(
        header=source,
        height=height,
        width=width,
        encoding="32FC1",
        is_bigendian=0,
        step=4 * width,
    )
    message.image.data = _data(np.nan_to_num(values, nan=-1.0).astype("<f4"))
    message.f = camera.fx
    message.t = camera.baseline
    message.valid_window.width = width
    message.valid_window.height = height
    message.min_disparity = camera.disparity_of(config.max_range)
    message.max_disparity = camera.disparity_of(config.min_range)
    from mrs_people_loc.sensing.disparity import SUBPIXELS  # here: a planner does without OpenCV

    message.delta_d = 1.0 / SUBPIXELS
    return message


def _data(values: np.ndarray) -> array.array:
    data = array.array("B")
    data.frombytes(values.tobytes())  # rclpy takes this as it is; per element it would be slow
    return data


def pose_with_covariance(pose: Pose) -> PoseWithCovariance:
    """A planar pose; z, roll and pitch are exactly zero."""
    covariance = np.zeros((6, 6))
    covariance[np.ix_((0, 1, 5), (0, 1, 5))] = pose.covariance
    x, y, z, w = quaternion_from_yaw(pose.yaw)
    return PoseWithCovariance(
        pose=RosPose(
            position=Point(x=pose.x, y=pose.y, z=0.0), orientation=Quaternion(x=x, y=y, z=z, w=w)
        ),
        covariance=covariance.reshape(-1),
    )


def pose_stamped(pose: Pose, frame_id: str) -> PoseWithCovarianceStamped:
    """A pose as the message on `pose`."""
    return PoseWithCovarianceStamped(
        header=header(pose.stamp_ns, frame_id), pose=pose_with_covariance(pose)
    )


def team_pose(told: TeamPose, frame_id: str) -> TeamPoseMessage:
    """What a robot tells its team as the message on `team_poses`."""
    odometry, pose = told.odometry, told.pose
    in_team = pose.covariance if pose.in_team is None else pose.in_team
    return TeamPoseMessage(
        header=header(odometry.stamp_ns, frame_id),
        robot=told.robot,
        pose=pose_with_covariance(pose),
        covariance_in_team=in_team.reshape(-1).astype(np.float64),
        odometry_x=float(odometry.x),
        odometry_y=float(odometry.y),
        odometry_yaw=float(odometry.yaw),
        position_variance=float(odometry.position_variance),
        heading_variance=float(odometry.heading_variance),
        walls=[wall for seen in told.walls for wall in _walls(seen)],
        absolute=[pose_stamped(pose, frame_id) for pose in told.absolute],
        status=TeamPoseMessage.LOST if told.lost else TeamPoseMessage.PLACED,
        doubted=list(told.doubted),
    )


def _walls(seen: SeenWalls) -> list[Wall]:
    walls, stamp = seen.walls, time(seen.stamp_ns)
    columns = zip(
        walls.distance.tolist(),
        walls.bearing.tolist(),
        walls.covariance.reshape(-1, 4)[:, [0, 1, 3]].tolist(),
        walls.extent.tolist(),
        walls.is_end.tolist(),
        strict=True,
    )
    return [
        Wall(
            stamp=stamp,
            distance=distance,
            bearing=bearing,
            covariance=covariance,
            from_m=begins,
            to_m=reaches,
            ends_at_from=first,
            ends_at_to=last,
        )
        for distance, bearing, covariance, (begins, reaches), (first, last) in columns
    ]


def relative_poses(
    stamp_ns: int, frame_id: str, measured: Sequence[TeamMeasurement]
) -> RelativePoses:
    """What was measured of robots in an interval as the message on `relative_poses`."""
    return RelativePoses(
        header=header(stamp_ns, frame_id),
        poses=[
            RelativePoseMessage(
                stamp=time(one.stamp_ns),
                robot=one.robot,
                other_stamp=time(one.other_stamp_ns),
                other=one.other,
                x=float(one.pose[0]),
                y=float(one.pose[1]),
                yaw=float(one.pose[2]),
                covariance=one.covariance.reshape(-1),
                inflated=float(one.inflated),
            )
            for one in measured
            if isinstance(one, RelativePose)
        ],
        standing=[
            StandingPersonMessage(
                stamp=time(one.stamp_ns),
                robot=one.robot,
                x=float(x),
                y=float(y),
                covariance=covariance.reshape(-1)[[0, 1, 3]],
                inflated=float(one.inflated),
            )
            for one in measured
            if isinstance(one, StandingPeople)
            for (x, y), covariance in zip(one.xy, one.covariance, strict=True)
        ],
    )


def transform(stamp_ns: int, parent: str, pose: Pose, child: str) -> TransformStamped:
    """A frame on the floor of another one, for TF.

    Args:
        stamp_ns: Stamp [ns].
        parent: Frame that the pose is given in.
        pose: Pose of the child.
        child: The frame that is placed.
    """
    place = np.array([pose.x, pose.y, 0.0])
    return _transform(stamp_ns, parent, child, place, quaternion_from_yaw(pose.yaw))


def camera_transforms(
    stamp_ns: int, base_frame: str, mounting: Mounting, camera: StereoCamera | None
) -> list[TransformStamped]:
    """Where a head's cameras are, for TF: optical frames (REP 103), named after the base's.

    Args:
        stamp_ns: Stamp [ns].
        base_frame: `<robot>/base_link`.
        mounting: Pose of the left camera on it.
        camera: The calibrated head, which gives the baselines; None: not known yet.
    """
    left, right, top = (
        base_frame.removesuffix("base_link") + f"{name}_camera_optical"
        for name in ("left", "right", "top")
    )
    rotation, place = robot_from_optical(mounting)
    quaternion = quaternion_from_rotation(rotation)
    made = [_transform(stamp_ns, base_frame, left, place, quaternion)]
    # In the left optical frame x is to the right and y down; rectified cameras are parallel.
    if camera is not None:
        to_right = np.array([camera.baseline, 0.0, 0.0])
        made.append(_transform(stamp_ns, left, right, to_right, (0.0, 0.0, 0.0, 1.0)))
        if camera.vertical_baseline:
            up = np.array([0.0, -camera.vertical_baseline, 0.0])
            made.append(_transform(stamp_ns, left, top, up, (0.0, 0.0, 0.0, 1.0)))
    return made


def _transform(
    stamp_ns: int,
    parent: str,
    child: str,
    place: np.ndarray,
    quaternion: tuple[float, float, float, float],
) -> TransformStamped:
    made = TransformStamped(header=header(stamp_ns, parent), child_frame_id=child)
    x, y, z = map(float, place)
    made.transform.translation = Vector3(x=x, y=y, z=z)
    x, y, z, w = quaternion
    made.transform.rotation = Quaternion(x=x, y=y, z=z, w=w)
    return made


def people(result: People, frame_id: str) -> PeopleMessage:
    """An interval's result as the message on `tracked_people`."""
    return PeopleMessage(
        header=header(result.stamp_ns, frame_id),
        scans=[
            RobotScan(robot=robot, stamp=time(pose.stamp_ns), pose=pose_with_covariance(pose))
            for robot, pose in result.poses.items()
        ],
        persons=[_person(person) for person in result.persons],
        hidden=[_hidden(person) for person in result.hidden],
        groups=[_group(group) for group in result.groups],
        quarantined=list(result.quarantined),
    )


def _person(person: Person) -> PersonMessage:
    return PersonMessage(
        id=person.id,
        pose=place(person.position, person.covariance),
        velocity=_velocity(person.velocity, person.velocity_covariance),
        height=person.height,
        sigma=person.sigma,
        robots=list(person.robots),
        age=_duration(person.age_s),
        coasting=person.coasting,
    )


def _hidden(person: Person) -> HiddenPersonMessage:
    made = HiddenPersonMessage(person=_person(person), last_seen=time(person.stamp_ns))
    if person.seen_at is not None:
        made.last_seen_at = floor_pose(person.seen_at).position
    return made


def _group(group: Group) -> GroupMessage:
    return GroupMessage(
        id=group.id,
        size=group.size,
        centre=place(group.centre, group.covariance),
        velocity=_velocity(group.velocity, group.velocity_covariance),
        radius=group.radius,
        rms_spread=group.rms_spread,
        members=list(group.members),
        stragglers=list(group.stragglers),
        straggling_for=[_duration(away_s) for away_s in group.stragglers.values()],
    )


def place(position: np.ndarray, covariance: np.ndarray) -> PoseWithCovariance:
    """A place on the floor with no heading."""
    full = np.zeros((6, 6))
    full[:2, :2] = covariance
    full[5, 5] = _ANY_HEADING
    return PoseWithCovariance(pose=floor_pose(position), covariance=full.reshape(-1))


def floor_pose(position: np.ndarray) -> RosPose:
    """A place on the floor [m], shape (2,), with no turn."""
    return RosPose(
        position=Point(x=float(position[0]), y=float(position[1]), z=0.0),
        orientation=Quaternion(w=1.0),
    )


def _velocity(value: np.ndarray | None, covariance: np.ndarray | None) -> TwistWithCovariance:
    """A velocity on the floor; NaN where nothing is known, as of turning."""
    unknown = math.nan
    made = TwistWithCovariance()
    made.twist.linear = Vector3(x=unknown, y=unknown, z=unknown)
    made.twist.angular = Vector3(x=unknown, y=unknown, z=unknown)
    full = np.full((6, 6), unknown)
    if value is not None and covariance is not None:
        made.twist.linear = Vector3(x=float(value[0]), y=float(value[1]), z=0.0)
        full[:3, :3] = 0.0
        full[:2, :2] = covariance
    made.covariance = full.reshape(-1)
    return made


def _duration(seconds: float) -> Duration:
    nanoseconds = round(seconds * 1e9)
    return Duration(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def people_poses(result: People, frame_id: str) -> PoseArray:
    """The positions, for tools without our message types."""
    return PoseArray(
        header=header(result.stamp_ns, frame_id),
        poses=[floor_pose(person.position) for person in result.persons],
    )


def group_centroid(result: People, frame_id: str) -> PointStamped | None:
    """The largest group's centre of gravity; None if there are no people."""
    if result.group is None:
        return None
    return PointStamped(
        header=header(result.stamp_ns, frame_id), point=floor_pose(result.group.centre).position
    )


#: A cell of the short-term map: place, heights, points, which robot (its place in `scans` of the
#: people message of this stamp), which cluster, and which person (-1: none).
MAP_DTYPE = np.dtype(
    [
        ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("z_min", "<f4"), ("top", "<f4"),
        ("count", "<u4"), ("robot", "<u4"), ("cluster", "<i4"), ("person", "<i4"),
    ]
)  # fmt: skip


def short_term_map(result: People, frame_id: str) -> PointCloud2:
    """The fused cells with robot, cluster and person."""
    fused, label = result.fused, result.clusters.label
    person_of_cluster = np.full(len(result.clusters), -1)
    for index, person in enumerate(result.persons):
        if person.label >= 0:
            person_of_cluster[person.label] = index
    records = np.empty(len(fused), MAP_DTYPE)
    records["x"], records["y"] = fused.xy.T
    for name in ("z", "z_min", "top", "count"):
        records[name] = getattr(fused.cells, name)
    records["robot"], records["cluster"] = fused.robot, label
    records["person"] = person_of_cluster[label]
    return cloud(result.stamp_ns, frame_id, records)


def guide_status(
    tour: str, guidance: Guidance, poses: Mapping[str, Pose], frame_id: str
) -> GuideStatus:
    """How a tour goes on as the message on `guide_status`.

    Args:
        tour: Name of the tour.
        guidance: How it goes on.
        poses: Where the robots are.
        frame_id: The common frame.
    """
    posts = [_post(robot, post, poses.get(robot)) for robot, post in guidance.posts.items()]
    faults = [
        RobotPost(robot=robot, distance=math.nan, fault=fault)
        for robot, fault in guidance.faults.items()
        if robot not in guidance.posts
    ]
    return GuideStatus(
        header=header(guidance.stamp_ns, frame_id),
        tour=tour,
        state=int(guidance.state),
        reason=guidance.reason,
        stop=guidance.stop,
        way=guidance.way_m,
        length=guidance.length_m,
        speed=guidance.speed,
        people=list(guidance.people),
        stragglers=list(guidance.stragglers),
        lost=list(guidance.lost),
        posts=[*posts, *faults],
    )


def _post(robot: str, post: Post, pose: Pose | None) -> RobotPost:
    away = math.nan
    if pose is not None:
        away = math.hypot(post.xy[0] - pose.x, post.xy[1] - pose.y)
    return RobotPost(robot=robot, role=int(post.role), post=post_pose(post), distance=away)


def post_pose(post: Post) -> RosPose:
    """Where a robot belongs."""
    made = floor_pose(post.xy)
    x, y, z, w = quaternion_from_yaw(post.yaw)
    made.orientation = Quaternion(x=x, y=y, z=z, w=w)
    return made


def tour_goal(tour: Tour, *, attended: bool = False) -> GuideTour.Goal:
    """A tour as a goal of the action `guide_tour`; attended: it ends where its client is silent."""
    path = Path(header=Header(frame_id=tour.frame))
    path.poses = [PoseStamped(header=path.header, pose=floor_pose(xy)) for xy in tour.points]
    stops = [
        TourStop(name=stop.name, position=floor_pose(stop.xy).position, wait=_duration(stop.wait_s))
        for stop in tour.stops
    ]
    return GuideTour.Goal(
        name=tour.name, path=path, stops=stops, speed=tour.speed or 0.0, attended=attended
    )
