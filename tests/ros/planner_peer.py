"""The planner_node under test, and robots that the test plays: scans and poses as they please."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from mrs_people_msgs.msg import People
from sensor_msgs.msg import PointCloud2, PointField

from ros.harness import Finding, NodeProcess, Peer
from ros.recording import set_stamp, stamp_of

#: The contract of `points`, spelled out here once more.
CELL = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("z_min", "<f4"), ("top", "<f4"), ("count", "<u4")]
)
#: Of a planner: however busy the machine, robots are waited for; stamps are the test's own.
PATIENT = {
    "interval.max_wait": "5.0",
    "interval.robot_timeout": "60.0",
    "interval.max_clock_offset": "5.0",
}
_DATATYPES = {"<f4": 7, "<f8": 8, "<u4": 6, "<i4": 5, "<u2": 4}


def person_cells(x: float, y: float, *, top: float = 1.7) -> np.ndarray:
    """Cells of somebody at (x, y) [m]: 7 x 5 of them, 5 cm apart, centred there."""
    cells = np.zeros(35, CELL)
    i, j = np.meshgrid(np.arange(-3, 4), np.arange(-2, 3))
    cells["x"], cells["y"] = x + 0.05 * i.reshape(-1), y + 0.05 * j.reshape(-1)
    cells["z"], cells["z_min"], cells["top"], cells["count"] = 1.3, 0.3, top, 20
    return cells


def cloud_of(records: np.ndarray, frame_id: str, stamp_ns: int) -> PointCloud2:
    """Records as a cloud, one row."""
    dtype = records.dtype
    message = PointCloud2(
        height=1,
        width=len(records),
        fields=[
            PointField(name=name, offset=offset, datatype=_DATATYPES[kind.str], count=1)
            for name, (kind, offset, *_) in (dtype.fields or {}).items()
        ],
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * len(records),
        is_dense=True,
        data=records.tobytes(),
    )
    message.header.frame_id = frame_id
    set_stamp(message, stamp_ns)
    return message


def pose_of(
    stamp_ns: int, x: float, y: float, yaw: float, frame_id: str = "map"
) -> PoseWithCovarianceStamped:
    """A pose without uncertainty."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame_id
    set_stamp(message, stamp_ns)
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    q = message.pose.pose.orientation
    q.z, q.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
    return message


class PlayedRobot:
    """A robot that the test plays; it stands at (x, y, yaw).

    Args:
        peer: A node on the domain.
        name: The robot's full name: its namespace without the leading slash.
        place: x, y [m] and yaw [rad] on the map.
    """

    def __init__(self, peer: Peer, name: str, place: tuple[float, float, float]) -> None:
        self.peer = peer
        self.name = name
        self.frame_id = f"{name}/base_link"
        self.place = place

    def announce(self) -> None:
        """Makes the publishers."""
        self.peer.publisher(PointCloud2, f"/{self.name}/points")
        self.peer.publisher(PoseWithCovarianceStamped, f"/{self.name}/pose")

    def seen_from_here(self, x: float, y: float) -> tuple[float, float]:
        """A place on the map as this robot sees it."""
        px, py, yaw = self.place
        dx, dy = x - px, y - py
        c, s = math.cos(yaw), math.sin(yaw)
        return c * dx + s * dy, c * dy - s * dx

    def scan(self, stamp_ns: int, *people: tuple[float, float], top: float = 1.7) -> PointCloud2:
        """A scan of people at places on the map."""
        parts = [person_cells(*self.seen_from_here(x, y), top=top) for x, y in people]
        return cloud_of(np.concatenate([np.empty(0, CELL), *parts]), self.frame_id, stamp_ns)

    def send_points(self, message: Any) -> None:
        """Sends something on `points`."""
        self.peer.send(f"/{self.name}/points", message)

    def send_pose(self, message: Any) -> None:
        """Sends something on `pose`."""
        self.peer.send(f"/{self.name}/pose", message)

    def send(self, stamp_ns: int, *people: tuple[float, float]) -> None:
        """Sends a pose at a stamp, and a scan of it."""
        self.send_pose(pose_of(stamp_ns, *self.place))
        self.send_points(self.scan(stamp_ns, *people))


class PlannerPeer:
    """Hears a planner_node.

    Args:
        peer: A node on its domain.
        process: The planner_node.
        namespace: Its namespace, with a slash at both ends.
    """

    def __init__(self, peer: Peer, process: NodeProcess, namespace: str = "/") -> None:
        self.peer = peer
        self.process = process
        self.node = process.name
        self.people = peer.hear(People, f"{namespace}tracked_people")
        self.people_poses = peer.hear(PoseArray, f"{namespace}people_poses")
        self._last_ns = 0

    def now(self) -> int:
        """A stamp that is newer than all before [ns]."""
        self._last_ns = max(time.time_ns(), self._last_ns + 20_000_000)
        return self._last_ns

    def people_at(self, stamp_ns: int) -> People:
        """The people of the interval of a stamp."""

        def found() -> Any:
            return next((m for m in reversed(self.people) if stamp_of(m) == stamp_ns), None)

        return self.peer.until(
            found,
            lambda: (
                f"no people at {stamp_ns}; {self.peer.findings(self.node)}; log:\n"
                f"{self.process.log}"
            ),
        )

    def until_finding(
        self, name: str, wanted: Callable[[Finding], bool], what: str = ""
    ) -> Finding:
        """Waits for an entry of the node's diagnostics."""
        return self.peer.until_finding(self.node, name, wanted, what)

    def taking(self, *topics: str) -> Callable[[], None]:
        """Counts what the node has taken of inputs; the result waits for one more of each.

        Of scans the node keeps the newest only; what must not be passed over is waited for.
        """
        findings = self.peer.next_findings(self.node)[self.node]
        counts = {topic: findings[topic].count("received") + 1 for topic in topics}

        def wait() -> None:
            for topic, count in counts.items():
                self.until_finding(topic, lambda f, n=count: f.count("received") >= n)  # type: ignore[misc]

        return wait


def places(message: People) -> list[tuple[float, float]]:
    """Where the people of a message are [m], to the millimetre, sorted."""
    return sorted(
        (round(p.pose.pose.position.x, 3), round(p.pose.pose.position.y, 3))
        for p in message.persons
    )


def robots_in(message: People) -> list[str]:
    """The robots whose scans a message was made from."""
    return [scan.robot for scan in message.scans]
