"""One robot_node under test: views and odometry in, points and poses out."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

from mrs_people_loc.config import RobotConfig
from ros.harness import Finding, NodeProcess, Peer
from ros.recording import Recording, View, records_of, stages_of, stamp_of, stamped

#: Image and camera_info by camera; for tests that change them.
MutableView = dict[str, tuple[Any, Any]]


class RobotPeer:
    """Feeds one robot_node and hears it.

    Args:
        peer: A node on its domain.
        process: The robot_node; None: it runs in this process.
        recording: Where the views are from.
        namespace: The robot's name.
    """

    def __init__(
        self,
        peer: Peer,
        process: NodeProcess | None,
        recording: Recording,
        namespace: str = "robot_a",
    ) -> None:
        self.peer = peer
        self.process = process
        self.namespace = namespace
        self.node = f"/{namespace}/robot_node"
        self.recording = recording
        self.points = peer.hear(PointCloud2, f"/{namespace}/points")
        self.poses = peer.hear(PoseWithCovarianceStamped, f"/{namespace}/pose")
        self.views_sent = 0
        self._last_ns = 0

    @property
    def log(self) -> str:
        """What the node has written."""
        return "" if self.process is None else self.process.log

    # ---- what is sent ----

    def now(self) -> int:
        """A stamp that is newer than all before, by more than the pose's period [ns]."""
        self._last_ns = max(time.time_ns(), self._last_ns + 20_000_000)
        return self._last_ns

    def view(
        self, stamp_ns: int | None = None, *, of: str = "robot_a", frame: int = 0
    ) -> MutableView:
        """A recorded view, with a new stamp."""
        stamp = self.now() if stamp_ns is None else stamp_ns
        recorded: View = self.recording.views[of][frame]
        return {
            camera: (stamped(image, stamp), stamped(info, stamp))
            for camera, (image, info) in recorded.items()
        }

    def odometry(self, stamp_ns: int | None = None, frame_id: str = "map") -> Odometry:
        """A recorded odometry message, with a new stamp."""
        made = stamped(
            self.recording.odometry["robot_b"][0], self.now() if stamp_ns is None else stamp_ns
        )
        made.header.frame_id = frame_id
        made.child_frame_id = f"{self.namespace}/base_link"
        return made

    def send(self, view: View, *, image: str = "image_rect", top: bool = False) -> None:
        """Sends a view: calibration first."""
        self.views_sent += 1
        cameras = ("left", "right", "top") if top else ("left", "right")
        for camera in cameras:
            self.send_info(camera, view[camera][1])
        for camera in cameras:
            self.send_image(camera, view[camera][0], image=image)

    def send_info(self, camera: str, message: Any) -> None:
        """Sends one camera's calibration."""
        self.peer.send(f"/{self.namespace}/{camera}/camera_info", message)

    def send_image(self, camera: str, message: Any, *, image: str = "image_rect") -> None:
        """Sends one camera's image."""
        self.peer.send(f"/{self.namespace}/{camera}/{image}", message)

    def send_pose(self, message: Any, topic: str = "odom") -> None:
        """Sends a pose."""
        self.peer.send(f"/{self.namespace}/{topic}", message)

    # ---- what comes back ----

    def settle(self) -> None:
        """Waits until what was sent has been taken: a pose that is sent behind it comes back.

        Of images the node keeps the newest only; what must not be passed over is waited for.
        """
        odometry = self.odometry()
        self.send_pose(odometry)
        self.pose_at(stamp_of(odometry))

    def points_at(self, stamp_ns: int) -> PointCloud2:
        """The scan of a stamp."""

        def found() -> Any:
            return next((m for m in reversed(self.points) if stamp_of(m) == stamp_ns), None)

        return self.peer.until(found, lambda: f"no points at {stamp_ns}; log:\n{self.log}")

    def pose_at(self, stamp_ns: int) -> PoseWithCovarianceStamped:
        """The pose of a stamp."""

        def found() -> Any:
            return next((m for m in reversed(self.poses) if stamp_of(m) == stamp_ns), None)

        return self.peer.until(found, lambda: f"no pose at {stamp_ns}; log:\n{self.log}")

    def check(
        self, config: RobotConfig, view: View | None = None, *, image: str = "image_rect"
    ) -> np.ndarray:
        """Sends a view and holds that what comes back is bit for bit that of the method."""
        view = self.view() if view is None else view
        self.send(view, image=image, top=config.images.top)
        stages = stages_of(view, config)
        message = self.points_at(stages.scan.stamp_ns)
        assert message.header.frame_id == f"{self.namespace}/base_link"
        records = records_of(message)
        wanted = stages.scan.cells.to_records()
        assert records.dtype == wanted.dtype
        np.testing.assert_array_equal(records, wanted)
        return records

    def warm_up(self, *, image: str = "image_rect", top: bool = False, pose: bool = True) -> None:
        """Sends views and odometry until the node answers: then all connections stand."""

        def answered() -> bool:
            view = self.view()
            stamp_ns = stamp_of(view["left"][0])
            self.send(view, image=image, top=top)
            if pose:
                self.send_pose(self.odometry(stamp_ns))
            self.peer.spin(0.1)
            heard = [m for m in self.points if stamp_of(m) >= began]
            return bool(heard and (self.poses or not pose))

        began = self.now()
        self.peer.until_active(self.node)
        self.peer.until(answered, lambda: f"no answer; log:\n{self.log}")

    def until_finding(
        self, name: str, wanted: Callable[[Finding], bool], what: str = ""
    ) -> Finding:
        """Waits for an entry of the node's diagnostics."""
        return self.peer.until_finding(self.node, name, wanted, what)
