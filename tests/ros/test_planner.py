"""planner_node: when an interval closes, what goes into it, and what is wrong with its inputs.

A planner in a namespace with three robots by name, which the test plays. Unless a test is about
waiting, all three are always waited for: then nothing depends on the machine's speed.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from mrs_people_msgs.msg import RelativePoses, TeamPose
from sensor_msgs.msg import PointCloud
from std_msgs.msg import String

from mrs_people_loc.messages import read_relative_poses
from ros.harness import ERROR, OK, STALE, WARN, Finding, Peer, Team, holds
from ros.planner_peer import (
    CELL,
    PATIENT,
    PlannerPeer,
    PlayedRobot,
    cloud_of,
    person_cells,
    places,
    pose_of,
    robots_in,
)
from ros.recording import set_stamp, stamp_of

SECOND = 1_000_000_000
NAMES = ["robot_a", "robot_b", "robot_c"]
PLACES = [(0.0, 0.0, 0.0), (4.0, 0.0, math.pi / 2), (2.0, 4.0, -2.0)]
SOMEBODY = (2.0, 1.0)
RELATIVE = "/team/relative_poses"


@pytest.fixture(scope="module")
def planner(team: Team, peer: Peer) -> PlannerPeer:
    # Each interval stands for itself; test_tracking.py follows people.
    memoryless = {"tracking.enabled": "false"}
    params = {"robots": f"[{','.join(NAMES)}]", **PATIENT, **memoryless}
    process = team.start("planner_node", namespace="/team", params=params)
    made = PlannerPeer(peer, process, "/team/")
    peer.until_active(made.node)
    return made


@pytest.fixture(scope="module")
def robots(peer: Peer) -> list[PlayedRobot]:
    return [
        PlayedRobot(peer, f"team/{name}", place) for name, place in zip(NAMES, PLACES, strict=True)
    ]


@pytest.fixture
def live(planner: PlannerPeer) -> Iterator[Callable[..., None]]:
    """Sets parameters of the interval, and puts them back at the end."""
    defaults = {
        "interval__max_wait": 5.0,
        "interval__robot_timeout": 60.0,
        "interval__max_scan_age": 0.25,
        "interval__max_pose_age": 0.25,
    }

    def change(**params: float) -> None:
        planner.peer.must_set(planner.node, **params)

    yield change
    change(**defaults)


def _still_works(planner: PlannerPeer, robots: list[PlayedRobot]) -> Any:
    """All robots see somebody: one person."""
    stamp_ns = planner.now()
    for robot in robots:
        robot.send(stamp_ns, SOMEBODY)
    message = planner.people_at(stamp_ns)
    assert robots_in(message) == NAMES
    assert places(message) == [SOMEBODY]
    assert planner.process.alive
    return message


# --- the beginning --------------------------------------------------------------------------------


def test_silence_and_wrong_types_are_reported(planner: PlannerPeer, domain: int) -> None:
    stranger = Peer(domain, "stranger")
    try:
        stranger.publisher(PointCloud, "/team/robot_c/points")
        text = (
            r"no data on /team/robot_c/points for \d+ s; publishers: 1; "
            "published as sensor_msgs/msg/PointCloud, wanted: sensor_msgs/msg/PointCloud2"
        )
        finding = planner.until_finding("robot_c/points", lambda f: holds(f.message, [text]), text)
        assert finding.level == ERROR
        findings = planner.peer.findings(planner.node)
        for name in NAMES:
            text = rf"no data on /team/{name}/pose for \d+ s; publishers: 0"
            assert holds(findings[f"{name}/pose"].message, [text])
            planner.peer.until(lambda t=text: holds(planner.process.log, [t]), text)  # type: ignore[misc]
            assert findings[f"robot {name}"].message == "no scan used yet"
        assert (findings["intervals"].level, findings["intervals"].message) == (
            STALE,
            "no interval yet",
        )
    finally:
        stranger.close()


def test_robots_named_in_advance_are_waited_for(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    """The first interval has all of them, too."""
    robot_a, robot_b, robot_c = robots
    for robot in robots:  # connections stand before the first scan
        planner.peer.until(
            lambda r=robot: _pose_arrived(planner, r),  # type: ignore[misc]
            "a pose arrives",
        )
    taken = planner.taking("robot_a/points")
    stamp_ns = planner.now()
    robot_a.send(stamp_ns, SOMEBODY)
    taken()
    assert planner.people == []
    robot_b.send(stamp_ns, SOMEBODY)
    robot_c.send(stamp_ns + 1, SOMEBODY)
    message = planner.people_at(stamp_ns + 1)
    assert robots_in(message) == NAMES
    assert len(planner.people) == 1


def _pose_arrived(planner: PlannerPeer, robot: PlayedRobot) -> bool:
    name = robot.name.removeprefix("team/")
    robot.send_pose(pose_of(planner.now(), *robot.place))
    robot.peer.publisher(type(robot.scan(0)), f"/{robot.name}/points")
    planner.peer.spin(0.1)
    finding = planner.peer.findings(planner.node).get(f"robot {name}")
    return finding is not None and finding.count("poses_held") > 0


# --- what goes into an interval, and when it closes -----------------------------------------------


def test_person_seen_by_all_robots_is_one_person(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    message = _still_works(planner, robots)
    (person,) = message.persons
    assert list(person.robots) == NAMES
    assert person.height == np.float32(1.7)
    planner.peer.until(
        lambda: planner.people_poses and stamp_of(planner.people_poses[-1]) == stamp_of(message),
        "people_poses",
    )
    assert planner.people_poses[-1].header == message.header
    finding = planner.until_finding("intervals", lambda f: f.level == OK)
    assert finding.values["robots"] == "robot_a, robot_b, robot_c"


def test_all_people_are_found_and_the_group_has_a_centre(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    centroids = planner.peer.hear(PointStamped, "/team/group_centroid")
    people = [(1.0, 0.0), (3.0, 0.0), (2.0, 3.0)]

    def heard() -> bool:
        stamp_ns = planner.now()
        for robot, seen in zip(robots, people, strict=True):
            robot.send(stamp_ns, seen)
        message = planner.people_at(stamp_ns)
        assert places(message) == sorted(people)
        assert {tuple(p.robots) for p in message.persons} == {(name,) for name in NAMES}
        (group,) = message.groups
        centre = group.centre.pose.position
        assert (centre.x, centre.y) == pytest.approx((2.0, 1.0), abs=1e-6)
        assert group.size == 3
        assert group.radius == pytest.approx(2.0, abs=1e-6)
        assert group.rms_spread == pytest.approx(math.sqrt(8.0 / 3.0), abs=1e-6)
        planner.peer.spin(0.1)
        return bool(centroids) and stamp_of(centroids[-1]) == stamp_ns

    planner.peer.until(heard, "group_centroid")
    assert (centroids[-1].point.x, centroids[-1].point.y) == pytest.approx((2.0, 1.0), abs=1e-6)


def test_empty_scans_make_an_interval_without_people(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    stamp_ns = planner.now()
    for robot in robots:
        robot.send(stamp_ns)
    message = planner.people_at(stamp_ns)
    assert robots_in(message) == NAMES
    assert (list(message.persons), list(message.groups)) == ([], [])
    planner.peer.until(
        lambda: planner.people_poses and stamp_of(planner.people_poses[-1]) == stamp_ns,
        "empty people_poses, too",
    )
    assert list(planner.people_poses[-1].poses) == []
    # One of them sees nothing: the others' person stays.
    stamp_ns = planner.now()
    for robot, seen in zip(robots, [[SOMEBODY], [], [SOMEBODY]], strict=True):
        robot.send(stamp_ns, *seen)
    message = planner.people_at(stamp_ns)
    assert [list(p.robots) for p in message.persons] == [["robot_a", "robot_c"]]


def test_scan_is_placed_with_the_pose_at_its_stamp(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    """A robot that drives and turns is placed where it was at the scan's stamp."""
    robot_a, *others = robots
    _still_works(planner, robots)
    stamp_ns = planner.now() + SECOND // 2
    robot_a.send_pose(pose_of(stamp_ns - 30_000_000, 1.0, 2.0, 3.1))
    robot_a.send_pose(pose_of(stamp_ns + 10_000_000, 1.4, 1.6, -3.1))  # past pi
    robot_a.send_points(cloud_of(person_cells(1.0, 0.0), robot_a.frame_id, stamp_ns))
    for robot in others:
        robot.send(stamp_ns)
    message = planner.people_at(stamp_ns)
    named = message.scans[0].pose.pose
    yaw = 3.1 + 0.75 * (2 * math.pi - 6.2)
    assert (named.position.x, named.position.y) == pytest.approx((1.3, 1.7), abs=1e-12)
    assert math.remainder(
        2 * math.atan2(named.orientation.z, named.orientation.w) - yaw, 2 * math.pi
    ) == (pytest.approx(0.0, abs=1e-12))
    (person,) = message.persons
    place = person.pose.pose.position
    assert (place.x, place.y) == pytest.approx((1.3 + math.cos(yaw), 1.7 + math.sin(yaw)), abs=1e-6)
    planner._last_ns = stamp_ns + 10_000_000
    _still_works(planner, robots)


def test_scans_wait_for_their_poses(planner: PlannerPeer, robots: list[PlayedRobot]) -> None:
    """Scans that arrive before their poses are not placed by extrapolation."""
    robot_a, *others = robots
    _still_works(planner, robots)
    stamp_ns = planner.now() + SECOND // 5
    robot_a.send_points(cloud_of(person_cells(1.0, 0.0), robot_a.frame_id, stamp_ns))
    for robot in others:
        robot.send(stamp_ns)
    planner.peer.next_findings(planner.node)
    assert stamp_of(planner.people[-1]) < stamp_ns
    robot_a.send_pose(pose_of(stamp_ns, 7.0, 7.0, 0.0))
    assert places(planner.people_at(stamp_ns)) == [(8.0, 7.0)]
    planner._last_ns = stamp_ns


def test_newer_scan_replaces_a_waiting_one(planner: PlannerPeer, robots: list[PlayedRobot]) -> None:
    robot_a, *others = robots
    before = planner.peer.next_findings(planner.node)[planner.node]["robot robot_a"]
    taken = planner.taking("robot_a/points")
    first, second = planner.now(), planner.now()
    robot_a.send(first, (1.0, 1.0))
    taken()
    robot_a.send(second, (3.0, 3.0))
    after = planner.until_finding(
        "robot robot_a",
        lambda f: f.count("dropped.superseded") > before.count("dropped.superseded"),
    )
    assert after.count("dropped.superseded") == before.count("dropped.superseded") + 1
    for robot in others:
        robot.send(second)
    assert places(planner.people_at(second)) == [(3.0, 3.0)]
    assert first not in [stamp_of(m) for m in planner.people]


def test_missing_robot_is_waited_for_no_longer_than_max_wait(
    planner: PlannerPeer, robots: list[PlayedRobot], live: Callable[..., None]
) -> None:
    _still_works(planner, robots)
    live(interval__max_wait=0.6)
    stamp_ns = planner.now()
    began = time.monotonic()
    robots[0].send(stamp_ns, SOMEBODY)
    robots[1].send(stamp_ns, SOMEBODY)
    message = planner.people_at(stamp_ns)
    assert time.monotonic() - began > 0.6
    # (a busy machine may have had no time to hear the second one)
    assert robots_in(message) in (["robot_a", "robot_b"], ["robot_a"])
    assert places(message) == [SOMEBODY]


def test_silent_robot_is_not_waited_for(
    planner: PlannerPeer, robots: list[PlayedRobot], live: Callable[..., None]
) -> None:
    _still_works(planner, robots)
    live(interval__robot_timeout=0.5)
    robot_a = robots[0]
    stamp_ns = planner.now()
    robot_a.send(stamp_ns, SOMEBODY)  # closes when the others have been silent for so long
    assert robots_in(planner.people_at(stamp_ns)) == ["robot_a"]
    took_s = []
    for _ in range(3):  # and from now on at once, below max_wait if the machine is not held up
        stamp_ns = planner.now()
        began = time.monotonic()
        robot_a.send(stamp_ns, SOMEBODY)
        assert robots_in(planner.people_at(stamp_ns)) == ["robot_a"]
        took_s.append(time.monotonic() - began)
    assert min(took_s) < 4.0
    live(interval__robot_timeout=60.0)
    _still_works(planner, robots)


def test_scan_that_is_too_old_is_left_out(
    planner: PlannerPeer, robots: list[PlayedRobot], live: Callable[..., None]
) -> None:
    _still_works(planner, robots)
    before = planner.peer.next_findings(planner.node)[planner.node]["robot robot_b"]
    planner.peer.spin(0.5)
    stamp_ns = planner.now()
    robots[1].send(stamp_ns - 400_000_000, (3.0, 3.0))
    robots[0].send(stamp_ns, SOMEBODY)
    robots[2].send(stamp_ns - 200_000_000, SOMEBODY)
    message = planner.people_at(stamp_ns)
    assert robots_in(message) == ["robot_a", "robot_c"]
    assert places(message) == [SOMEBODY]
    after = planner.until_finding("robot robot_b", lambda f: f.count("dropped.too_old") > 0)
    assert after.count("dropped.too_old") == before.count("dropped.too_old") + 1
    assert (after.level, after.message) == (
        WARN,
        "1 scans left out: older than the newest by more than interval.max_scan_age",
    )
    assert (
        "robot_b: scan left out: scan is 0.400 s older than the newest; allowed: 0.25 s"
        in planner.process.log
    )
    # What is too old is a parameter.
    live(interval__max_scan_age=0.5)
    planner.peer.spin(0.5)
    stamp_ns = planner.now()
    robots[1].send(stamp_ns - 400_000_000, (3.0, 3.0))
    robots[0].send(stamp_ns, SOMEBODY)
    robots[2].send(stamp_ns, SOMEBODY)
    assert places(planner.people_at(stamp_ns)) == [SOMEBODY, (3.0, 3.0)]


def test_scan_that_is_older_than_the_last_interval_is_left_out(
    planner: PlannerPeer, robots: list[PlayedRobot], live: Callable[..., None]
) -> None:
    """It arrives alone: people must not jump back."""
    live(interval__max_wait=0.05)
    _still_works(planner, robots)
    before = planner.peer.next_findings(planner.node)[planner.node]["robot robot_b"]
    held_back_ns = planner.now()
    planner.peer.spin(0.5)
    stamp_ns = planner.now()
    robots[0].send(stamp_ns, SOMEBODY)
    assert robots_in(planner.people_at(stamp_ns)) == ["robot_a"]
    heard, taken = len(planner.people), planner.taking("robot_b/points")
    robots[1].send(held_back_ns, (3.0, 3.0))
    taken()
    stamp_ns = planner.now()
    robots[2].send(stamp_ns, SOMEBODY)
    assert robots_in(planner.people_at(stamp_ns)) == ["robot_c"]
    assert len(planner.people) == heard + 1
    count = before.count("dropped.too_old") + 1
    planner.until_finding("robot robot_b", lambda f: f.count("dropped.too_old") == count)
    live(interval__max_wait=5.0)
    _still_works(planner, robots)


def test_pose_that_jumps_or_is_far_away_is_reported(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    _still_works(planner, robots)
    robots[0].send_pose(pose_of(planner.now(), 5000.0, 0.0, 0.0))
    far = r"its pose is \(5000\.00, 0\.00\) m, 5\.0 km from the nearest other robot: is it in map"
    finding = planner.until_finding("robot robot_a", lambda f: holds(f.message, [far]))
    assert finding.level == WARN
    _still_works(planner, robots)
    jump = r"its pose jumped from \(5000\.00, 0\.00\) m to \(0\.00, 0\.00\) m in \d+\.\d\d s"
    after = planner.until_finding("robot robot_a", lambda f: holds(f.message, [jump]))
    assert after.level == WARN
    assert after.count("pose_jumps") == finding.count("pose_jumps") + 1


def test_scan_without_a_pose_near_it_is_left_out(
    planner: PlannerPeer, robots: list[PlayedRobot], live: Callable[..., None]
) -> None:
    robot_a, *others = robots
    _still_works(planner, robots)
    live(interval__max_wait=1.0)
    last = planner._last_ns
    stamp_ns = last + SECOND
    robot_a.send_points(robot_a.scan(stamp_ns, (3.0, 3.0)))
    for robot in others:
        robot.send(stamp_ns, SOMEBODY)
    message = planner.people_at(stamp_ns)
    assert "robot_a" not in robots_in(message)
    assert places(message) == [SOMEBODY]
    finding = planner.until_finding("robot robot_a", lambda f: f.count("dropped.no_pose") == 1)
    assert finding.level == WARN
    text = (
        "robot_a: scan left out: the nearest pose is 1.000 s from the scan's stamp; allowed: 0.25 s"
    )
    planner.peer.until(lambda: text in planner.process.log, lambda: planner.process.log)
    # How near is a parameter; the robot stands still, so that pose does.
    live(interval__max_pose_age=2.5)
    stamp_ns = last + 2 * SECOND
    robot_a.send_points(robot_a.scan(stamp_ns, (3.0, 3.0)))
    for robot in others:
        robot.send(stamp_ns, SOMEBODY)
    assert places(planner.people_at(stamp_ns)) == [SOMEBODY, (3.0, 3.0)]
    planner._last_ns = stamp_ns


# --- bad messages ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bad:
    """Something bad: the topic, who sends it, and what is to be said of it (`ROBOT` sent it)."""

    topic: str
    send: Callable[[PlannerPeer, PlayedRobot], None]
    kind: str
    wanted: tuple[str, ...]


def _points(
    *wanted: str,
    spoil: Callable[[Any], None] = lambda message: None,
    records: Callable[[np.ndarray], np.ndarray] = lambda records: records,
    back_ns: int | None = None,
) -> Bad:
    """A scan of changed records, or with other fields of the message, or an old stamp."""

    def send(planner: PlannerPeer, robot: PlayedRobot) -> None:
        stamp_ns = planner.now() if back_ns is None else stamp_of(planner.people[-1]) - back_ns
        cells = records(person_cells(1.0, 0.0))
        message = cloud_of(cells, robot.frame_id, stamp_ns)
        spoil(message)
        robot.send_points(message)

    return Bad("points", send, "ScanError", wanted)


def _pose(
    *wanted: str, spoil: Callable[[Any], None] = lambda message: None, again: bool = False
) -> Bad:
    def send(planner: PlannerPeer, robot: PlayedRobot) -> None:
        stamp_ns = stamp_of(planner.people[-1]) if again else planner.now()
        message = pose_of(stamp_ns, *robot.place)
        spoil(message)
        robot.send_pose(message)

    return Bad("pose", send, "PoseError", wanted)


def _set(path: str, value: Any) -> Callable[[Any], None]:
    """Sets an attribute of a message, given by its dotted name; a function takes what is there."""
    *parents, name = path.split(".")

    def spoil(message: Any) -> None:
        for parent in parents:
            message = getattr(message, parent)
        setattr(message, name, value(getattr(message, name)) if callable(value) else value)

    return spoil


def _cell(name: str, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(records: np.ndarray) -> np.ndarray:
        records[name][3] = value
        return records

    return change


def _without(*names: str) -> Callable[[np.ndarray], np.ndarray]:
    def change(records: np.ndarray) -> np.ndarray:
        kept = [name for name in CELL.names or () if name not in names]
        made = np.empty(len(records), [(name, CELL[name]) for name in kept])
        for name in kept:
            made[name] = records[name]
        return made

    return change


def _retyped(name: str, kind: str, value: float) -> Callable[[np.ndarray], np.ndarray]:
    """One field of another type, with a value in one point."""

    def change(records: np.ndarray) -> np.ndarray:
        made = records.astype([(n, kind if n == name else CELL[n]) for n in CELL.names or ()])
        made[name][3] = value
        return made

    return change


def _field(index: int, **values: int) -> Callable[[Any], None]:
    def spoil(message: Any) -> None:
        for name, value in values.items():
            setattr(message.fields[index], name, value)

    return spoil


BAD = {
    "frame of another robot": _points(
        "frame_id is 'team/robot_z/base_link'", "wanted: 'team/ROBOT/base_link'",
        spoil=_set("header.frame_id", "team/robot_z/base_link"),
    ),
    "frame without the namespace": _points(
        "frame_id is 'base_link'", "wanted: 'team/ROBOT/base_link'",
        spoil=_set("header.frame_id", "base_link"),
    ),
    "field missing": _points(
        "fields are missing: top", "got: x, y, z, z_min, count", "wanted: x, y, z, z_min, top, c",
        records=_without("top"),
    ),
    "plain xyz cloud": _points(
        "fields are missing: z_min, top, count", "got: x, y, z;",
        records=_without("z_min", "top", "count"),
    ),
    "no fields": _points("fields are missing: x, y", "got: none", spoil=_set("fields", [])),
    "truncated": _points(
        "data has 839 bytes", r"row_step \* height = 840", spoil=_set("data", lambda d: d[:-1])
    ),
    "no data": _points("data has 0 bytes", "840", spoil=_set("data", b"")),
    "big-endian": _points(
        "is_bigendian is true", "wanted: little-endian", spoil=_set("is_bigendian", True)
    ),
    "point_step too small": _points(
        "field count ends at byte 24", "point_step is 20", spoil=_set("point_step", 20)
    ),
    "row_step too small": _points(
        "row_step is 24", "at least 840", spoil=_set("row_step", 24)
    ),
    "unknown datatype": _points("field top has datatype 9", spoil=_field(4, datatype=9)),
    "field of several numbers": _points(
        "field x has datatype 7 and count 3", spoil=_field(0, count=3)
    ),
    "NaN": _points("x is NaN or infinite in 1 of 35 points", records=_cell("x", math.nan)),
    "infinity": _points("top is NaN or infinite in 1 of 35", records=_cell("top", -math.inf)),
    "negative count": _points("count is negative", records=_retyped("count", "<i4", -1)),
    "count NaN": _points("count is NaN", records=_retyped("count", "<f4", math.nan)),
    "scan stamp repeated": _points(r"stamp is \d+ ns", r"newer than \d+ ns", back_ns=0),
    "scan stamp slightly back": _points(
        r"stamp is \d+ ns", r"newer than \d+ ns", back_ns=900_000_000
    ),
    "pose in odom": _pose(
        "frame_id is 'robot_a/odom'", "wanted: 'map'", spoil=_set("header.frame_id", "robot_a/odom")
    ),
    "pose with NaN": _pose(
        "pose holds NaN", r"position \(nan", spoil=_set("pose.pose.position.x", math.nan)
    ),
    "pose with infinity": _pose(
        "infinite", "inf", spoil=_set("pose.pose.position.y", -math.inf)
    ),
    "orientation not of length 1": _pose(
        "orientation has length 3", "quaternion of length 1",
        spoil=_set("pose.pose.orientation.x", math.sqrt(8.0)),
    ),
    "covariance with NaN": _pose(
        "covariance", "finite", spoil=_set("pose.covariance", np.full(36, math.nan))
    ),
    "pose stamp repeated": _pose(r"stamp \d+ ns is repeated", "one pose per stamp", again=True),
}  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What the diagnostics said before and after something bad, and what went wrong after it."""

    robot: str
    before: Finding
    after: Finding
    trouble: str


@pytest.fixture(scope="module")
def outcomes(planner: PlannerPeer, robots: list[PlayedRobot]) -> Mapping[str, Outcome]:
    """All of these, one per topic at a time, as a report takes a second."""
    queues = {
        kind: [name for name, bad in BAD.items() if bad.topic == kind]
        for kind in ("points", "pose")
    }
    result = {}
    while any(queues.values()):
        trouble = _what_does_not_work(planner, robots)
        sent = {}
        for robot, short in zip(robots, NAMES, strict=True):
            for queue in queues.values():
                if queue:
                    name = queue.pop(0)
                    topic = f"{short}/{BAD[name].topic}"
                    sent[name] = (short, topic, planner.peer.findings(planner.node)[topic])
                    BAD[name].send(planner, robot)
        after = {name: _once_counted(planner, *how[1:]) for name, how in sent.items()}
        trouble += _what_does_not_work(planner, robots)
        result |= {n: Outcome(how[0], how[2], after[n], trouble) for n, how in sent.items()}
    return result


def _once_counted(planner: PlannerPeer, topic: str, before: Finding) -> Finding:
    with contextlib.suppress(AssertionError):  # the test of this one will say it
        planner.peer.until_finding(
            planner.node,
            topic,
            lambda f: f.count("dropped") > before.count("dropped"),
            deadline=15.0,
        )
    return planner.peer.findings(planner.node)[topic]


def _what_does_not_work(planner: PlannerPeer, robots: list[PlayedRobot]) -> str:
    try:
        _still_works(planner, robots)
    except AssertionError as err:
        return str(err)
    return ""


@pytest.mark.parametrize("name", BAD)
def test_bad_message_is_reported_counted_and_dropped(
    outcomes: Mapping[str, Outcome], name: str
) -> None:
    bad, outcome = BAD[name], outcomes[name]
    before, after = outcome.before, outcome.after
    assert after.count("dropped") == before.count("dropped") + 1
    assert after.count(f"dropped.{bad.kind}") == before.count(f"dropped.{bad.kind}") + 1
    assert after.level == WARN
    assert after.message.startswith(f"{after.count('dropped')} dropped; last: ")
    wanted = [text.replace("ROBOT", outcome.robot) for text in bad.wanted]
    assert holds(after.message, wanted), after.message


@pytest.mark.parametrize("name", BAD)
def test_good_messages_are_used_after_a_bad_one(outcomes: Mapping[str, Outcome], name: str) -> None:
    """All robots see one person."""
    assert outcomes[name].trouble == ""


def test_bad_messages_are_in_the_log_with_their_topic(
    planner: PlannerPeer, outcomes: Mapping[str, Outcome]
) -> None:
    for name in ("frame of another robot", "pose in odom"):
        robot, bad = outcomes[name].robot, BAD[name]
        wanted = "; ".join(text.replace("ROBOT", robot) for text in bad.wanted)
        line = rf"/team/{robot}/{bad.topic}: {wanted} \[dropped: 1\]"
        assert holds(planner.process.log, [line]), planner.process.log


# --- strange, but legal ---------------------------------------------------------------------------


def _rearranged(records: np.ndarray) -> np.ndarray:
    """Other order, other types, further fields, gaps."""
    made = np.zeros(
        len(records),
        np.dtype(
            {
                "names": ["intensity", "count", "top", "y", "x", "z_min", "z"],
                "formats": ["<f4", "<u2", "<f4", "<f8", "<f8", "<f4", "<f4"],
                "offsets": [0, 4, 8, 16, 24, 32, 36],
                "itemsize": 48,
            }
        ),
    )
    for name in CELL.names or ():
        made[name] = records[name]
    made["intensity"] = math.nan
    return made


def _organized(message: Any) -> None:
    """Five rows of seven, with rubbish at the end of each."""
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(5, 7 * 24)
    message.height, message.width, message.row_step = 5, 7, 7 * 24 + 9
    message.data = np.pad(rows, ((0, 0), (0, 9)), constant_values=0xFF).tobytes()


@pytest.mark.parametrize(
    ("records", "spoil"),
    [(_rearranged, lambda message: None), (lambda records: records, _organized)],
    ids=["rearranged", "organized"],
)
def test_point_fields_are_read_by_name(
    planner: PlannerPeer,
    robots: list[PlayedRobot],
    records: Callable[[np.ndarray], np.ndarray],
    spoil: Callable[[Any], None],
) -> None:
    stamp_ns = planner.now()
    message = cloud_of(records(person_cells(1.0, 0.0)), robots[0].frame_id, stamp_ns)
    spoil(message)
    robots[0].send_pose(pose_of(stamp_ns, *robots[0].place))
    robots[0].send_points(message)
    for robot in robots[1:]:
        robot.send(stamp_ns)
    people = planner.people_at(stamp_ns)
    assert places(people) == [(1.0, 0.0)]
    assert people.persons[0].height == np.float32(1.7)


def test_late_poses_are_sorted_by_stamp(planner: PlannerPeer, robots: list[PlayedRobot]) -> None:
    """Only stamps matter, not the order of arrival."""
    stamp_ns = planner.now() + SECOND // 5
    robot_a, *others = robots
    robot_a.send_pose(pose_of(stamp_ns + 20_000_000, 2.0, 0.0, 0.0))
    robot_a.send_pose(pose_of(stamp_ns - 20_000_000, 1.0, 0.0, 0.0))
    planner.peer.next_findings(planner.node)  # both have arrived, in this order
    robot_a.send_points(cloud_of(person_cells(1.0, 0.0), robot_a.frame_id, stamp_ns))
    for robot in others:
        robot.send(stamp_ns)
    assert places(planner.people_at(stamp_ns)) == [(2.5, 0.0)]
    planner._last_ns = stamp_ns + 20_000_000


def test_planner_begins_anew_when_all_stamps_jump_back(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    """As in a bag that loops: all robots jump, and three scans in succession confirm it."""
    _still_works(planner, robots)
    before = planner.peer.next_findings(planner.node)[planner.node]
    old = planner.now() - 100 * SECOND
    for step in range(-2, 0):
        taken = planner.taking(*(f"{name}/points" for name in NAMES))
        for robot in robots:
            robot.send(old + step * 200_000_000, SOMEBODY)
        taken()
    for step in range(3):
        for robot in robots:
            robot.send(old + step * 200_000_000, SOMEBODY)
        message = planner.people_at(old + step * 200_000_000)
        assert robots_in(message) == NAMES
        assert places(message) == [SOMEBODY]
    for name in NAMES:
        resets = before[f"robot {name}"].count("stamp_resets")
        # The scans' and the poses'.
        planner.until_finding(
            f"robot {name}",
            lambda f, n=resets: f.count("stamp_resets") == n + 2,  # type: ignore[misc]
        )
    finding = planner.until_finding("robot robot_a", lambda f: "behind" in f.message)
    assert finding.level == WARN
    assert holds(finding.message, [r"stamps are (9|10)\d\.\d+ s behind this machine's clock"])
    _still_works(planner, robots)


# --- parameters of the method ---------------------------------------------------------------------


def test_size_of_a_person_takes_effect_in_the_next_interval(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    _still_works(planner, robots)
    planner.peer.must_set(planner.node, human__min_height=1.8)
    stamp_ns = planner.now()
    for robot in robots:
        robot.send(stamp_ns, SOMEBODY)
    assert places(planner.people_at(stamp_ns)) == []
    planner.peer.must_set(planner.node, human__min_height=1.2)
    _still_works(planner, robots)


def test_clusters_join_within_the_distance(planner: PlannerPeer, robots: list[PlayedRobot]) -> None:
    """Two people with 0.2 m between their cells: two at 0.15 m, one at 0.25 m."""
    for distance, wanted in ((0.15, [(1.0, 0.0), (1.0, 0.4)]), (0.25, [(1.0, 0.2)])):
        planner.peer.must_set(planner.node, clustering__distance=distance)
        stamp_ns = planner.now()
        robots[0].send(stamp_ns, (1.0, 0.0), (1.0, 0.4))
        for robot in robots[1:]:
            robot.send(stamp_ns)
        assert places(planner.people_at(stamp_ns)) == wanted
    planner.peer.must_set(planner.node, clustering__distance=0.15)


# --- where robots are to each other ---------------------------------------------------------------


def test_relative_pose_is_measured_by_people_whom_both_see(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    """One robot says that it is 0.18 m and 3 degrees from where it is."""
    peer, (one, other, third) = planner.peer, robots
    heard = peer.hear(RelativePoses, RELATIVE)
    people = [(2.0, 1.0), (3.1, -0.6), (4.0, 1.7), (2.6, 2.9), (4.6, -0.2)]
    x, y, yaw = other.place

    def measured() -> Any:
        stamp_ns = planner.now()
        one.send(stamp_ns, *people)
        third.send(stamp_ns)
        other.send_pose(pose_of(stamp_ns, x + 0.15, y - 0.1, yaw + 0.05))
        other.send_points(other.scan(stamp_ns, *people))
        peer.spin(0.1)
        return heard

    message = peer.until(measured, lambda: planner.process.log)[-1]
    assert message.header.frame_id == "map"
    (pose,) = message.poses
    assert (pose.robot, pose.other) == ("robot_a", "robot_b")
    wanted = one.seen_from_here(*other.place[:2])
    assert (pose.x, pose.y) == pytest.approx(wanted, abs=0.05)
    assert pose.yaw == pytest.approx(other.place[2] - one.place[2], abs=0.02)
    sigmas = np.sqrt(np.diag(np.reshape(pose.covariance, (3, 3))))
    assert (sigmas < (0.2, 0.2, 0.1)).all()
    read_relative_poses(message)


# --- quarantine -----------------------------------------------------------------------------------


def test_scans_of_a_robot_that_is_lost_are_left_out_until_it_is_placed_again(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    """What it believes to see is nobody, and where it believes to be somebody may stand."""
    peer = planner.peer
    events, measured = peer.hear(String, "/team/events"), peer.hear(RelativePoses, RELATIVE)
    one, lost, third = robots
    people = [(2.0, 1.0), (3.1, -0.6), (4.6, 1.7), (2.6, 2.9)]
    there, believed = lost.place[:2], PlayedRobot(peer, lost.name, (9.0, 9.0, 0.0))
    wrong = PlayedRobot(peer, lost.name, (*there, lost.place[2] + 0.03))

    def tell(status: int) -> None:
        message = TeamPose(robot="robot_b", status=status)
        message.header.frame_id = "map"
        set_stamp(message, planner.now())
        peer.send("/team/team_poses", message)

    def found() -> Any:
        stamp_ns = planner.now()
        lost.send_pose(pose_of(stamp_ns, *wrong.place))
        lost.send_points(lost.scan(stamp_ns, *people))
        for robot in (one, third):
            robot.send(stamp_ns, *people, there)
        return planner.people_at(stamp_ns)

    assert len(places(_still_works(planner, robots))) == 1
    tell(TeamPose.LOST)
    finding = planner.until_finding(
        "robot robot_b", lambda f: f.values.get("code") == "quarantined"
    )
    assert (finding.level, finding.message.partition(";")[0]) == (
        WARN,
        "robot_b is in quarantine, its scans find no people: it says that it is lost",
    )
    stamp_ns = planner.now()
    believed.send(stamp_ns - 1, believed.place[:2], (8.0, 8.0))  # nobody waits for it, either
    for robot in (one, third):
        robot.send(stamp_ns, *people, there)
    message = planner.people_at(stamp_ns)
    assert robots_in(message) == ["robot_a", "robot_c"]
    assert message.quarantined == ["robot_b"]
    assert sorted(places(message)) == sorted([*people, there])
    peer.until(lambda: events, "an event")
    assert [event.data for event in events] == ["robot_b is left out: it says that it is lost"]
    # By its scans it is found again.
    measured.clear()
    names = peer.until(
        lambda: found() and [pose.other for m in measured for pose in m.poses],
        lambda: planner.process.log,
    )
    assert "robot_b" in names
    tell(TeamPose.PLACED)
    peer.until(lambda: len(events) == 2, "an event")
    assert events[1].data == "robot_b is no longer left out"
    assert list(_still_works(planner, robots).quarantined) == []


def test_robot_is_left_out_if_two_doubt_it(planner: PlannerPeer, robots: list[PlayedRobot]) -> None:
    peer = planner.peer
    peer.hear(RelativePoses, RELATIVE)  # measured for those who listen
    events = peer.hear(String, "/team/events")

    def tell(*names: str, people: Sequence[tuple[float, float]] = (SOMEBODY,)) -> Any:
        peer.spin(0.1)
        stamp_ns = planner.now()
        for robot in robots:
            robot.send(stamp_ns, *people)
        message = planner.people_at(stamp_ns)
        for name in names:
            told = TeamPose(robot=name, doubted=["robot_b"])
            told.header.frame_id = "map"
            set_stamp(told, planner.now())
            peer.send("/team/team_poses", told)
        return message

    def doubted() -> bool:
        assert list(tell("robot_a").quarantined) == []
        code = peer.findings(planner.node)["robot robot_b"].values.get("code")
        return code == "doubted"  # (for some seconds it is that its pose has jumped)

    peer.until(doubted, lambda: peer.findings(planner.node)["robot robot_b"])
    for _ in range(10):
        tell("robot_a")
    for _ in range(10):  # it sees people where the others do
        assert list(tell("robot_a", "robot_c").quarantined) == []
    peer.until(lambda: tell("robot_a", "robot_c", people=()) and events, "an event")
    assert [event.data for event in events] == [
        "robot_b is left out: robot_a, robot_c doubt its pose"
    ]
    peer.until(lambda: len(events) == 2, "an event")  # they are silent
    assert list(_still_works(planner, robots).quarantined) == []
