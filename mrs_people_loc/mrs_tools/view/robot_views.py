"""What robots see, subscribed to only while somebody looks at it."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from mrs_people_loc import messages
from mrs_people_loc.arrays import Float32
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ImageError, PeopleLocError
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.sensing.images import Gray, ImagePreparer
from mrs_people_loc.team.poses import Pose
from mrs_ros.qos import STREAM
from mrs_tools.view import protocol
from mrs_tools.view.pictures import HEIGHT, WIDTH, body_boxes, in_colours, jpeg, with_boxes
from mrs_tools.view.protocol import Look, Publish

if TYPE_CHECKING:
    from rclpy.node import Node

#: Images of a robot are sent at most this often [s].
_PERIOD_S = 0.1
#: What belongs to an image is waited for so long [s].
_WAIT_S = 0.4
#: A robot without images for so long is told of [s].
_NO_IMAGE_S = 2.0
#: So many stamps are kept of what comes in parts.
_KEPT = 4


@dataclass(frozen=True)
class HeadSettings:
    """What is known of a robot's head.

    Attributes:
        rectified: Whether its node takes rectified images.
        mounting: Where the head is on the robot.
    """

    rectified: bool = True
    mounting: Mounting = field(default_factory=Mounting)


@dataclass
class _Robot:
    """One robot that is looked at: subscriptions by kind, and what came, by stamp [ns] and kind."""

    subscriptions: dict[str, Any] = field(default_factory=dict)
    came: dict[int, dict[str, bytes]] = field(default_factory=dict)
    camera: CameraModel | None = None
    sent_s: float = 0.0
    sent_ns: int = 0

    def keep(self, stamp_ns: int, kind: str, data: bytes) -> dict[str, bytes]:
        parts = self.came.setdefault(stamp_ns, {})
        parts[kind] = data
        while len(self.came) > _KEPT:
            del self.came[next(iter(self.came))]
        return parts


class RobotViews:
    """Images, disparities and cells of robots; used in the thread of its node.

    Args:
        node: The ROS node to subscribe with.
        publish: Takes images and cells.
        now_s: Says the ROS time [s].

    Attributes:
        robots: The robots that are there.
        heads: Of those whose node has answered, what is known of their heads.
    """

    def __init__(self, node: Node, publish: Publish, now_s: Callable[[], float]) -> None:
        self.robots: frozenset[str] = frozenset()
        self.heads: dict[str, HeadSettings] = {}
        self._node, self._publish, self._now_s = node, publish, now_s
        self._look = Look()
        self._watched: dict[str, _Robot] = {}

    def look(self, wanted: Look) -> None:
        """Takes what viewers look at."""
        self._look = wanted
        for robot in set(self._watched) - self._wanted_robots():
            self._end(self._watched.pop(robot))
        for robot in self._wanted_robots():
            self._subscribe(robot)

    def _wanted_robots(self) -> frozenset[str]:
        return self.robots if self._look.cells else self.robots & self._look.robots

    def update(self) -> None:
        """Sends images whose parts do not all come; follows robots that come."""
        if self._wanted_robots() - self._watched.keys():
            self.look(self._look)
        now_s = time.monotonic()
        for robot, one in self._watched.items():
            if "image" not in one.subscriptions:
                continue
            since_s = now_s - one.sent_s
            stamps = [ns for ns, parts in one.came.items() if "image" in parts]
            if since_s > _PERIOD_S + _WAIT_S and stamps and max(stamps) > one.sent_ns:
                self._send(robot, one, max(stamps))
            elif since_s > _NO_IMAGE_S:
                topic = one.subscriptions["image"].topic_name
                lacks = (
                    "nobody publishes it" if not self._node.count_publishers(topic) else "silent"
                )
                self._tell(robot, one, f"no images come: {topic}: {lacks}")
                self._choose_images(robot, one)

    def cells(self, stamp_ns: int, poses: Mapping[str, Pose]) -> None:
        """Sends the cells of an interval's scans.

        Args:
            stamp_ns: Of the interval [ns].
            poses: By robot, where it was at its scan's stamp.
        """
        if not self._look.cells:
            return
        found = {}
        for robot, pose in poses.items():
            one = self._watched.get(robot)
            data = one.came.get(pose.stamp_ns, {}).get("points") if one else None
            if data is not None:
                found[robot] = _in_map(self._scan(robot, data), pose)
        self._publish(protocol.Cells(type="cells", t=round(stamp_ns / 1e9, 3), robots=found))

    # ---- subscriptions ----

    def _subscribe(self, robot: str) -> None:
        from sensor_msgs.msg import CameraInfo, PointCloud2
        from stereo_msgs.msg import DisparityImage

        one = self._watched.setdefault(robot, _Robot())
        if "points" not in one.subscriptions:
            self._hear(robot, one, "points", PointCloud2, "points")
        if robot in self._look.robots and "image" not in one.subscriptions:
            one.sent_s = time.monotonic()
            self._choose_images(robot, one)
            self._hear(robot, one, "disparity", DisparityImage, "debug/disparity")
            take_info = partial(self._on_info, one)
            one.subscriptions["info"] = self._node.create_subscription(
                CameraInfo, f"{robot}/left/camera_info", take_info, STREAM
            )
        elif robot not in self._look.robots:
            for kind in ("image", "disparity", "info"):
                if kind in one.subscriptions:
                    self._node.destroy_subscription(one.subscriptions.pop(kind))

    def _hear(self, robot: str, one: _Robot, kind: str, type_: type, topic: str) -> None:
        """Subscribes to bytes: only what is shown is decoded."""
        one.subscriptions[kind] = self._node.create_subscription(
            type_, f"{robot}/{topic}", partial(self._on_part, robot, one, kind), STREAM, raw=True
        )

    def _choose_images(self, robot: str, one: _Robot) -> None:
        """Subscribes to what the robot's node takes, compressed where that is published."""
        from sensor_msgs.msg import CompressedImage, Image

        rectified = self.heads.get(robot, HeadSettings()).rectified
        topic = "left/image_rect" if rectified else "left/image_raw"
        compressed = f"{robot}/{topic}/compressed"
        choice: tuple[type, str] = Image, topic
        if self._node.count_publishers(self._node.resolve_topic_name(compressed)):
            choice = CompressedImage, f"{topic}/compressed"
        before = one.subscriptions.get("image")
        if before is not None and before.topic_name.endswith(choice[1]):
            return
        if before is not None:
            self._node.destroy_subscription(before)
        self._hear(robot, one, "image", *choice)

    def _end(self, one: _Robot) -> None:
        for subscription in one.subscriptions.values():
            self._node.destroy_subscription(subscription)

    # ---- what comes ----

    def _on_info(self, one: _Robot, message: Any) -> None:
        try:
            one.camera = messages.read_camera_info(message)
        except PeopleLocError:
            one.camera = None

    def _on_part(self, robot: str, one: _Robot, kind: str, data: bytes) -> None:
        parts = one.keep(_stamp_ns(data), kind, data)
        is_whole = {"image", "points", "disparity"} <= parts.keys()
        if is_whole and time.monotonic() - one.sent_s >= _PERIOD_S:
            self._send(robot, one, _stamp_ns(data))

    # ---- what goes out ----

    def _send(self, robot: str, one: _Robot, stamp_ns: int) -> None:
        parts = one.came[stamp_ns]
        try:
            image = self._image(robot, one, parts)
            disparity = _disparity(parts["disparity"]) if "disparity" in parts else None
        except (PeopleLocError, cv2.error) as err:
            self._tell(robot, one, str(err))
            return
        note = "" if one.camera else "no camera_info comes: bodies are not drawn"
        self._publish(
            protocol.Image(
                type="image",
                robot=robot,
                t=round(stamp_ns / 1e9, 3),
                age=round(self._now_s() - stamp_ns / 1e9, 3),
                image=image,
                disparity=disparity,
                note=note,
            )
        )
        one.sent_s, one.sent_ns = time.monotonic(), stamp_ns

    def _tell(self, robot: str, one: _Robot, note: str) -> None:
        one.sent_s = time.monotonic()
        self._publish(
            protocol.Image(
                type="image", robot=robot, t=None, age=None, image=None, disparity=None, note=note
            )
        )

    def _image(self, robot: str, one: _Robot, parts: Mapping[str, bytes]) -> str:
        """The left image, with the bodies found drawn into it, as a JPEG in base64.

        Raises:
            PeopleLocError: It cannot be shown.
        """
        topic = one.subscriptions["image"].topic_name
        gray = _gray(parts["image"], compressed=topic.endswith("/compressed"))
        head = self.heads.get(robot, HeadSettings())
        if one.camera is None:
            return jpeg(gray)
        rectified = "/image_rect" in topic
        prepare = ImagePreparer(one.camera, rectified=rectified, width=WIDTH, height=HEIGHT)
        prepared = prepare(gray)
        boxes = []
        if "points" in parts:
            cells = self._scan(robot, parts["points"])
            boxes = body_boxes(cells, prepare.output, head.mounting)
        return jpeg(with_boxes(prepared, boxes))

    def _scan(self, robot: str, data: bytes) -> Any:
        """The cells of a message on `points`; none if it cannot be used, as the planner reports."""
        from rclpy.serialization import deserialize_message
        from sensor_msgs.msg import PointCloud2

        from mrs_people_loc.scan import Cells

        message = deserialize_message(data, PointCloud2)
        try:
            return messages.read_scan(message, robot, message.header.frame_id).cells
        except PeopleLocError:
            return Cells.empty()


def _stamp_ns(data: bytes) -> int:
    """The stamp of a message in CDR that begins with a header [ns]."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
    return int(seconds) * 10**9 + int(nanoseconds)


def _in_map(cells: Any, pose: Pose) -> list[float]:
    """x, y of cells in the common frame, one after the other."""
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    x = pose.x + cos * cells.x - sin * cells.y
    y = pose.y + sin * cells.x + cos * cells.y
    flat = np.stack([x, y], axis=1).reshape(-1)
    return [round(float(value), 3) for value in flat]


def _gray(data: bytes, *, compressed: bool) -> Gray:
    """An image as grey.

    Raises:
        ImageError: It cannot be read.
    """
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import CompressedImage, Image

    if not compressed:
        return messages.read_image(deserialize_message(data, Image))
    packed = np.frombuffer(deserialize_message(data, CompressedImage).data, np.uint8)
    image = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE) if packed.size else None
    if image is None:
        raise ImageError("a compressed image cannot be read")
    return image  # type: ignore[return-value]


def _disparity(data: bytes) -> str | None:
    """A stereo_msgs/DisparityImage in colours, as a JPEG in base64; None if it holds none."""
    from rclpy.serialization import deserialize_message
    from stereo_msgs.msg import DisparityImage

    message = deserialize_message(data, DisparityImage)
    image = message.image
    values: Float32 = np.frombuffer(image.data, "<f4")
    if image.encoding != "32FC1" or not values.size or values.size != image.height * image.width:
        return None
    values = values.reshape(image.height, image.width)
    return jpeg(in_colours(values, message.min_disparity, message.max_disparity))
