"""What the fuzzer hands bytes to: every way by which something from outside comes in.

Each target takes bytes and must raise nothing but `PeopleLocError`; each has seeds, made of what is
right. Messages come as they do on the wire (CDR), so that lengths and numbers of all sizes occur.
"""

from __future__ import annotations

import contextlib
import io
import json
import struct
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import rich.console
from rosbags.rosbag2 import StoragePlugin, Writer

from mrs_people_loc import messages
from mrs_people_loc.config import PlannerConfig, PoseInput, RobotConfig, load_team, robots_named
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.tour import check_tour, read_tour
from mrs_people_loc.head import Head
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.robot_localization import PoseIntake
from mrs_people_loc.localization.walls.known import read_walls, walls_of_grid
from mrs_people_loc.localization.walls.sonar import SonarTuning, SonarWalls
from mrs_people_loc.messages import read_people, read_tour_path
from mrs_people_loc.messages.scans import MAX_CELLS
from mrs_people_loc.planner import Planner
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE
from mrs_people_loc.team.intervals import IntervalCollector
from mrs_people_loc.team.poses import Pose, PoseBuffer
from mrs_people_sim.estimates import read_estimate
from mrs_people_sim.evaluation.labels import read_labels
from mrs_people_sim.layouts import expand
from mrs_people_sim.scene import load_scene
from mrs_studies.recordings.mrclam import MrclamTuning, convert_mrclam
from mrs_studies.recordings.oak import read_oak_calibration
from mrs_studies.recordings.pcd import read_rgbd
from mrs_tools.bags.message_types import default_typestore
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.sources import robots_of
from mrs_tools.bags.truth import read_truth
from mrs_tools.bags.writer import BagWriter
from mrs_tools.diagnosis.diagnose import diagnose
from mrs_tools.diagnosis.facts import Facts, figures
from mrs_tools.live.people_table import LivePeople
from mrs_tools.view import protocol

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


def _points(bodies: bool, count: int = 12, sigma: float = 0.1) -> Any:
    dtype = BODY_DTYPE if bodies else CELL_DTYPE
    cells = np.zeros(count, dtype)
    cells["x"], cells["y"] = 2.0, 0.05 * np.arange(count)
    cells["z"], cells["z_min"], cells["top"], cells["count"] = 1.3, 0.3, 1.7, 20
    if bodies:
        cells["body"], cells["score"] = 1, 3.0
        cells["sigma_range"], cells["sigma_across"] = sigma, sigma / 2
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
    walls_of_grid(messages.read_occupancy_grid(message, "map"), occupied_from=65)


def _grid() -> bytes:
    data = np.zeros((30, 40), np.int8)
    data[0], data[-1], data[:, 0], data[5:9, 7:12] = 100, -1, 60, 100
    time = _make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    info = _make("nav_msgs/msg/MapMetaData", map_load_time=time, resolution=0.1, width=40,
                 height=30, origin=_pose().pose)  # fmt: skip
    return _encoded(GRID, _make(GRID, header=_header(), info=info, data=data.reshape(-1)))


RANGE = "sensor_msgs/msg/Range"
LASER = "sensor_msgs/msg/LaserScan"


def take_range(data: bytes) -> None:
    """A range of a sonar, four times, of a robot that drives past what it measures."""
    message = _decoded(RANGE, data)
    if message is None:
        return
    measured, walls = messages.read_range(message), SonarWalls(SonarTuning(least=2, period_s=0.0))
    for k in range(4):
        stamp_ns = measured.stamp_ns + k * 50_000_000
        walls.take(measured, (0.1, 0.2, 1.5), Odometry(stamp_ns, 0.1 * k, 0, 0, 1e-4 * k, 1e-5 * k))


def _range() -> bytes:
    return _encoded(RANGE, _make(
        RANGE, header=_header("robot_a/sonar"), radiation_type=0, field_of_view=0.5, min_range=0.1,
        max_range=4.0, range=1.5, variance=0.0,
    ))  # fmt: skip


def take_laser(data: bytes) -> None:
    """A scan of a laser scanner."""
    message = _decoded(LASER, data)
    if message is not None:
        messages.read_laser_scan(message)


def _laser() -> bytes:
    return _encoded(LASER, _make(
        LASER, header=_header("robot_a/laser"), angle_min=-1.0, angle_max=1.0, angle_increment=0.1,
        time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=8.0,
        ranges=np.linspace(1, 9, 21, dtype=np.float32), intensities=np.empty(0, np.float32),
    ))  # fmt: skip


PEOPLE = "mrs_people_msgs/msg/People"


def take_people(data: bytes) -> None:
    """What a planner said: which scans it used, and whom it found."""
    message = _decoded(PEOPLE, data)
    if message is not None:
        with contextlib.suppress(PeopleLocError):
            messages.read_people_scans(message)
        with contextlib.suppress(PeopleLocError):
            read_people(message, "map")
        read_estimate(message)


def _people(stragglers: int = 0, words: str = "") -> bytes:
    time, duration = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"
    scan = _make("mrs_people_msgs/msg/RobotScan", robot="robot_a",
                 stamp=_make(time, sec=1, nanosec=2), pose=_pose())  # fmt: skip
    person = _make(
        "mrs_people_msgs/msg/Person", id=0, pose=_pose(), velocity=_twist(), height=1.7, sigma=0.1,
        robots=["robot_a" + words], age=_make(duration, sec=0, nanosec=0), coasting=False,
    )  # fmt: skip
    hidden = _make(
        "mrs_people_msgs/msg/HiddenPerson", person=person, last_seen=_make(time, sec=1, nanosec=2),
        last_seen_at=person.pose.pose.position,
    )  # fmt: skip
    group = _make(
        "mrs_people_msgs/msg/Group", id=0, size=1, centre=_pose(), velocity=_twist(), radius=1.0,
        rms_spread=1.0, members=np.zeros(0, np.uint32),
        stragglers=np.arange(stragglers, dtype=np.uint32),
        straggling_for=[_make(duration, sec=3, nanosec=0)] * stragglers,
    )  # fmt: skip
    reported = _make(
        PEOPLE, header=_header(), scans=[scan], persons=[person], hidden=[hidden], groups=[group],
        quarantined=["robot_b"],
    )  # fmt: skip
    return _encoded(PEOPLE, reported)


PATH = "nav_msgs/msg/Path"


def take_path(data: bytes) -> None:
    """A tour as a path."""
    message = _decoded(PATH, data)
    if message is not None:
        read_tour_path(message, "map")


def _path() -> bytes:
    stamped = "geometry_msgs/msg/PoseStamped"
    poses = [_make(stamped, header=_header(), pose=_pose(x, 0.0).pose) for x in (0.0, 3.0)]
    return _encoded(PATH, _make(PATH, header=_header(), poses=poses))


TEAM_POSE = "mrs_people_msgs/msg/TeamPose"
RELATIVE_POSES = "mrs_people_msgs/msg/RelativePoses"


def take_team_pose(data: bytes) -> None:
    """What a team-mate says of where it is."""
    message = _decoded(TEAM_POSE, data)
    if message is not None:
        messages.read_team_pose(message, "map")


def _team_pose() -> bytes:
    stamp = _header().stamp
    walls = [
        _make(
            "mrs_people_msgs/msg/Wall", stamp=stamp, distance=distance, bearing=1.0,
            covariance=np.array([0.01, 0.001, 0.002]), from_m=-1.0, to_m=2.0, ends_at_from=False,
            ends_at_to=True,
        )
        for distance in (0.5, 3.0)
    ]  # fmt: skip
    told = _make(
        TEAM_POSE, header=_header(), robot="robot_b", pose=_pose(), odometry_x=1.0, odometry_y=2.0,
        odometry_yaw=0.5, position_variance=0.01, heading_variance=0.01, walls=walls,
        status=1, doubted=["robot_a"], covariance_in_team=0.01 * np.eye(3).reshape(-1),
        absolute=[_make(POSE, header=_header(), pose=_pose())],
    )  # fmt: skip
    return _encoded(TEAM_POSE, told)


def take_relative_poses(data: bytes) -> None:
    """Where robots are to each other, as the planner says."""
    message = _decoded(RELATIVE_POSES, data)
    if message is not None:
        messages.read_relative_poses(message)


def _relative_poses() -> bytes:
    stamp = _header().stamp
    pose = _make(
        "mrs_people_msgs/msg/RelativePose", stamp=stamp, robot="robot_a", other_stamp=stamp,
        other="robot_b", x=1.0, y=2.0, yaw=0.5, covariance=0.01 * np.eye(3).reshape(-1),
        inflated=2.0,
    )  # fmt: skip
    person = _make(
        "mrs_people_msgs/msg/StandingPerson", stamp=stamp, robot="robot_a", x=1.0, y=2.0,
        covariance=np.array([0.01, 0.0, 0.01]), inflated=2.0,
    )  # fmt: skip
    message = _make(RELATIVE_POSES, header=_header(), poses=[pose, pose], standing=[person])
    return _encoded(RELATIVE_POSES, message)


DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


class _Ear:
    """A node, as far as `LivePeople` needs one: what it listens to, by type."""

    def __init__(self) -> None:
        self.callbacks: dict[str, Callable[[Any], None]] = {}

    def create_subscription(
        self, kind: Any, _topic: str, callback: Callable[[Any], None], _qos: Any
    ) -> None:
        self.callbacks[kind.__name__] = callback

    def create_timer(self, *_args: Any, **_kwargs: Any) -> None:
        pass

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=STAMP_NS))


def take_shown(data: bytes) -> None:
    """What `mrs people` shows of a people message or of diagnostics (by the first byte)."""
    kind = PEOPLE if data[:1] == b"p" else DIAGNOSTICS
    message = _decoded(kind, data[1:])
    if message is None:
        return
    if kind == DIAGNOSTICS:
        _as_rclpy(message)
    ear: Any = _Ear()
    live = LivePeople(ear)
    for one in (_decoded(PEOPLE, _people()), message, message):
        ear.callbacks[one.__msgtype__.rpartition("/")[2]](one)
    rich.console.Console(file=io.StringIO(), width=100).print(live)


def take_diagnosed(data: bytes) -> None:
    """What `mrs doctor` makes of diagnostics."""
    message = _decoded(DIAGNOSTICS, data)
    if message is None:
        return
    facts = Facts(0, ["/planner_node", "/robot_a/robot_node"])
    for status in message.status:
        values = {entry.key: entry.value for entry in status.values}
        node, _, subject = status.name.partition(": ")
        facts.reports.setdefault(node, {})[subject] = ("warning", status.message, values)
    diagnose(facts)
    figures(facts)


def _as_rclpy(message: Any) -> None:
    """rclpy has bytes where rosbags has numbers."""
    for status in message.status:
        object.__setattr__(status, "level", bytes([int(status.level) & 255]))


def _diagnostics() -> bytes:
    reports = {
        "/planner_node: robot robot_a": {"scan_hz": "5.0", "age_s": "0.1"},
        "/robot_a/robot_node: scan": {"disparity_ms": "4.0"},
        "/robot_a/robot_node: state": {"cpu_percent": "50"},
    }
    status = [
        _make(
            "diagnostic_msgs/msg/DiagnosticStatus", level=1, name=name, message="found no pair",
            hardware_id="",
            values=[
                _make("diagnostic_msgs/msg/KeyValue", key=k, value=v) for k, v in reported.items()
            ],
        )
        for name, reported in reports.items()
    ]  # fmt: skip
    return _encoded(DIAGNOSTICS, _make(DIAGNOSTICS, header=_header(), status=status))


# ------------------------------------------------------------------------------------ over time

_CELLS = struct.Struct("<HBBbb")


def take_full_scan(data: bytes) -> None:
    """A scan as large as any may be: six bytes each say where so many cells are, and how close."""
    parts = [_CELLS.unpack_from(data, at) for at in range(0, len(data) - 5, 6)]
    left, places, bodies = MAX_CELLS, [], []
    for number, (count, spread, of_body, x, y) in enumerate(parts):
        count = min(count, left)
        left -= count
        rng = np.random.default_rng([count, spread, number])
        size = 0.01 * spread**2 / 50  # from one point to 13 m
        middle = np.array([x, y]) / 10
        places.append(middle + rng.uniform(-size, size, (count, 2)))
        bodies.append(np.full(count, of_body % 120))
    cells = np.zeros(MAX_CELLS - left, BODY_DTYPE)
    if not cells.size:
        return
    cells["x"], cells["y"] = np.concatenate(places).T
    cells["z"], cells["z_min"], cells["top"], cells["count"] = 1.3, 0.3, 1.7, 20
    cells["body"], cells["score"] = np.concatenate(bodies), 3.0
    cells["sigma_range"], cells["sigma_across"] = 0.1, 0.05
    message = _points(bodies=True)
    message.width = len(cells)
    message.row_step = cells.nbytes
    message.data = np.frombuffer(cells.tobytes(), np.uint8)
    scan = messages.read_scan(message, "robot_a")
    pose = Pose(scan.stamp_ns, 1.0, 2.0, 0.5, 0.01 * np.eye(3))
    Planner(PlannerConfig()).step([scan], {"robot_a": pose}, scan.stamp_ns)


def _full_scans() -> list[bytes]:
    spread_out = b"".join(_CELLS.pack(500, 30, 0, 4 * n - 60, 5 * n % 70) for n in range(30))
    of_bodies = b"".join(_CELLS.pack(60, 20, n, 2 * n - 60, 7 * n % 90) for n in range(1, 60))
    return [spread_out, of_bodies]


_EVENT = struct.Struct("<BBhhhb")


def take_sequence(data: bytes) -> None:
    """Poses and scans of three robots over time, by nine bytes each.

    The first byte says of which robot and which of these, and how unsure it is; the second on what
    scale the time that has gone by, the delay and the place are: near what is usual, or far off.
    """
    collector = IntervalCollector(PlannerConfig().interval, ["robot_a"])
    planner = Planner(PlannerConfig())
    now_ns = STAMP_NS
    for at in range(0, len(data) - _EVENT.size + 1, _EVENT.size):
        which, scales, step, late, x, y = _EVENT.unpack_from(data, at)
        by_time, by_delay, by_place = (10 ** (scales >> k & 3) for k in (0, 2, 4))
        now_ns = max(0, now_ns + round(step * by_time * 1e6))
        stamp_ns = max(0, now_ns - round(late * by_delay * 1e5))
        robot = f"robot_{'abc'[which % 3]}"
        place = (0.001 * x * by_place, 0.05 * y)
        with contextlib.suppress(PeopleLocError):
            if which & 32:
                message = _odometry("map", f"{robot}/base_link")
                message.pose = _pose(*place, yaw=0.1 * y)
                message.pose.covariance *= (1.0, 0.0, 1e14, np.nan)[which >> 6]
                message.header.stamp = _stamp(stamp_ns)
                collector.add_pose(robot, messages.read_pose(message), now_ns)
            else:
                cloud = _points(bool(which & 16), which & 15, (0.1, 1e-9, 1e9, 1e-30)[which >> 6])
                cloud.header.frame_id = f"{robot}/base_link"
                cloud.header.stamp = _stamp(stamp_ns)
                collector.add_scan(messages.read_scan(cloud, robot), now_ns)
        closed = collector.close(now_ns)
        if closed is None or not closed.scans:
            continue
        people = planner.step(closed.scans, closed.all_poses, closed.time_ns)
        for person in people.persons:
            assert np.isfinite(person.position).all(), person
            assert np.isfinite(person.covariance).all(), person
        ids = [person.id for person in people.persons]
        assert len(set(ids)) == len(ids), ids
        known = {*ids, *(who for group in people.groups for who in group.stragglers)}
        assert known == set(ids), (known, ids)
        collector.clocks_astray(now_ns)


def _stamp(stamp_ns: int) -> Any:
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return _make("builtin_interfaces/msg/Time", sec=sec & 0x7FFFFFFF, nanosec=nanosec)


def _sequences() -> list[bytes]:
    """Two robots that stand, and see the same; one that drives."""
    both = [
        event
        for step in range(30)
        for robot in (0, 1)
        for event in (
            _EVENT.pack(32 | robot + 30, 0, 50, 10, 10 * step * robot, robot),
            _EVENT.pack(12 | (16 if robot else 0), 0, 50, 60, 0, 0),
        )
    ]
    return [b"".join(both)]


# ------------------------------------------------------------------------------------- the page


def take_command(data: bytes) -> None:
    """A command of the page of `mrs view`; what refuses it can be sent."""
    try:
        protocol.read_command(data.decode())
    except UnicodeDecodeError:
        return  # WebSockets refuse it
    except protocol.CommandError as err:
        protocol.encode(protocol.Answer(type="answer", ok=False, text=str(err))).encode()
        raise


_COMMANDS = (
    '{"type": "look", "cells": true, "robots": ["robot_a", "site/robot_b"]}',
    '{"type": "speed", "speed": 2.5}',
    '{"type": "seek", "t": 1700000000.5}',
    '{"type": "tour", "start": "hall"}',
    '{"type": "tour", "cancel": true}',
    '{"type": "stop"}',
    '{"type": "release"}',
)


# ---------------------------------------------------------------------------------------- files


def take_labels(data: bytes) -> None:
    """The hand labels of a recording."""
    path = _folder() / "bag.labels.json"
    path.write_bytes(data)
    labels = read_labels(path)
    labels.check_span(STAMP_NS, STAMP_NS + 10**9)
    labels.truth(trunk=True)


def _labels() -> list[bytes]:
    """Two people in one of three frames; and nobody."""
    person = {
        "frame": 1, "id": 1, "head": [1.5, -2], "trunk": [1.4, -2.0], "must": True,
        "posture": "walks", "source": "head",
    }  # fmt: skip
    people = [person, {**person, "id": 0, "trunk": None, "must": False, "posture": "sits"}]
    room = {"first_ns": STAMP_NS, "step_ns": 200_000_000, "frames": 3, "follow": True}
    return [json.dumps({**room, "people": each}).encode() for each in (people, [])]


def take_oak(data: bytes) -> None:
    """The calibration of an OAK-D."""
    path = _folder() / "calib.json"
    path.write_bytes(data)
    read_oak_calibration(path)


def _oak() -> list[bytes]:
    def camera(focal: float) -> dict[str, Any]:
        return {
            "intrinsicMatrix": [[focal, 0, 63.5], [0, focal, 39.5], [0, 0, 1]],
            "distortionCoeff": [-0.2, 0.05] + [0.0] * 12, "width": 128, "height": 80,
        }  # fmt: skip

    extrinsics = {
        "rotationMatrix": np.eye(3).tolist(),
        "translation": {"x": -7.5, "y": 0.2, "z": -0.1},
        "toCameraSocket": 2,
    }
    document = {
        "cameraData": [[1, {**camera(63.0), "extrinsics": extrinsics}], [2, camera(66.0)]],
        "stereoRectificationData": {"leftCameraSocket": 1, "rightCameraSocket": 2},
    }
    return [json.dumps(document).encode()]


#: The files of a data set of MRCLAM with one robot.
_MRCLAM = (
    "Barcodes", "Landmark_Groundtruth", "Robot1_Groundtruth", "Robot1_Odometry",
    "Robot1_Measurement",
)  # fmt: skip


def take_mrclam(data: bytes) -> None:
    """A data set of MRCLAM: its files, with form feeds between them."""
    folder = _folder()
    for name in _MRCLAM:
        part, _, data = data.partition(b"\f")
        (folder / f"{name}.dat").write_bytes(part)
    with tempfile.TemporaryDirectory() as out:
        convert_mrclam(folder, Path(out) / "bag.mcap", MrclamTuning(longest_s=5.0))


def _mrclam() -> list[bytes]:
    parts = (
        "1 5\n6 72 # a landmark\n", "6 2.5 -1 0 0\n", "1.5 0 0 3.1\n2.5 0.1 0 -3.1\n4 0.2 0 3\n",
        "1.25 0.1 0.5\n1.25 0.1 0\n3 0 0\n", "2 72 1.5 -0.25\n2.001 72 1.5 0\n2.5 43 1 0\n",
    )  # fmt: skip
    return ["\f".join(parts).encode()]


def take_pcd(data: bytes) -> None:
    """A cloud of points with colours."""
    path = _folder() / "frame.pcd"
    path.write_bytes(data)
    read_rgbd(path)


def _pcds() -> list[bytes]:
    header = (
        b"VERSION 0.7\nFIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 4\n"
        b"HEIGHT 3\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 12\nDATA "
    )
    points = np.zeros(12, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgba", "<u4")])
    points["z"], points["rgba"] = np.arange(12), 0x646464
    lines = "".join(f"1 1 {z} 6579300\n" for z in range(12)).encode()
    return [header + b"ascii\n" + lines, header + b"binary\n" + points.tobytes()]


def take_scene(data: bytes) -> None:
    """A scene that is to be drawn, up to where everything in it has its place."""
    path = _folder() / "scene.yaml"
    path.write_bytes(data)
    expand(load_scene(path))


_SCENES = (
    """\
name: two_people
seed: 7
timing: {frames: 5, rate: 10.0}
room: {length: 8.0, width: 7.0}
furniture: [{kind: table, x: 2.6, y: 1.3}]
people:
  - {x: 3.0, y: 3.5, yaw: 0.0}
  - {path: [1.0, 1.0, 5.0, 2.0], speed: 1.1}
robots:
  robot_a: {x: 6.3, y: 3.5, yaw: 3.14, head: {pitch: 0.3, height: 1.5}}
head: {baseline: 0.10}
imaging: {noise: 2.0}
odometry: {mode: exact}
layout: {people: 4, robots: 2, furniture: 3, clutter: 2}
""",
    "layout: {people: 5, robots: 3, activity: group}\nwalk: {gap: 0.6}\nroom: {length: 20.0}\n",
    "layout: {people: 5, robots: 3, activity: tour, heads: mixed}\n",
)


@lru_cache(maxsize=1)
def _folder() -> Path:
    """A folder of this process; in memory, where there is such a thing."""
    memory = Path("/dev/shm")
    made = tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)
    _folder_ends.append(made)
    return Path(made.name)


_folder_ends: list[Any] = []


_WALLS = (
    "walls: [[0.0, 0.0, 20.0, 0.0], [20.0, 0.0, 20.0, 8.0]]",
    "walls:\n- [0, 1, 2, 3]\n- [-1.0e+3, .5, 7, 9]\nsigma: 0.05",
)


def take_walls(data: bytes) -> None:
    """A file of known walls."""
    with tempfile.NamedTemporaryFile(suffix=".yaml") as file:
        file.write(data)
        file.flush()
        read_walls(file.name)


def take_team(data: bytes) -> None:
    """A team's parameter file."""
    path = _folder() / "team.yaml"
    path.write_bytes(data)
    for read in (partial(load_team, robots=("robot_a", "site/robot_b")), robots_named):
        with contextlib.suppress(PeopleLocError):
            read(path)


def take_tour(data: bytes) -> None:
    """The file of a tour."""
    path = _folder() / "tour.yaml"
    path.write_bytes(data)
    check_tour(read_tour(path), FreeSpace.unbounded(), 0.35)


_TOURS = (
    """\
name: hall
points: [[0.0, 0.0], [12.0, 0.0], [12, 8.0]]
stops: [{name: Foyer, at: [12.0, 0.5], wait: 10.0}, {name: End, at: [12.0, 8.0]}]
speed: 0.5
""",
    "points:\n- [0, 1]\n- [2, 3]\nframe: site/map\n",
)

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
    "range": Target(take_range, lambda: [_range()], 300, 3_000),
    "laser": Target(take_laser, lambda: [_laser()], 1_000, 3_000),
    "tour": Target(take_tour, lambda: [text.encode() for text in _TOURS], 1_000, 300),
    "path": Target(take_path, lambda: [_path()], 1_000, 1_000),
    "people": Target(take_people, lambda: [_people(), _people(2)], 3_000, 3_000),
    "team_pose": Target(take_team_pose, lambda: [_team_pose()], 1_500, 3_000),
    "relative_poses": Target(take_relative_poses, lambda: [_relative_poses()], 800, 3_000),
    "shown": Target(
        take_shown, lambda: [b"p" + _people(2, "[/b]\x1b[1m"), b"d" + _diagnostics()], 3_000, 300
    ),
    "diagnosed": Target(take_diagnosed, lambda: [_diagnostics()], 3_000, 3_000),
    "command": Target(take_command, lambda: [text.encode() for text in _COMMANDS], 4_096, 3_000),
    "full_scan": Target(take_full_scan, _full_scans, 600, 20),
    "sequence": Target(take_sequence, _sequences, 1_100, 40),
    "labels": Target(take_labels, _labels, 1_000, 500),
    "oak": Target(take_oak, _oak, 3_000, 500),
    "mrclam": Target(take_mrclam, _mrclam, 500, 200),
    "pcd": Target(take_pcd, _pcds, 2_000, 1_000),
    "scene": Target(take_scene, lambda: [text.encode() for text in _SCENES], 2_000, 100),
    "walls": Target(take_walls, lambda: [text.encode() for text in _WALLS], 1_000, 300),
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
