"""The state of a team for the page, from the messages of ROS or of a bag as they come."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mrs_people_loc import messages
from mrs_people_loc.arrays import Float
from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.errors import PoseError
from mrs_people_loc.geometry import yaw_from_quaternion
from mrs_people_loc.guiding.guidance import Role
from mrs_people_loc.guiding.guidance import State as TourState
from mrs_people_loc.people import Group, Person
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.team.poses import Pose
from mrs_tools.plain import plain
from mrs_tools.view import protocol
from mrs_tools.view.protocol import rounded

#: A robot without a pose for so long is silent [s].
SILENT_S = 2.0
#: A tour that has ended is shown for so long [s].
_ENDED_S = 60.0
_ENDED = (TourState.FINISHED, TourState.CANCELLED)


@dataclass(frozen=True)
class HeadView:
    """What a head sees, seen from above.

    Attributes:
        reach: How far [m].
        view: Horizontal field of view [rad].
        yaw: Direction of its middle in the robot's frame [rad].
    """

    reach: float
    view: float
    yaw: float

    @classmethod
    def of(cls, camera: CameraModel, reach: float, mounting_yaw: float) -> HeadView:
        """The view of a rectified camera.

        Args:
            camera: The left one.
            reach: How far it sees [m].
            mounting_yaw: Its heading in the robot's frame [rad].
        """
        focal, centre = float(camera.p[0, 0]), float(camera.p[0, 2])
        left, right = math.atan2(centre, focal), math.atan2(camera.width - centre, focal)
        return cls(reach, left + right, mounting_yaw + 0.5 * (left - right))


@dataclass
class TeamState:
    """What is known of a team.

    Ages are those since something came, not those of stamps: `now_s` may be of any clock [s].

    Attributes:
        heads: By robot, where it is known.
        notes: By robot that is not well: why, in words.
        poses: By robot, the last one in the common frame.
    """

    heads: dict[str, HeadView] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    poses: dict[str, Pose] = field(default_factory=dict)
    _stamp_ns: int = 0
    _people_s: float = 0.0
    _poses_s: dict[str, float] = field(default_factory=dict)
    _frame: str = ""
    _people: list[protocol.Person] = field(default_factory=list)
    _groups: list[protocol.Group] = field(default_factory=list)
    _seen_ns: dict[int, int] = field(default_factory=dict)
    _tour: protocol.Tour | None = None
    _tour_s: float = 0.0

    def take_people(self, message: Any, now_s: float) -> None:
        """Takes a mrs_people_msgs/People that comes now.

        Raises:
            PeopleLocError: A value cannot be used; nothing of the message is taken.
        """
        frame = message.header.frame_id.lstrip("/")
        persons, groups = messages.read_people(message, frame)
        poses = messages.read_people_scans(message)
        self.show(messages.read_stamp(message), persons, groups, poses, now_s)
        self._frame = frame

    def show(
        self,
        stamp_ns: int,
        persons: Sequence[Person],
        groups: Sequence[Group],
        poses: Mapping[str, Pose],
        now_s: float,
    ) -> None:
        """Takes the people of an interval, and where its robots were.

        Args:
            stamp_ns: Stamp of the interval [ns].
            persons: Everybody, also who is hidden.
            groups: Their groups.
            poses: By robot, its pose in the common frame.
            now_s: When they come [s].
        """
        if stamp_ns < self._stamp_ns - RESET_NS:
            self.reset()
        self._stamp_ns, self._people_s = stamp_ns, now_s
        for robot, pose in poses.items():
            self._take(plain(robot), pose, now_s)
        for person in persons:
            if not person.coasting:
                self._seen_ns[person.id] = stamp_ns
            elif person.seen_at is not None:
                self._seen_ns[person.id] = person.stamp_ns
        ids = {person.id for person in persons}
        self._seen_ns = {one: ns for one, ns in self._seen_ns.items() if one in ids}
        self._people = [self._person(person, groups) for person in persons]
        self._groups = [_group(group) for group in groups]

    def take_pose(self, robot: str, message: Any, now_s: float) -> None:
        """Takes a PoseWithCovarianceStamped in the common frame that comes now.

        Raises:
            PeopleLocError: It cannot be used, or is in another frame than the people.
        """
        frame = message.header.frame_id.lstrip("/")
        if self._frame and frame != self._frame:
            raise PoseError(f"frame_id is {frame!r}; wanted: {self._frame!r}")
        self._take(robot, messages.read_pose(message), now_s)

    def take_status(self, message: Any, now_s: float) -> None:
        """Takes a mrs_people_msgs/GuideStatus that comes now."""
        self._tour, self._tour_s = _tour(message), now_s

    def forget_robot(self, robot: str) -> None:
        """Forgets a robot that has left."""
        self.heads.pop(robot, None)
        self.poses.pop(robot, None)
        self._poses_s.pop(robot, None)

    def reset(self) -> None:
        """Forgets people and poses: the time jumped back."""
        self._stamp_ns, self._people, self._groups = 0, [], []
        self._seen_ns.clear()
        self.poses.clear()

    def state(self, now_s: float) -> protocol.State:
        """The state now."""
        t = round(self._stamp_ns / 1e9, 3) if self._stamp_ns else None
        return protocol.State(
            type="state",
            t=t,
            age=None if t is None else rounded(now_s - self._people_s),
            people=self._people,
            groups=self._groups,
            robots=[self._robot(name, now_s) for name in sorted(self.poses)],
            tour=self._shown_tour(now_s),
        )

    def _take(self, robot: str, pose: Pose, now_s: float) -> None:
        before = self.poses.get(robot)
        if before is None or not -RESET_NS < pose.stamp_ns - before.stamp_ns <= 0:
            self.poses[robot], self._poses_s[robot] = pose, now_s

    def _person(self, person: Person, groups: Sequence[Group]) -> protocol.Person:
        vx, vy = (math.nan, math.nan) if person.velocity is None else person.velocity
        own = next((g for g in groups if _is_in(person.id, g)), None)
        away_s = own.stragglers.get(person.id) if own else None
        seen_ns = self._seen_ns.get(person.id)
        return protocol.Person(
            id=person.id,
            x=round(float(person.position[0]), 3),
            y=round(float(person.position[1]), 3),
            vx=rounded(vx),
            vy=rounded(vy),
            cov=_planar(person.covariance),
            height=rounded(person.height),
            age=round(person.age_s, 1),
            seen_s=None if seen_ns is None else round((self._stamp_ns - seen_ns) / 1e9, 2),
            predicted=person.coasting,
            seen_at=None if person.seen_at is None else person.seen_at.round(3).tolist(),
            group=own.id if own else None,
            straggler=away_s is not None,
            straggling_s=None if away_s is None else round(away_s, 1),
        )

    def _robot(self, name: str, now_s: float) -> protocol.Robot:
        pose, head = self.poses[name], self.heads.get(name)
        age = round(now_s - self._poses_s[name], 3)
        note = "sends no pose" if age > SILENT_S else self.notes.get(name, "")
        return protocol.Robot(
            name=name,
            x=round(pose.x, 3),
            y=round(pose.y, 3),
            yaw=round(pose.yaw, 3),
            cov=_planar(pose.covariance),
            yaw_sigma=rounded(math.sqrt(max(0.0, pose.covariance[2, 2]))),
            reach=rounded(head.reach) if head else None,
            view=rounded(head.view) if head else None,
            view_yaw=rounded(head.yaw) if head else None,
            age=age,
            ok=not note,
            note=note,
        )

    def _shown_tour(self, now_s: float) -> protocol.Tour | None:
        tour, age = self._tour, now_s - self._tour_s
        if tour is None or (age > _ENDED_S and tour["state"] in map(_name, _ENDED)):
            return None
        return {**tour, "age": round(age, 1)}


def _is_in(person: int, group: Group) -> bool:
    return bool(person) and (person in group.members or person in group.stragglers)


def _group(group: Group) -> protocol.Group:
    return protocol.Group(
        id=group.id,
        x=round(float(group.centre[0]), 3),
        y=round(float(group.centre[1]), 3),
        members=list(group.members),
        stragglers=list(group.stragglers),
    )


def _planar(covariance: Float) -> list[float | None]:
    entries = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    return [rounded(float(value), 5) for value in entries]


def _name(state: TourState | Role) -> str:
    return state.name.lower()


def _tour(message: Any) -> protocol.Tour:
    """A mrs_people_msgs/GuideStatus."""
    known_state = message.state in list(TourState)
    way, length = (
        value if math.isfinite(value) else 0.0 for value in (message.way, message.length)
    )
    posts = [post for post in map(_post, message.posts) if post is not None]
    return protocol.Tour(
        name=plain(message.tour),
        state=_name(TourState(message.state)) if known_state else "idle",
        leader=next((post["robot"] for post in posts if post["role"] == "leader"), ""),
        progress=round(min(1.0, max(0.0, way / length)), 4) if length > 0.0 else 0.0,
        way=round(float(way), 2),
        length=round(float(length), 2),
        stop=plain(message.stop),
        posts=posts,
        message=plain(message.reason),
        lost=[int(one) for one in message.lost],
        age=0.0,
    )


def _post(message: Any) -> protocol.Post | None:
    """A mrs_people_msgs/RobotPost; None where the robot takes no part, or it holds no place."""
    at, q = message.post.position, message.post.orientation
    values = (at.x, at.y, q.x, q.y, q.z, q.w)
    if message.fault or message.role not in list(Role) or not all(map(math.isfinite, values)):
        return None
    return protocol.Post(
        robot=plain(message.robot),
        x=round(at.x, 3),
        y=round(at.y, 3),
        yaw=round(yaw_from_quaternion(q.x, q.y, q.z, q.w), 3),
        role=_name(Role(message.role)),
    )
