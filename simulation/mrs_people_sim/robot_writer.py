"""Writes the messages of one robot's cameras and odometry into a bag."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.geometry import quaternion_from_yaw
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.sensing.images import Gray
from mrs_tools.bags.message_types import default_typestore
from mrs_tools.bags.truth import TRUTH_TOPIC, VISIBLE_TOPIC, true_pose_topic
from mrs_tools.bags.writer import BagWriter


class RobotWriter:
    """Writes what one robot's cameras and base would send.

    Args:
        bag: Where to.
        robot: Name of the robot, the first part of its topics and frames.

    Raises:
        ConfigError: The name is no ROS namespace.
    """

    def __init__(self, bag: BagWriter, robot: str) -> None:
        PlannerConfig(robots=(robot,))  # knows which names are allowed
        self._bag = bag
        self._robot = robot
        self._types = default_typestore().types

    def camera(self, name: str, image_topic: str, image: Gray, model: CameraModel, ns: int) -> None:
        """Writes one image and its camera_info.

        Args:
            name: `left` or `right`.
            image_topic: `image_raw` or `image_rect`.
            image: Grey image.
            model: Its calibration.
            ns: Its stamp [ns].
        """
        header = self._header(f"{self._robot}/{name}_camera_optical", ns)
        self._bag.write(
            f"/{self._robot}/{name}/{image_topic}", ns, image_message(self._make, header, image)
        )
        info = camera_info(self._make, header, model)
        self._bag.write(f"/{self._robot}/{name}/camera_info", ns, info)

    def odometry_at_origin(self, ns: int) -> None:
        """Writes the pose of a robot that stands at the origin of `map` (1 cm, 0.01 rad)."""
        covariance = np.diag([1e-4, 1e-4, 0.0, 0.0, 0.0, 1e-4])
        self.odometry("map", (0.0, 0.0, 0.0), (0.0, 0.0), ns, covariance)

    def odometry(
        self,
        frame: str,
        place: tuple[float, float, float],
        speed: tuple[float, float],
        ns: int,
        covariance: Float | None = None,
    ) -> None:
        """Writes odometry.

        Args:
            frame: Its frame.
            place: x, y [m] and yaw [rad] in that frame.
            speed: Forward [m/s], and turn to the left [rad/s].
            ns: Its stamp [ns].
            covariance: Of pose and twist, shape (6, 6); None: not stated.
        """
        stated = np.zeros(36) if covariance is None else covariance.reshape(-1)
        forward, turn = (
            self._make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=z)
            for x, z in ((speed[0], 0.0), (0.0, speed[1]))
        )
        message = self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(frame, ns),
            child_frame_id=f"{self._robot}/base_link",
            pose=self._make(
                "geometry_msgs/msg/PoseWithCovariance", pose=self._pose(*place), covariance=stated
            ),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self._make("geometry_msgs/msg/Twist", linear=forward, angular=turn),
                covariance=stated,
            ),
        )
        self._bag.write(f"/{self._robot}/odom", ns, message)

    def points(self, scan: Scan) -> None:
        """Writes a scan, as the robot's node sends it."""
        header = self._header(f"{self._robot}/base_link", scan.stamp_ns)
        message = cloud_message(self._make, header, scan.cells.to_records())
        self._bag.write(f"/{self._robot}/points", scan.stamp_ns, message)

    def true_pose(self, place: tuple[float, float, float], ns: int) -> None:
        """Writes where the robot is: x, y [m] and yaw [rad] in `map`."""
        message = self._make(
            "geometry_msgs/msg/PoseStamped",
            header=self._header("map", ns),
            pose=self._pose(*place),
        )
        self._bag.write(true_pose_topic(self._robot), ns, message)

    def ground_truth(self, positions: Float, ns: int, seen: Bool | None = None) -> None:
        """Writes where the people are.

        Args:
            positions: x and y in `map` [m], shape (people, 2).
            ns: Time [ns].
            seen: Which of them robots see, shape (people,); None: that is not known.
        """
        poses = [self._pose(float(x), float(y), 0.0) for x, y in positions]
        message = self._make(
            "geometry_msgs/msg/PoseArray", header=self._header("map", ns), poses=poses
        )
        self._bag.write(TRUTH_TOPIC, ns, message)
        if seen is not None:
            count = len(seen)
            dimension = self._make(
                "std_msgs/msg/MultiArrayDimension", label="people_seen", size=count, stride=count
            )
            layout = self._make("std_msgs/msg/MultiArrayLayout", dim=[dimension], data_offset=0)
            array = self._make(
                "std_msgs/msg/Int32MultiArray", layout=layout, data=seen.astype(np.int32)
            )
            self._bag.write(VISIBLE_TOPIC, ns, array)

    def _pose(self, x: float, y: float, yaw: float) -> Any:
        qx, qy, qz, qw = quaternion_from_yaw(yaw)
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
            orientation=self._make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        )

    def _header(self, frame: str, ns: int) -> Any:
        stamp = self._make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)


#: PointField's numbers of the types in a scan.
_FIELD_TYPES = {"f4": 7, "u4": 6}


def cloud_message(make: Callable[..., Any], header: Any, records: NDArray[np.void]) -> Any:
    """sensor_msgs/PointCloud2 of a structured array, shape (n,); see `image_message`."""
    dtype = records.dtype
    fields = [
        make(
            "sensor_msgs/msg/PointField",
            name=name,
            offset=offset,
            datatype=_FIELD_TYPES[kind.str[1:]],
            count=1,
        )
        for name, (kind, offset, *_) in (dtype.fields or {}).items()
    ]
    return make(
        "sensor_msgs/msg/PointCloud2",
        header=header,
        height=1,
        width=len(records),
        fields=fields,
        is_bigendian=False,
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * len(records),
        data=np.frombuffer(records.tobytes(), dtype=np.uint8),
        is_dense=True,
    )


def image_message(make: Callable[..., Any], header: Any, image: Gray) -> Any:
    """sensor_msgs/Image.

    Args:
        make: Makes a message from its type name and fields.
        header: Its header.
        image: Grey image.
    """
    height, width = image.shape
    return make(
        "sensor_msgs/msg/Image",
        header=header,
        height=height,
        width=width,
        encoding="mono8",
        is_bigendian=0,
        step=width,
        data=np.ascontiguousarray(image).reshape(-1),
    )


def camera_info(make: Callable[..., Any], header: Any, model: CameraModel) -> Any:
    """sensor_msgs/CameraInfo of a calibration; see `image_message`."""
    return make(
        "sensor_msgs/msg/CameraInfo",
        header=header,
        height=model.height,
        width=model.width,
        distortion_model=model.distortion_model,
        d=np.array(model.d, dtype=np.float64),
        k=model.k.reshape(-1),
        r=model.r.reshape(-1),
        p=model.p.reshape(-1),
        binning_x=0,
        binning_y=0,
        roi=make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        ),
    )
