"""Two ways to share: the architectures that `mrs experiment` compares.

Both get the same views and poses. `send` makes what a robot sends; `plan` is everything that the
planner's machine does with it, from the message to the people.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from mrs_people_loc.cells.scanner import filter_cloud
from mrs_people_loc.config import RobotConfig, Team
from mrs_people_loc.errors import ConfigError, ScanError
from mrs_people_loc.messages import read_scan
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.timing import StageTimes
from mrs_tools.bags.message_types import default_typestore
from mrs_tools.bags.sources import RobotView

_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
_XYZ = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
_FLOAT32, _UINT32 = 7, 6  # of sensor_msgs/PointField


def cloud_message(stamp_ns: int, frame_id: str, records: np.ndarray) -> Any:
    """A structured array of shape (n,) as sensor_msgs/PointCloud2 of rosbags."""
    types = default_typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    field_type = types["sensor_msgs/msg/PointField"]
    layout: Mapping[str, Any] = records.dtype.fields or {}
    fields = [
        field_type(
            name=name, offset=offset, datatype=_UINT32 if kind.kind == "u" else _FLOAT32, count=1
        )
        for name, (kind, offset, *_) in layout.items()
    ]
    step = records.dtype.itemsize
    return types[_CLOUD_TYPE](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id),
        height=1,
        width=len(records),
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * len(records),
        data=np.frombuffer(records.tobytes(), dtype=np.uint8),
        is_dense=True,
    )


def size_on_wire(message: Any) -> int:
    """Bytes of a message in CDR."""
    return len(default_typestore().serialize_cdr(message, message.__msgtype__))


class FilterThenShare:
    """The paper's way: robots filter and quantize, the planner joins cells.

    Args:
        team: Configuration of the team.

    Attributes:
        zones: Points before the noise windows, summed over all that was sent or planned.
        noise: Points after them.
    """

    def __init__(self, team: Team) -> None:
        self._planner = Planner(team.planner)
        self.zones = self.noise = 0

    def send(self, view: RobotView) -> Any:
        """What a robot sends of a view."""
        scan = view.stages.scan
        self.zones += len(view.stages.cropped)
        self.noise += len(view.stages.foreground)
        return cloud_message(scan.stamp_ns, f"{scan.robot}/base_link", scan.cells.to_records())

    def plan(self, sent: Mapping[str, Any], poses: Mapping[str, Pose], time_ns: int) -> People:
        """The people of an interval: all that the planner's machine does.

        Args:
            sent: By robot, its message.
            poses: By robot, its pose.
            time_ns: Time of the interval [ns].
        """
        return self._planner.step(
            [read_scan(message, robot) for robot, message in sent.items()], poses, time_ns
        )


class ShareThenFilter:
    """The other way: robots send raw clouds; the planner joins, filters and quantizes them.

    Args:
        team: Configuration of the team; the stages' constants are the same for all robots.
        scaled: The noise threshold is multiplied by the number of robots that sent.

    Attributes:
        zones, noise: As in `FilterThenShare`.

    Raises:
        ConfigError: The constants differ between robots.
    """

    def __init__(self, team: Team, *, scaled: bool = False) -> None:
        self._planner = Planner(team.planner)
        self._config = one_config(team)
        self._scaled = scaled
        self.zones = self.noise = 0

    def send(self, view: RobotView) -> Any:
        """What a robot sends of a view."""
        cloud = view.stages.cloud
        records = np.empty(len(cloud), _XYZ)
        for axis, name in enumerate("xyz"):
            records[name] = cloud[:, axis]
        stamp_ns = view.stages.scan.stamp_ns
        return cloud_message(stamp_ns, f"{view.robot}/base_link", records)

    def plan(self, sent: Mapping[str, Any], poses: Mapping[str, Pose], time_ns: int) -> People:
        """As in `FilterThenShare`; everything in the common frame, as if from one robot."""
        config = self._config
        if self._scaled:
            noise = config.noise
            scaled = dataclasses.replace(noise, min_points=len(sent) * noise.min_points)
            config = dataclasses.replace(config, noise=scaled)
        clouds = [read_cloud(message) for message in sent.values()]
        cloud = join(clouds, [poses[robot] for robot in sent])
        zones, points, cells = filter_cloud(cloud, config, StageTimes())
        self.zones += len(zones)
        self.noise += len(points)
        origin = Pose(time_ns, 0.0, 0.0, 0.0, np.zeros((3, 3)))
        return self._planner.step([Scan("all", time_ns, cells)], {"all": origin}, time_ns)


def one_config(team: Team) -> RobotConfig:
    """The configuration whose stages all robots of a team share.

    Raises:
        ConfigError: They differ in zones, noise or quantization.
    """
    first, *others = team.robots.values()
    for other in others:
        for section in ("zones", "noise", "quantization"):
            if getattr(first, section) != getattr(other, section):
                raise ConfigError(f"{section} differs between robots; wanted: the same for all")
    return first


def read_cloud(message: Any) -> np.ndarray:
    """Points of a raw cloud [m], float32, shape (n, 3).

    Raises:
        ScanError: A value is not finite.
    """
    points = np.frombuffer(message.data, dtype="<f4").reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ScanError(f"{message.header.frame_id}: a point is NaN or infinite")
    return points


def join(clouds: Sequence[np.ndarray], poses: Sequence[Pose]) -> np.ndarray:
    """Clouds in the common frame, one after the other, float32, shape (n, 3).

    Args:
        clouds: In each robot's base_link [m], shape (n, 3).
        poses: Of the robots.
    """
    axes = np.empty((3, sum(map(len, clouds))), dtype=np.float32)
    begin = 0
    for cloud, pose in zip(clouds, poses, strict=True):
        part = axes[:, begin : begin + len(cloud)]
        part[:2] = map_from_robot(cloud[:, :2].astype(np.float64), pose).T
        part[2] = cloud[:, 2]
        begin += len(cloud)
    return axes.T


#: Ways to share, by their name in the report.
WAYS: Mapping[str, Callable[[Team], Any]] = {
    "filter_then_share": FilterThenShare,
    "share_then_filter": ShareThenFilter,
    "share_then_filter_scaled": partial(ShareThenFilter, scaled=True),
}
