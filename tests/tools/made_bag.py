"""Bags made by hand, message by message."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mrs_people_loc.scan import CELL_DTYPE
from mrs_tools.bags.message_types import default_typestore
from mrs_tools.bags.writer import BagWriter

START_NS = 1_700_000_000_000_000_000
MS = 1_000_000


class Bag:
    """Writes messages; times are milliseconds after `START_NS`."""

    def __init__(self, writer: BagWriter) -> None:
        self.writer = writer
        self.types = default_typestore().types

    def make(self, msgtype: str, /, **fields: Any) -> Any:
        return self.types[msgtype](**fields)

    def header(self, ms: float, frame: str) -> Any:
        sec, nanosec = divmod(START_NS + round(ms * MS), 1_000_000_000)
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def write(self, topic: str, ms: float, message: Any) -> None:
        self.writer.write(topic, START_NS + round(ms * MS), message)

    def pose(self, x: float, y: float, yaw: float = 0.0) -> Any:
        quaternion = {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0),
            orientation=self.make("geometry_msgs/msg/Quaternion", **quaternion),
        )

    def uncertain(self, x: float, y: float, yaw: float = 0.0, variance: float = 0.01) -> Any:
        return self.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=self.pose(x, y, yaw),
            covariance=(np.eye(6) * variance).reshape(-1),
        )

    def truth(self, ms: float, *people: tuple[float, float], visible: Any = None) -> None:
        poses = [self.pose(*xy) for xy in people]
        header = self.header(ms, "map")
        array = self.make("geometry_msgs/msg/PoseArray", header=header, poses=poses)
        self.write("/ground_truth/people_poses", ms, array)
        if visible is not None:
            self.visible(ms, visible)

    def visible(self, ms: float, numbers: Iterable[int], kind: str = "Int32") -> None:
        self._numbers("/ground_truth/visible", ms, numbers, kind)

    def percent(self, ms: float, numbers: Iterable[int]) -> None:
        self._numbers("/ground_truth/visible_percent", ms, numbers, "Int32")

    def group(self, ms: float, numbers: Iterable[int]) -> None:
        self._numbers("/ground_truth/group", ms, numbers, "Int32")

    def _numbers(self, topic: str, ms: float, numbers: Iterable[int], kind: str) -> None:
        layout = self.make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        dtype = np.dtype(kind.lower())
        message = self.make(
            f"std_msgs/msg/{kind}MultiArray", layout=layout, data=np.array([*numbers], dtype)
        )
        self.write(topic, ms, message)

    def room(self, ms: float, length: float, width: float, frame: str = "map") -> None:
        """A map of a room around the origin, walls of 0.1 m around it."""
        data = np.zeros((round(width * 10) + 2, round(length * 10) + 2), np.int8)
        data[[0, -1]] = 100
        data[:, [0, -1]] = 100
        header = self.header(ms, frame)
        info = self.make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=header.stamp,
            resolution=0.1,
            width=data.shape[1],
            height=data.shape[0],
            origin=self.pose(-length / 2 - 0.1, -width / 2 - 0.1),
        )
        grid = self.make(
            "nav_msgs/msg/OccupancyGrid", header=header, info=info, data=data.reshape(-1)
        )
        self.write("/map", ms, grid)

    def twist(self, x: float, y: float) -> Any:
        return self.make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=self.make(
                "geometry_msgs/msg/Twist",
                linear=self.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=0.0),
                angular=self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0),
            ),
            covariance=np.zeros(36),
        )

    def people(
        self,
        ms: float,
        *people: tuple[float, float],
        centre: Any = None,
        ids: Sequence[int] | None = None,
        velocities: Sequence[tuple[float, float]] | None = None,
        coasting: Sequence[int] = (),
        hidden: Sequence[int] = (),
        stragglers: Sequence[int] = (),
        topic: str = "/tracked_people",
    ) -> None:
        """People; `coasting` and `hidden` name ids, `stragglers` those of each group."""
        numbers = ids or [0] * len(people)
        twists = [self.twist(*v) for v in velocities or [(math.nan, math.nan)] * len(people)]
        persons = [
            self.make(
                "mrs_people_msgs/msg/Person",
                id=number,
                pose=self.uncertain(*xy),
                velocity=twist,
                height=1.7,
                sigma=0.1,
                robots=["robot_a"],
                age=self.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
                coasting=number in coasting or number in hidden,
            )
            for number, xy, twist in zip(numbers, people, twists, strict=True)
        ]
        duration = self.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
        groups = [
            self.make(
                "mrs_people_msgs/msg/Group",
                id=0,
                size=size,
                centre=self.uncertain(*xy),
                velocity=self.twist(math.nan, math.nan),
                radius=1.0,
                rms_spread=1.0,
                members=np.zeros(0, np.uint32),
                stragglers=np.array(stragglers, np.uint32),
                straggling_for=[duration for _ in stragglers],
            )
            for size, xy in (centre or {}).items()
        ]
        header = self.header(ms, "map")
        unseen = [
            self.make(
                "mrs_people_msgs/msg/HiddenPerson",
                person=person,
                last_seen=header.stamp,
                last_seen_at=person.pose.pose.position,
            )
            for person in persons
            if person.id in hidden
        ]
        self.write(
            topic,
            ms,
            self.make(
                "mrs_people_msgs/msg/People",
                header=header,
                scans=[],
                persons=[person for person in persons if person.id not in hidden],
                hidden=unseen,
                groups=groups,
                quarantined=[],
            ),
        )

    def true_pose(self, robot: str, ms: float, x: float, y: float, yaw: float = 0.0) -> None:
        header = self.header(ms, "map")
        message = self.make(
            "geometry_msgs/msg/PoseStamped", header=header, pose=self.pose(x, y, yaw)
        )
        self.write(f"/ground_truth/{robot}/pose", ms, message)

    def guide_status(
        self, ms: float, state: int, *, way: float = 0.0, lost: Sequence[int] = (),
        posts: Mapping[str, tuple[float, float]] | None = None, faults: Sequence[str] = (),
    ) -> None:  # fmt: skip
        """Posts of robots by name, and names of robots that take no part."""
        kind = "mrs_people_msgs/msg/RobotPost"
        every = [
            *(self.make(kind, robot=name, role=1, post=self.pose(*xy), distance=0.0, fault="")
              for name, xy in (posts or {}).items()),
            *(self.make(kind, robot=name, role=0, post=self.pose(math.nan, math.nan),
                        distance=math.nan, fault="no pose") for name in faults),
        ]  # fmt: skip
        message = self.make(
            "mrs_people_msgs/msg/GuideStatus",
            header=self.header(ms, "map"),
            tour="hall",
            state=state,
            reason="",
            stop="",
            way=way,
            length=10.0,
            speed=0.5,
            people=np.zeros(0, np.uint32),
            stragglers=np.zeros(0, np.uint32),
            lost=np.array(lost, np.uint32),
            posts=every,
        )
        self.write("/guide_status", ms, message)

    def pose_topic(
        self, robot: str, ms: float, x: float, y: float, yaw: float = 0.0, *, name: str = "pose",
        frame: str = "map",
    ) -> None:  # fmt: skip
        message = self.make(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header=self.header(ms, frame),
            pose=self.uncertain(x, y, yaw, 1e-4),
        )
        self.write(f"/{robot}/{name}", ms, message)

    def points(self, robot: str, ms: float, *bodies: tuple[float, float], at: Any = None) -> None:
        """A scan in which each body is 4 x 4 cells with 20 points each, 1.7 m high."""
        steps = (np.arange(4) - 1.5) * 0.1
        x, y = (axis.reshape(-1) for axis in np.meshgrid(steps, steps))
        cells = np.zeros(16 * len(bodies), CELL_DTYPE)
        for index, body in enumerate(bodies):
            mine = cells[16 * index : 16 * (index + 1)]
            mine["x"], mine["y"] = body[0] + x, body[1] + y
            mine["z"], mine["z_min"], mine["top"], mine["count"] = 1.4, 0.2, 1.7, 20
        field = "sensor_msgs/msg/PointField"
        message = self.make(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(ms, f"{robot}/base_link"),
            height=1,
            width=len(cells),
            fields=[
                self.make(field, name=n, offset=4 * i, datatype=6 if n == "count" else 7, count=1)
                for i, n in enumerate(CELL_DTYPE.names or ())
            ],
            is_bigendian=False,
            point_step=24,
            row_step=24 * len(cells),
            data=np.frombuffer(cells.tobytes(), np.uint8),
            is_dense=True,
        )
        self.write(f"/{robot}/points", ms if at is None else at, message)
