"""Localization over real DDS: robots whose odometry and sensors the test plays."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from mrs_people_msgs.msg import TeamPose
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import LaserScan, Range
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mrs_people_loc.health.findings import Code
from mrs_people_loc.localization.odometry import Odometry as OdometryValue
from mrs_people_loc.localization.shared import RelativePose
from mrs_people_loc.localization.shared import TeamPose as TeamPoseValue
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_ros.qos import TEAM as TEAM_QOS
from ros.harness import HEAR_ALL, OK, WARN, Finding, NodeProcess, Peer, Team
from ros.planner_peer import pose_of
from ros.recording import set_stamp, stamp_of

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

#: The namespace that the robots have in common: that of the team.
TEAM = "guides"


def planar(pose: Any) -> tuple[float, float, float]:
    """x, y [m] and yaw [rad] of a geometry_msgs/Pose or Transform."""
    place = pose.position if hasattr(pose, "position") else pose.translation
    q = pose.orientation if hasattr(pose, "orientation") else pose.rotation
    return place.x, place.y, 2.0 * math.atan2(q.z, q.w)


def placed(x: float, y: float, yaw: float) -> Pose:
    return Pose(0, x, y, yaw)


class Driven:
    """A robot_node whose odometry, in a frame of its own, the test plays.

    Args:
        peer: A node on its domain.
        process: The robot_node.
        name: The robot's name in its team.
        team: The namespace of its team.
    """

    def __init__(self, peer: Peer, process: NodeProcess, name: str, team: str = TEAM) -> None:
        self.peer, self.process, self.name = peer, process, name
        self.space = f"/{team}/{name}"
        self.node = f"{self.space}/robot_node"
        self.place = (0.0, 0.0, 0.0)
        self.poses: list[Any] = peer.hear(PoseWithCovarianceStamped, f"{self.space}/pose")
        self._last_ns = 0

    @property
    def odom_frame(self) -> str:
        return f"{TEAM}/{self.name}/odom"

    def step(self, *place: float) -> int:
        """Sends odometry of now, at another place if one is given; returns its stamp [ns]."""
        self.place = place or self.place  # type: ignore[assignment]
        stamp_ns = max(time.time_ns(), self._last_ns + 20_000_000)
        self._last_ns = stamp_ns
        message = Odometry(child_frame_id="base_link")
        message.header.frame_id = self.odom_frame
        set_stamp(message, stamp_ns)
        message.pose = pose_of(stamp_ns, *self.place).pose
        self.peer.send(f"{self.space}/odom", message)
        return stamp_ns

    def stepped(self, *place: float) -> Any:
        """Sends odometry, and returns the pose that comes back."""
        stamp_ns = self.step(*place)
        return self.peer.until(lambda: self.at(stamp_ns), f"no pose; log:\n{self.process.log}")

    def at(self, stamp_ns: int) -> Any:
        """The pose of a stamp; None: it has not come."""
        return next((m for m in reversed(self.poses) if stamp_of(m) == stamp_ns), None)

    def tell_absolute(self, x: float, y: float, yaw: float, sigma: float) -> None:
        """Sends a measured pose in the map, of the last odometry's time."""
        message = pose_of(self._last_ns, x, y, yaw)
        message.pose.covariance[[0, 7, 35]] = sigma**2
        self.peer.send(f"{self.space}/pose_in", message)

    def localization(self, wanted: Any, what: str = "") -> Finding:
        return self.peer.until_finding(self.node, "localization", wanted, what)


@pytest.fixture(scope="module")
def make(team: Team, peer: Peer) -> Callable[..., Driven]:
    """Starts robots by name; what odometry's frame is in the map is given."""

    def start(name: str, map_from_odom: list[float], **params: Any) -> Driven:
        given = {"pose.map_from_odom": str(map_from_odom)}
        given |= {key.replace("__", "."): str(value) for key, value in params.items()}
        process = team.start("robot_node", namespace=f"/{TEAM}/{name}", params=given)
        made = Driven(peer, process, name)
        peer.until_active(made.node)

        def answered() -> bool:
            made.step()
            peer.spin(0.05)
            return bool(made.poses)

        peer.until(answered, lambda: f"no pose of {name}; log:\n{process.log}")
        return made

    return start


@pytest.fixture(scope="module")
def first(make: Callable[..., Driven]) -> Driven:
    # Exact wheels: systematic errors would add to the covariance.
    return make("robot_a", [10.0, 20.0, math.pi / 2], localization__wheel_sigmas=[0.0, 0.0, 0.0])


def test_pose_has_the_covariance_of_dead_reckoning(first: Driven) -> None:
    """From the start, 4 m along y of the map; sigmas and noises are the defaults."""
    for x in (*np.arange(0.1, 3.95, 0.1).tolist(), 3.999, 4.0):  # no robot stops dead
        pose = first.stepped(x, 0.0, 0.0)
    assert pose.header.frame_id == "map"
    assert planar(pose.pose.pose) == pytest.approx((10.0, 24.0, math.pi / 2), abs=1e-9)
    covariance = np.reshape(pose.pose.covariance, (6, 6))[np.ix_((0, 1, 5), (0, 1, 5))]
    along = 0.1**2 + 4 * 0.02**2
    heading = 0.05**2 + 4 * 0.006**2
    across = along + 4.0**2 * (0.05**2 + 4 * 0.006**2 / 3)
    np.testing.assert_allclose(np.diag(covariance), [across, along, heading], rtol=1e-3)


def test_absolute_pose_corrects_and_an_outlier_is_refused(first: Driven, peer: Peer) -> None:
    x, y, yaw = planar(first.stepped().pose.pose)

    def corrected() -> bool:
        first.step()
        first.tell_absolute(x + 0.2, y - 0.1, yaw, 0.01)
        return planar(first.stepped().pose.pose)[0] > x + 0.19

    peer.until(corrected, "the correction")
    pose = first.stepped()
    assert planar(pose.pose.pose) == pytest.approx((x + 0.2, y - 0.1, yaw), abs=0.02)
    assert pose.pose.covariance[0] == pytest.approx(0.01**2, rel=0.1)
    accepted = first.localization(lambda f: f.count("absolute.accepted") > 0)
    assert accepted.level == OK, accepted
    assert accepted.count("absolute.refused") == 0
    first.tell_absolute(x + 5.0, y, yaw, 0.01)
    first.stepped()
    refused = first.localization(lambda f: f.count("absolute.refused") > 0)
    assert float(refused.values["absolute.innovation"]) > 10.0
    assert refused.level == OK, "of one outlier nobody need know"
    assert planar(first.stepped().pose.pose) == pytest.approx((x + 0.2, y - 0.1, yaw), abs=0.02)


# --- the team -------------------------------------------------------------------------------------


class Planner:
    """Says where robots are to each other, as a planner does; they stand at given places.

    Args:
        peer: A node on their domain.
        robots: They, by name, and where they really are.
    """

    def __init__(self, peer: Peer, robots: dict[str, tuple[Driven, tuple[float, float, float]]]):
        self._peer, self._robots = peer, robots

    def measure(self) -> None:
        """Lets every robot send odometry, and tells the relative poses of all pairs."""
        stamps = {name: robot.step() for name, (robot, _) in self._robots.items()}
        self._peer.spin(0.05)  # what they share is there before what is measured of them
        measured = []
        for one, (_, at) in self._robots.items():
            for other, (_, there) in self._robots.items():
                if one < other:
                    seen = inverse(*at) @ placed(*there)
                    measured.append(
                        RelativePose(
                            one,
                            stamps[one],
                            other,
                            stamps[other],
                            np.array([seen.x, seen.y, seen.yaw]),
                            np.diag([0.03**2, 0.03**2, 0.01**2]),
                        )
                    )
        message = convert.relative_poses(max(stamps.values()), "map", measured)
        self._peer.send(f"/{TEAM}/relative_poses", message)

    def is_right(self, within_m: float) -> bool:
        """Whether all robots are where they really are, by their own poses."""
        return all(
            math.dist(planar(robot.poses[-1].pose.pose)[:2], there[:2]) < within_m
            for robot, there in self._robots.values()
        )

    def until_right(self, within_m: float = 0.06) -> None:
        """Measures until all are."""

        def right() -> bool:
            self.measure()
            return self.is_right(within_m)

        def now() -> str:
            return str({n: planar(r.poses[-1].pose.pose) for n, (r, _) in self._robots.items()})

        self._peer.until(right, now)

    def until_finding(self, robot: Driven, team: str) -> None:
        """Goes on until a robot reports that all is well with its localization in a team."""

        def found() -> bool:
            self.measure()
            finding = self._peer.findings(robot.node).get("localization")
            if finding is None or finding.values["team"] != team:
                return False
            return finding.level == OK and finding.count("relative.accepted") > 0

        self._peer.until(found, lambda: str(dict(self._peer.findings(robot.node))))


def inverse(x: float, y: float, yaw: float) -> Pose:
    c, s = math.cos(yaw), math.sin(yaw)
    return placed(-c * x - s * y, s * x - c * y, -yaw)


def test_robots_join_correct_each_other_and_leave(
    first: Driven, make: Callable[..., Driven], peer: Peer
) -> None:
    """Only robot_a is sure of where it is; the others are told wrong by up to 0.15 m and 4 deg."""
    here = planar(first.stepped().pose.pose)
    second = make("robot_b", [12.1, 24.1, 0.35])
    team = {"robot_a": (first, here), "robot_b": (second, (12.0, 24.2, 0.3))}
    assert not Planner(peer, team).is_right(0.1)
    Planner(peer, team).until_right()
    third = make("robot_c", [9.0, 26.1, -1.0])
    team["robot_c"] = (third, (9.1, 26.0, -1.07))
    Planner(peer, team).until_right()
    for robot, _ in team.values():
        Planner(peer, team).until_finding(robot, "robot_a, robot_b, robot_c")
    # It knows the turn, too, and is about as sure as what it was measured with.
    pose = third.poses[-1].pose
    assert planar(pose.pose)[2] == pytest.approx(-1.07, abs=0.02)
    assert pose.covariance[35] < 0.02**2
    third.process.stop()
    del team["robot_c"]
    second.step(1.0, 0.0, 0.0)
    began = placed(*team["robot_b"][1]) @ placed(1.0, 0.0, 0.0)
    team["robot_b"] = (second, (began.x, began.y, began.yaw))
    Planner(peer, team).until_right()
    for node in (first.node, second.node):
        findings = peer.next_findings(node)[node]
        for subject in (
            "localization",
            f"/{TEAM}/team_poses",
            f"/{TEAM}/relative_poses",
            "pose_in",
        ):
            assert findings[subject].level == OK, findings[subject]


def told_by(name: str, robot: Driven, x: float = 0.0) -> Any:
    """What a robot of a name, somewhere, tells at the time of another one's last odometry."""
    stamp_ns = robot.step()
    pose = Pose(stamp_ns, x, 0.0, 0.0, 0.01 * np.eye(3))
    odometry = OdometryValue(stamp_ns, 0.0, 0.0, 0.0, 0.0, 0.0)
    return convert.team_pose(TeamPoseValue(name, pose, odometry), "map")


def test_bad_messages_of_the_team_are_refused(first: Driven, peer: Peer) -> None:
    before = planar(first.stepped().pose.pose)
    topics = {name: f"/{TEAM}/{name}" for name in ("team_poses", "relative_poses")}
    counts = {
        name: peer.next_findings(first.node)[first.node][topic].count("dropped.PoseError")
        for name, topic in topics.items()
    }
    bad = told_by("robot_x", first)
    bad.odometry_x = math.nan
    peer.send(topics["team_poses"], bad)
    measured = RelativePose(
        "robot_a", first.step(), "robot_x", first.step(), np.zeros(3), 0.01 * np.eye(3)
    )
    relative = convert.relative_poses(first.step(), "map", [measured])
    relative.poses[0].covariance[0] = -1.0
    peer.send(topics["relative_poses"], relative)
    for name, topic in topics.items():
        finding = peer.until_finding(
            first.node,
            topic,
            lambda f, n=name: f.count("dropped.PoseError") > counts[n],  # type: ignore[misc]
        )
        assert (finding.level, finding.values["code"]) == (WARN, "some_refused"), finding
    # Nor does it take what another one says in its name.
    peer.send(topics["team_poses"], told_by("robot_a", first, 50.0))
    assert planar(first.stepped().pose.pose) == pytest.approx(before, abs=1e-6)
    findings = peer.next_findings(first.node)[first.node]
    assert "robot_x" not in findings["localization"].values["team"]


# --- walls ----------------------------------------------------------------------------------------


def send_scan(robot: Driven, stamp_ns: int, at: Pose) -> None:
    """Sends what a laser scanner at a place sees of the walls x = 3 and y = 2, in the map [m]."""
    bearings = np.arange(-120, 121) * math.pi / 180
    directions = bearings + at.yaw
    with np.errstate(divide="ignore"):
        to_x = (3.0 - at.x) / np.cos(directions)
        to_y = (2.0 - at.y) / np.sin(directions)
    to_x[to_x < 0], to_y[to_y < 0] = np.inf, np.inf
    scan = LaserScan(
        angle_min=float(bearings[0]), angle_increment=math.pi / 180, range_min=0.1,
        range_max=10.0, ranges=[float(r) for r in np.minimum(to_x, to_y)],
    )  # fmt: skip
    set_stamp(scan, stamp_ns)
    robot.peer.send(f"{robot.space}/scan", scan)


def test_walls_of_a_map_in_a_laser_scan_correct_the_pose(
    make: Callable[..., Driven], peer: Peer
) -> None:
    """Two walls at a corner; the start is told 0.19 m and 2 degrees wrong."""
    truth, mounting = placed(0.5, 0.3, 0.4), (0.1, 0.05, 0.2)
    started = make(
        "robot_d", [0.65, 0.18, 0.435], walls__laser=True, walls__laser_mounting=[*mounting],
        walls__occupancy_grid=True,
    )  # fmt: skip
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    grid = OccupancyGrid()
    grid.header.frame_id = "map"
    grid.info.resolution, grid.info.width, grid.info.height = 0.05, 100, 80
    grid.info.origin.position.x, grid.info.origin.position.y = -1.0, -1.0
    grid.info.origin.orientation.w = 1.0
    cells = np.zeros((80, 100), np.int8)
    cells[60:62], cells[:62, 80:82], cells[:, 82:], cells[62:] = 100, 100, -1, -1
    grid.data = cells.reshape(-1).tolist()
    peer.publisher(OccupancyGrid, f"/{TEAM}/map", latched).publish(grid)
    drawn = peer.hear(MarkerArray, f"/{TEAM}/walls")

    def corrected() -> bool:
        send_scan(started, started.step(), truth @ placed(*mounting))
        x, y, yaw = planar(started.stepped().pose.pose)
        away = math.hypot(x - truth.x, y - truth.y)
        is_drawn = any(m.ns == "robot_d" for message in drawn for m in message.markers)
        return away < 0.03 and abs(yaw - truth.yaw) < 0.02 and is_drawn

    peer.until(corrected, lambda: str(peer.findings(started.node).get("localization")))
    finding = started.localization(lambda f: f.count("known_walls.accepted") > 0)
    assert finding.level == OK, finding
    # Its team-mates draw the walls that it tells them of, too.
    marker = [m for message in drawn for m in message.markers if m.ns == "robot_d"][-1]
    assert marker.header.frame_id == "map"
    # Lines along both walls.
    lines = np.array([(p.x, p.y) for p in marker.points]).reshape(-1, 2, 2)
    off = np.minimum(np.abs(lines[:, :, 0] - 3.0), np.abs(lines[:, :, 1] - 2.0))
    assert off.max() < 0.06
    started.process.stop()


def test_known_wall_in_sonar_ranges_corrects_the_pose(
    make: Callable[..., Driven], peer: Peer, tmp_path: Path
) -> None:
    """It drives along a wall at y = 1.5, and is 0.15 m farther from it than it is told."""
    file = tmp_path / "walls.yaml"
    file.write_text("walls: [[-2.0, 1.5, 12.0, 1.5]]\n")
    driven = make(
        "robot_e", [0.0, 0.15, 0.0], walls__file=file, walls__sonars="[sonar/front, sonar/rear]",
        walls__sonar_mountings=[0.3, 0.1, math.pi / 2, -0.3, 0.1, math.pi / 2],
    )  # fmt: skip

    def drive() -> bool:
        x, _, _ = driven.place
        stamp_ns = driven.step(x + 0.02, 0.0, 0.0)
        for sonar in ("front", "rear"):
            measured = Range(field_of_view=0.4, min_range=0.1, max_range=4.0, range=1.4)
            set_stamp(measured, stamp_ns)
            peer.send(f"{driven.space}/sonar/{sonar}", measured)
        _, y, _ = planar(driven.stepped().pose.pose)
        return abs(y) < 0.04

    peer.until(drive, lambda: f"{driven.place} {peer.findings(driven.node).get('localization')}")
    assert driven.place[0] < 8.0
    # They say the same all the time, which real ones do not.

    def named() -> bool:
        drive()
        finding = peer.findings(driven.node)["localization"]
        return "sonar_dead" in finding.values.get("problems", "").split(", ")

    peer.until(named, lambda: str(peer.findings(driven.node)["localization"]))
    text = peer.findings(driven.node)["localization"].message
    assert f"{driven.space}/sonar/front (1.400 m for" in text
    driven.process.stop()


def test_errors_of_wheels_are_kept_for_the_next_start(make: Callable[..., Driven]) -> None:
    """The true way is 2 % longer than the odometry's; before 10 m nothing is kept."""
    driven = make("robot_w", [0.0, 0.0, 0.0])
    service = f"{driven.node}/keep_wheels"

    def keep() -> Any:
        return driven.peer.call(Trigger, service, Trigger.Request())

    refused = keep()
    assert (refused.success, refused.message) == (False, "the robot has driven 0.0 m; wanted: 10 m")
    for k in range(1, 201):
        driven.stepped(0.1 * k, 0.0, 0.0)
        driven.tell_absolute(0.102 * k, 0.0, 0.0, 0.01)
    (given,) = driven.peer.set(driven.node, localization__wheels=[0.02, 0.0, 0.0])
    assert not given.successful, "it is not live"
    before = planar(driven.stepped().pose.pose)
    kept = keep()
    assert kept.success, kept
    names = "localization.wheels", "localization.wheel_sigmas"
    wheels, sigmas = driven.peer.get(driven.node, *names)
    assert list(wheels) == pytest.approx([0.02, 0.0, 0.0], abs=3e-3)
    assert list(sigmas) == pytest.approx([0.005, 0.002, 0.03], abs=1e-3)
    assert planar(driven.stepped().pose.pose) == pytest.approx(before, abs=1e-6)
    driven.localization(lambda f: abs(float(f.values["wheel_scale"]) - wheels[0]) < 1e-4)
    driven.process.stop()


def test_static_robot_holds_its_team_in_place(
    team: Team, make: Callable[..., Driven], peer: Peer
) -> None:
    """By its pose relative to that one, a robot that is told 0.16 m wrong is right."""
    heard = peer.hear(TeamPose, f"/{TEAM}/team_poses", TEAM_QOS)
    static = {"pose.source": "static", "pose.static": "[4.0, 1.0, 0.5]"}
    tripod = team.start("robot_node", namespace=f"/{TEAM}/robot_t", params=static)
    driven = make("robot_s", [0.15, -0.05, 0.03])

    def told() -> Any:
        return next((m for m in reversed(heard) if m.robot == "robot_t"), None)

    peer.until(told, lambda: tripod.log)

    def right() -> bool:
        there, stamp_ns = told(), driven.step()
        place, covariance = np.array([4.0, 1.0, 0.5]), np.diag([0.03**2, 0.03**2, 0.01**2])
        seen = RelativePose("robot_s", stamp_ns, "robot_t", stamp_of(there), place, covariance)
        peer.send(f"/{TEAM}/relative_poses", convert.relative_poses(stamp_ns, "map", [seen]))
        return math.hypot(*planar(driven.stepped().pose.pose)[:2]) < 0.03

    peer.until(right, lambda: str(peer.findings(driven.node).get("localization")))
    measured = peer.until(lambda: [one for m in heard for one in m.absolute], "its place")
    assert planar(measured[0].pose.pose) == pytest.approx((4.0, 1.0, 0.5))
    for process in (driven.process, tripod):
        process.stop()


# --- what goes wrong ------------------------------------------------------------------------------


class Liar:
    """Tells a team what a robot of another one says; when it lies, the pose 1 m off in x.

    Args:
        peer: A node on their domain.
        origin: The team whose robot it is.
        team: The team that hears it.
    """

    def __init__(self, peer: Peer, origin: str, team: str) -> None:
        self.lies = False
        self._to = peer.publisher(TeamPose, f"/{team}/team_poses", TEAM_QOS)
        peer.node.create_subscription(TeamPose, f"/{origin}/team_poses", self._on_told, HEAR_ALL)

    def _on_told(self, told: Any) -> None:
        if self.lies:
            told.pose.pose.position.x += 1.0
        self._to.publish(told)


def test_carried_robot_lying_team_mate_and_wrong_map_are_named(
    team: Team, peer: Peer, tmp_path: Path
) -> None:
    """Three robots stand before a corner; of its walls one is known, the other 1 m off in the map.

    One robot is carried by 0.5 m. What another says about its pose is falsified on the way.
    """
    file = tmp_path / "walls.yaml"
    file.write_text("walls: [[3.0, 2.0, -3.0, 2.0], [4.0, -3.0, 4.0, 1.9]]\n")
    true = {"robot_a": (0.5, 0.3, 0.4), "robot_b": (0.1, -0.6, 0.6), "robot_c": (-0.5, 0.6, 0.3)}
    teams = {"robot_a": "hall", "robot_b": "hall", "robot_c": "elsewhere"}
    params = {"walls.laser": "true", "walls.laser_mounting": "[0.0, 0.0, 0.0]",
              "walls.file": str(file)}  # fmt: skip
    robots = {}
    for name, place in true.items():
        given = {**params, "pose.map_from_odom": str([*place])}
        space = f"/{teams[name]}/{name}"
        process = team.start("robot_node", namespace=space, params=given)
        robots[name] = Driven(peer, process, name, teams[name])
    liar = Liar(peer, "elsewhere", "hall")
    a, b, c = robots.values()
    peer.until_active(*(robot.node for robot in robots.values()))

    def reported(robot: Driven, *codes: Code) -> bool:
        """Goes on; whether a robot's last report names these problems."""
        for name, driven in robots.items():
            send_scan(driven, driven.step(), placed(*true[name]))
        peer.spin(0.05)
        finding = peer.findings(robot.node).get("localization")
        names = "robot_a, robot_b, robot_c" if robot is not c else "robot_c"
        if finding is None or finding.values["team"] != names:
            return False
        return {*codes} <= set(finding.values.get("problems", "").split(", "))

    def sights(robot: Driven) -> int:
        return peer.findings(robot.node)["localization"].count("known_walls.accepted")

    def until(robot: Driven, *codes: Code) -> str:
        def now() -> str:
            return f"{codes}; {peer.findings(robot.node).get('localization')}"

        peer.until(lambda: reported(robot, *codes), now)
        return peer.findings(robot.node)["localization"].message

    for robot in (a, b, c):
        assert re.search(
            r"wall 1 \(off by (0\.9[5-9]|1\.0[0-5]) m\)", until(robot, Code.MAP_MISFIT)
        )
    # A wall speaks against a robot that has seen it five times.
    peer.until(lambda: reported(a) and min(sights(a), sights(b)) >= 5, "sights of wall 0")
    x, y, yaw = true["robot_b"]
    true["robot_b"] = (x, y - 0.5, yaw)
    liar.lies = True
    until(b, Code.CARRIED, Code.MATE_DOUBTED)
    assert "robot_c (off by 1.00 m)" in until(a, Code.MATE_DOUBTED, Code.MAP_MISFIT)
    # The carried robot is right again, the others were right all the time.

    def errors() -> dict[str, float]:
        places = {name: planar(robot.poses[-1].pose.pose) for name, robot in robots.items()}
        return {name: math.dist(place, true[name]) for name, place in places.items()}

    peer.until(lambda: reported(b) and max(errors().values()) < 0.03, errors)
    for robot in robots.values():
        assert peer.findings(robot.node)["localization"].count("times_lost") == (robot is b)
