"""The robot's node: converts, calls `RobotPipeline`, publishes."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from mrs_people_loc import messages
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import CameraError, ConfigError
from mrs_people_loc.head import Head, View
from mrs_people_loc.poses import PoseIntake
from mrs_people_loc.robot import Stages
from mrs_ros import convert
from mrs_ros.diagnostics import ERROR, OK, STALE, WARN, Finding, stamp_hint
from mrs_ros.managed_node import ManagedNode

#: Poses come up to some hundred times a second and none should be lost while a frame is matched.
POSE_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


class RobotNode(ManagedNode):
    """Images and odometry of one robot in, scan and pose out."""

    def __init__(self) -> None:
        super().__init__("robot_node", RobotConfig)
        if not self.name_in_team:
            self.get_logger().warning(
                "the node has no namespace; a robot's name is its namespace: "
                "use --ros-args -r __ns:=/robot_a"
            )

    # ---- life cycle ----

    def set_up(self) -> None:
        """Makes the publishers."""
        self.base_frame = "/".join(filter(None, (self.name_in_team, "base_link")))
        self._head = Head(self.name_in_team, self.config)
        self._stages: Stages | None = None
        self._frames = 0
        self._newest_ns = 0
        self._intake = PoseIntake(self.config.pose)
        self._overhead_ms = 0.0

        self._points = self.offer(PointCloud2, "points", qos_profile_sensor_data)
        self._pose = self.offer(PoseWithCovarianceStamped, "pose", POSE_QOS)
        self._debug_disparity = self.offer(DisparityImage, "debug/disparity", 2)
        self._debug_clouds = {
            stage: self.offer(PointCloud2, f"debug/{stage}", 2)
            for stage in ("cloud", "zones", "noise")
        }

    def start(self) -> None:
        """Listens to images, calibration and poses."""
        image = "image_rect" if self.config.images.rectified else "image_raw"
        for camera in self._head.cameras:
            self.listen(
                CameraInfo,
                f"{camera}/camera_info",
                partial(self._on_camera_info, camera),
                qos_profile_sensor_data,
            )
            self.listen(
                Image, f"{camera}/{image}", partial(self._on_image, camera), qos_profile_sensor_data
            )
        source = self.config.pose.source
        kind = Odometry if source == "odom" else PoseWithCovarianceStamped
        self.listen(kind, source, self._on_pose, POSE_QOS)

    def stop(self) -> None:
        """Forgets what waits."""
        self._head.reset()

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters from the next frame on."""
        if self._configured:
            try:
                self._head.configure(config)
            except CameraError as err:
                raise ConfigError(str(err)) from err
            self._intake.config = config.pose

    # ---- images ----

    def _on_camera_info(self, camera: str, message: CameraInfo) -> None:
        self._publish(self._head.take_camera_info(camera, message))

    def _on_image(self, camera: str, message: Image) -> None:
        resets = self._head.pairer.resets
        view = self._head.take_image(camera, message)
        if self._head.pairer.resets > resets:
            self.get_logger().warning(f"{camera} images: stamps jumped back; starting anew")
        self._publish(view)

    def _publish(self, view: View | None) -> None:
        if view is None:
            return
        stages = view.stages
        began = time.perf_counter()
        self._points.publish(convert.points(stages.scan, self.base_frame))
        if self._debug_disparity.get_subscription_count():
            pipeline = self._head.pipeline
            self._debug_disparity.publish(
                convert.disparity(
                    view.header, stages.disparity, pipeline.camera, pipeline.config.disparity
                )
            )
        for stage, publisher in self._debug_clouds.items():
            if publisher.get_subscription_count():
                publisher.publish(
                    convert.xyz_cloud(stages.scan.stamp_ns, self.base_frame, getattr(stages, stage))
                )
        self._overhead_ms = (time.perf_counter() - began) * 1e3
        self._stages = stages
        self._frames += 1
        self._newest_ns = stages.scan.stamp_ns

    # ---- pose ----

    def _on_pose(self, message: Any) -> None:
        pose = self._intake(messages.read_pose(message), message.header.frame_id)
        if pose is not None:
            self._pose.publish(convert.pose_stamped(pose, self.config.pose.map_frame))

    # ---- diagnostics ----

    def findings(self) -> list[Finding]:
        """The head, the pose and the scan."""
        return [self._pairing_finding(), self._scan_finding(), self._pose_finding()]

    def _pairing_finding(self) -> Finding:
        pairer = self._head.pairer
        values = {"unpaired": pairer.unpaired, "stamp_resets": pairer.resets}
        if pairer.unpaired:
            nearest = pairer.smallest_difference_ns
            seen = "no image of the other camera" if nearest is None else f"{nearest / 1e9:.4f} s"
            text = (
                f"{pairer.unpaired} images found no pair; smallest difference of stamps seen: "
                f"{seen}; allowed by images.max_stamp_difference: "
                f"{pairer.max_difference_ns / 1e9:g} s"
            )
            if not self._frames:
                return Finding("pairs", ERROR, text, values)
            return Finding("pairs", WARN, text, values)
        return Finding("pairs", OK, "ok", values)

    def _scan_finding(self) -> Finding:
        stages = self._stages
        if stages is None:
            return Finding("scan", STALE, "no scan yet", {"frames": 0})
        valid = float(np.isfinite(stages.disparity).mean())
        values: dict[str, object] = {
            "frames": self._frames,
            "valid_pixels": f"{valid:.2f}",
            "points": len(stages.cloud),
            "points_in_zone": len(stages.zones),
            "points_after_noise": len(stages.noise),
            "cells": len(stages.scan.cells),
            "publish_ms": f"{self._overhead_ms:.2f}",
            **{f"{stage}_ms": f"{ms:.2f}" for stage, ms in stages.times_ms.items()},
        }
        hint = stamp_hint(self, self._newest_ns)
        return Finding("scan", WARN if hint else OK, hint or "ok", values)

    def _pose_finding(self) -> Finding:
        pose = self._intake.last
        if pose is None:
            return Finding("pose", ERROR, f"no usable pose on {self.config.pose.source} yet")
        values = {"x": f"{pose.x:.3f}", "y": f"{pose.y:.3f}", "yaw": f"{pose.yaw:.3f}"}
        return Finding("pose", OK, "ok", values)
