"""The recorded bag as messages, and what the method makes of it in this process."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from mrs_people_loc import messages
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.robot import RobotPipeline, Stages
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import ImagePreparer, StereoImages

#: What a node runs that is started without parameters.
DEFAULTS = RobotConfig()

#: One view of a head: image and camera_info by camera.
View = Mapping[str, tuple[Any, Any]]


@dataclass
class Recording:
    """What a bag holds.

    Attributes:
        views: By robot, the views in their order.
        odometry: By robot, the odometry in its order.
        truth: PoseArray messages.
    """

    views: dict[str, list[dict[str, tuple[Any, Any]]]] = field(default_factory=dict)
    odometry: dict[str, list[Any]] = field(default_factory=dict)
    truth: list[Any] = field(default_factory=list)


def read_recording(path: Path) -> Recording:
    """Reads a bag of robots with rectified images."""
    result = Recording()
    parts: dict[tuple[str, int], dict[str, dict[str, Any]]] = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            topic, data = connection.topic, bytes(raw)
            robot, _, name = topic.lstrip("/").partition("/")
            if topic == "/ground_truth/people_poses":
                result.truth.append(deserialize_message(data, PoseArray))
            elif name == "odom":
                result.odometry.setdefault(robot, []).append(deserialize_message(data, Odometry))
            else:
                camera, _, kind = name.partition("/")
                message = deserialize_message(data, CameraInfo if kind == "camera_info" else Image)
                stamp = messages.stamp_ns_of(message.header.stamp)
                view = parts.setdefault((robot, stamp), {})
                view.setdefault(camera, {})[kind] = message
    for (robot, _), view in sorted(parts.items(), key=lambda item: item[0]):
        result.views.setdefault(robot, []).append(
            {camera: (both["image_rect"], both["camera_info"]) for camera, both in view.items()}
        )
    return result


def set_stamp(message: Any, stamp_ns: int) -> None:
    """Puts a stamp [ns] into a message's header."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)


def stamped(message: Any, stamp_ns: int) -> Any:
    """A copy of a message with another stamp [ns]."""
    made = copy.deepcopy(message)
    set_stamp(made, stamp_ns)
    return made


def stamp_of(message: Any) -> int:
    """Stamp of a message [ns]."""
    return messages.stamp_ns_of(message.header.stamp)


def stages_of(view: View, config: RobotConfig, robot: str = "robot") -> Stages:
    """What the method makes of a view in this process, without any node."""
    cameras = ("left", "right", "top") if config.images.top else ("left", "right")
    prepared, models = {}, {}
    for camera in cameras:
        image, info = view[camera]
        preparer = ImagePreparer(
            messages.read_camera_info(info),
            rectified=config.images.rectified,
            width=config.images.working_width,
            height=config.images.working_height,
        )
        prepared[camera] = preparer(messages.read_image(image))
        models[camera] = preparer.output
    head = StereoCamera.from_models(
        models["left"], models["right"], models.get("top"), config.mounting
    )
    images = StereoImages(stamp_of(view["left"][0]), **prepared)
    return RobotPipeline(robot, head, config).stages(images)


def records_of(message: PointCloud2, dtype: np.dtype | None = None) -> np.ndarray:
    """The points of a message, whose fields must be exactly those of a dtype.

    Args:
        message: The message.
        dtype: The dtype; None: that of cells, or that of cells of bodies.
    """
    kinds = {7: "<f4", 6: "<u4", 5: "<i4"}
    got = np.dtype(
        {
            "names": [f.name for f in message.fields],
            "formats": [kinds[f.datatype] for f in message.fields],
            "offsets": [f.offset for f in message.fields],
            "itemsize": message.point_step,
        }
    )
    if dtype is None:
        dtype = BODY_DTYPE if "body" in (got.names or ()) else CELL_DTYPE
    assert got == dtype, f"{got}; wanted: {dtype}"
    assert not message.is_bigendian
    assert message.is_dense
    assert (message.height, message.row_step) == (1, message.width * dtype.itemsize)
    assert len(message.data) == message.row_step
    return np.frombuffer(bytes(message.data), dtype)
