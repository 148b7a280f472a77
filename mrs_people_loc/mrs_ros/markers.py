"""What RViz draws: people, their velocities and trails, groups, robots; walls."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Quaternion, Vector3
from geometry_msgs.msg import Pose as RosPose
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mrs_people_loc.geometry import quaternion_from_yaw
from mrs_people_loc.guiding.guidance import Guidance, State
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.people import Person
from mrs_people_loc.planner import People
from mrs_people_loc.team.poses import Pose
from mrs_ros.convert import floor_pose, header, pose_with_covariance, post_pose

if TYPE_CHECKING:
    from mrs_people_loc.guiding.tour import Tour  # which loads OpenCV

#: Of people without a group, and by id of those with one; they differ for people who see few
#: colours, too, and are those of the page (`mrs view`) in the dark.
_PERSON = (0.66, 0.71, 0.76)
_GROUPS = (
    (0.0, 0.45, 0.7),
    (0.61, 0.42, 1.0),
    (0.9, 0.62, 0.0),
    (0.2, 0.73, 0.93),
    (0.54, 0.43, 0.12),
    (0.78, 0.94, 0.85),
)
#: Opacity of people who are seen, and of those who are predicted.
_SEEN, _COASTING = 0.5, 0.25
_TEXT = ColorRGBA(r=1.0, g=1.0, b=1.0, a=0.9)
_ROBOT = ColorRGBA(r=0.2, g=0.4, b=0.9, a=0.9)
_ELLIPSE = ColorRGBA(r=0.2, g=0.4, b=0.9, a=0.3)
_WAY = ColorRGBA(r=0.6, g=0.3, b=0.8, a=0.6)
_POST = ColorRGBA(r=0.9, g=0.7, b=0.1, a=0.9)
_WALL = ColorRGBA(r=0.8, g=0.3, b=0.2, a=0.9)
#: Walls of a robot that says no more are drawn for so long [s].
_WALLS_FOR_S = 5
#: A way is drawn by points that are so far apart [m].
_WAY_STEP_M = 0.25
#: No half axis is drawn shorter, for a sigma [m].
_LEAST_AXIS_M = 1e-3
#: Diameters of an arrow's shaft and head, and the head's length [m].
_ARROW = {"x": 0.04, "y": 0.12, "z": 0.15}

#: Places of a trail by id [m], the oldest first.
Places = Mapping[int, Sequence[tuple[float, float]]]


class Trails:
    """Where tracked people were in the last seconds."""

    #: For how long places are kept, and the time between two of them, at least [ns].
    SPAN_NS, STEP_NS = 10_000_000_000, 250_000_000

    def __init__(self) -> None:
        self._trails: dict[int, deque[tuple[int, float, float]]] = {}

    def add(self, result: People) -> None:
        """Takes an interval."""
        now_ns = result.stamp_ns
        for person in result.everybody:
            if person.id:
                trail = self._trails.setdefault(person.id, deque())
                if len(trail) > 1 and trail[-1][0] - trail[-2][0] < self.STEP_NS:
                    trail.pop()
                trail.append((now_ns, float(person.position[0]), float(person.position[1])))
        for track_id, trail in list(self._trails.items()):
            while trail and now_ns - trail[0][0] > self.SPAN_NS:
                trail.popleft()
            if not trail:
                del self._trails[track_id]

    def places(self) -> Places:
        """The trails by id."""
        return {track_id: [(x, y) for _, x, y in way] for track_id, way in self._trails.items()}


def markers(
    result: People, frame_id: str, circle_sigmas: float, trails: Places | None = None
) -> MarkerArray:
    """The markers of an interval, which replace those before.

    Args:
        result: The interval.
        frame_id: The common frame.
        circle_sigmas: Radius of a person's circle, and half axes of a robot's ellipse, in sigmas of
            their positions.
        trails: Trails to draw.
    """
    made = _Markers(result.stamp_ns, frame_id)
    away_s = {member: s for group in result.groups for member, s in group.stragglers.items()}
    colors = {
        member: _GROUPS[group.id % len(_GROUPS)]
        for group in result.groups
        for member in (*group.members, *group.stragglers)
        if member and group.id
    }
    for index, person in enumerate(result.everybody):
        label = f"{person.id or index + 1}: {person.height:.2f} m"
        if person.id in away_s:
            label += f", {away_s[person.id]:.0f} s behind"
        color = _color(colors.get(person.id, _PERSON), _COASTING if person.coasting else _SEEN)
        made.add_person(person, label, circle_sigmas, (trails or {}).get(person.id, ()), color)
    for group in result.groups:
        size = {"x": 0.2, "y": 0.2, "z": 0.2}
        color = _color(_GROUPS[group.id % len(_GROUPS)] if group.id else _PERSON, 0.9)
        made.add("centre", Marker.SPHERE, floor_pose(group.centre), size, color)
    for robot, robot_pose in result.poses.items():
        pose = pose_with_covariance(robot_pose).pose
        made.add("robots", Marker.ARROW, pose, {"x": 0.5, "y": 0.08, "z": 0.08}, _ROBOT)
        made.add("robot names", Marker.TEXT_VIEW_FACING, pose, {"z": 0.2}, _TEXT).text = robot
        made.add_ellipse("robot ellipses", robot_pose, circle_sigmas, _ELLIPSE)
    return MarkerArray(markers=made.all)


def wall_markers(stamp_ns: int, frame_id: str, robot: str, walls: Walls) -> MarkerArray:
    """The walls that a robot uses, as lines; they replace those of this robot before.

    Args:
        stamp_ns: Stamp [ns].
        frame_id: The common frame, which the walls are in.
        robot: The robot's name, the namespace of its markers.
        walls: The walls.
    """
    normal = np.stack([np.cos(walls.bearing), np.sin(walls.bearing)], axis=1)
    along = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    feet = walls.distance[:, None] * normal
    ends = feet[:, None] + walls.extent[:, :, None] * along[:, None]
    drawn = Marker(header=header(stamp_ns, frame_id), ns=robot, id=0, type=Marker.LINE_LIST)
    drawn.action = Marker.ADD if len(walls) else Marker.DELETE
    drawn.pose.orientation.w = 1.0
    drawn.scale = Vector3(x=0.05)
    drawn.color = _WALL
    drawn.points = [_point(x, y) for x, y in ends.reshape(-1, 2)]
    drawn.lifetime = Duration(sec=_WALLS_FOR_S)
    return MarkerArray(markers=[drawn])


def tour_markers(tour: Tour, guidance: Guidance, frame_id: str) -> MarkerArray:
    """The way and the stops of a tour, and the robots' posts, which replace those before.

    Args:
        tour: The tour.
        guidance: How it goes on.
        frame_id: The common frame.
    """
    made = _Markers(guidance.stamp_ns, frame_id)
    if guidance.state in (State.FINISHED, State.CANCELLED):
        return MarkerArray(markers=made.all)
    way = made.add("way", Marker.LINE_STRIP, RosPose(), {"x": 0.04}, _WAY)
    along = np.linspace(0.0, tour.way.length, max(2, round(tour.way.length / _WAY_STEP_M)))
    way.points = [_point(x, y) for x, y in tour.way.at(along)]
    for stop in tour.stops:
        place = floor_pose(stop.xy)
        made.add("stops", Marker.CYLINDER, place, {"x": 0.3, "y": 0.3, "z": 0.02}, _WAY)
        made.add("stop names", Marker.TEXT_VIEW_FACING, place, {"z": 0.25}, _TEXT).text = stop.name
    for robot, post in guidance.posts.items():
        pose = post_pose(post)
        made.add("posts", Marker.ARROW, pose, {"x": 0.5, "y": 0.05, "z": 0.05}, _POST)
        label = f"{robot}: {post.role.name.lower()}"
        made.add("roles", Marker.TEXT_VIEW_FACING, pose, {"z": 0.15}, _TEXT).text = label
    return MarkerArray(markers=made.all)


class _Markers:
    """Markers of one stamp and frame; the first one removes those before.

    Attributes:
        all: The markers.
    """

    def __init__(self, stamp_ns: int, frame_id: str) -> None:
        self._header = header(stamp_ns, frame_id)
        self.all = [Marker(header=self._header, action=Marker.DELETEALL)]

    def add(
        self, namespace: str, kind: int, pose: RosPose, scale: Mapping[str, float], color: Any
    ) -> Any:
        marker = Marker(
            header=self._header,
            ns=namespace,
            id=len(self.all),
            type=kind,
            action=Marker.ADD,
            pose=pose,
            color=color,
        )
        marker.scale = Vector3(**scale)
        self.all.append(marker)
        return marker

    def add_ellipse(self, namespace: str, pose: Pose, sigmas: float, color: Any) -> None:
        """The ellipse of so many sigmas of a pose's place; none where it is exact."""
        variances, axes = np.linalg.eigh(pose.covariance[:2, :2])
        if variances[1] <= 0.0:
            return
        yaw = math.atan2(axes[1, 1], axes[0, 1])  # of the longer one
        x, y, z, w = quaternion_from_yaw(yaw)
        place = floor_pose(np.array([pose.x, pose.y]))
        place.orientation = Quaternion(x=x, y=y, z=z, w=w)
        minor, major = 2.0 * sigmas * np.sqrt(np.clip(variances, _LEAST_AXIS_M**2, None))
        size = {"x": float(major), "y": float(minor), "z": 0.01}
        self.add(namespace, Marker.CYLINDER, place, size, color)

    def add_person(
        self,
        person: Person,
        label: str,
        circle_sigmas: float,
        trail: Sequence[tuple[float, float]],
        color: ColorRGBA,
    ) -> None:
        """A circle, a label, an arrow to where they will be in a second, and their trail."""
        size = 2.0 * circle_sigmas * person.sigma
        circle = {"x": size, "y": size, "z": 0.02}
        self.add("people", Marker.CYLINDER, floor_pose(person.position), circle, color)
        above = floor_pose(person.position)
        above.position.z = person.height + 0.2
        self.add("heights", Marker.TEXT_VIEW_FACING, above, {"z": 0.2}, _TEXT).text = label
        if person.velocity is not None:
            arrow = self.add("velocities", Marker.ARROW, RosPose(), _ARROW, color)
            ends = np.array([person.position, person.position + person.velocity])
            arrow.points = [_point(x, y) for x, y in ends]
        if len(trail) > 1:
            line = self.add("trails", Marker.LINE_STRIP, RosPose(), {"x": 0.03}, color)
            line.points = [_point(x, y) for x, y in trail]


def _color(rgb: tuple[float, float, float], opacity: float) -> ColorRGBA:
    return ColorRGBA(r=rgb[0], g=rgb[1], b=rgb[2], a=opacity)


def _point(x: float, y: float) -> Point:
    return Point(x=float(x), y=float(y), z=0.05)
