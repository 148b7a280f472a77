"""What the fuzzer hands bytes to: every way by which something from outside comes in.

Each target takes bytes and must raise nothing but `PeopleLocError`; each has seeds, made of what is
right. Messages come as they do on the wire (CDR), so that lengths and numbers of all sizes occur.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from mrs_people_loc import messages
from mrs_people_loc.config import PlannerConfig, PoseInput, RobotConfig, load_team, robots_named
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.head import Head
from mrs_people_loc.planner import Planner
from mrs_people_loc.poses import Pose, PoseBuffer, PoseIntake
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE
from mrs_tools.bags import BagReader, BagWriter, default_typestore
from mrs_tools.offline import read_estimate, read_truth, robots_of

ROOT = Path(__file__).resolve().parents[2]
STAMP_NS = 1_700_000_000_000_000_000
WIDTH, HEIGHT = 48, 36


@dataclass(frozen=True)
class Target:
    """One way in.

    Attributes:
        take: Takes bytes; raises nothing but `PeopleLocError`.
        seeds: Makes bytes that are right.
        max_length: Longer inputs are not tried.
        runs: So many inputs in the short run, of a second or two.
    """

    take: Callable[[bytes], None]
    seeds: Callable[[], list[bytes]]
    max_length: int
    runs: int


# ------------------------------------------------------------------------------------- messages


def _decoded(kind: str, data: bytes) -> Any:
    """A message from its bytes; None if they are none, which DDS or `BagReader` say then."""
    try:
        return default_typestore().deserialize_cdr(data, kind)
    except Exception:
        return None


def _encoded(kind: str, message: Any) -> bytes:
    return bytes(default_typestore().serialize_cdr(message, kind))


def _make(kind: str, /, **fields: Any) -> Any:
    return default_typestore().types[kind](**fields)


def _header(frame_id: str = "map") -> Any:
    sec, nanosec = divmod(STAMP_NS, 1_000_000_000)
    stamp = _make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return _make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


IMAGE = "sensor_msgs/msg/Image"


def _image(
    encoding: str = "mono8", width: int = WIDTH, height: int = HEIGHT, shift: int = 0
) -> Any:
    """A random texture; one that is shifted by -1 is 3 px (1 px in colour) to the left."""
    step = width * messages.ENCODINGS.get(encoding, (3, ""))[0]
    rows = np.random.default_rng(1).integers(0, 256, (height, step), np.uint8)
    data = np.roll(rows, 3 * shift, axis=1).reshape(-1)
    return _make(
        IMAGE, header=_header("eye"), height=height, width=width, encoding=encoding,
        is_bigendian=0, step=step, data=data,
    )  # fmt: skip


def take_image(data: bytes) -> None:
    """An image of the left camera, of a head that works."""
    message = _decoded(IMAGE, data)
    if message is not None:
        head = _head()
        head.reset()
        with contextlib.suppress(PeopleLocError):
            head.take_image("right", _image(message.encoding, shift=-1))
        head.take_image("left", message)


INFO = "sensor_msgs/msg/CameraInfo"


def _info(tx: float = 0.0, **fields: Any) -> Any:
    f, cx, cy = 30.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    values = {
        "header": _header("eye"), "height": HEIGHT, "width": WIDTH,
        "distortion_model": "plumb_bob", "d": np.zeros(5),
        "k": np.array([f, 0, cx, 0, f, cy, 0, 0, 1.0]), "r": np.eye(3).reshape(-1),
        "p": np.array([f, 0, cx, tx, 0, f, cy, 0, 0, 0, 1.0, 0]),
        "binning_x": 0, "binning_y": 0, "roi": _make("sensor_msgs/msg/RegionOfInterest", **roi),
    }  # fmt: skip
    return _make(INFO, **values | fields)


@lru_cache
def _head(rectified: bool = True) -> Head:
    """A head with the calibration of both cameras."""
    made = Head("robot_a", RobotConfig.from_mapping({"images.rectified": rectified}))
    made.take_camera_info("left", _info())
    made.take_camera_info("right", _info(-3.0))
    return made


def take_camera_info(data: bytes) -> None:
    """Calibration of one camera of a head, whose images then come; the first byte says which."""
    message = _decoded(INFO, data[1:])
    if message is None:
        return
    which = data[0]
    right, rectified = which & 1, not which & 2
    head = Head("robot_a", RobotConfig.from_mapping({"images.rectified": rectified}))
    infos = {"left": _info(), "right": _info(-3.0)}
    infos["right" if right else "left"] = message
    if which & 4:  # both of this size
        for info in infos.values():
            info.width, info.height = message.width, message.height
    for camera, info in infos.items():
        with contextlib.suppress(PeopleLocError):
            head.take_camera_info(camera, info)
    width, height = int(message.width), int(message.height)
    if not which & 4 or not 0 < width * height <= 100_000:
        width, height = WIDTH, HEIGHT
    for camera in infos:
        with contextlib.suppress(PeopleLocError):
            shift = -(camera == "right")
            head.take_image(camera, _image(width=width, height=height, shift=shift))


ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped"


def _pose(x: float = 1.0, y: float = 2.0, yaw: float = 0.5) -> Any:
    turn = {"x": 0.0, "y": 0.0, "z": np.sin(yaw / 2), "w": np.cos(yaw / 2)}
    pose = _make(
        "geometry_msgs/msg/Pose",
        position=_make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=_make("geometry_msgs/msg/Quaternion", **turn),
    )
    covariance = 0.01 * np.eye(6).reshape(-1)
    return _make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance)


def _twist() -> Any:
    zero = _make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    twist = _make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
    covariance = np.zeros(36)
    return _make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance)


def _odometry(frame_id: str, child: str) -> Any:
    return _make(
        ODOMETRY, header=_header(frame_id), child_frame_id=child, pose=_pose(), twist=_twist()
    )


def take_pose(data: bytes) -> None:
    """Odometry or a pose (by the first byte), and what the robot and the planner do with it."""
    message = _decoded(ODOMETRY if data[:1] == b"o" else POSE, data[1:])
    if message is None:
        return
    pose = messages.read_pose(message, "robot_a/base_link")
    intake = PoseIntake(PoseInput(map_from_odom=(1.0, 2.0, 0.5)))
    buffer = PoseBuffer()
    for stamp_ns in (STAMP_NS, STAMP_NS + 20_000_000):
        buffer.add(Pose(stamp_ns, 0.0, 0.0, 0.0))
    with contextlib.suppress(PeopleLocError):
        taken = intake(pose, message.header.frame_id)
        if taken is not None:
            buffer.add(taken)
    for stamp_ns in (STAMP_NS + 5_000_000, STAMP_NS + 100_000_000, pose.stamp_ns + 1):
        with contextlib.suppress(PeopleLocError):
            buffer.at(stamp_ns, 250_000_000)


TRANSFORM = "geometry_msgs/msg/TransformStamped"


def take_transform(data: bytes) -> None:
    """What TF says."""
    message = _decoded(TRANSFORM, data)
    if message is not None:
        messages.read_transform(message, (0.1, 0.1, 0.1))


def _transform() -> bytes:
    pose = _pose().pose
    transform = _make(
        "geometry_msgs/msg/Transform",
        translation=_make("geometry_msgs/msg/Vector3", x=1.0, y=2.0, z=0.0),
        rotation=pose.orientation,
    )
    fields = {"header": _header(), "child_frame_id": "robot_a/base_link", "transform": transform}
    return _encoded(TRANSFORM, _make(TRANSFORM, **fields))


POINTS = "sensor_msgs/msg/PointCloud2"


def _points(bodies: bool, count: int = 12) -> Any:
    dtype = BODY_DTYPE if bodies else CELL_DTYPE
    cells = np.zeros(count, dtype)
    cells["x"], cells["y"] = 2.0, 0.05 * np.arange(count)
    cells["z"], cells["z_min"], cells["top"], cells["count"] = 1.3, 0.3, 1.7, 20
    if bodies:
        cells["body"], cells["score"] = 1, 3.0
        cells["sigma_range"], cells["sigma_across"] = 0.1, 0.05
    codes = {"f": 7, "u": 6}
    fields = [
        _make("sensor_msgs/msg/PointField", name=name, offset=4 * i, datatype=codes[dtype[i].kind],
              count=1)
        for i, name in enumerate(dtype.names or ())
    ]  # fmt: skip
    return _make(
        POINTS, header=_header("robot_a/base_link"), height=1, width=count, fields=fields,
        is_bigendian=False, point_step=dtype.itemsize, row_step=dtype.itemsize * count,
        data=np.frombuffer(cells.tobytes(), np.uint8), is_dense=True,
    )  # fmt: skip


def take_scan(data: bytes) -> None:
    """A scan, and people from it, by both methods."""
    message = _decoded(POINTS, data)
    if message is None:
        return
    scan = messages.read_scan(message, "robot_a")
    pose = Pose(scan.stamp_ns, 1.0, 2.0, 0.5, 0.01 * np.eye(3))
    Planner(PlannerConfig()).step([scan], {"robot_a": pose}, scan.stamp_ns)


GRID = "nav_msgs/msg/OccupancyGrid"


def take_grid(data: bytes) -> None:
    """A map of walls, and people beside them by both methods, in view of two robots."""
    message = _decoded(GRID, data)
    if message is None:
        return
    planner = Planner(PlannerConfig())
    planner.take_grid(messages.read_occupancy_grid(message, "map"))
    scans = []
    for robot, bodies in (("robot_a", True), ("robot_b", False)):
        cloud = _points(bodies)
        cloud.header.frame_id = f"{robot}/base_link"
        scans.append(messages.read_scan(cloud, robot))
    poses = {scan.robot: Pose(scan.stamp_ns, 1.0, 2.0, 0.5) for scan in scans}
    planner.step(scans, poses, STAMP_NS)


def _grid() -> bytes:
    data = np.zeros((30, 40), np.int8)
    data[0], data[-1], data[:, 0], data[5:9, 7:12] = 100, -1, 60, 100
    time = _make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    info = _make("nav_msgs/msg/MapMetaData", map_load_time=time, resolution=0.1, width=40,
                 height=30, origin=_pose().pose)  # fmt: skip
    return _encoded(GRID, _make(GRID, header=_header(), info=info, data=data.reshape(-1)))


PEOPLE = "mrs_people_msgs/msg/People"


def take_people(data: bytes) -> None:
    """What a planner said: which scans it used, and whom it found."""
    message = _decoded(PEOPLE, data)
    if message is not None:
        with contextlib.suppress(PeopleLocError):
            messages.read_people_scans(message)
        read_estimate(message)


def _people() -> bytes:
    time, duration = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"
    scan = _make("mrs_people_msgs/msg/RobotScan", robot="robot_a",
                 stamp=_make(time, sec=1, nanosec=2), pose=_pose())  # fmt: skip
    person = _make(
        "mrs_people_msgs/msg/Person", id=0, pose=_pose(), velocity=_twist(), height=1.7, sigma=0.1,
        robots=["robot_a"], age=_make(duration, sec=0, nanosec=0), coasting=False,
    )  # fmt: skip
    group = _make(
        "mrs_people_msgs/msg/Group", id=0, size=1, centre=_pose(), velocity=_twist(), radius=1.0,
        rms_spread=1.0, members=np.zeros(0, np.uint32), stragglers=np.zeros(0, np.uint32),
        straggling_for=[],
    )  # fmt: skip
    said = _make(PEOPLE, header=_header(), scans=[scan], persons=[person], groups=[group])
    return _encoded(PEOPLE, said)


# ---------------------------------------------------------------------------------------- files


@lru_cache(maxsize=1)
def _folder() -> Path:
    """A folder of this process; in memory, where there is such a thing."""
    memory = Path("/dev/shm")
    made = tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)
    _folder_ends.append(made)
    return Path(made.name)


_folder_ends: list[Any] = []


def take_team(data: bytes) -> None:
    """A team's parameter file."""
    path = _folder() / "team.yaml"
    path.write_bytes(data)
    for read in (partial(load_team, robots=("robot_a", "site/robot_b")), robots_named):
        with contextlib.suppress(PeopleLocError):
            read(path)


_TEAMS = (
    """\
/**/robot_node:
  ros__parameters: {images: {top: true}, mounting: {height: 1.2, pitch: -0.1}, zones.low: 0.3}
/robot_a/robot_node:
  ros__parameters: {pose: {source: static, static: [1.0, 2, 0.5]}, disparity.block_size_px: 15}
/**/planner_node:
  ros__parameters: {robots: [robot_a, site/robot_b], interval: {max_wait: 0.1}}
""",
    "/*:\n  ros__parameters:\n    bodies:\n      search: false # paper\n      max_range: 6\n",
)


def _read_bag(path: Path) -> None:
    """All that the tools ask of a bag."""
    with BagReader(path) as bag:
        robots_of(bag)
        for topic in bag.topics.values():
            bag.type_hash(topic.type)
        for read in (read_truth, lambda b: list(b.decoded())):
            with contextlib.suppress(PeopleLocError):
                read(bag)


def take_mcap(data: bytes) -> None:
    """One file in mcap."""
    path = _folder() / "bag.mcap"
    path.write_bytes(data)
    _read_bag(path)


def take_sqlite(data: bytes) -> None:
    """One file in SQLite."""
    path = _folder() / "bag.db3"
    path.write_bytes(data)
    _read_bag(path)


def take_metadata(data: bytes) -> None:
    """The metadata of a folder whose data file is whole; the first byte says of which kind."""
    plugin = "sqlite3" if data[:1] == b"s" else "mcap"
    folder = _folder() / plugin / "bag"
    if not folder.exists():
        folder.parent.mkdir()
        _small_bag(folder, plugin)
    (folder / "metadata.yaml").write_bytes(data[1:])
    _read_bag(folder)


def _small_bag(path: Path, plugin: str) -> Path:
    """A bag with a message or two of each kind that the tools read."""
    kinds = {
        "/robot_a/odom": (ODOMETRY, _odometry("map", "robot_a/base_link")),
        "/robot_a/left/image_rect": (IMAGE, _image(width=4, height=3)),
        "/robot_a/right/image_rect": (IMAGE, _image(width=4, height=3)),
        "/robot_b/points": (POINTS, _points(bodies=False, count=2)),
        "/ground_truth/people_poses": (
            "geometry_msgs/msg/PoseArray",
            _make("geometry_msgs/msg/PoseArray", header=_header(), poses=[_pose().pose]),
        ),
        "/ground_truth/visible": (
            "std_msgs/msg/Int32MultiArray",
            _make(
                "std_msgs/msg/Int32MultiArray",
                layout=_make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0),
                data=np.array([7], np.int32),
            ),
        ),
    }
    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin.upper()]) as writer:
        for step, (topic, (kind, message)) in enumerate(kinds.items()):
            made = writer.add_connection(topic, kind, typestore=default_typestore())
            writer.write(made, STAMP_NS + step, _encoded(kind, message))
    return path


def _bag_seeds(plugin: str, *, metadata: bool = False) -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        bag = _small_bag(Path(folder, "bag"), plugin)
        if metadata:
            return [plugin[:1].encode() + (bag / "metadata.yaml").read_bytes()]
        (file,) = (f for f in bag.iterdir() if f.name != "metadata.yaml")
        seeds = [file.read_bytes()]
        if plugin == "mcap":
            plain = Path(folder, "plain.mcap")
            with BagWriter(plain) as out:
                out.write("/talk", STAMP_NS, _make("std_msgs/msg/String", data="hello"))
            seeds.append(plain.read_bytes())
        return seeds


def _infos() -> list[bytes]:
    raw = _info(d=np.array([-0.2, 0.05, 0.001, -0.001, 0.0]))
    eye = _info(distortion_model="equidistant", d=np.array([-0.01, 0.002, 0.0, 0.0]))
    made = ((0, _info()), (1, _info(-3.0)), (2, raw), (6, eye), (5, _info(-3.0)))
    return [bytes([which]) + _encoded(INFO, info) for which, info in made]


def _poses() -> list[bytes]:
    odometry = [_odometry("map", "robot_a/base_link"), _odometry("odom", "base_footprint")]
    pose = _make(POSE, header=_header(), pose=_pose())
    return [*(b"o" + _encoded(ODOMETRY, each) for each in odometry), b"p" + _encoded(POSE, pose)]


TARGETS: Mapping[str, Target] = {
    "image": Target(
        take_image,
        lambda: [_encoded(IMAGE, _image(encoding)) for encoding in messages.ENCODINGS],
        8_000,
        1_000,
    ),
    "camera_info": Target(take_camera_info, _infos, 1_000, 300),
    "pose": Target(take_pose, _poses, 1_200, 3_000),
    "transform": Target(take_transform, lambda: [_transform()], 300, 5_000),
    "scan": Target(
        take_scan, lambda: [_encoded(POINTS, _points(b)) for b in (False, True)], 2_000, 2_000
    ),
    "grid": Target(take_grid, lambda: [_grid()], 3_000, 300),
    "people": Target(take_people, lambda: [_people()], 3_000, 3_000),
    "team": Target(take_team, lambda: [text.encode() for text in _TEAMS], 1_000, 300),
    "mcap": Target(take_mcap, lambda: _bag_seeds("mcap"), 60_000, 100),
    "sqlite": Target(take_sqlite, lambda: _bag_seeds("sqlite3"), 60_000, 30),
    "metadata": Target(
        take_metadata,
        lambda: _bag_seeds("mcap", metadata=True) + _bag_seeds("sqlite3", metadata=True),
        60_000,
        100,
    ),
}
