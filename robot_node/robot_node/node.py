"""The robot's node: converts, calls `RobotPipeline`, publishes."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import CameraError, ConfigError, ImageError, WaitedError
from mrs_people_loc.head import Head, View
from mrs_people_loc.health.findings import Code, of_scans
from mrs_people_loc.health.floor import FloorWatch, in_words
from mrs_people_loc.health.sight import SightWatch
from mrs_people_loc.robot import Stages
from mrs_ros import convert
from mrs_ros.diagnostics import ERROR, OK, STALE, WARN, Finding, Growth, Input, recording_hint
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import STREAM
from robot_node import pose_source
from robot_node.pose_source import PoseSource


class RobotNode(ManagedNode):
    """Images and odometry of one robot in, scan and pose out."""

    def __init__(self) -> None:
        super().__init__("robot_node", RobotConfig)
        pose_source.check(self.config.pose)
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
        self._unpaired = Growth()
        self._scan_at_s = self._ahead_s = 0.0
        self._overhead_ms = 0.0
        self._sight = SightWatch(self.config.sight)
        self._floor: FloorWatch | None = None
        self._floor_key: object = None

        self._points = self.offer(PointCloud2, "points", STREAM)
        self._pose = PoseSource(self, self.base_frame)
        self._debug_disparity = self.offer(DisparityImage, "debug/disparity", 2)
        self._debug_clouds = {
            stage: self.offer(PointCloud2, f"debug/{stage}", 2)
            for stage in ("cloud", "zones", "noise")
        }

    def start(self) -> None:
        """Listens to images, calibration and poses."""
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
            heard = self.listen(Image, f"{camera}/{image}", partial(self._on_image, camera), STREAM)
            remedy = f"set images.rectified: {str(not rectified).lower()}"
            self._images[camera] = heard
            heard.instead = (f"{camera}/{other}", remedy)
        self._pose.start()

    def stop(self) -> None:
        """Forgets what waits."""
        self._head.reset()
        self._pose.stop()

    def jumped_back(self) -> None:
        """Forgets what waits, and what was seen."""
        self._head.reset()
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Forgets what was seen, and where: the time, or stamps of images, jumped back."""
        self._pose.begin_anew()
        self._sight = SightWatch(self.config.sight)
        self._floor = None
        self._stages = None

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters from the next frame on."""
        pose_source.check(config.pose)
        if self._configured:
            try:
                self._head.configure(config)
            except CameraError as err:
                raise ConfigError(str(err)) from err
            self._pose.changed(config)
            self._sight.config = config.sight

    # ---- images ----

    def _on_camera_info(self, camera: str, message: CameraInfo) -> None:
        view = None
        try:
            view = self._head.take_camera_info(camera, message)
        except WaitedError as err:
            self._images[err.camera].refuse(ImageError(str(err)))
        if self._head.pipeline is not None:
            self._pose.camera_known(self._head.pipeline.camera)
        self._publish(view)

    def _on_image(self, camera: str, message: Image) -> None:
        resets = self._head.pairer.resets
        view = self._head.take_image(camera, message)
        if self._head.pairer.resets > resets:
            self.get_logger().warning(f"{camera} images: stamps jumped back; starting anew")
            self._begin_anew()
        self._publish(view)

    def _publish(self, view: View | None) -> None:
        if view is None:
            return
        stages = view.stages
        began = time.perf_counter()
        self._pose.before_scan(stages.scan.stamp_ns)
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
        self._scan_at_s = time.monotonic()
        self._ahead_s = (stages.scan.stamp_ns - self.get_clock().now().nanoseconds) / 1e9
        self._watch(view)

    def _watch(self, view: View) -> None:
        self._sight.step(view.images, view.stages.disparity)
        camera, config, matching = (
            self._head.pipeline.camera,
            self.config.floor,
            self.config.disparity,
        )
        if not config.watch:
            self._floor = None
            return
        key = (camera, config, max(matching.block_size_px, matching.fill_block_size_px))
        if self._floor is None or self._floor_key != key:
            self._floor, self._floor_key = FloorWatch(camera, config, block_px=key[2]), key
        self._floor.step(view.stages.disparity, view.images.stamp_ns)

    # ---- diagnostics ----

    def findings(self) -> list[Finding]:
        """The head, the pose and the scan."""
        return [
            self._pairing_finding(),
            self._head_finding(),
            self._mounting_finding(),
            self._scan_finding(),
            self._pose.finding(),
        ]

    def _head_finding(self) -> Finding:
        """Whether the head sees anything."""
        sight = self._sight
        if not sight.values:
            return Finding("head", STALE, "no view yet", code=Code.NO_VIEW)
        values = {name: f"{value:.2f}" for name, value in sight.values.items()}
        if sight.trouble:
            text = f"the head is blind: {sight.trouble}; check lens caps, light and exposure"
            return Finding("head", WARN, text, values, Code.BLIND)
        return Finding("head", OK, "ok", values)

    def _mounting_finding(self) -> Finding:
        """Whether the head sits where it is configured to, by the floor."""
        watch = self._floor
        if watch is None:
            why = "not watched: floor.watch is false" if not self.config.floor.watch else "no view"
            return Finding("mounting", OK, why)
        floor, configured = watch.floor, in_words(watch.camera.mounting)
        values: dict[str, object] = {"configured": configured}
        if floor is not None:
            values |= {"by_the_floor": in_words(floor), "floor_part": f"{floor.part:.2f}"}
        if watch.moved:
            seen = "where the floor was last seen" if floor is None else in_words(floor)
            text = (
                f"the head has moved: by the floor {seen}; configured: {configured}; run "
                f"`mrs calibrate --robot {self.name_in_team}`"
            )
            return Finding("mounting", WARN, text, values, Code.HEAD_MOVED)
        if floor is None:
            why = watch.why_not or "too few looks yet"
            return Finding("mounting", OK, f"not enough floor in view to tell: {why}", values)
        return Finding("mounting", OK, "ok", values)

    def _pairing_finding(self) -> Finding:
        pairer = self._head.pairer
        values = {"unpaired": pairer.unpaired, "stamp_resets": pairer.resets}
        lately = self._unpaired.lately(pairer.unpaired)
        if pairer.unpaired and (lately or not self._frames):
            text = f"{pairer.unpaired} images found no pair; {pairer.why_unpaired()}"
            if not self._frames:
                return Finding("pairs", ERROR, text, values, Code.NO_PAIR)
            return Finding("pairs", WARN, text, values, Code.SOME_UNPAIRED)
        return Finding("pairs", OK, "ok", values)

    def _scan_finding(self) -> Finding:
        stages = self._stages
        if stages is None:
            return Finding("scan", STALE, "no scan yet", {"frames": self._frames}, Code.NO_SCAN)
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
        silent_s = time.monotonic() - self._scan_at_s
        level, code, text = of_scans(silent_s, self._ahead_s, recording_hint(self))
        return Finding("scan", level, text, values, code)
