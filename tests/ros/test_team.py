"""Three robots and the planner as four processes: the result equals that of the method in one.

Each frame is sent when the one before it has been answered, so nothing depends on the machine's
speed. The odometry of the first run moves and is uncertain, so that the place of a scan has to be
interpolated; that of the second is as recorded, so that the answer can be held against the truth.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, PoseArray, PoseWithCovarianceStamped
from mrs_people_msgs.msg import People
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from mrs_people_loc import messages
from mrs_people_loc.config import load_team
from mrs_people_loc.planner import People as CorePeople
from mrs_people_loc.planner import Planner
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.poses import Pose, PoseBuffer
from mrs_people_sim.scoring.positions import match
from ros.harness import ERROR, OK, ROOT, NodeProcess, Peer, Team
from ros.recording import (
    Recording,
    records_of,
    stages_of,
    stamp_of,
    stamped,
)

pytestmark = pytest.mark.slow

ROBOTS = ("robot_a", "robot_b", "robot_c")
PLANNER = "/planner_node"
CONFIG = ROOT / "config"
CONFIGS = {
    "team": [CONFIG / "team.yaml"],
    "paper": [CONFIG / "paper.yaml", CONFIG / "team.yaml"],
}
#: Robots that send nothing in a frame: then the interval closes without them.
ABSENT = {5: {"robot_b"}, 9: {"robot_b", "robot_c"}}
#: For what does not depend on the configuration.
once = pytest.mark.parametrize("run", ["team"], indirect=True)
MAP_DTYPE = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "z_min", "top")]
    + [("count", "<u4"), ("robot", "<u4"), ("cluster", "<i4"), ("person", "<i4")]
)


@dataclass
class Run:
    """What was sent and heard in one run; lists by stamp, as all of it is stamped alike."""

    name: str
    processes: dict[str, NodeProcess]
    peer: Peer
    sent: dict[str, list[dict[str, tuple[Any, Any]]]]
    truth: np.ndarray
    points: dict[str, list[Any]]
    poses: dict[str, list[Any]]
    heard: dict[str, dict[int, Any]] = field(default_factory=dict)
    warm_ups: int = 0

    @property
    def people(self) -> list[Any]:
        """The `people` messages in their order."""
        return list(self.heard["tracked_people"].values())

    @cached_property
    def buffers(self) -> dict[str, PoseBuffer]:
        """By robot, all its poses as they were heard."""
        made = {robot: PoseBuffer() for robot in ROBOTS}
        for robot, buffer in made.items():
            for message in self.poses[robot]:
                buffer.add(messages.read_pose(message))
        return made

    def scans_heard(self) -> set[tuple[str, int]]:
        """Robot and stamp of the scans heard so far."""
        return {(robot, stamp_of(m)) for robot, heard in self.points.items() for m in heard}

    @property
    def full(self) -> list[Any]:
        """Those of intervals that all robots' scans went into."""
        return [message for message in self.people if len(message.scans) == len(ROBOTS)]


@pytest.fixture(scope="module", params=CONFIGS)
def run(
    request: pytest.FixtureRequest, domain: int, team: Team, recording: Recording
) -> Iterator[Run]:
    """Plays the recording to a team."""
    files = CONFIGS[request.param]
    processes = {
        robot: team.start("robot_node", namespace=f"/{robot}", files=files) for robot in ROBOTS
    }
    # Robots are waited for until the machine has had time for them, however busy it is.
    patient = {
        "interval.max_wait": "5.0",
        "interval.robot_timeout": "60.0",
        "interval.max_clock_offset": "5.0",  # stamps are those of the recording, moved to about now
        "tracking.enabled": "false",  # whatever came before; test_tracking.py follows people
    }
    processes["planner"] = team.start("planner_node", files=files, params=patient)
    peer = Peer(domain)
    try:
        yield _play(request.param, peer, recording, processes)
        for process in processes.values():
            process.stop()
    finally:
        peer.close()


def _play(name: str, peer: Peer, recording: Recording, processes: dict[str, NodeProcess]) -> Run:
    kinds = {
        "tracked_people": People,
        "people_poses": PoseArray,
        "group_centroid": PointStamped,
        "short_term_map": PointCloud2,
        "markers": MarkerArray,
    }
    heard = {topic: peer.hear(kind, f"/{topic}") for topic, kind in kinds.items()}
    run = Run(
        name,
        processes,
        peer,
        sent={robot: [] for robot in ROBOTS},
        truth=np.array([[p.position.x, p.position.y] for p in recording.truth[0].poses]),
        points={robot: peer.hear(PointCloud2, f"/{robot}/points") for robot in ROBOTS},
        poses={robot: peer.hear(PoseWithCovarianceStamped, f"/{robot}/pose") for robot in ROBOTS},
    )
    peer.until_active(*(process.name for process in processes.values()))
    _warm_up(run, recording, heard)
    start = time.time_ns() + 500_000_000
    shift = start - stamp_of(recording.truth[0])
    for frame in range(len(recording.truth)):
        _send_frame(run, recording, frame, shift)
        _until_heard(run, frame)
        if frame in ABSENT:  # all that was sent has arrived; nobody else is to be waited for
            peer.next_findings(PLANNER)
            peer.must_set(PLANNER, interval__max_wait=0.0)
        _until_used(run, heard["tracked_people"], frame)
        if frame in ABSENT:
            peer.must_set(PLANNER, interval__max_wait=5.0)
    stamps = [s for s in map(stamp_of, heard["tracked_people"]) if s >= start]
    for topic, got in heard.items():
        by_stamp = run.heard[topic] = {}

        def arrived(by_stamp: Any = by_stamp, got: Any = got) -> bool:
            by_stamp.update({s: m for m in got if (s := _stamp_in(m)) >= start})
            return list(by_stamp) == stamps

        peer.until(arrived, f"{topic} of all intervals")
    return run


def _wanted(run: Run, frame: int) -> set[tuple[str, int]]:
    """The scans of a frame: robot and stamp."""
    return {
        (robot, stamp_of(run.sent[robot][-1]["left"][0]))
        for robot in ROBOTS
        if robot not in ABSENT.get(frame, ())
    }


def _until_heard(run: Run, frame: int) -> None:
    wanted = _wanted(run, frame)
    run.peer.until(lambda: wanted <= run.scans_heard(), f"frame {frame}: scans {wanted}")


def _until_used(run: Run, people: list[Any], frame: int) -> None:
    wanted = _wanted(run, frame)
    run.peer.until(
        lambda: wanted <= {_scan_key(scan) for message in people for scan in message.scans},
        lambda: f"frame {frame}: {wanted}; got {[list(m.scans) for m in people[-2:]]}",
    )


def _warm_up(run: Run, recording: Recording, heard: dict[str, list[Any]]) -> None:
    """Sends the first frame again and again until all connections stand."""

    def connected() -> bool:
        now = time.time_ns()
        for robot in ROBOTS:
            for offset in (-20_000_000, 20_000_000):
                odometry = stamped(recording.odometry[robot][0], now + offset)
                run.peer.send(f"/{robot}/odom", odometry)
            _send_view(run.peer, robot, recording.views[robot][0], now)
        run.warm_ups += 1
        for _ in range(20 * run.warm_ups):  # 0.4 s, and longer on a machine that needs it
            run.peer.spin(0.02)
            full = [m for m in heard["tracked_people"] if len(m.scans) == len(ROBOTS)]
            if full and stamp_of(full[-1]) == now:
                break
        lists = [full, *heard.values(), *run.points.values(), *run.poses.values()]
        return all(lists) and stamp_of(full[-1]) == now

    run.peer.until(connected, lambda: {p.name: p.log for p in run.processes.values()})


def _send_view(peer: Peer, robot: str, view: Any, stamp_ns: int) -> dict[str, tuple[Any, Any]]:
    sent = {}
    for camera, (image, info) in view.items():
        sent[camera] = (stamped(image, stamp_ns), stamped(info, stamp_ns))
        peer.send(f"/{robot}/{camera}/camera_info", sent[camera][1])
        kind = "top" if camera == "top" else camera
        peer.send(f"/{robot}/{kind}/image_rect", sent[camera][0])
    return sent


def _send_frame(run: Run, recording: Recording, frame: int, shift: int) -> None:
    """The odometry until a moment after the images, then these."""
    for number, robot in enumerate(ROBOTS):
        view = recording.views[robot][frame]
        stamp_ns = stamp_of(view["left"][0]) + shift
        begin = -math.inf if frame == 0 else stamp_ns - 160_000_000
        for recorded in recording.odometry[robot]:
            if begin < stamp_of(recorded) + shift <= stamp_ns + 40_000_000:
                odometry = stamped(recorded, stamp_of(recorded) + shift)
                if run.name == "team":
                    _move(odometry, number, (stamp_of(recorded) - 1.7e18) / 1e9)
                run.peer.send(f"/{robot}/odom", odometry)
    run.peer.until(
        lambda: all(
            stamp_of(run.poses[r][-1]) > stamp_of(recording.views[r][frame]["left"][0]) + shift
            for r in ROBOTS
        ),
        "poses past the images",
    )
    for robot in ROBOTS:
        if robot not in ABSENT.get(frame, ()):
            view = recording.views[robot][frame]
            stamp_ns = stamp_of(view["left"][0]) + shift
            run.sent[robot].append(_send_view(run.peer, robot, view, stamp_ns))


def _move(odometry: Odometry, number: int, t: float) -> None:
    """A robot that curves along, each its own way, and is less and less sure of where it is."""
    position, q = odometry.pose.pose.position, odometry.pose.pose.orientation
    yaw = 2.0 * math.atan2(q.z, q.w) + 0.02 * math.sin(3.0 * t + number)
    position.x += 0.05 * math.sin(2.0 * t + number)
    position.y += 0.03 * t * (1 - number)
    q.z, q.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
    grown = 1e-4 * (1.0 + t + number)
    covariance = np.diag([grown, 2.0 * grown, 0.0, 0.0, 0.0, 0.5 * grown])
    covariance[0, 5] = covariance[5, 0] = 0.1 * grown
    odometry.pose.covariance = covariance.reshape(-1)


def _scan_key(scan: Any) -> tuple[str, int]:
    return scan.robot, messages.stamp_ns_of(scan.stamp)


def _stamp_in(message: Any) -> int:
    return stamp_of(message.markers[0] if isinstance(message, MarkerArray) else message)


def _in_process(run: Run, message: Any) -> tuple[CorePeople, dict[str, Pose]]:
    """What the method makes of the scans that a message names, in this process."""
    scans, poses = [], {}
    for robot, named in messages.read_people_scans(message).items():
        (points,) = [m for m in run.points[robot] if stamp_of(m) == named.stamp_ns]
        scans.append(messages.read_scan(points, robot))
        poses[robot] = run.buffers[robot].at(named.stamp_ns, 250_000_000)
    return _planner(run).step(scans, poses, stamp_of(message)), poses


def _planner(run: Run) -> Planner:
    return Planner(load_team(*CONFIGS[run.name]).planner.memoryless())


def _xy(point: Any) -> tuple[float, float]:
    return point.x, point.y


def _covariance(with_covariance: Any) -> np.ndarray:
    return np.reshape(with_covariance.covariance, (6, 6))


# --- the same answer, distributed or not ----------------------------------------------------------


def test_intervals_are_as_sent(run: Run) -> None:
    """Each frame is one interval, of exactly those robots that sent it."""
    for frame, message in enumerate(run.people):
        wanted = [robot for robot in ROBOTS if robot not in ABSENT.get(frame, ())]
        assert [scan.robot for scan in message.scans] == wanted
    assert len(run.people) == 15
    used = [_scan_key(scan) for message in run.people for scan in message.scans]
    assert len(set(used)) == len(used), "a scan was used twice"


def test_stamp_is_that_of_the_newest_scan_and_frame_is_map(run: Run) -> None:
    for message in run.people:
        assert message.header.frame_id == "map"
        assert stamp_of(message) == max(_scan_key(scan)[1] for scan in message.scans)


def test_points_equal_those_of_the_method(run: Run) -> None:
    files = CONFIGS[run.name]
    configs = load_team(*files).robots
    for robot in ROBOTS:
        by_stamp = {stamp_of(message): message for message in run.points[robot]}
        for view in run.sent[robot]:
            stages = stages_of(view, configs[robot], robot)
            message = by_stamp[stages.scan.stamp_ns]
            assert message.header.frame_id == f"{robot}/base_link"
            assert len(stages.scan.cells) > 20
            np.testing.assert_array_equal(records_of(message), stages.scan.cells.to_records())


def test_poses_in_people_are_those_at_the_stamps_of_scans(run: Run) -> None:
    for message in run.people:
        _, poses = _in_process(run, message)
        for scan in message.scans:
            wanted, got = poses[scan.robot], scan.pose
            assert (*_xy(got.pose.position), got.pose.position.z) == (wanted.x, wanted.y, 0.0)
            q = got.pose.orientation
            assert (q.x, q.y) == (0.0, 0.0)
            assert (q.z, q.w) == (math.sin(wanted.yaw / 2.0), math.cos(wanted.yaw / 2.0))
            planar = np.zeros((6, 6))
            planar[np.ix_((0, 1, 5), (0, 1, 5))] = wanted.covariance
            np.testing.assert_array_equal(_covariance(got), planar)
            if run.name == "team":
                assert wanted.covariance[0, 0] > 0


def test_people_equal_those_of_the_method(run: Run) -> None:
    """Every field, for every interval: float64 bit for bit, float32 as rounded."""
    for message in run.people:
        wanted, _ = _in_process(run, message)
        assert stamp_of(message) == wanted.stamp_ns
        assert len(message.persons) == len(wanted.persons)
        for got, person in zip(message.persons, wanted.persons, strict=True):
            assert _xy(got.pose.pose.position) == tuple(person.position)
            covariance = np.zeros((6, 6))
            covariance[:2, :2] = person.covariance
            covariance[5, 5] = math.pi**2 / 3.0  # of a heading that is unknown
            np.testing.assert_array_equal(_covariance(got.pose), covariance)
            assert got.height == np.float32(person.height)
            assert got.sigma == np.float32(person.sigma)
            assert tuple(got.robots) == person.robots
            assert (got.id, got.coasting) == (0, False)
            assert math.isnan(got.velocity.twist.linear.x)
        assert len(message.groups) == (wanted.group is not None)
        for got in message.groups:
            assert wanted.group is not None
            assert _xy(got.centre.pose.position) == tuple(wanted.group.centre)
            np.testing.assert_array_equal(_covariance(got.centre)[:2, :2], wanted.group.covariance)
            assert got.radius == np.float32(wanted.group.radius)
            assert got.rms_spread == np.float32(wanted.group.rms_spread)
            assert got.size == wanted.group.size == len(message.persons)
    assert sum(len(message.persons) for message in run.people) > 30


def test_people_can_be_computed_from_the_poses_in_the_message(run: Run) -> None:
    """The message is sufficient, without the topic `pose`."""
    for message in run.people:
        named = messages.read_people_scans(message)
        scans: list[Scan] = []
        for robot, pose in named.items():
            (points,) = [m for m in run.points[robot] if stamp_of(m) == pose.stamp_ns]
            scans.append(messages.read_scan(points, robot))
        wanted = _planner(run).step(scans, named, stamp_of(message))
        got = [_xy(person.pose.pose.position) for person in message.persons]
        # A heading goes through a quaternion on its way: the last digit may differ.
        np.testing.assert_allclose(got, [p.position for p in wanted.persons], rtol=0, atol=1e-12)


def test_the_other_topics_agree_with_people(run: Run) -> None:
    for stamp_ns, message in run.heard["tracked_people"].items():
        places = [_xy(person.pose.pose.position) for person in message.persons]
        poses = run.heard["people_poses"][stamp_ns]
        assert poses.header == message.header
        assert [_xy(pose.position) for pose in poses.poses] == places
        assert all(pose.orientation.w == 1.0 for pose in poses.poses)

        centroid = run.heard["group_centroid"][stamp_ns]
        assert centroid.header == message.header
        (group,) = message.groups
        assert centroid.point == group.centre.pose.position
        np.testing.assert_allclose(_xy(centroid.point), np.mean(places, axis=0), atol=1e-12)
        away = np.linalg.norm(np.subtract(places, _xy(centroid.point)), axis=1)
        assert group.radius == pytest.approx(away.max(), abs=1e-6)
        assert group.rms_spread == pytest.approx(np.sqrt(np.mean(away**2)), abs=1e-6)


def test_short_term_map_holds_every_cell_once(run: Run) -> None:
    for stamp_ns, message in run.heard["tracked_people"].items():
        cloud = run.heard["short_term_map"][stamp_ns]
        assert cloud.header == message.header
        cells = records_of(cloud, MAP_DTYPE)
        for index, scan in enumerate(message.scans):
            (points,) = [m for m in run.points[scan.robot] if stamp_of(m) == _scan_key(scan)[1]]
            sent, placed = records_of(points), cells[cells["robot"] == index]
            q, position = scan.pose.pose.orientation, scan.pose.pose.position
            yaw = 2.0 * math.atan2(q.z, q.w)
            x = position.x + math.cos(yaw) * sent["x"] - math.sin(yaw) * sent["y"]
            y = position.y + math.sin(yaw) * sent["x"] + math.cos(yaw) * sent["y"]
            np.testing.assert_allclose(placed["x"], x, atol=2e-6)
            np.testing.assert_allclose(placed["y"], y, atol=2e-6)
            for name in ("z", "z_min", "top", "count"):
                np.testing.assert_array_equal(placed[name], sent[name])
        assert cells["robot"].max() == len(message.scans) - 1
        assert set(cells["person"]) - {-1} == set(range(len(message.persons)))
        of_bodies = "body" in (records_of(run.points["robot_a"][0]).dtype.names or ())
        assert of_bodies == (run.name == "team")
        if not of_bodies:
            assert -1 in cells["person"]  # the table, and what else is there
        for index, person in enumerate(message.persons):
            own = cells[cells["person"] == index]
            assert len(set(own["cluster"])) == 1
            np.testing.assert_allclose(
                [own["x"].mean(dtype=float), own["y"].mean(dtype=float)],
                _xy(person.pose.pose.position),
                # Bodies are joined by their covariances; each of them is this near at most.
                atol=0.35 if of_bodies else 2e-6,
            )
            assert own["top"].max() == person.height
            assert {message.scans[i].robot for i in set(own["robot"])} == set(person.robots)


def test_markers_show_people_centre_and_robots(run: Run) -> None:
    for stamp_ns, message in run.heard["tracked_people"].items():
        markers = run.heard["markers"][stamp_ns].markers
        assert markers[0].action == Marker.DELETEALL
        assert all(marker.header == message.header for marker in markers)
        drawn = {
            name: [m for m in markers[1:] if m.ns == name]
            for name in ("people", "heights", "centre", "robots", "robot names", "robot ellipses")
        }
        assert sum(map(len, drawn.values())) == len(markers) - 1
        assert len({(marker.ns, marker.id) for marker in markers}) == len(markers)
        assert len(drawn["people"]) == len(drawn["heights"]) == len(message.persons)
        for index, person in enumerate(message.persons):
            circle, label = drawn["people"][index], drawn["heights"][index]
            assert _xy(circle.pose.position) == _xy(person.pose.pose.position)
            assert circle.type == Marker.CYLINDER
            assert circle.scale.x == circle.scale.y == pytest.approx(2 * 3 * person.sigma)
            assert label.text == f"{index + 1}: {person.height:.2f} m"
        (centre,) = drawn["centre"]
        assert centre.pose.position == message.groups[0].centre.pose.position
        assert [marker.text for marker in drawn["robot names"]] == [
            scan.robot for scan in message.scans
        ]
        assert [m.pose for m in drawn["robots"]] == [scan.pose.pose for scan in message.scans]
        for ellipse, scan in zip(drawn["robot ellipses"], message.scans, strict=True):
            assert _xy(ellipse.pose.position) == _xy(scan.pose.pose.position)
            variances = np.linalg.eigvalsh(np.reshape(scan.pose.covariance, (6, 6))[:2, :2])
            axes = 2 * 3 * np.sqrt(variances)
            assert (ellipse.scale.y, ellipse.scale.x) == pytest.approx(axes)


def test_all_five_people_are_found_where_they_are(run: Run) -> None:
    """All people and no others, within 6 cm, or more by as much as the odometry was perturbed."""
    errors = []
    for message in run.full:
        found = np.array([_xy(person.pose.pose.position) for person in message.persons])
        assert len(found) == len(run.truth) == 5
        _, true, distance = match(found, run.truth, distance=0.25)
        assert sorted(true) == [0, 1, 2, 3, 4]
        errors.extend(distance)
    assert len(run.full) == 15 - len(ABSENT)
    assert np.mean(errors) <= {"paper": 0.06, "team": 0.12}[run.name]


# --- images never leave the robot -----------------------------------------------------------------


@once
def test_images_go_to_their_robot_only(run: Run) -> None:
    """In DDS every image topic has one reader, the robot's own node."""
    image = "sensor_msgs/msg/Image"
    node = run.peer.node
    topics = [name for name, types in node.get_topic_names_and_types() if image in types]
    assert len(topics) == 7  # two of each robot, and the third camera of robot_a
    for topic in topics:
        readers = node.get_subscriptions_info_by_topic(topic)
        assert [(r.node_namespace, r.node_name) for r in readers] == [
            (topic.rsplit("/", 2)[0], "robot_node")
        ]
        # Matched, not only announced: so many readers get what is written.
        assert run.peer._publishers[topic].get_subscription_count() == 1


@once
def test_planner_hears_scans_and_poses_only(run: Run) -> None:
    wanted = {f"/{robot}/points": ["sensor_msgs/msg/PointCloud2"] for robot in ROBOTS}
    wanted |= {
        f"/{robot}/pose": ["geometry_msgs/msg/PoseWithCovarianceStamped"] for robot in ROBOTS
    }
    wanted["/team_poses"] = ["mrs_people_msgs/msg/TeamPose"]
    assert run.peer.heard_by(PLANNER) == wanted


@once
def test_robots_publish_no_images(run: Run) -> None:
    for robot in ROBOTS:
        published = run.peer.published_by(f"/{robot}/robot_node")
        images = [name for name, types in published.items() if "sensor_msgs/msg/Image" in types]
        assert images == []
        assert f"/{robot}/points" in published


def test_scans_and_poses_are_small_against_images(run: Run) -> None:
    """Per frame, in bytes."""
    for robot in ROBOTS:
        sent = run.sent[robot]
        stamps = {stamp_of(view["left"][0]) for view in sent}
        images = sum(len(image.data) for view in sent for image, _ in view.values())
        scans = [m for m in run.points[robot] if stamp_of(m) in stamps]
        assert len(scans) == len(sent)
        left = sum(len(serialize_message(m)) for m in (*scans, *run.poses[robot]))
        assert left < 0.25 * images, f"{left} of {images} bytes"


# --- what the team says of itself -----------------------------------------------------------------


@once
def test_diagnostics_of_a_working_team_are_ok(run: Run) -> None:
    reports = run.peer.next_findings(PLANNER, *(f"/{robot}/robot_node" for robot in ROBOTS))
    findings = reports[PLANNER]
    intervals = findings["intervals"]
    assert intervals.level == OK
    assert intervals.values["robots"] == "robot_a, robot_b, robot_c"
    assert intervals.count("people") == len(run.people[-1].persons)
    assert intervals.count("cells") == sum(
        len(records_of(m))
        for robot in ROBOTS
        for m in run.points[robot]
        if (robot, stamp_of(m)) in {_scan_key(s) for s in run.people[-1].scans}
    )
    for robot in ROBOTS:
        assert findings[f"robot {robot}"].count("dropped.no_pose") == 0
        scan = reports[f"/{robot}/robot_node"]["scan"]
        # The first ones were sent before all connections stood.
        assert 0 <= len(run.sent[robot]) + run.warm_ups - scan.count("frames") < run.warm_ups
        assert scan.count("cells") == len(records_of(run.points[robot][-1]))
        pose = reports[f"/{robot}/robot_node"]["pose"]
        assert pose.level == OK
        assert float(pose.values["x"]) == pytest.approx(
            run.poses[robot][-1].pose.pose.position.x, abs=1e-3
        )


@once
def test_two_robots_of_one_name_are_reported(run: Run, team: Team) -> None:
    other = team.start("robot_node", namespace="/robot_b")
    finding = run.peer.until_finding(PLANNER, "robot robot_b", lambda f: f.level == ERROR)
    assert finding.message == (
        "2 publishers on /robot_b/points: two robots share a name, rename one; "
        "or one was killed in the last 20 s"
    )
    assert run.peer.findings(PLANNER)["robot robot_a"].level != ERROR
    other.stop()
    run.peer.until_finding(PLANNER, "robot robot_b", lambda f: "share a name" not in f.message)


@once
def test_no_message_was_lost(run: Run) -> None:
    """The last test: no robot dropped anything."""
    nodes = [f"/{robot}/robot_node" for robot in ROBOTS]
    for findings in run.peer.next_findings(*nodes).values():
        assert findings["pairs"].count("stamp_resets") == 0
        for topic in ("left/camera_info", "right/camera_info", "odom"):
            assert findings[topic].count("dropped") == 0
