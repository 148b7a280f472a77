"""What RViz draws of an interval: people, their velocities and trails, groups and robots."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Vector3
from geometry_msgs.msg import Pose as RosPose
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mrs_people_loc.people import Person
from mrs_people_loc.planner import People
from mrs_ros.convert import floor_pose, header, pose_with_covariance

_PERSON = ColorRGBA(r=0.1, g=0.6, b=0.2, a=0.5)
_COASTING = ColorRGBA(r=0.6, g=0.85, b=0.65, a=0.35)
_TEXT = ColorRGBA(r=1.0, g=1.0, b=1.0, a=0.9)
_CENTRE = ColorRGBA(r=0.9, g=0.5, b=0.1, a=0.9)
_ROBOT = ColorRGBA(r=0.2, g=0.4, b=0.9, a=0.9)
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
        for person in result.persons:
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
        circle_sigmas: Radius of a person's circle, in sigmas of their position.
        trails: Trails to draw.
    """
    made = _Markers(result.stamp_ns, frame_id)
    away_s = {member: s for group in result.groups for member, s in group.stragglers.items()}
    for index, person in enumerate(result.persons):
        label = f"{person.id or index + 1}: {person.height:.2f} m"
        if person.id in away_s:
            label += f", {away_s[person.id]:.0f} s behind"
        made.add_person(person, label, circle_sigmas, (trails or {}).get(person.id, ()))
    for group in result.groups:
        size = {"x": 0.2, "y": 0.2, "z": 0.2}
        made.add("centre", Marker.SPHERE, floor_pose(group.centre), size, _CENTRE)
    for robot, robot_pose in result.poses.items():
        pose = pose_with_covariance(robot_pose).pose
        made.add("robots", Marker.ARROW, pose, {"x": 0.5, "y": 0.08, "z": 0.08}, _ROBOT)
        made.add("robot names", Marker.TEXT_VIEW_FACING, pose, {"z": 0.2}, _TEXT).text = robot
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

    def add_person(
        self,
        person: Person,
        label: str,
        circle_sigmas: float,
        trail: Sequence[tuple[float, float]],
    ) -> None:
        """A circle, a label, an arrow to where they will be in a second, and their trail."""
        size, color = 2.0 * circle_sigmas * person.sigma, _COASTING if person.coasting else _PERSON
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


def _point(x: float, y: float) -> Point:
    return Point(x=float(x), y=float(y), z=0.05)
