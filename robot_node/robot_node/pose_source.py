"""The robot's pose: from the configured source to `pose` and to TF."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from mrs_people_loc import messages
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import ConfigError, PoseError
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.robot import PoseState, of_pose
from mrs_people_loc.localization.robot_localization import RobotLocalization, localizes
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.poses import Pose, frame_of, static_pose
from mrs_ros import convert, tf
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import POSES
from robot_node import wall_topics
from robot_node.localization import LocalizationTopics

#: Period of looking the pose up in TF [s].
TF_PERIOD_S = 0.02
#: Period of the poses of a static robot while it sends no scan [s].
STANDING_PERIOD_S = 0.1
#: It counts as sending none after this long without [s].
NO_SCAN_S = 1.0


def check(robot: RobotConfig) -> None:
    """Checks that the pose can come from its source, and go to TF, and what localization needs.

    Raises:
        ConfigError: A parameter, a file or a package for that is missing.
    """
    config = robot.pose
    wall_topics.check(robot.walls)
    if robot.localization.run == "always" and config.source not in ("odom", "pose_in"):
        raise ConfigError(
            f"localization.run is always but pose.source is {config.source}; allowed: odom, pose_in"
        )
    if config.source == "static":
        static_pose(config, 0)
    if config.source == "tf":
        tf.require("tf2_ros", "pose.source is tf; allowed here: odom, pose_in, static")
    if config.publish_tf == "always":
        tf.require("tf2_msgs", "pose.publish_tf is always; allowed here: auto, never")


class PoseSource:
    """The robot's pose, from odometry, from TF or from a parameter.

    Args:
        node: The robot's node.
        base_frame: Its base_link.
        frames: Looks frames up in TF.
        localization: Places its poses in the map.
        topics: Those of the localization.
        take_odometry: Is called with each odometry, too.
    """

    def __init__(
        self,
        node: ManagedNode,
        base_frame: str,
        frames: tf.FrameListener,
        localization: RobotLocalization,
        topics: LocalizationTopics,
        take_odometry: Callable[[Pose], None],
    ) -> None:
        self._node, self._take_odometry = node, take_odometry
        self._base_frame = base_frame
        self._config: RobotConfig = node.config
        self._frames, self._localization, self._topics = frames, localization, topics
        self._timer: Any = None
        self._standing: Pose | None = None  # from TF
        self._last: Pose | None = None
        self._asked_ns = 0
        self._heard_s: float | None = None  # when TF last gave something new
        self._scan_at_s = 0.0
        self._error = ""
        self._pose = node.offer(PoseWithCovarianceStamped, "pose", POSES)
        tells = self._config.pose.publish_tf != "never" and tf.installed("tf2_msgs")
        self._frames_out = tf.FramePublisher(node.offer) if tells else None
        self._odom_frame = ""
        self._camera: StereoCamera | None = None

    def start(self) -> None:
        """Subscribes to the source, or begins to publish a static pose."""
        source, steady = self._config.pose.source, Clock(clock_type=ClockType.STEADY_TIME)
        if source == "static":
            self._timer = self._node.create_timer(STANDING_PERIOD_S, self._stand, clock=steady)
        elif source == "tf":
            self._timer = self._node.create_timer(TF_PERIOD_S, self._ask_tf, clock=steady)
        else:
            kind = Odometry if source == "odom" else PoseWithCovarianceStamped
            self._node.listen(kind, source, self._on_pose, POSES)
            self._topics.start()
        self._tell_fixed_frames()

    def stop(self) -> None:
        """Ends that."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None
        self._frames.destroy()
        self._standing, self._error, self._heard_s = None, "", None

    def reset(self) -> None:
        """Forgets what came last: the time was set back."""
        self._last, self._asked_ns = None, 0

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters, which `check` let pass."""
        self._config = config
        if self._node.is_active:
            self._tell_fixed_frames()

    def camera_known(self, camera: StereoCamera | None) -> None:
        """Takes the head, whose frames are published to TF."""
        if camera is not self._camera:
            self._camera = camera
            self._tell_fixed_frames()

    def before_scan(self, stamp_ns: int) -> None:
        """Publishes the pose of a static robot for the scan that follows."""
        standing = self._standing_at(stamp_ns)
        if standing is not None:
            self._scan_at_s = time.perf_counter()
            self._send(standing)

    def finding(self) -> Finding:
        """Whether the robot knows where it is."""
        config, last = self._config.pose, self._last
        state = PoseState(
            source=config.source,
            error=self._error,
            silent_s=0.0 if self._heard_s is None else time.monotonic() - self._heard_s,
            frames=f"{config.map_frame} -> {self._base_frame}",
            pose=None if last is None else (last.x, last.y, last.yaw),
        )
        return of_pose(state)

    def _on_pose(self, message: Any) -> None:
        pose, frame_id = messages.read_pose(message, self._base_frame), message.header.frame_id
        if self._config.pose.source == "odom":
            self._take_odometry(pose)
        came_in = frame_id.lstrip("/")
        placed = self._localization.place(pose, came_in)
        corrected = localizes(self._config, came_in)
        if corrected:
            self._topics.tell_team()
        if placed is not None and corrected:
            self._send_corrected(placed, pose, came_in)
        elif placed is not None:
            self._send(placed, came_in)

    def _ask_tf(self) -> None:
        config = self._config.pose
        try:
            pose = self._frames.pose(config.map_frame, self._base_frame, config.sigmas)
            self._standing = None
            if pose.stamp_ns == 0:
                self._standing = pose
                self._stand()
                self._heard_s = time.monotonic()
            elif pose.stamp_ns != self._asked_ns:
                self._asked_ns, self._heard_s = pose.stamp_ns, time.monotonic()
                placed = self._localization.place(pose, config.map_frame)
                if placed is not None:
                    self._send(placed)
            self._error = ""
        except PoseError as err:
            self._standing, self._error = None, str(err)

    def _standing_at(self, stamp_ns: int) -> Pose | None:
        """The pose of a static robot with a stamp [ns]; None: it is not static."""
        if self._config.pose.source == "static":
            return static_pose(self._config.pose, stamp_ns)
        return self._standing and dataclasses.replace(self._standing, stamp_ns=stamp_ns)

    def _stand(self) -> None:
        """Publishes the pose of a static robot that sends no scan: others may have it in view."""
        now_ns = self._node.get_clock().now().nanoseconds
        if time.perf_counter() - self._scan_at_s < NO_SCAN_S or now_ns == 0:
            return
        last, pose = self._last, self._standing_at(now_ns)
        if last is None or abs(now_ns - last.stamp_ns) > 0.9e9 * STANDING_PERIOD_S:
            assert pose is not None
            self._send(pose)

    def _send_corrected(self, pose: Pose, odometry: Pose, odom_frame: str) -> None:
        """Publishes a pose that was corrected, and where that puts its odometry's frame.

        Args:
            pose: The pose in the map.
            odometry: The pose in the odometry's frame.
            odom_frame: That frame.
        """
        config = self._config.pose
        self._last = pose
        self._pose.publish(convert.pose_stamped(pose, config.map_frame))
        if self._frames_out is None:
            return
        if config.publish_tf == "always" or odom_frame == config.map_frame:
            parent, child, where = config.map_frame, self._base_frame, pose
        else:
            parent, child, where = config.map_frame, odom_frame, frame_of(pose, odometry)
        self._frames_out.moving(convert.transform(pose.stamp_ns, parent, where, child))

    def _send(self, pose: Pose, came_in: str = "") -> None:
        """Publishes a pose, and its frames.

        Args:
            pose: The pose in the map.
            came_in: The frame that it came in; empty: the map.
        """
        config = self._config.pose
        self._last = pose
        self._pose.publish(convert.pose_stamped(pose, config.map_frame))
        if came_in in ("", config.map_frame):
            self._topics.tell_anchor(pose)
        if self._frames_out is None or config.source == "tf":
            return
        known = config.source == "static" or (config.source, came_in) == ("odom", config.map_frame)
        if known or config.publish_tf == "always":
            self._frames_out.moving(
                convert.transform(pose.stamp_ns, config.map_frame, pose, self._base_frame)
            )
        elif came_in not in (self._odom_frame, config.map_frame):
            self._odom_frame = came_in
            self._tell_fixed_frames()

    def _tell_fixed_frames(self) -> None:
        """Publishes where the cameras are on the robot, and its odometry's frame on the map."""
        if self._frames_out is None:
            return
        config, now_ns = self._config, self._node.get_clock().now().nanoseconds
        made = convert.camera_transforms(now_ns, self._base_frame, config.mounting, self._camera)
        if self._odom_frame and config.pose.map_from_odom:
            x, y, yaw = config.pose.map_from_odom
            begins = Pose(now_ns, x, y, yaw)
            made.append(convert.transform(now_ns, config.pose.map_frame, begins, self._odom_frame))
        self._frames_out.fixed(*made)
