"""TF: the frames that a robot publishes, and poses from TF."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile

from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.messages import read_camera_info
from mrs_people_loc.sensing.camera import StereoCamera, robot_from_optical
from mrs_ros import tf as frames
from ros.harness import ERROR, OK, Peer, Team
from ros.planner_peer import pose_of
from ros.recording import Recording, set_stamp, stamp_of
from ros.robot_peer import RobotPeer
from ros.tf2 import tf2

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MOUNTING = {"height": 1.2, "forward": 0.1, "left": -0.05, "pitch": 0.17, "roll": 0.05, "yaw": 0.3}


@pytest.fixture(scope="module")
def tf_message(tmp_path_factory: pytest.TempPathFactory, domain: int) -> Iterator[type]:
    """The type tf2_msgs/msg/TFMessage."""
    with tf2(tmp_path_factory):
        from tf2_msgs.msg import TFMessage

        yield TFMessage


def test_missing_package_is_named_with_the_way_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "installed", lambda _: False)
    text = (
        r"pose\.publish_tf is always; needs tf2_msgs, which is not installed: sudo apt install "
        r"ros-jazzy-tf2-msgs; allowed here: auto, never"
    )
    with pytest.raises(ConfigError, match=text):
        frames.require("tf2_msgs", "pose.publish_tf is always; allowed here: auto, never")


class Tf:
    """TF as a tool hears it, and as somebody else tells it."""

    def __init__(self, peer: Peer, kind: Any) -> None:
        self._peer = peer
        self._kind = kind
        self.heard = peer.hear(kind, "/tf", QoSProfile(depth=1000))
        self.latched = self.late()
        peer.publisher(kind, "/tf_static", LATCHED)

    def late(self) -> list[Any]:
        """What somebody hears on `/tf_static` who comes now."""
        return self._peer.hear(self._kind, "/tf_static", LATCHED)

    def tell(self, *transforms: Any, static: bool = False) -> None:
        """Tells where frames are."""
        topic = "/tf_static" if static else "/tf"
        self._peer.publisher(self._kind, topic).publish(self._kind(transforms=transforms))

    def moving(self, child: str) -> list[Any]:
        """What was said of a frame on `/tf`."""
        return [t for m in self.heard for t in m.transforms if t.child_frame_id == child]

    def fixed(self, child: str, heard: list[Any] | None = None) -> Any:
        """What was said last of a frame on `/tf_static`."""
        messages = self.latched if heard is None else heard
        found = [t for m in messages for t in m.transforms if t.child_frame_id == child]
        return found[-1] if found else None


@pytest.fixture(scope="module")
def tf(tf_message: type, peer: Peer) -> Tf:
    return Tf(peer, tf_message)


@pytest.fixture(scope="module")
def robots(tf: Tf, team: Team, peer: Peer, recording: Recording) -> Callable[..., RobotPeer]:
    """Makes robots, each with parameters of its own."""

    def make(name: str, **params: Any) -> RobotPeer:
        given = {key.replace("__", "."): str(value) for key, value in params.items()}
        process = team.start("robot_node", namespace=f"/{name}", params=given)
        made = RobotPeer(peer, process, recording, name)
        peer.until_active(made.node)
        return made

    return make


@pytest.fixture(scope="module")
def standing(robots: Callable[..., RobotPeer]) -> RobotPeer:
    mounting = {f"mounting__{name}": value for name, value in MOUNTING.items()}
    return robots(
        "robot_a", pose__source="static", pose__static=[1.0, 2.0, 0.5], images__top=True, **mounting
    )


def matrix_of(transform: Any) -> np.ndarray:
    """Homogeneous matrix (4, 4) of a geometry_msgs/Transform, by the textbook."""
    q, place = transform.rotation, transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    assert math.hypot(x, y, z, w) == pytest.approx(1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), place.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), place.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), place.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def matrix(rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation, place
    return made


def printed(
    parent: str, child: str, x: float, y: float, yaw: float, stamp_ns: int = 0
) -> TransformStamped:
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    set_stamp(made, stamp_ns)
    made.transform.translation.x, made.transform.translation.y = x, y
    made.transform.rotation.z, made.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return made


def planar(message: Any) -> tuple[float, float, float]:
    position, q = message.pose.pose.position, message.pose.pose.orientation
    return position.x, position.y, 2.0 * math.atan2(q.z, q.w)


# --- told -----------------------------------------------------------------------------------------


def test_static_robot_publishes_map_to_base_link(standing: RobotPeer, tf: Tf) -> None:
    frame = "robot_a/base_link"
    reported = standing.peer.until(lambda: tf.moving(frame), "/tf")[-1]
    assert reported.header.frame_id == "map"
    wanted = matrix_of(printed("map", frame, 1.0, 2.0, 0.5).transform)
    np.testing.assert_allclose(matrix_of(reported.transform), wanted, atol=1e-12)
    # At the stamps of the poses; scans have theirs.
    standing.warm_up(top=True, pose=False)
    view = standing.view()
    standing.send(view, top=True)
    stamp_ns = stamp_of(view["left"][0])
    standing.pose_at(stamp_ns)
    standing.peer.until(lambda: stamp_ns in map(stamp_of, tf.moving(frame)), "/tf at the scan")


def test_camera_frames_agree_with_the_method(standing: RobotPeer, tf: Tf) -> None:
    """The trinocular head, numerically: by TF, and by the geometry of the method."""
    view = standing.view()
    standing.send(view, top=True)
    standing.points_at(stamp_of(view["left"][0]))
    # By somebody who comes late, too.
    late = tf.late()
    top_frame = "robot_a/top_camera_optical"
    for heard in (tf.latched, late):
        standing.peer.until(partial(tf.fixed, top_frame, heard), "/tf_static")
        left, right, top = (
            tf.fixed(f"robot_a/{camera}_camera_optical", heard)
            for camera in ("left", "right", "top")
        )
        assert left.header.frame_id == "robot_a/base_link"
        assert right.header.frame_id == top.header.frame_id == "robot_a/left_camera_optical"
        to_left = matrix_of(left.transform)
        np.testing.assert_allclose(
            to_left, matrix(*robot_from_optical(Mounting(**MOUNTING))), atol=1e-9
        )
        # A point as each camera's projection matrix sees it has the disparities of the head.
        models = {name: read_camera_info(view[name][1]) for name in ("left", "right", "top")}
        camera = StereoCamera.from_models(**models)
        point = np.array([3.0, 0.4, 1.1, 1.0])
        pixels = []
        for frame in (np.eye(4), matrix_of(right.transform), matrix_of(top.transform)):
            x, y, z, _ = np.linalg.inv(to_left @ frame) @ point
            pixels.append((camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy))
        depth = (np.linalg.inv(to_left) @ point)[2]
        assert depth > 1.0
        assert pixels[0][0] - pixels[1][0] == pytest.approx(camera.depth_disparity / depth)
        assert pixels[0][1] == pytest.approx(pixels[1][1])
        down = pixels[2][1] - pixels[0][1]
        assert down == pytest.approx(camera.fy * camera.vertical_baseline / depth)
        assert pixels[0][0] == pytest.approx(pixels[2][0])


def test_turned_head_is_published_again(standing: RobotPeer, tf: Tf) -> None:
    changed = MOUNTING | {"yaw": -0.4, "height": 0.9}
    standing.peer.must_set(standing.node, mounting__yaw=-0.4, mounting__height=0.9)
    wanted = matrix(*robot_from_optical(Mounting(**changed)))

    def turned() -> bool:
        reported = matrix_of(tf.fixed("robot_a/left_camera_optical").transform)
        return bool(np.allclose(reported, wanted, atol=1e-9))

    standing.peer.until(turned, "the head's new mounting on /tf_static")


def test_base_link_has_one_parent(robots: Callable[..., RobotPeer], tf: Tf) -> None:
    """Odometry in its own frame: the base publishes odom to base_link, the node map to odom."""
    robot = robots("robot_b", pose__map_from_odom=[5.0, 6.0, 1.0], localization__run="never")

    def placed() -> Any:
        robot.send_pose(robot.odometry(frame_id="robot_b/odom"))
        robot.peer.spin(0.05)
        return tf.fixed("robot_b/odom")

    reported = robot.peer.until(placed, "/tf_static")
    assert reported.header.frame_id == "map"
    wanted = matrix_of(printed("map", "robot_b/odom", 5.0, 6.0, 1.0).transform)
    np.testing.assert_allclose(matrix_of(reported.transform), wanted, atol=1e-12)
    assert tf.fixed("robot_b/left_camera_optical").header.frame_id == "robot_b/base_link"
    # In the map itself nobody else can say it.
    odometry = robot.odometry()
    robot.send_pose(odometry)
    found = robot.peer.until(lambda: tf.moving("robot_b/base_link"), "/tf")
    assert [stamp_of(t) for t in found] == [stamp_of(odometry)]


def test_localization_moves_the_frame_of_the_odometry(
    robots: Callable[..., RobotPeer], tf: Tf
) -> None:
    """With absolute poses 0.2 m beside where the robot is told to start."""
    robot = robots("robot_h", pose__map_from_odom=[5.0, 6.0, 1.0])

    def corrected() -> bool:
        odometry = robot.odometry(frame_id="robot_h/odom")
        odometry.pose = pose_of(0, 2.0, 1.0, 0.3).pose
        robot.send_pose(odometry)
        start = matrix_of(printed("map", "", 5.0, 6.0, 1.0).transform)
        x, y, _, _ = start @ (2.0, 1.2, 0.0, 1.0)
        beside = pose_of(stamp_of(odometry), x, y, 1.3)
        beside.pose.covariance[[0, 7, 35]] = 1e-4
        robot.send_pose(beside, "pose_in")
        robot.peer.spin(0.05)
        found = tf.moving("robot_h/odom")
        return bool(found) and math.dist(planar(robot.poses[-1])[:2], planar(beside)[:2]) < 0.05

    robot.peer.until(corrected, "the correction")
    pose = robot.poses[-1]

    def told() -> Any:
        return [t for t in tf.moving("robot_h/odom") if stamp_of(t) == stamp_of(pose)]

    (frame,) = robot.peer.until(told, "/tf")
    assert frame.header.frame_id == "map"
    # What the base says of itself on it gives the pose.
    local = printed("robot_h/odom", "robot_h/base_link", 2.0, 1.0, 0.3)
    found = matrix_of(frame.transform) @ matrix_of(local.transform)
    wanted = matrix_of(printed("map", "", *planar(pose)).transform)
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert tf.moving("robot_h/base_link") == []
    assert tf.fixed("robot_h/odom") is None


def test_frames_are_published_as_the_parameter_says(
    robots: Callable[..., RobotPeer], tf: Tf
) -> None:
    silent = robots("robot_c", pose__publish_tf="never")
    always = robots(
        "robot_d", pose__publish_tf="always", pose__map_from_odom=[1.0, 0.0, math.pi / 2]
    )
    for robot in (silent, always):

        def answered(robot: RobotPeer = robot) -> list[Any]:
            odometry = robot.odometry(frame_id="odom" if robot is always else "map")
            odometry.pose.pose.position.x, odometry.pose.pose.position.y = 2.0, 0.0
            odometry.pose.pose.orientation.z, odometry.pose.pose.orientation.w = 0.0, 1.0
            robot.send_pose(odometry)
            robot.peer.spin(0.05)
            return robot.poses

        robot.peer.until(answered, "a pose")
    reported = always.peer.until(lambda: tf.moving("robot_d/base_link"), "/tf")[-1]
    wanted = matrix_of(printed("map", "robot_d/base_link", 1.0, 2.0, math.pi / 2).transform)
    np.testing.assert_allclose(matrix_of(reported.transform), wanted, atol=1e-12)
    assert tf.fixed("odom") is None
    assert not {"/tf", "/tf_static"} & set(silent.peer.published_by(silent.node))


# --- heard ----------------------------------------------------------------------------------------


def test_pose_can_come_from_tf(robots: Callable[..., RobotPeer], tf: Tf) -> None:
    """The chain is map to odom from a localization, and odom to base_link from the base."""
    robot = robots("robot_e", pose__source="tf", pose__sigmas=[0.1, 0.1, 0.02])
    finding = robot.until_finding("pose", lambda f: f.level == ERROR and "TF has no" in f.message)
    assert finding.message.startswith("TF has no map -> robot_e/base_link: ")
    assert "robot_e/base_link" in finding.message

    def told_at(stamp_ns: int) -> bool:
        tf.tell(printed("map", "robot_e/odom", 10.0, 20.0, math.pi / 2, stamp_ns + 10**9))
        tf.tell(printed("robot_e/odom", "robot_e/base_link", 3.0, 1.0, 0.1, stamp_ns))
        for _ in range(20):
            robot.peer.spin(0.1)
            if any(stamp_of(pose) == stamp_ns for pose in robot.poses):
                return True  # and no other pose is under way
        return False

    robot.peer.until(lambda: told_at(robot.now()), "a pose")
    pose = robot.poses[-1]
    assert planar(pose) == pytest.approx((9.0, 23.0, math.pi / 2 + 0.1))
    assert np.reshape(pose.pose.covariance, (6, 6))[5, 5] == pytest.approx(0.0004)
    assert robot.until_finding("pose", lambda f: f.level == OK).values["x"] == "9.000"
    # What somebody else says is not said again; the cameras are ours.
    assert len(tf.moving("robot_e/base_link")) == len(
        {stamp_of(t) for t in tf.moving("robot_e/base_link")}
    )
    assert tf.fixed("robot_e/left_camera_optical") is not None
    # Nor is a pose: it comes again with what is new.
    count = len(robot.poses)
    robot.peer.next_findings(robot.node)
    robot.peer.next_findings(robot.node)
    assert len(robot.poses) == count
    robot.peer.until(lambda: told_at(robot.now()), "another pose")


def test_static_transform_is_a_pose_at_any_time(robots: Callable[..., RobotPeer], tf: Tf) -> None:
    """As from static_transform_publisher: valid at the stamp of each scan."""
    tf.tell(printed("map", "robot_f/base_link", -1.0, 0.5, 3.0), static=True)
    robot = robots("robot_f", pose__source="tf")
    robot.peer.until(lambda: robot.poses, "a pose without a scan")
    robot.warm_up(pose=False)
    view = robot.view()
    robot.send(view)
    assert planar(robot.pose_at(stamp_of(view["left"][0]))) == pytest.approx((-1.0, 0.5, 3.0))


def test_tf_places_odometry_in_the_map(robots: Callable[..., RobotPeer], tf: Tf) -> None:
    """Without the parameter pose.map_from_odom."""
    robot = robots("robot_g")

    def sent() -> Any:
        made = copy.deepcopy(robot.odometry(frame_id="robot_g/odom"))
        made.pose.pose.position.x, made.pose.pose.position.y = 3.0, 1.0
        made.pose.pose.orientation.z, made.pose.pose.orientation.w = 0.0, 1.0
        robot.send_pose(made)
        robot.peer.spin(0.05)
        return robot.poses

    finding = robot.peer.until(
        lambda: sent() or robot.peer.findings(robot.node).get("odom"), "a report"
    )
    robot.until_finding("odom", lambda f: f.count("dropped.PoseError") > 0, str(finding))
    finding = robot.peer.findings(robot.node)["odom"]
    assert "TF has no map -> robot_g/odom: " in finding.message
    tf.tell(printed("map", "robot_g/odom", 10.0, 20.0, math.pi / 2), static=True)
    robot.peer.until(sent, "a pose")
    assert planar(robot.poses[-1]) == pytest.approx((9.0, 23.0, math.pi / 2))
    # Its base says where base_link is, and somebody else where its odometry begins.
    assert tf.moving("robot_g/base_link") == []
