"""`mrs convert`: foreign recordings as bags that the nodes and the offline tools read.

Two sources, both real: the OAK-D stereo video that looks down on people who walk by, and PCL's
RGB-D frame of five people. They prove that the same pipeline works on other cameras and mountings
with its configuration changed and nothing else. The bags hold what a robot's cameras and base
would send: images, `camera_info` and `odom` in frame `map`.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import BagError, CameraError, ConfigError
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.sensing.images import Gray
from mrs_tools.bags.rosbag import BagWriter, default_typestore
from mrs_tools.installing import how_to_install
from mrs_tools.plain import plain

Float = NDArray[np.float64]

#: Stamp of a recording's first frame [ns]: an arbitrary, fixed moment.
EPOCH_NS = 1_700_000_000_000_000_000
#: Centimetres in OAK's calib.json.
_CM = 0.01

#: Camera of PCL's `five_people.pcd`: focal length and principal point [px] (exact for its points).
PCL_FOCAL_PX, PCL_CX_PX, PCL_CY_PX = 525.0, 319.5, 239.5
#: Its height over the floor [m], and the floor's normal (upwards) in its optical frame.
PCL_HEIGHT_M = 1.259
PCL_FLOOR_NORMAL = (0.002, -0.9973, -0.0737)
#: Torsos (x, z) in its optical frame [m], read from its depth: surfaces, not the bodies' axes.
PCL_TORSOS_M = ((-0.90, 1.97), (-0.55, 2.30), (0.03, 2.75), (0.46, 2.50), (0.77, 1.80))

#: Depths beyond these are none [m].
_NEAREST_M, _FARTHEST_M = 0.05, 1000.0
#: What is read of a PCD file at most: bytes per line of its header, numbers per point, bytes.
_MAX_PCD_LINE, _MAX_PCD_VALUES, _MAX_PCD_BYTES = 1000, 100, 256 << 20


# ---------------------------------------------------------------------------- writing ----


class Recording:
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
        height, width = image.shape
        message = self._make(
            "sensor_msgs/msg/Image",
            header=header,
            height=height,
            width=width,
            encoding="mono8",
            is_bigendian=0,
            step=width,
            data=np.ascontiguousarray(image).reshape(-1),
        )
        self._bag.write(f"/{self._robot}/{name}/{image_topic}", ns, message)
        info = self._make(
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
            roi=self._make(
                "sensor_msgs/msg/RegionOfInterest",
                x_offset=0,
                y_offset=0,
                height=0,
                width=0,
                do_rectify=False,
            ),
        )
        self._bag.write(f"/{self._robot}/{name}/camera_info", ns, info)

    def odometry_at_origin(self, ns: int) -> None:
        """Writes the pose of a robot that stands at the origin of `map` (1 cm, 0.01 rad)."""
        covariance = np.diag([1e-4, 1e-4, 0.0, 0.0, 0.0, 1e-4]).reshape(-1)
        zero = self._make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        message = self._make(
            "nav_msgs/msg/Odometry",
            header=self._header("map", ns),
            child_frame_id=f"{self._robot}/base_link",
            pose=self._make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._pose(0.0, 0.0),
                covariance=covariance,
            ),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self._make("geometry_msgs/msg/Twist", linear=zero, angular=zero),
                covariance=covariance,
            ),
        )
        self._bag.write(f"/{self._robot}/odom", ns, message)

    def ground_truth(self, positions: Float, ns: int) -> None:
        """Writes where the people are.

        Args:
            positions: x and y in `map` [m], shape (people, 2).
            ns: Time [ns].
        """
        poses = [self._pose(float(x), float(y)) for x, y in positions]
        message = self._make(
            "geometry_msgs/msg/PoseArray", header=self._header("map", ns), poses=poses
        )
        self._bag.write("/ground_truth/people_poses", ns, message)

    def _pose(self, x: float, y: float) -> Any:
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
            orientation=self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        )

    def _header(self, frame: str, ns: int) -> Any:
        stamp = self._make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)


# -------------------------------------------------------------------------------- OAK ----


def convert_oak(
    folder: Path,
    out: Path,
    *,
    robot: str = "robot_a",
    frames: slice = slice(None),
    reduce: int = 2,
) -> int:
    """Writes an OAK-D recording (left.mp4, right.mp4, calib.json) as a bag of raw images.

    The images stay as they were taken; `camera_info` holds what rectifies them. The robot stands
    at the origin of `map`, under the left camera; frame i has the stamp that the videos' rate
    gives it, also where frames are left out.

    Args:
        folder: Where the three files lie.
        out: The bag: a folder, or one file if it ends in `.mcap`.
        robot: The robot's name.
        frames: Which frames to take.
        reduce: Images are scaled down by 1, 2, 4, ... (by area).

    Returns:
        Number of stereo pairs written.

    Raises:
        BagError: A file cannot be read, the videos differ, no frame is left, or `out` exists.
        CameraError: calib.json is not the calibration of this stereo pair.
        ConfigError: `robot`, `frames` or `reduce` is not allowed.
    """
    left, right = read_oak_calibration(folder / "calib.json", reduce)
    count = 0
    with _Videos(folder / "left.mp4", folder / "right.mp4") as videos:
        period_ns = 1e9 / videos.rate_hz
        for video, model in zip(videos.sizes, (left, right), strict=True):
            calibrated = (model.width * reduce, model.height * reduce)
            if video != calibrated:
                raise BagError(
                    f"{folder}: the images are {video[0]}x{video[1]}; calib.json is of "
                    f"{calibrated[0]}x{calibrated[1]}"
                )
        wanted = _indices(frames, len(videos))
        if not wanted:
            raise BagError(f"{folder}: no frame is left of the {len(videos)} in the videos")
        with BagWriter(out) as writer:
            bag = Recording(writer, robot)
            bag.odometry_at_origin(EPOCH_NS + round((wanted.start - 1) * period_ns))
            for index, left_image, right_image in videos.read(wanted):
                ns = EPOCH_NS + round(index * period_ns)
                bag.odometry_at_origin(ns)
                bag.camera("left", "image_raw", _scaled(left_image, left), left, ns)
                bag.camera("right", "image_raw", _scaled(right_image, right), right, ns)
                count += 1
            bag.odometry_at_origin(EPOCH_NS + round((wanted[-1] + 1) * period_ns))
    return count


def read_oak_calibration(path: Path, reduce: int = 1) -> tuple[CameraModel, CameraModel]:
    """Reads the stereo pair of OAK's calib.json, with the rectification of `cv2.stereoRectify`.

    Distances in the file are centimetres. Distortion is OpenCV's rational model with 14
    coefficients. The rectified images are zoomed so that every pixel comes from the raw ones
    (alpha = 0).

    Args:
        path: The file.
        reduce: The models are of images that are so many times smaller.

    Returns:
        The left and the right camera; P[3] of the right one is -f * baseline [px m].

    Raises:
        BagError: The file cannot be read.
        CameraError: It holds no calibrated pair, or its left camera is not at the left.
        ConfigError: `reduce` does not divide the images' size.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as err:  # RecursionError: lists in lists in lists
        raise BagError(f"{path} cannot be read: {err}") from err
    try:
        sockets = document["stereoRectificationData"]
        cameras = dict(document["cameraData"])
        left, right = cameras[sockets["leftCameraSocket"]], cameras[sockets["rightCameraSocket"]]
        k1, d1, size = _oak_intrinsics(left)
        k2, d2, right_size = _oak_intrinsics(right)
        extrinsics = left["extrinsics"]
        rotation = np.array(extrinsics["rotationMatrix"], dtype=np.float64).reshape(3, 3)
        translation = np.array([[extrinsics["translation"][axis] * _CM] for axis in "xyz"])
        to_socket = extrinsics["toCameraSocket"]
    except (KeyError, TypeError, ValueError, OverflowError) as err:
        raise CameraError(f"{path} is not an OAK calibration: {err!r}") from err
    if to_socket != sockets["rightCameraSocket"] or size != right_size:
        raise CameraError(f"{path}: the left camera's extrinsics do not lead to the right camera")
    # A point moves towards -x from the left camera's frame to the right one's.
    if translation[0, 0] >= 0:
        raise CameraError(
            f"{path}: the right camera is {-translation[0, 0]:g} m to the right of the left one; "
            "allowed: more than 0 (are the sockets swapped?)"
        )
    try:
        r1, r2, p1, p2, *_ = cv2.stereoRectify(
            k1, d1, k2, d2, size, rotation, translation, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
        )
    except cv2.error as err:
        raise CameraError(f"{path}: the pair cannot be rectified: {err.err}") from err
    models = []
    for k, d, r, p in ((k1, d1, r1, p1), (k2, d2, r2, p2)):
        model = CameraModel(
            width=size[0],
            height=size[1],
            k=k,
            d=tuple(map(float, d)),
            r=np.asarray(r, dtype=np.float64),
            p=np.asarray(p, dtype=np.float64),
            distortion_model="rational_polynomial",
        )
        models.append(_reduced(model, reduce))
    return models[0], models[1]


def _oak_intrinsics(camera: Mapping[str, Any]) -> tuple[Float, Float, tuple[int, int]]:
    k = np.array(camera["intrinsicMatrix"], dtype=np.float64).reshape(3, 3)
    d = np.array(camera["distortionCoeff"], dtype=np.float64).reshape(14)
    width, height = int(camera["width"]), int(camera["height"])
    # Checks all of it, before OpenCV computes with it.
    CameraModel(width, height, k, tuple(d), np.eye(3), np.column_stack([k, np.zeros(3)]))
    return k, d, (width, height)


def _reduced(model: CameraModel, reduce: int) -> CameraModel:
    if reduce < 1 or model.width % reduce or model.height % reduce:
        raise ConfigError(
            f"reduce is {reduce}; allowed: a divisor of {model.width} and {model.height}"
        )
    return model.scaled_to_fit(model.width // reduce, model.height // reduce)


def _scaled(image: Gray, model: CameraModel) -> Gray:
    size = (model.width, model.height)
    if image.shape == size[::-1]:
        return image
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)


class _Videos:
    """The two videos of a stereo pair, read in step."""

    def __init__(self, left: Path, right: Path) -> None:
        self._paths = (left, right)
        self._captures = [cv2.VideoCapture(str(path)) for path in self._paths]
        for path, capture in zip(self._paths, self._captures, strict=True):
            if not capture.isOpened():
                raise BagError(f"{path} cannot be read as a video")
        counts = [int(c.get(cv2.CAP_PROP_FRAME_COUNT)) for c in self._captures]
        rates = [c.get(cv2.CAP_PROP_FPS) for c in self._captures]
        if counts[0] != counts[1] or rates[0] != rates[1] or not rates[0] > 0:
            raise BagError(
                f"{left} and {right} are no stereo pair: {counts[0]} and {counts[1]} frames "
                f"at {rates[0]:g} and {rates[1]:g} Hz"
            )
        self._count, self.rate_hz = counts[0], rates[0]
        sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        #: Width and height of the images [px], left and right.
        self.sizes = [tuple(int(c.get(side)) for side in sides) for c in self._captures]

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> _Videos:
        return self

    def __exit__(self, *_: object) -> None:
        for capture in self._captures:
            capture.release()

    def read(self, wanted: range) -> Iterator[tuple[int, Gray, Gray]]:
        """Yields index, left and right image; decodes one by one, for seeking is not exact."""
        for index in range(wanted[-1] + 1):
            if not all(capture.grab() for capture in self._captures):
                raise BagError(f"{self._paths[0].parent}: the videos end before frame {index}")
            if index in wanted:
                images = []
                for capture in self._captures:
                    _, image = capture.retrieve()
                    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
                    images.append(gray.astype(np.uint8))
                yield index, images[0], images[1]


def parse_frames(text: str) -> slice:
    """Reads `START:STOP:STEP`, each of which may be missing, or one frame's number.

    Raises:
        ConfigError: It is none of these, a number is negative, or the step is 0.
    """
    try:
        numbers = [int(part) if part.strip() else None for part in text.split(":")]
    except ValueError:
        numbers = [-1]
    good = 1 <= len(numbers) <= 3 and all(n is None or n >= 0 for n in numbers)
    if not good or numbers == [None] or numbers[2:] == [0]:
        raise ConfigError(f"frames is {text!r}; allowed: START:STOP:STEP, such as 0:627:3")
    if len(numbers) == 1:
        assert numbers[0] is not None
        return slice(numbers[0], numbers[0] + 1)
    return slice(*numbers)


def _indices(frames: slice, count: int) -> range:
    return range(count)[frames]


# -------------------------------------------------------------------------------- PCL ----


def convert_pcl(
    file: Path,
    out: Path,
    *,
    robot: str = "robot_a",
    repeat: int = 10,
    rate_hz: float = 5.0,
    baseline_m: float = 0.12,
    reduce: int = 1,
    noise_grey: float = 2.0,
) -> int:
    """Writes PCL's RGB-D frame of five people as a bag of rectified stereo pairs.

    Left is the frame's grey image, right is the left one as a camera `baseline_m` to the right
    would see it (see `render_right`), pixels without a depth filled by `fill_depth`. The pair is
    repeated; each repetition has sensor noise of its own in both images.

    The robot stands at the origin of `map`, under the camera, which looks along x. Nobody
    measured where the people are: `/ground_truth/people_poses` holds the torsos as they were read
    from the depth (`torsos_in_map`), i.e. the surface that the camera sees, some 0.1 m in front
    of the body's axis.

    Args:
        file: The organised PCD file, with x, y, z and rgba.
        out: The bag: a folder, or one file if it ends in `.mcap`.
        robot: The robot's name.
        repeat: Number of pairs.
        rate_hz: Pairs per second.
        baseline_m: Distance between the cameras [m].
        reduce: Images are scaled down by 1, 2, 4, ... (by area).
        noise_grey: Standard deviation of the noise [grey levels].

    Returns:
        Number of stereo pairs written.

    Raises:
        BagError: The file cannot be read, is no such frame, or `out` exists.
        ConfigError: `robot` or a number is not allowed.
    """
    for name, value, low in (
        ("repeat", repeat, 1),
        ("rate", rate_hz, 1e-3),
        ("baseline", baseline_m, 1e-3),
        ("noise", noise_grey, 0.0),
    ):
        if not (math.isfinite(value) and value >= low):
            raise ConfigError(f"{name} is {value}; allowed: at least {low:g}")
    image, depth = read_rgbd(file)
    left, right = _pcl_cameras(image.shape, baseline_m, reduce)
    right_image = render_right(image, fill_depth(depth), PCL_FOCAL_PX * baseline_m)
    views = [_scaled(view, left).astype(np.float64) for view in (image, right_image)]
    truth = torsos_in_map()
    rng = np.random.default_rng(0)
    period_ns = 1e9 / rate_hz
    with BagWriter(out) as writer:
        bag = Recording(writer, robot)
        bag.odometry_at_origin(EPOCH_NS - round(period_ns))
        for index in range(repeat):
            ns = EPOCH_NS + round(index * period_ns)
            noisy = [
                np.clip(np.rint(v + rng.normal(0.0, noise_grey, v.shape)), 0, 255).astype(np.uint8)
                for v in views
            ]
            bag.odometry_at_origin(ns)
            bag.camera("left", "image_rect", noisy[0], left, ns)
            bag.camera("right", "image_rect", noisy[1], right, ns)
            bag.ground_truth(truth, ns)
        bag.odometry_at_origin(EPOCH_NS + round(repeat * period_ns))
    return repeat


def _pcl_cameras(
    shape: tuple[int, ...], baseline_m: float, reduce: int
) -> tuple[CameraModel, CameraModel]:
    k = np.array([[PCL_FOCAL_PX, 0.0, PCL_CX_PX], [0.0, PCL_FOCAL_PX, PCL_CY_PX], [0.0, 0.0, 1.0]])
    left = CameraModel(
        width=shape[1],
        height=shape[0],
        k=k,
        d=(0.0,) * 5,
        r=np.eye(3),
        p=np.column_stack([k, np.zeros(3)]),
    )
    p_right = left.p.copy()
    p_right[0, 3] = -PCL_FOCAL_PX * baseline_m
    right = dataclasses.replace(left, p=p_right)
    return _reduced(left, reduce), _reduced(right, reduce)


def pcl_pitch() -> float:
    """How far the camera of PCL's frame looks down [rad].

    The floor's normal has a component against the optical axis: ahead, the axis sinks.
    """
    normal = np.array(PCL_FLOOR_NORMAL)
    return math.asin(-normal[2] / float(np.linalg.norm(normal)))


def torsos_in_map() -> Float:
    """The torsos of PCL's frame on the floor, for a robot at the origin of `map`.

    They are given as (x, z) of the optical frame; at the height of the optical axis, which is
    that of a torso, z along the axis is z * cos(pitch) along the floor.

    Returns:
        x and y [m], shape (5, 2), from left to right in the image.
    """
    torsos = np.array(PCL_TORSOS_M)
    return np.column_stack([torsos[:, 1] * math.cos(pcl_pitch()), -torsos[:, 0]])


def read_rgbd(file: Path) -> tuple[Gray, Float]:
    """Reads an organised PCD file.

    Returns:
        Grey image, uint8, and depth along the optical axis [m], NaN where there is none; both of
        shape (height, width).

    Raises:
        BagError: The file cannot be read, or is not organised with x, y, z and rgb(a).
    """
    try:
        from pypcd4 import PointCloud  # needed by this converter alone
    except ImportError as err:
        how = how_to_install("pypcd4")
        raise BagError(f"reading PCD files needs pypcd4, which is not installed: {how}") from err
    if not file.is_file():
        raise BagError(f"{file} is no file")
    try:
        _check_pcd_size(file)
        cloud = PointCloud.from_path(file)
    except BagError:
        raise
    except Exception as err:  # pypcd4 raises whatever its parsing stumbles on
        reason = " ".join(str(err).split())
        raise BagError(f"{file} cannot be read as a PCD file: {reason}") from err
    about, points = cloud.metadata, cloud.pc_data
    names = points.dtype.names or ()
    color = next((name for name in ("rgba", "rgb") if name in names), None)
    shape = (int(about.height), int(about.width))
    if color is None or "z" not in names or shape[0] < 2 or shape[1] < 2:
        raise BagError(
            f"{file} has fields {', '.join(names)} and {shape[1]}x{shape[0]} points; "
            "wanted: an organised cloud with x, y, z and rgb or rgba"
        )
    color_bytes = points.dtype[color].itemsize
    if points.shape != (shape[0] * shape[1],) or color_bytes != 4:
        raise BagError(
            f"{file} has {points.size} points with colours of {color_bytes} bytes; "
            f"wanted: {shape[1]}x{shape[0]} points, 4 bytes"
        )
    depth = points["z"].astype(np.float64).reshape(shape)
    packed = np.ascontiguousarray(points[color]).view(np.uint32).reshape(shape)
    bgr = np.stack([(packed >> shift) & 255 for shift in (0, 8, 16)], axis=-1).astype(np.uint8)
    with np.errstate(invalid="ignore"):
        depth[~((depth >= _NEAREST_M) & (depth <= _FARTHEST_M))] = np.nan
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY).astype(np.uint8), depth


def _check_pcd_size(file: Path) -> None:
    """Raise if a PCD file's header says more than is read; pypcd4 would allocate it all."""
    from pypcd4 import MetaData

    with file.open("rb") as stream:
        lines: list[str] = []
        while not (lines and lines[-1].startswith("DATA")):
            line = stream.readline(_MAX_PCD_LINE)
            if not line or len(line) == _MAX_PCD_LINE:
                raise BagError(f"{file} cannot be read as a PCD file: its header has no end")
            if not line.startswith(b"#") and line.strip():
                lines.append(line.decode().strip())
        about = MetaData.parse_header(lines)
        if len(lines) > 10 or not len(about.fields) == len(about.count) == len(about.size):
            raise BagError(f"{file} cannot be read as a PCD file: its header is no header")
        asked = about.points * sum(s * c for s, c in zip(about.size, about.count, strict=True))
        if about.data.value.startswith("binary") and about.data.value != "binary":
            asked = max(asked, *np.frombuffer(stream.read(8), "<u4").astype(int))
    values = sum(about.count)
    if asked > _MAX_PCD_BYTES or values > _MAX_PCD_VALUES:
        raise BagError(
            f"{file} has {values} values per point, {about.points} points, {asked} bytes; "
            f"allowed: {_MAX_PCD_VALUES} values per point, {_MAX_PCD_BYTES} bytes"
        )


def fill_depth(depth: Float) -> Float:
    """Gives a depth to the pixels that have none, in the favour of the background.

    A hole inside a row (the shadow of a body in the depth sensor's light, dark hair) takes the
    farther of its two ends. A hole that reaches the image's border takes the far part of its row
    (90th percentile), since the body beside it may not go on. A row without any depth copies the
    nearest row that has some.

    Args:
        depth: Depth [m], NaN where there is none, shape (height, width).

    Returns:
        Depth [m], finite everywhere.

    Raises:
        BagError: No pixel has a depth.
    """
    valid = np.isfinite(depth)
    if not valid.any():
        raise BagError("no pixel has a depth")
    columns = np.arange(depth.shape[1])
    before = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(valid, columns, columns.size)[:, ::-1], axis=1)[:, ::-1]
    rows = np.arange(depth.shape[0])[:, None]
    inside = (before >= 0) & (after < columns.size)
    farther = np.maximum(
        depth[rows, np.maximum(before, 0)], depth[rows, np.minimum(after, columns.size - 1)]
    )
    filled = np.where(valid, depth, np.where(inside, farther, np.nan))
    known = np.flatnonzero(valid.any(axis=1))
    far = np.nanpercentile(depth[known], 90, axis=1)
    filled[known] = np.where(np.isfinite(filled[known]), filled[known], far[:, None])
    nearest = known[np.argmin(np.abs(known[None, :] - rows), axis=1)]
    result: Float = filled[nearest]
    return result


#: Sub-pixel steps of the drawn view.
_STEPS = 8
#: Neighbours whose disparities differ by less are one surface [px].
_SAME_SURFACE_PX = 1.0


def render_right(left: Gray, depth: Float, focal_baseline: float) -> Gray:
    """Draws what the right camera of a rectified pair would see, from the left view and its depth.

    Every pixel moves to the left by its disparity; between two neighbours on one surface the
    image goes on linearly, in steps of 1/8 px. Where several points arrive, the nearest is seen.
    What the left camera did not see (beside each body, and at the right border) is filled from
    the background's side with the mirror image of that background, so it has its texture.

    Args:
        left: Grey image, shape (height, width).
        depth: Depth of each pixel [m], finite and positive, the same shape.
        focal_baseline: Focal length times baseline [px m].

    Returns:
        Grey image of the same shape.
    """
    height, width = left.shape
    disparity = focal_baseline / depth
    fine = np.arange((width - 1) * _STEPS + 1)
    first = np.minimum(fine // _STEPS, width - 2)
    weight = fine / _STEPS - first
    step = disparity[:, first + 1] - disparity[:, first]
    # Over an edge of a body nothing is interpolated: the nearer pixel's centre decides.
    weight = np.where(np.abs(step) < _SAME_SURFACE_PX, weight, np.rint(weight))
    grey = left.astype(np.float64)
    fine_disparity = disparity[:, first] + weight * step
    fine_grey = grey[:, first] + weight * (grey[:, first + 1] - grey[:, first])

    target = np.rint(fine - fine_disparity * _STEPS).astype(np.int64)
    rows = np.broadcast_to(np.arange(height)[:, None], target.shape)
    inside = np.flatnonzero(target >= 0)
    near_last = inside[np.argsort(fine_disparity.flat[inside], kind="stable")]
    where = (rows.flat[near_last], target.flat[near_last])
    seen_grey = np.full(target.shape, np.nan)
    seen_disparity = np.full(target.shape, np.nan)
    seen_grey[where] = fine_grey.flat[near_last]  # of repeated places the last one stays
    seen_disparity[where] = fine_disparity.flat[near_last]
    for row_grey, row_disparity in zip(seen_grey, seen_disparity, strict=True):
        _fill_row(row_grey, row_disparity)
    return np.clip(np.rint(seen_grey[:, ::_STEPS]), 0, 255).astype(np.uint8)


def _fill_row(grey: Float, disparity: Float) -> None:
    """Fills the holes (NaN) of one row in place, each from the side that is farther away."""
    hole = np.isnan(disparity)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], hole, [False]]).astype(np.int8)))
    seen = disparity.copy()
    for start, stop in edges.reshape(-1, 2):
        at_left = seen[start - 1] if start > 0 else np.inf
        at_right = seen[stop] if stop < grey.size else np.inf
        from_left = at_left <= at_right
        side = np.arange(start - 1, -1, -1) if from_left else np.arange(stop, grey.size)
        if not side.size:
            grey[start:stop] = 0.0
            continue
        # How far the background goes on from the hole's edge, and that much mirrored about the
        # edge, to and fro where the hole is wider.
        side = side[: stop - start + 1]
        other = ~(np.abs(seen[side] - seen[side[0]]) < _SAME_SURFACE_PX)
        count = int(np.argmax(other)) if other.any() else side.size
        period = max(1, 2 * (count - 1))
        steps = np.arange(1, stop - start + 1) % period
        mirrored = grey[side[np.minimum(steps, period - steps)]]
        grey[start:stop] = mirrored if from_left else mirrored[::-1]


# ------------------------------------------------------------------------ command line ----

app = typer.Typer(
    help="Write foreign recordings as bags.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

Robot = Annotated[str, typer.Option(help="Name of the robot, the first part of its topics.")]
Reduce = Annotated[int, typer.Option(help="Scale images down by this: 1, 2, 4, ...", min=1)]


@app.command("oak")
def oak_command(
    folder: Annotated[Path, typer.Argument(help="Folder of left.mp4, right.mp4, calib.json.")],
    out: Annotated[Path, typer.Argument(help="The new bag: a folder, or NAME.mcap.")],
    robot: Robot = "robot_a",
    frames: Annotated[str, typer.Option(help="START:STOP:STEP, such as 0:627:3.")] = "::",
    reduce: Reduce = 2,
) -> None:
    """OAK-D stereo video with its calibration: raw images, to be rectified by the node."""
    count = convert_oak(folder, out, robot=robot, frames=parse_frames(frames), reduce=reduce)
    typer.echo(plain(f"{out}: {count} stereo pairs of {robot}"))


@app.command("pcl")
def pcl_command(
    file: Annotated[Path, typer.Argument(help="PCL's five_people.pcd.")],
    out: Annotated[Path, typer.Argument(help="The new bag: a folder, or NAME.mcap.")],
    robot: Robot = "robot_a",
    repeat: Annotated[int, typer.Option(help="Number of stereo pairs.", min=1)] = 10,
    rate: Annotated[float, typer.Option(help="Stereo pairs per second.")] = 5.0,
    baseline: Annotated[float, typer.Option(help="Between the cameras [m].")] = 0.12,
    reduce: Reduce = 1,
    noise: Annotated[float, typer.Option(help="Sensor noise added [grey levels].")] = 2.0,
) -> None:
    """RGB-D frame of five people: a rectified pair, the right view drawn from the depth."""
    count = convert_pcl(
        file,
        out,
        robot=robot,
        repeat=repeat,
        rate_hz=rate,
        baseline_m=baseline,
        reduce=reduce,
        noise_grey=noise,
    )
    typer.echo(plain(f"{out}: {count} stereo pairs of {robot}"))
