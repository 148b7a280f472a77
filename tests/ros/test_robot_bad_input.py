"""robot_node reports, counts and drops bad inputs, and uses the next good one.

Every case sends something bad to the same running node and looks at its `/diagnostics`; then a good
view and a good pose must come out as ever.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image, PointCloud2

from mrs_ros.diagnostics import Input
from ros.harness import ERROR, OK, WARN, Finding, Peer, Team, holds
from ros.recording import DEFAULTS, Recording, set_stamp, stamp_of, stamped
from ros.robot_peer import RobotPeer

NAN, INF = math.nan, math.inf
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def silent(team: Team, peer: Peer, recording: Recording) -> RobotPeer:
    """A robot that nobody sends anything, as long as the test does not."""
    process = team.start("robot_node", namespace="/robot_x")
    return RobotPeer(peer, process, recording, "robot_x")


@pytest.fixture(scope="module")
def robot(silent: RobotPeer, team: Team, peer: Peer, recording: Recording) -> RobotPeer:
    """A robot that works (started with the other, to save time)."""
    made = RobotPeer(peer, team.start("robot_node", namespace="/robot_a"), recording)
    made.warm_up()
    made.until_finding("left/image_rect", lambda f: True)
    return made


def _still_works(robot: RobotPeer) -> None:
    assert robot.process is not None
    assert robot.process.alive
    robot.check(DEFAULTS)
    odometry = robot.odometry()
    robot.send_pose(odometry)
    pose = robot.pose_at(stamp_of(odometry))
    assert pose.pose.pose.position.x == odometry.pose.pose.position.x
    assert "Traceback" not in robot.log


# --- nothing, or nothing that can be understood ---------------------------------------------------


def test_silence_wrong_types_and_missing_calibration_are_reported(
    robot: RobotPeer, silent: RobotPeer, domain: int
) -> None:
    """A robot without usable inputs, corrected step by step."""
    stranger = Peer(domain, "stranger")
    peer, node = silent.peer, silent.node
    try:
        stranger.publisher(CompressedImage, "/robot_x/right/image_rect")
        stranger.publisher(PoseStamped, "/robot_x/odom")
        wrong = (
            r"no data on /robot_x/right/image_rect for \d+ s; publishers: 1; "
            "published as sensor_msgs/msg/CompressedImage, wanted: sensor_msgs/msg/Image",
            r"no data on /robot_x/odom for \d+ s; publishers: 1; "
            "published as geometry_msgs/msg/PoseStamped, wanted: nav_msgs/msg/Odometry",
        )
        for topic, text in zip(("right/image_rect", "odom"), wrong, strict=True):
            finding = silent.until_finding(topic, lambda f, t=text: holds(f.message, [t]), text)  # type: ignore[misc]
            assert finding.level == ERROR
        for topic in ("left/image_rect", "left/camera_info", "right/camera_info"):
            text = rf"no data on /robot_x/{topic} for \d+ s; publishers: 0"
            finding = silent.until_finding(topic, lambda f, t=text: holds(f.message, [t]), text)  # type: ignore[misc]
            assert finding.level == ERROR
            # Each of them is in the log: one does not keep the others out.
            assert holds(silent.log, [text]), silent.log
        # All that is missing is one line, and not repeated while nothing else goes missing.
        missing = [line for line in silent.log.splitlines() if "/left/camera_info for" in line]
        assert len(missing) == 1
        assert "/right/camera_info for" in missing[0]
        assert "no usable pose on odom yet" in missing[0]
        assert silent.log.count("no usable pose") == 1
        pose = peer.findings(node)["pose"]
        assert (pose.level, pose.message) == (ERROR, "no usable pose on odom yet")
        assert peer.findings(node)["scan"].message == "no scan yet"
    finally:
        stranger.close()

    # Images alone: the calibration is missing.
    def uncalibrated() -> bool:
        silent.send_info("left", silent.view()["left"][1])
        for camera, (image, _) in silent.view().items():
            if camera != "top":
                silent.send_image(camera, image)
        peer.spin(0.1)
        finding = peer.findings(node)["right/image_rect"]
        return "images are not used: no camera_info of right" in finding.message

    peer.until(uncalibrated, lambda: peer.findings(node))

    # Calibration that cannot be used: the images say why they are not used.
    def unusable() -> bool:
        view = silent.view()
        view["right"][1].p[3] = 0.0
        silent.send(view)
        peer.spin(0.1)
        finding = peer.findings(node)["right/image_rect"]
        return "images are not used: baseline is 0" in finding.message

    peer.until(unusable, lambda: peer.findings(node))
    assert not silent.points

    # And all is well.
    silent.warm_up()
    silent.until_finding("scan", lambda f: f.level == OK)
    silent.until_finding("pose", lambda f: f.level == OK)
    _still_works(silent)


# --- one bad message ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bad:
    """Something bad: the topic, who sends it, and what is to be said of it."""

    topic: str
    send: Callable[[RobotPeer], None]
    kind: str
    wanted: tuple[str, ...]


def _image(*wanted: str, camera: str = "left", **fields: Any) -> Bad:
    """An image with other fields; `data` may be a function of the good bytes."""

    def send(robot: RobotPeer) -> None:
        image = robot.view()[camera][0]
        for name, value in fields.items():
            setattr(image, name, value(bytes(image.data)) if callable(value) else value)
        robot.send_image(camera, image)

    return Bad(f"{camera}/image_rect", send, "ImageError", wanted)


def _image_again(*wanted: str, back_ns: int) -> Bad:
    """An image that is as old as the last one, or a little older."""

    def send(robot: RobotPeer) -> None:
        last = stamp_of(robot.points[-1])
        robot.send_image("left", robot.view(last - back_ns)["left"][0])

    return Bad("left/image_rect", send, "ImageError", wanted)


def _info(*wanted: str, camera: str = "right", **fields: Any) -> Bad:
    """Calibration with other fields; those that are functions take the good value."""

    def send(robot: RobotPeer) -> None:
        info = robot.view()[camera][1]
        for name, value in fields.items():
            setattr(info, name, value(getattr(info, name)) if callable(value) else value)
        robot.send_info(camera, info)

    return Bad(f"{camera}/camera_info", send, "CameraError", wanted)


def _pose(
    *wanted: str, frame_id: str = "map", child: str = "", back_ns: int = -SECOND, **fields: float
) -> Bad:
    """Odometry with other numbers, stamped so much before the last."""

    def send(robot: RobotPeer) -> None:
        last = stamp_of(robot.poses[-1])
        robot._last_ns = max(robot._last_ns, last - back_ns)
        odometry = robot.odometry(last - back_ns, frame_id)
        odometry.child_frame_id = child or odometry.child_frame_id
        for name, value in fields.items():
            if name == "variance":
                odometry.pose.covariance[0] = value
            elif name in ("x", "y", "z"):
                setattr(odometry.pose.pose.position, name, value)
            else:
                setattr(odometry.pose.pose.orientation, name.removeprefix("q"), value)
        robot.send_pose(odometry)

    return Bad("odom", send, "PoseError", wanted)


def _at(index: int, value: float) -> Callable[[Any], Any]:
    """A matrix with one entry changed."""

    def change(matrix: Any) -> Any:
        matrix = np.array(matrix)
        matrix[index] = value
        return matrix

    return change


def _times(index: int, factor: float) -> Callable[[Any], Any]:
    def change(matrix: Any) -> Any:
        matrix = np.array(matrix)
        matrix[index] *= factor
        return matrix

    return change


BAD = {
    # images
    "image larger than camera_info": _image(
        "image is 200x120", "wanted as in camera_info: 160x120",
        width=200, step=200, data=lambda _: bytes(200 * 120),
    ),
    "image smaller than camera_info": _image(
        "image is 160x60", "wanted as in camera_info: 160x120",
        camera="right", height=60, data=lambda data: data[: 160 * 60],
    ),
    "image of no size": _image("image is 0x120", "more than 0x0", width=0, step=0, data=b""),
    "image encoding": _image(
        "encoding is '16UC1'", "allowed: mono8, bgr8, rgb8, bgra8", encoding="16UC1"
    ),
    "image encoding of the other camera": _image(
        "encoding is 'bayer_rggb8'", "allowed: mono8", camera="right", encoding="bayer_rggb8"
    ),
    "image says colour, holds grey": _image(
        "step is 160 bytes", "wanted for rgb8 at width 160: at least 480", encoding="rgb8"
    ),
    "image truncated": _image(
        "data has 19199 bytes", r"step \* height = 19200", data=lambda data: data[:-1]
    ),
    "image without data": _image("data has 0 bytes", "19200", data=b""),
    "image stamp repeated": _image_again(r"stamp is \d+ ns", r"newer than \d+ ns", back_ns=0),
    "image stamp slightly back": _image_again(
        r"stamp is \d+ ns", r"newer than \d+ ns", back_ns=400_000_000
    ),
    # calibration
    "camera_info without baseline": _info(
        "baseline is 0", r"P\[3\] of the right camera_info", r"wanted: -fx \* baseline",
        p=_at(3, 0.0),
    ),
    "camera_info with reversed baseline": _info(
        "baseline is -0.1 m", "negative", "left and right swapped", p=_times(3, -1.0)
    ),
    "camera_info with far too long baseline": _info(
        "disparity.min_range = 0.7 m", "1520 px of disparity", "raise min_range",
        p=_times(3, 100.0),
    ),
    "camera_info of another size": _info(
        "right camera_info is ", "wanted as left: 160x120", width=200
    ),
    "camera_info uncalibrated": _info(
        "focal length in p is 0, 0 px", "at least 0.01", camera="left", p=np.zeros(12)
    ),
    "camera_info of another focal length": _info(
        "right camera_info has focal length 110.7", "wanted as left: 105.46", p=_times(0, 1.05)
    ),
    "camera_info of other rows": _info("right camera_info has cy = 66.", "59.5", p=_at(6, 66.0)),
    "camera_info with NaN": _info("p holds NaN", p=_at(2, NAN)),
    "camera_info with infinity": _info("k holds NaN or infinite", camera="left", k=_at(0, INF)),
    "camera_info of no size": _info("image size is 0x120", "more than 0x0", width=0),
    "camera_info binned": _info("binning is 2x2", "allowed: none", binning_x=2, binning_y=2),
    # poses
    "pose with NaN": _pose("NaN or infinite", r"position \(nan", x=NAN),
    "pose with infinity": _pose("NaN or infinite", "inf", y=INF),
    "orientation with NaN": _pose("NaN or infinite", "orientation", qw=NAN),
    "orientation not of length 1": _pose(
        "orientation has length 2", "quaternion of length 1", qz=0.0, qw=2.0
    ),
    "orientation all zero": _pose(
        "orientation has length 0", "quaternion of length 1", qz=0.0, qw=0.0
    ),
    "pose that lies": _pose(
        "leans by 1.57 rad", "allowed: 0.52", "upright", qx=0.5**0.5, qw=0.5**0.5, qz=0.0
    ),
    "pose with negative variance": _pose("covariance", "at least 0", variance=-1.0),
    "pose with NaN variance": _pose("covariance", "finite", variance=NAN),
    "pose in an unknown frame": _pose(
        "frame_id is 'robot_a/odom'", "wanted: 'map'", "pose.map_from_odom", frame_id="robot_a/odom"
    ),
    "pose of another robot": _pose(
        "child_frame_id is 'robot_b/base_link'", "wanted: '.*/base_link'", child="robot_b/base_link"
    ),
    "pose without a frame": _pose("frame_id is ''", "wanted: 'map'", frame_id=""),
    "pose stamp repeated": _pose(r"stamp is \d+ ns", r"newer than \d+ ns", back_ns=0),
    "pose stamp slightly back": _pose(
        r"stamp is \d+ ns", r"newer than \d+ ns", back_ns=300_000_000
    ),
}  # fmt: skip


def test_problems_of_several_topics_are_all_logged(robot: RobotPeer) -> None:
    """Three kinds of problems at a time are three lines."""
    kinds = (BAD["image encoding"], BAD["camera_info with NaN"], BAD["pose with NaN"])
    for bad in kinds:
        bad.send(robot)
    for text in (
        r"/robot_a/left/image_rect: encoding is '16UC1'; allowed: mono8, .* \[dropped: \d+",
        r"/robot_a/right/camera_info: p holds NaN or infinite values \[dropped: \d+\]",
        r"/robot_a/odom: pose holds NaN or infinite values.* \[dropped: \d+\]",
    ):
        robot.peer.until(lambda t=text: holds(robot.log, [t]), lambda: robot.log)  # type: ignore[misc]
    for bad in kinds:
        robot.until_finding(bad.topic, lambda f, k=bad.kind: f.count(f"dropped.{k}") > 0)  # type: ignore[misc]
    _still_works(robot)


@dataclass(frozen=True)
class Outcome:
    """What the diagnostics said before and after something bad, and what went wrong after it."""

    before: Finding
    after: Finding
    trouble: str


@pytest.fixture(scope="module")
def outcomes(robot: RobotPeer, silent: RobotPeer) -> Mapping[str, Outcome]:
    """All of these, some at a time, as a report takes a second: two robots, and poses beside."""
    silent.warm_up()
    robots = (robot, silent)
    for each in robots:
        robot.peer.until(lambda n=each.node: len(robot.peer.findings(n)) >= 5, "reports")  # type: ignore[misc]
    poses = [name for name, bad in BAD.items() if bad.topic == "odom"]
    others = [name for name in BAD if name not in poses]
    result = {}
    while poses or others:
        sent = []
        for each in robots:
            for queue in (others, poses):
                if queue:
                    name = queue.pop(0)
                    sent.append((name, each, each.peer.findings(each.node)[BAD[name].topic]))
                    BAD[name].send(each)
        after = {name: _once_counted(each, name, before) for name, each, before in sent}
        trouble = {each: _what_does_not_work(each) for each in robots}
        result |= {name: Outcome(before, after[name], trouble[r]) for name, r, before in sent}
    return result


def _once_counted(robot: RobotPeer, name: str, before: Finding) -> Finding:
    topic = BAD[name].topic
    with contextlib.suppress(AssertionError):  # the test of this one will say it
        robot.peer.until_finding(
            robot.node, topic, lambda f: f.count("dropped") > before.count("dropped"), deadline=15.0
        )
    return robot.peer.findings(robot.node)[topic]


def _what_does_not_work(robot: RobotPeer) -> str:
    try:
        _still_works(robot)
    except AssertionError as err:
        return str(err)
    return ""


@pytest.mark.parametrize("name", BAD)
def test_bad_message_is_reported_counted_and_dropped(
    outcomes: Mapping[str, Outcome], name: str
) -> None:
    bad, before, after = BAD[name], outcomes[name].before, outcomes[name].after
    assert after.count("dropped") == before.count("dropped") + 1
    assert after.count(f"dropped.{bad.kind}") == before.count(f"dropped.{bad.kind}") + 1
    assert after.level == WARN
    assert after.message.startswith(f"{after.count('dropped')} dropped; last: ")
    assert holds(after.message, bad.wanted), after.message


@pytest.mark.parametrize("name", BAD)
def test_good_messages_are_used_after_a_bad_one(outcomes: Mapping[str, Outcome], name: str) -> None:
    """A view and a pose are published as usual."""
    assert outcomes[name].trouble == ""


def test_bad_message_counts_only_against_its_topic(
    outcomes: Mapping[str, Outcome], robot: RobotPeer, silent: RobotPeer
) -> None:
    """Each of the bad messages above was counted at its own topic."""
    kinds = {bad.topic: {f"dropped.{bad.kind}"} for bad in BAD.values()}
    findings = robot.peer.next_findings(robot.node, silent.node).values()
    for topic, wanted in kinds.items():
        values = {key for finding in findings for key in finding[topic].values}
        # (One robot's calibration came late, in a test above.)
        dropped = {key for key in values if key.startswith("dropped.")}
        assert dropped - {"dropped.UncalibratedError"} == wanted, topic


# --- time that starts again -----------------------------------------------------------------------


def test_robot_begins_anew_when_image_stamps_jump_back(robot: RobotPeer) -> None:
    """As in a bag that loops: three images in succession confirm it."""
    before = robot.peer.next_findings(robot.node)[robot.node]["pairs"]
    then = robot.now() - 100 * SECOND
    for step in range(2):
        robot.send(robot.view(then + step * (SECOND // 5)))
        robot.settle()
    old = robot.view(then + 2 * (SECOND // 5))
    robot.check(DEFAULTS, old)
    after = robot.until_finding("pairs", lambda f: f.count("stamp_resets") > 0)
    assert after.count("stamp_resets") == before.count("stamp_resets") + 1
    assert "left images: stamps jumped back; starting over" in robot.log
    robot.check(DEFAULTS, robot.view(stamp_of(old["left"][0]) + SECOND // 5))
    _still_works(robot)


def test_robot_begins_anew_when_pose_stamps_jump_back(robot: RobotPeer) -> None:
    _still_works(robot)
    old = robot.now() - 100 * SECOND
    for step in range(-2, 3):
        odometry = robot.odometry(old + step * 20_000_000)
        robot.send_pose(odometry)
        if step < 0:  # it may be late
            continue
        robot.pose_at(stamp_of(odometry))
    _still_works(robot)


# --- images that never pair -----------------------------------------------------------------------


def test_images_that_never_pair_are_reported_with_their_difference(robot: RobotPeer) -> None:
    """The observed difference is reported, so that the parameter can be set."""
    robot.peer.must_set(robot.node, images__queue_size=2)  # which also starts to count again
    began_ns = robot.now()
    for frame in range(4):  # at 30 Hz, and half a frame apart
        view = robot.view(began_ns + frame * 33_000_000)
        set_stamp(view["right"][0], stamp_of(view["left"][0]) + 16_000_000)
        robot.send(view)
        robot.settle()
    finding = robot.until_finding("pairs", lambda f: f.count("unpaired") == 4)
    assert finding.level == WARN
    assert finding.message == (
        "4 images found no pair; smallest difference of stamps seen: 0.0160 s; allowed by "
        "images.max_stamp_difference: 0.005 s; trigger the cameras together, or, where nothing "
        "moves fast, set images.max_stamp_difference: 0.017 (half of the time between images)"
    )
    robot._last_ns = began_ns + SECOND
    robot.peer.must_set(robot.node, images__queue_size=8)
    _still_works(robot)


# --- nothing any more -----------------------------------------------------------------------------


def test_silence_after_data_is_reported(robot: RobotPeer, silent: RobotPeer) -> None:
    _still_works(silent)
    finding = silent.until_finding("odom", lambda f: f.level == ERROR)
    assert holds(finding.message, [r"no data on /robot_x/odom for \d+ s; publishers: 1"])
    silent.send_pose(silent.odometry())
    silent.until_finding("odom", lambda f: f.level != ERROR)


# --- quality of service ---------------------------------------------------------------------------


@pytest.mark.parametrize("reliability", [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
@pytest.mark.parametrize(
    "durability", [DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL]
)
def test_images_of_any_quality_of_service_arrive(
    robot: RobotPeer,
    domain: int,
    reliability: ReliabilityPolicy,
    durability: DurabilityPolicy,
) -> None:
    """Every combination that a driver may offer is compatible with the node's."""
    qos = QoSProfile(depth=5, reliability=reliability, durability=durability)
    driver = Peer(domain, "driver")
    try:
        publisher = driver.publisher(Image, "/robot_a/left/image_rect", qos)
        driver.until(publisher.get_subscription_count, "not connected")

        def heard() -> bool:
            view = robot.view()
            robot.send_image("right", view["right"][0])
            publisher.publish(view["left"][0])
            robot.peer.spin(0.1)
            return stamp_of(robot.points[-1]) == stamp_of(view["left"][0])

        robot.peer.until(heard, "no scan of these images")
    finally:
        driver.close()
    _still_works(robot)


def test_incompatible_quality_of_service_is_reported(peer: Peer, domain: int) -> None:
    """By an input that requests more than is offered; those of our nodes request the least."""
    other = Peer(domain, "other")
    try:
        other.publisher(
            Image, "/asks/image", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        )
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        asks = Input(peer.node, Image, "/asks/image", lambda message: None, reliable)
        text = r"no data on /asks/image for \d+ s; publishers: 1; incompatible QoS: RELIABILITY"
        peer.until(lambda: holds(asks.finding().message, [text]), lambda: asks.finding())
        asks.destroy()
    finally:
        other.close()


def test_subscriber_that_requests_reliable_points_is_logged(robot: RobotPeer) -> None:
    """`points` is best effort, as sensor data is; one that requests more receives nothing."""
    reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    subscription = robot.peer.node.create_subscription(
        PointCloud2, "/robot_a/points", lambda message: None, reliable
    )
    try:
        text = "'points', requesting incompatible QoS.*RELIABILITY"
        robot.peer.until(lambda: holds(robot.log, [text]), lambda: robot.log)
    finally:
        robot.peer.node.destroy_subscription(subscription)


# --- strange, but not to be guessed ---------------------------------------------------------------


def _tiny(robot: RobotPeer) -> None:
    view = robot.view()
    for camera in ("left", "right"):
        image, info = view[camera]
        info.width = info.height = image.width = image.height = image.step = 1
        image.data = b"\x00"
        robot.send_info(camera, info)
        robot.send_image(camera, image)


def _extreme_focal_length(value: float) -> Callable[[RobotPeer], None]:
    def send(robot: RobotPeer) -> None:
        view = robot.view()
        for camera in ("left", "right"):
            info = view[camera][1]
            info.p[0] = info.p[5] = value
        robot.send(view)

    return send


def _far_away(robot: RobotPeer) -> None:
    odometry = robot.odometry()
    odometry.pose.pose.position.x = 1e300
    odometry.pose.covariance[0] = 1e300
    robot.send_pose(odometry)


def _stamp_of_no_time(robot: RobotPeer) -> None:
    odometry = robot.odometry()
    odometry.header.stamp.sec, odometry.header.stamp.nanosec = -5, 4_294_967_295
    robot.send_pose(odometry)
    robot.send(stamped_view(robot, -5))


def stamped_view(robot: RobotPeer, sec: int) -> Any:
    view = robot.view()
    for camera, (image, info) in view.items():
        view[camera] = (stamped(image, sec * SECOND), info)
    return view


@pytest.mark.parametrize(
    "send",
    [
        _tiny,
        _extreme_focal_length(1e-300),
        _extreme_focal_length(1e300),
        _far_away,
        _stamp_of_no_time,
    ],
    ids=["one pixel", "tiny focal length", "huge focal length", "far away", "stamp"],
)
def test_node_survives_strange_messages(
    robot: RobotPeer, send: Callable[[RobotPeer], None]
) -> None:
    send(robot)
    robot.settle()
    _still_works(robot)
