"""The robot's node: converts, calls `RobotPipeline`, publishes."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from mrs_people_loc import messages
from mrs_people_loc.camera import CameraModel, StereoCamera
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import CameraError, ConfigError, ImageError
from mrs_people_loc.images import ImagePreparer, Pairer, StereoImages
from mrs_people_loc.poses import PoseIntake
from mrs_people_loc.robot import RobotPipeline, Stages
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
        self.cameras = ("left", "right", "top") if self.config.images.top else ("left", "right")
        self.base_frame = "/".join(filter(None, (self.name_in_team, "base_link")))
        self._models: dict[str, CameraModel] = {}
        self._info_keys: dict[str, Any] = {}
        self._preparers: dict[str, ImagePreparer] = {}
        self._pipeline: RobotPipeline | None = None
        self._head_error = ""
        self._waiting: Mapping[str, tuple[int, Any]] | None = None
        self._pairer = self._new_pairer(self.config)
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
        for camera in self.cameras:
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
        self._pairer.reset()
        self._waiting = None

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters from the next frame on."""
        if self._configured:
            if self._pipeline is not None:
                try:
                    preparers, pipeline = self._build(config)
                except CameraError as err:
                    raise ConfigError(str(err)) from err
                self._preparers, self._pipeline = preparers, pipeline
            self._intake.config = config.pose
            if config.images != self.config.images:
                self._pairer = self._new_pairer(config)

    # ---- images ----

    def _on_camera_info(self, camera: str, message: CameraInfo) -> None:
        # The calibration comes with every image; it is read again only when it changes.
        key = (
            message.width,
            message.height,
            message.distortion_model,
            *(np.asarray(m).tobytes() for m in (message.k, message.d, message.r, message.p)),
            (message.binning_x, message.binning_y, message.roi.width, message.roi.height),
        )
        if self._info_keys.get(camera) == key:
            return
        self._models.pop(camera, None)
        self._preparers, self._pipeline = {}, None
        self._info_keys[camera] = key
        try:
            self._models[camera] = messages.read_camera_info(message)
            if len(self._models) < len(self.cameras):
                return
            self._preparers, self._pipeline = self._build(self.config)
        except CameraError as err:
            self._head_error = str(err)
            raise
        waited, self._waiting = self._waiting, None
        if waited is not None:
            self._process(waited)

    def _build(self, config: RobotConfig) -> tuple[dict[str, ImagePreparer], RobotPipeline]:
        preparers = {
            camera: ImagePreparer(
                self._models[camera],
                rectified=config.images.rectified,
                width=config.images.working_width,
                height=config.images.working_height,
            )
            for camera in self.cameras
        }
        outputs = {camera: preparer.output for camera, preparer in preparers.items()}
        head = StereoCamera.from_models(
            outputs["left"], outputs["right"], outputs.get("top"), config.mounting
        )
        return preparers, RobotPipeline(self.name_in_team, head, config)

    def _on_image(self, camera: str, message: Image) -> None:
        image = messages.read_image(message)
        if camera in self._preparers:
            self._preparers[camera].check_size(image)
        resets = self._pairer.resets
        stamp_ns = messages.stamp_ns_of(message.header.stamp)
        found = self._pairer.add(camera, stamp_ns, (message.header, image))
        if self._pairer.resets > resets:
            self.get_logger().warning(f"{camera} images: stamps jumped back; starting anew")
        if found is None:
            return
        if self._pipeline is not None:
            self._process(found)
            return
        # The calibration may come a moment after the first images: the newest set waits for it.
        waited, self._waiting = self._waiting, found
        if waited is not None:
            missing = ", ".join(c for c in self.cameras if c not in self._info_keys)
            why = f"no camera_info of {missing}" if missing else self._head_error
            raise ImageError(f"images are not used: {why}")

    def _process(self, found: Mapping[str, tuple[int, Any]]) -> None:
        assert self._pipeline is not None
        prepared = {c: self._preparers[c](image) for c, (_, (_, image)) in found.items()}
        stamp_ns, (left_header, _) = found["left"]
        images = StereoImages(stamp_ns, **prepared)
        stages = self._pipeline.stages(images)
        began = time.perf_counter()
        self._points.publish(convert.points(stages.scan, self.base_frame))
        self._publish_debug(left_header, stages, self._pipeline)
        self._overhead_ms = (time.perf_counter() - began) * 1e3
        self._stages = stages
        self._frames += 1
        self._newest_ns = images.stamp_ns

    def _publish_debug(self, left_header: Any, stages: Stages, pipeline: RobotPipeline) -> None:
        if self._debug_disparity.get_subscription_count():
            self._debug_disparity.publish(
                convert.disparity(
                    left_header, stages.disparity, pipeline.camera, pipeline.config.disparity
                )
            )
        for stage, publisher in self._debug_clouds.items():
            if publisher.get_subscription_count():
                publisher.publish(
                    convert.xyz_cloud(stages.scan.stamp_ns, self.base_frame, getattr(stages, stage))
                )

    def _new_pairer(self, config: RobotConfig) -> Pairer:
        return Pairer(
            self.cameras,
            max_difference_ns=round(config.images.max_stamp_difference * 1e9),
            queue_size=config.images.queue_size,
        )

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
        pairer = self._pairer
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
