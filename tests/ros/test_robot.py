"""robot_node: inputs, outputs, and that they equal those of the method in one process.

One process does all of it; where a parameter takes a new beginning, it is cleaned up and
configured again, as a user does.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.lifecycle.publisher import LifecyclePublisher
from sensor_msgs.msg import Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from mrs_people_loc.config import RobotConfig
from mrs_people_loc.messages import read_scan
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE
from robot_node.node import RobotNode
from ros.harness import OK, WARN, Peer, Team
from ros.recording import (
    DEFAULTS,
    Recording,
    records_of,
    set_stamp,
    stages_of,
    stamp_of,
)
from ros.robot_peer import MutableView, RobotPeer

Change = Callable[..., RobotConfig]
XYZ = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


@pytest.fixture(scope="module")
def robot(team: Team, peer: Peer, recording: Recording) -> RobotPeer:
    """A robot with the default parameters, in a nested namespace."""
    made = RobotPeer(
        peer,
        team.start("robot_node", namespace="/site/robot_a"),
        recording,
        "site/robot_a",
    )
    made.warm_up()
    return made


def _named(params: dict[str, Any]) -> dict[str, Any]:
    return {name.replace("__", "."): value for name, value in params.items()}


def _defaults(names: Iterable[str]) -> dict[str, Any]:
    known = {p.name.replace(".", "__"): p.default for p in RobotConfig.parameters()}
    return {n: [] if known[n] == () else known[n] for n in names}


@pytest.fixture
def live(robot: RobotPeer) -> Iterator[Callable[..., RobotConfig]]:
    """Sets parameters of the running robot, and puts them back at the end."""
    changed: set[str] = set()

    def change(**params: Any) -> RobotConfig:
        changed.update(params)
        robot.peer.must_set(robot.node, **params)
        return RobotConfig.from_mapping(_named(params), base=DEFAULTS)

    yield change
    robot.peer.must_set(robot.node, **_defaults(changed))


@pytest.fixture
def reconfigured(robot: RobotPeer) -> Iterator[Callable[..., RobotConfig]]:
    """Takes the robot through cleanup with other parameters, and back at the end."""
    changed: set[str] = set()

    def change(**params: Any) -> RobotConfig:
        changed.update(params)
        robot.peer.reconfigure(robot.node, **params)
        return RobotConfig.from_mapping(_named(params), base=DEFAULTS)

    yield change
    robot.peer.reconfigure(robot.node, **_defaults(changed))
    robot.warm_up()


def _resized(view: MutableView, scale: int) -> MutableView:
    """The view in images that are larger by a whole factor, each pixel repeated."""
    made = {}
    for camera, (image, info) in view.items():
        pixels = np.frombuffer(bytes(image.data), np.uint8).reshape(image.height, image.width)
        image, info = copy.deepcopy(image), copy.deepcopy(info)
        _set_pixels(image, pixels.repeat(scale, axis=0).repeat(scale, axis=1))
        info.width, info.height = info.width * scale, info.height * scale
        to_large = np.array(
            [[scale, 0, (scale - 1) / 2], [0, scale, (scale - 1) / 2], [0, 0, 1]], dtype=float
        )
        info.p = (to_large @ np.reshape(info.p, (3, 4))).reshape(-1)
        info.k = (to_large @ np.reshape(info.k, (3, 3))).reshape(-1)
        made[camera] = (image, info)
    return made


def _set_pixels(image: Image, pixels: np.ndarray, encoding: str = "mono8", pad: int = 0) -> None:
    """Puts pixels into a message; `pad` bytes of rubbish end each row."""
    height, width = pixels.shape[:2]
    rows = pixels.reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=0xAB)
    image.height, image.width, image.encoding = height, width, encoding
    image.step = rows.shape[1]
    image.data = rows.tobytes()


def _pixels(image: Image) -> np.ndarray:
    return np.frombuffer(bytes(image.data), np.uint8).reshape(image.height, image.width)


# --- points ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("of", ["robot_a", "robot_b", "robot_c"])
def test_points_equal_those_of_the_method_bit_for_bit(robot: RobotPeer, of: str) -> None:
    for frame in (0, 7):
        records = robot.check(DEFAULTS, robot.view(of=of, frame=frame))
        assert len(records) > 20
        assert records.dtype == BODY_DTYPE
        assert records["body"].max() >= 4
        assert (records["sigma_range"] > 0).all()


@pytest.mark.parametrize("of", ["robot_a", "robot_b", "robot_c"])
def test_points_equal_those_of_the_papers_method_bit_for_bit(
    robot: RobotPeer, live: Change, of: str
) -> None:
    config = live(
        bodies__search=False, disparity__block_size_px=15, disparity__fill_block_size_px=0
    )
    for frame in (0, 7):
        records = robot.check(config, robot.view(of=of, frame=frame))
        assert len(records) > 20
        assert records.dtype == CELL_DTYPE


def test_bodies_are_read_back_as_they_were_sent(robot: RobotPeer) -> None:
    """Every field, also as read by the planner."""
    view = robot.view()
    robot.check(DEFAULTS, view)
    sent = stages_of(view, DEFAULTS).scan.cells
    read = read_scan(robot.points[-1], "site/robot_a").cells
    assert len(read) == len(sent) > 20
    for name in BODY_DTYPE.names or ():
        np.testing.assert_array_equal(getattr(read, name), getattr(sent, name))
        assert getattr(read, name).dtype == BODY_DTYPE[name]


def test_scan_has_the_stamp_of_the_left_image(robot: RobotPeer, live: Change) -> None:
    live(images__max_stamp_difference=0.02)
    view = robot.view()
    stamp_ns = stamp_of(view["left"][0])
    set_stamp(view["right"][0], stamp_ns + 15_000_000)
    robot.check(DEFAULTS, view)
    # 5 ms too far: no pair, and the next view is one again.
    far = robot.view(stamp_ns + 100_000_000)
    set_stamp(far["right"][0], stamp_ns + 125_000_000)
    robot.send(far)
    robot.settle()
    robot.check(DEFAULTS, robot.view(stamp_ns + 200_000_000))
    robot._last_ns = stamp_ns + 200_000_000
    assert stamp_of(robot.points[-2]) == stamp_ns
    finding = robot.until_finding("pairs", lambda f: f.count("unpaired") == 2)
    assert finding.level == WARN
    assert finding.message.startswith(
        "2 images found no pair; smallest difference of stamps seen: 0.0250 s; "
        "allowed by images.max_stamp_difference: 0.02 s; trigger the cameras together, or"
    )


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "bgra8"])
@pytest.mark.parametrize("pad", [0, 7])
def test_colour_images_are_converted_to_grey(robot: RobotPeer, encoding: str, pad: int) -> None:
    """Grey is 0.299 R + 0.587 G + 0.114 B, here the recorded image."""
    view, coloured = robot.view(), {}
    rng = np.random.default_rng(1)
    for camera in ("left", "right"):
        image, info = copy.deepcopy(view[camera])
        grey = _pixels(image).astype(float)
        tint = np.minimum(60.0, np.minimum(grey, 255.0 - grey) / 2.0).round()
        tint *= rng.choice([-1, 1], grey.shape)
        red, blue = grey + tint, grey - tint
        green = (grey - (0.299 * red + 0.114 * blue)) / 0.587
        channels = [red, green, blue] if encoding == "rgb8" else [blue, green, red]
        if encoding == "bgra8":
            channels.append(np.full_like(grey, 255))
        _set_pixels(image, np.stack(channels, axis=2).round().astype(np.uint8), encoding, pad)
        coloured[camera] = (image, info)
    records = robot.check(DEFAULTS, coloured)
    plain = stages_of(view, DEFAULTS).scan.cells
    # Rounding to whole levels moves a few matches, no more; swapped channels are noise.
    assert _overlap(_xy(records), np.stack([plain.x, plain.y], axis=1)) > 0.9


def test_padded_image_rows_are_read(robot: RobotPeer) -> None:
    view = robot.view()
    wanted = stages_of(view, DEFAULTS).scan.cells.to_records()
    for camera in ("left", "right"):
        _set_pixels(view[camera][0], _pixels(view[camera][0]), pad=13)
    np.testing.assert_array_equal(robot.check(DEFAULTS, view), wanted)


def test_larger_images_are_scaled_down(robot: RobotPeer) -> None:
    """By two, a power of two, not even rounding differs."""
    view = robot.view()
    wanted = stages_of(view, DEFAULTS).scan.cells
    records = robot.check(DEFAULTS, _resized(view, 2))
    np.testing.assert_array_equal(records, wanted.to_records())


def test_working_size_takes_effect(robot: RobotPeer, live: Change) -> None:
    view = _resized(robot.view(), 2)
    large = {"images__working_width": 320, "images__working_height": 240}
    robot.check(live(**large), view)
    # Each point counts, where no bodies are sought.
    view = _resized(robot.view(), 2)
    records = robot.check(live(**large, bodies__search=False), view)
    small = stages_of(view, RobotConfig.from_mapping({"bodies.search": False}, DEFAULTS)).scan.cells
    assert records["count"].sum() > 3 * small.count.sum()


def test_mounting_moves_the_points(robot: RobotPeer, live: Change) -> None:
    before = robot.check(DEFAULTS)
    after = robot.check(live(mounting__forward=0.3, mounting__yaw=math.pi / 2))
    # What was ahead is now to the left; a quarter turn maps cells onto cells.
    turned = np.stack([0.3 - before["y"], before["x"]], axis=1)
    assert _overlap(_xy(after), turned) > 0.95


def test_images_may_come_before_their_calibration(robot: RobotPeer, reconfigured: Change) -> None:
    config = reconfigured(images__queue_size=4)
    view = robot.view()
    for camera in ("left", "right"):
        robot.send_image(camera, view[camera][0])

    def calibrated() -> bool:
        # The connections are as new as the configuration: calibration is sent until it is heard.
        for camera in ("left", "right"):
            robot.send_info(camera, view[camera][1])
            robot.send_image(camera, view[camera][0])
        robot.peer.spin(0.1)
        return stamp_of(robot.points[-1]) == stamp_of(view["left"][0])

    robot.peer.until(calibrated, lambda: robot.log)
    np.testing.assert_array_equal(
        records_of(robot.points[-1]), stages_of(view, config).scan.cells.to_records()
    )


# --- heads ----------------------------------------------------------------------------------------


def test_trinocular_head_gives_the_methods_points(robot: RobotPeer, reconfigured: Change) -> None:
    config = reconfigured(images__top=True)
    robot.warm_up(top=True)
    for frame in (0, 3):
        view = robot.view(frame=frame)
        three = robot.check(config, view)
        two = stages_of(view, DEFAULTS).scan.cells.to_records()
        assert len(three) > 20
        assert three.tobytes() != two.tobytes()


def _raw(view: MutableView, scale: int = 2) -> MutableView:
    """The view as a real lens of twice the resolution shows it: distorted, turned, off-centre."""
    raw = {}
    angles = {"left": (0.01, -0.02, 0.015), "right": (-0.015, 0.01, -0.01)}
    for camera, (image, info) in view.items():
        if camera == "top":
            continue
        image, info = copy.deepcopy(image), copy.deepcopy(info)
        size = (image.width * scale, image.height * scale)
        large = cv2.resize(_pixels(image), size, interpolation=cv2.INTER_CUBIC)
        p = np.diag([scale, scale, 1.0]) @ np.reshape(info.p, (3, 4))
        p[:2, 2] += (scale - 1) / 2
        k = np.array([[203.0, 0.0, 162.5], [0.0, 204.0, 117.0], [0.0, 0.0, 1.0]])
        d = np.array([-0.22, 0.05, 0.001, -0.0008, 0.0])
        r, _ = cv2.Rodrigues(np.array(angles[camera]))
        u, v = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
        raw_pixels = np.stack([u, v], axis=2).reshape(-1, 1, 2)
        rectified = cv2.undistortPoints(raw_pixels, k, d, R=r, P=p[:, :3])
        where = rectified.reshape(size[1], size[0], 2).astype(np.float32)
        _set_pixels(
            image, cv2.remap(large, where[..., 0], where[..., 1], cv2.INTER_CUBIC, borderValue=90)
        )
        info.width, info.height = size
        info.distortion_model = "plumb_bob"
        info.k, info.d, info.r, info.p = (m.reshape(-1) for m in (k, d, r, p))
        raw[camera] = (image, info)
    return raw


def test_raw_images_are_rectified_by_the_node(robot: RobotPeer, reconfigured: Change) -> None:
    # Of likely people: what is hardly one may be sent by the one and not by the other.
    config = reconfigured(images__rectified=False, bodies__min_score=-1.0)
    likely = RobotConfig.from_mapping({"bodies.min_score": -1.0}, base=DEFAULTS)
    view = robot.view(of="robot_b")

    def answered() -> bool:
        robot.send(_raw(robot.view(of="robot_b")), image="image_raw")
        robot.peer.spin(0.1)
        return stamp_of(robot.points[-1]) > stamp_of(view["left"][0])

    robot.peer.until(answered, lambda: robot.log)
    view = robot.view(of="robot_b")
    raw = _raw(view)
    records = robot.check(config, raw, image="image_raw")
    original = stages_of(view, likely).scan.cells
    there = np.stack([original.x, original.y], axis=1)
    assert _overlap(_xy(records), there) > 0.85
    # The same images taken for rectified ones show how much there was to do.
    wrong = stages_of(raw, likely).scan.cells
    assert _overlap(np.stack([wrong.x, wrong.y], axis=1), there) < 0.5


def _xy(records: np.ndarray) -> np.ndarray:
    return np.stack([records["x"], records["y"]], axis=1)


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Part of the cells (5 cm) of either set that have one of the other beside them or on them,
    0 where a set is empty."""
    if not (len(one) and len(other)):
        return 0.0
    away = np.abs(one[:, np.newaxis] - other[np.newaxis]).max(axis=2)
    near = away < 0.075
    return float(min(near.any(axis=1).mean(), near.any(axis=0).mean()))


# --- pose -----------------------------------------------------------------------------------------


def _covariance() -> np.ndarray:
    """Six by six, every entry another number."""
    root = np.random.default_rng(3).normal(size=(6, 6)) * 0.1
    return root @ root.T


def _planar(message: Any) -> tuple[float, float, float]:
    position, q = message.pose.pose.position, message.pose.pose.orientation
    assert (position.z, q.x, q.y) == (0.0, 0.0, 0.0)
    return position.x, position.y, 2.0 * math.atan2(q.z, q.w)


def _set_pose(message: Any, x: float, y: float, yaw: float) -> None:
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    q = message.pose.pose.orientation
    q.x, q.y, q.z, q.w = 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)
    message.pose.covariance = _covariance().reshape(-1)


def test_odometry_in_the_map_is_published_as_the_pose(robot: RobotPeer) -> None:
    odometry = robot.odometry()
    _set_pose(odometry, 1.25, -3.5, 2.5)
    odometry.pose.pose.position.z = 0.3  # base_link is on the floor
    robot.send_pose(odometry)
    pose = robot.pose_at(stamp_of(odometry))
    assert pose.header.frame_id == "map"
    assert _planar(pose) == pytest.approx((1.25, -3.5, 2.5), abs=1e-12)
    got, given = np.reshape(pose.pose.covariance, (6, 6)), _covariance()
    kept = np.ix_((0, 1, 5), (0, 1, 5))
    np.testing.assert_allclose(got[kept], given[kept], atol=1e-15)
    got[kept] = 0.0
    assert not got.any()
    finding = robot.until_finding("pose", lambda f: f.values.get("x") == "1.250")
    assert (finding.level, finding.values["y"], finding.values["yaw"]) == (OK, "-3.500", "2.500")


def test_odometry_of_another_frame_is_placed_by_map_from_odom(
    robot: RobotPeer, reconfigured: Change
) -> None:
    reconfigured(pose__map_from_odom=[10.0, 20.0, math.pi / 2], localization__run="never")

    def answered() -> Any:
        odometry = robot.odometry(frame_id="robot_a/odom")
        _set_pose(odometry, 3.0, 1.0, 0.1)
        robot.send_pose(odometry)
        robot.peer.spin(0.1)
        return [m for m in robot.poses if stamp_of(m) == stamp_of(odometry)]

    (pose,) = robot.peer.until(answered, lambda: robot.log)
    assert pose.header.frame_id == "map"
    assert _planar(pose) == pytest.approx((9.0, 23.0, math.pi / 2 + 0.1), abs=1e-12)
    # x of the odometry is y of the map, y of the odometry is -x of the map.
    given, got = _covariance(), np.reshape(pose.pose.covariance, (6, 6))
    assert got[0, 0] == pytest.approx(given[1, 1])
    assert got[1, 1] == pytest.approx(given[0, 0])
    assert got[0, 1] == pytest.approx(-given[0, 1])
    assert got[0, 5] == pytest.approx(-given[1, 5])
    assert got[1, 5] == pytest.approx(given[0, 5])
    assert got[5, 5] == pytest.approx(given[5, 5])
    # What is in the map already is not moved, and a leading slash (ROS 1) is no other frame.
    in_map = robot.odometry(frame_id="/map")
    _set_pose(in_map, 3.0, 1.0, 0.1)
    robot.send_pose(in_map)
    assert _planar(robot.pose_at(stamp_of(in_map))) == pytest.approx((3.0, 1.0, 0.1), abs=1e-12)


def test_pose_in_can_be_the_source(robot: RobotPeer, reconfigured: Change) -> None:
    reconfigured(pose__source="pose_in")
    message = PoseWithCovarianceStamped()
    message.header.frame_id = "map"

    def answered() -> bool:
        set_stamp(message, robot.now())
        _set_pose(message, -2.0, 4.0, -3.0)
        robot.send_pose(message, "pose_in")
        robot.peer.spin(0.1)
        return stamp_of(robot.poses[-1]) == stamp_of(message)

    robot.peer.until(answered, lambda: robot.log)
    assert _planar(robot.poses[-1]) == pytest.approx((-2.0, 4.0, -3.0), abs=1e-12)
    assert "/site/robot_a/odom" not in robot.peer.heard_by(robot.node)


@pytest.mark.parametrize(("max_rate", "every"), [(100.0, 1), (50.0, 2), (20.0, 5)])
def test_pose_rate_is_limited(robot: RobotPeer, live: Change, max_rate: float, every: int) -> None:
    """From odometry at 100 Hz with some jitter, as many poses are published as the rate allows."""
    live(pose__max_rate=max_rate)
    start = robot.now() + 1_000_000_000
    stamps = [start + 10_000_000 * i + (200_000 if i % 3 else 0) for i in range(41)]
    assert _poses_out(robot, stamps) == stamps[::every]


@pytest.mark.parametrize("max_rate", [10.0, 30.0, 70.0])
def test_pose_rate_holds_in_the_long_run(robot: RobotPeer, live: Change, max_rate: float) -> None:
    """Also where the allowed period is no multiple of the odometry's."""
    live(pose__max_rate=max_rate)
    start = robot.now() + 1_000_000_000
    stamps = [start + 10_000_000 * i for i in range(201)]
    out = _poses_out(robot, stamps)
    assert len(out) == pytest.approx(2.0 * max_rate + 1.0, abs=1.0)
    assert min(np.diff(out)) >= 0.9e9 / max_rate - 10_000_000


def _until_pose(robot: RobotPeer, stamp_ns: int) -> None:
    robot.peer.until(lambda: stamp_of(robot.poses[-1]) >= stamp_ns, "poses")


def _poses_out(robot: RobotPeer, stamps: list[int]) -> list[int]:
    """Stamps of the poses that come out for odometry of these stamps."""
    for count, stamp_ns in enumerate(stamps, 1):
        robot.send_pose(robot.odometry(stamp_ns))
        if count % 40 == 0:  # not more at once than the queues hold
            _until_pose(robot, stamp_ns - 110_000_000)
    # One that is always due, to know when all have come.
    robot._last_ns = stamps[-1] + 1_000_000_000
    end = robot.now()
    robot.send_pose(robot.odometry(end))
    robot.pose_at(end)
    return [s for s in map(stamp_of, robot.poses) if stamps[0] <= s <= stamps[-1]]


# --- debug topics ---------------------------------------------------------------------------------


def test_debug_topics_show_the_stages(robot: RobotPeer) -> None:
    base = f"/{robot.namespace}/debug"
    disparity = robot.peer.hear(DisparityImage, f"{base}/disparity")
    clouds = {
        stage: robot.peer.hear(PointCloud2, f"{base}/{stage}")
        for stage in ("cloud", "cropped", "foreground")
    }
    view: MutableView = {}

    def heard() -> bool:
        view.update(robot.view(of="robot_c"))
        robot.check(DEFAULTS, view)
        robot.peer.spin(0.1)
        stamps = [stamp_of(got[-1]) for got in (disparity, *clouds.values()) if got]
        return stamps == [stamp_of(view["left"][0])] * 4

    robot.peer.until(heard, "debug topics of one stamp")
    stages = stages_of(view, DEFAULTS)
    for stage, got in clouds.items():
        assert got[-1].header.frame_id == "site/robot_a/base_link"
        records, wanted = records_of(got[-1], XYZ), getattr(stages, stage)
        assert len(records) == len(wanted) > 100
        for axis, name in enumerate("xyz"):
            np.testing.assert_array_equal(records[name], wanted[:, axis])
    message = disparity[-1]
    assert message.header == message.image.header == view["left"][0].header
    assert (message.image.encoding, message.image.step) == ("32FC1", 640)
    values = np.frombuffer(bytes(message.image.data), "<f4").reshape(120, 160)
    seen = values != -1.0
    np.testing.assert_array_equal(seen, ~np.isnan(stages.disparity))
    assert 0.3 < seen.mean() < 1.0
    np.testing.assert_array_equal(values[seen], stages.disparity[seen])
    assert message.f == pytest.approx(105.46, abs=0.01)
    assert message.t == pytest.approx(0.1, abs=1e-6)
    assert message.delta_d == 1 / 16
    assert message.min_disparity == pytest.approx(10.546 / 5.0, abs=1e-3)
    assert message.max_disparity == pytest.approx(10.546 / 0.7, abs=1e-2)


def test_debug_topics_are_published_only_while_subscribed(
    peer: Peer, recording: Recording, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The node runs in this process, so that the calls of its publishers can be counted."""
    published: list[str] = []
    publish = LifecyclePublisher.publish

    def spy(self: Any, message: Any) -> None:
        published.append(self.topic_name.removeprefix("/spied/"))
        publish(self, message)

    monkeypatch.setattr(LifecyclePublisher, "publish", spy)
    rclpy.init(args=["--ros-args", "-r", "__ns:=/spied"])
    node = RobotNode()
    try:
        node.trigger_configure()
        node.trigger_activate()
        made = RobotPeer(peer, None, recording, "spied")

        def frame() -> set[str]:
            published.clear()
            made.send(made.view())
            for _ in range(100):
                rclpy.spin_once(node, timeout_sec=0.01)
                if "points" in published:
                    break
            return set(published)

        def counted() -> set[str]:
            """Figures of what is made for debug topics only."""
            assert node._stages is not None
            return {"points", "points_cropped", "points_foreground"} & set(
                node._figures(node._stages)
            )

        peer.until(frame, "a scan")
        assert frame() == {"points"}
        assert counted() == set()
        subscription = peer.node.create_subscription(
            PointCloud2, "/spied/debug/cropped", lambda message: None, 1
        )
        peer.until(node._debug_clouds["cropped"].get_subscription_count, "subscribed")
        assert frame() == {"points", "debug/cropped"}
        assert counted() == {"points", "points_cropped"}
        peer.node.destroy_subscription(subscription)
        peer.until(
            lambda: not node._debug_clouds["cropped"].get_subscription_count(), "unsubscribed"
        )
        assert frame() == {"points"}
    finally:
        node.destroy_node()
        rclpy.shutdown()
