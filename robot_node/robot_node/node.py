"""The robot's node: converts, calls `RobotPipeline`, publishes."""

from __future__ import annotations

import time
from functools import partial

import cv2
import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import CameraError, ConfigError, ImageError, WaitedError
from mrs_people_loc.head import Head, View
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.floor import FloorWatch, in_words, watch_for
from mrs_people_loc.health.robot import (
    MountingState,
    PairingState,
    ScanState,
    of_head,
    of_mounting,
    of_pairing,
    of_scan,
)
from mrs_people_loc.health.sight import SightWatch
from mrs_people_loc.localization.robot_localization import RobotLocalization
from mrs_people_loc.robot import Stages
from mrs_ros import convert, tf
from mrs_ros.diagnostics import Growth, Input, recording_hint
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import STREAM
from robot_node import pose_source
from robot_node.collision_monitor import MonitorTopics
from robot_node.localization import LocalizationTopics
from robot_node.pose_source import PoseSource
from robot_node.range_topics import RangeTopics

#: Images up to this size are processed by one thread [px]: OpenCV's StereoBM divides larger ones
#: only, and in its other functions threads spend more on waiting for each other than they gain.
_ONE_THREAD_PX = 320 * 240
#: By stage, what the number of its points is called on `/diagnostics`.
_COUNTED = {"cloud": "points", "cropped": "points_cropped", "foreground": "points_foreground"}


class RobotNode(ManagedNode):
    """Images and odometry of one robot in, scan and pose out."""

    def __init__(self) -> None:
        super().__init__("robot_node", RobotConfig)
        pose_source.check(self.config)
        if not self.name_in_team:
            self.get_logger().warning(
                "the node has no namespace; a robot's name is its namespace: "
                "use --ros-args -r __ns:=/robot_a"
            )

    # ---- parameters and life cycle ----

    def set_up(self) -> None:
        """Makes the publishers."""
        self.base_frame = "/".join(filter(None, (self.name_in_team, "base_link")))
        self._head = Head(self.name_in_team, self.config)
        self._stages: Stages | None = None
        self._views = 0
        self._unpaired = Growth()
        self._scan_at_s = self._ahead_s = 0.0
        self._publish_ms = 0.0
        self._sight = SightWatch(self.config.sight)
        self._floor: FloorWatch | None = None

        self._points = self.offer(PointCloud2, "points", STREAM)
        frames = self._frames = tf.FrameListener(self)
        map_frame = self.config.pose.map_frame
        in_map = partial(frames.pose, map_frame) if tf.installed("tf2_ros") else None
        name = self.name_in_team.rpartition("/")[2]
        self._localization = RobotLocalization(name, self.config, in_map)
        ranges = RangeTopics(self, self.base_frame, frames)
        self._team = LocalizationTopics(self, ranges, self._localization)
        self._monitor = MonitorTopics(self, self.base_frame, ranges)
        moved = self._monitor.take_odometry
        self._pose = PoseSource(
            self, self.base_frame, frames, self._localization, self._team, moved
        )
        self._debug_disparity = self.offer(DisparityImage, "debug/disparity", 2)
        self._debug_clouds = {
            stage: self.offer(PointCloud2, f"debug/{stage}", 2) for stage in _COUNTED
        }

    def start(self) -> None:
        """Subscribes to images, calibration and poses."""
        rectified = self.config.images.rectified
        image, other = ("image_rect", "image_raw") if rectified else ("image_raw", "image_rect")
        self._images: dict[str, Input] = {}
        for camera in self._head.cameras:
            self.listen(
                CameraInfo,
                f"{camera}/camera_info",
                partial(self._on_camera_info, camera),
                STREAM,
            )
            source = self.listen(
                Image, f"{camera}/{image}", partial(self._on_image, camera), STREAM
            )
            remedy = f"set images.rectified: {str(not rectified).lower()}"
            self._images[camera] = source
            source.instead = (f"{camera}/{other}", remedy)
        self._pose.start()
        self._monitor.start()

    def destroy_node(self) -> None:
        """Lets the robot stand before the node is destroyed."""
        if self.is_active:
            self._halt()
        super().destroy_node()

    def stop(self) -> None:
        """Lets the robot stand, and drops the images that wait for their pair."""
        self._monitor.stop()
        self._head.reset()
        self._pose.stop()

    def jumped_back(self) -> None:
        """Forgets what waits, and what was seen."""
        self._head.reset()
        self._pose.reset()
        self._team.reset()
        self._monitor.reset()
        self._frames.clear()
        self._forget_views()

    def _forget_views(self) -> None:
        """Forgets what was seen: the time, or stamps of images, jumped back."""
        self._sight = SightWatch(self.config.sight)
        self._floor = None
        self._stages = None

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters from the next frame on."""
        pose_source.check(config)
        if self.is_configured:
            try:
                self._head.configure(config)
            except CameraError as err:
                raise ConfigError(str(err)) from err
            self._team.changed(config)
            self._pose.changed(config)
            self._monitor.changed(config)
            self._sight.config = config.sight

    # ---- inputs ----

    def _on_camera_info(self, camera: str, message: CameraInfo) -> None:
        view = None
        try:
            view = self._head.take_camera_info(camera, message)
        except WaitedError as err:
            self._images[err.camera].refuse(ImageError(str(err)))
        if self._head.pipeline is not None:
            head = self._head.pipeline.camera
            cv2.setNumThreads(1 if head.width * head.height <= _ONE_THREAD_PX else -1)
            self._pose.camera_known(head)
        self._step(view)

    def _on_image(self, camera: str, message: Image) -> None:
        resets = self._head.pairer.resets
        view = self._head.take_image(camera, message)
        if self._head.pairer.resets > resets:
            self.get_logger().warning(f"{camera} images: stamps jumped back; starting over")
            self._forget_views()
        self._step(view)

    # ---- step ----

    def _step(self, view: View | None) -> None:
        """Publishes a complete view, and checks the head with it."""
        if view is None:
            return
        self._publish(view)
        stages, camera = view.stages, self._head.pipeline.camera
        self._stages = stages
        self._monitor.take_view(stages.disparity, stages.scan.stamp_ns, camera)
        self._localization.take_view(stages.scan, stages.disparity, camera)
        self._views += 1
        self._scan_at_s = time.monotonic()
        self._ahead_s = (view.stages.scan.stamp_ns - self._now_ns()) / 1e9
        self._sight.step(view.images, view.stages.disparity)
        self._floor = watch_for(self._head.pipeline.camera, self.config, self._floor)
        if self._floor is not None:
            self._floor.step(view.stages.disparity, view.images.stamp_ns)

    # ---- outputs ----

    def _publish(self, view: View) -> None:
        stages, began = view.stages, time.perf_counter()
        stamp_ns = stages.scan.stamp_ns
        self._pose.before_scan(stamp_ns)
        self._points.publish(convert.points(stages.scan, self.base_frame))
        if self._debug_disparity.get_subscription_count():
            pipeline = self._head.pipeline
            matching = pipeline.config.disparity
            self._debug_disparity.publish(
                convert.disparity(view.header, stages.disparity, pipeline.camera, matching)
            )
        for stage, publisher in self._debug_clouds.items():
            if publisher.get_subscription_count():
                xyz = getattr(stages, stage)
                publisher.publish(convert.xyz_cloud(stamp_ns, self.base_frame, xyz))
        self._publish_ms = (time.perf_counter() - began) * 1e3

    # ---- diagnostics ----

    def observe(self) -> None:
        """Counts images without a pair, and what localization refuses."""
        self._team.observe()
        self._unpaired.update(self._head.pairer.unpaired)

    def findings(self) -> list[Finding]:
        """The pairs of images, the head, its mounting, the scan, the pose and what uses them."""
        pairer = self._head.pairer
        pairing = PairingState(
            unpaired=pairer.unpaired,
            unpaired_lately=self._unpaired.lately,
            why_unpaired=pairer.why_unpaired(),
            stamp_resets=pairer.resets,
            frames=self._views,
        )
        scan = ScanState(
            frames=self._views,
            silent_s=time.monotonic() - self._scan_at_s,
            ahead_s=self._ahead_s,
            remedy=recording_hint(self),
            figures={} if self._stages is None else self._figures(self._stages),
        )
        return [
            of_pairing(pairing),
            of_head(self._sight.trouble, self._sight.values),
            of_mounting(self._mounting(), watched=self.config.floor.watch),
            of_scan(scan),
            self._pose.finding(),
            *self._team.findings(),
            *self._monitor.findings(),
        ]

    def _mounting(self) -> MountingState | None:
        watch = self._floor
        if watch is None:
            return None
        floor = watch.floor
        return MountingState(
            robot=self.name_in_team,
            configured=in_words(watch.camera.mounting),
            measured="" if floor is None else in_words(floor),
            floor_part=None if floor is None else floor.part,
            moved=watch.moved,
            why_not=watch.why_not,
        )

    def _figures(self, stages: Stages) -> dict[str, object]:
        made = vars(stages)  # the default method makes points only for debug topics
        return {
            "valid_pixels": f"{np.isfinite(stages.disparity).mean():.2f}",
            **{name: len(made[stage]) for stage, name in _COUNTED.items() if stage in made},
            "cells": len(stages.scan.cells),
            "publish_ms": f"{self._publish_ms:.2f}",
            **{f"{stage}_ms": f"{ms:.2f}" for stage, ms in stages.times_ms.items()},
        }
