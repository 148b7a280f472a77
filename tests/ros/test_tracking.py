"""The planner tracks people: ids, velocities and groups in its messages over time."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest
from mrs_people_msgs.msg import People, Person
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from mrs_people_loc import messages
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.planner import Planner
from ros.harness import Peer, Team
from ros.planner_peer import PATIENT, PlannerPeer, PlayedRobot, pose_of
from ros.recording import stamp_of

pytestmark = pytest.mark.slow

NAMES = ("robot_a", "robot_b")
PLACES = ((0.0, 0.0, 0.0), (6.0, 0.0, math.pi))
STEP_NS = 100_000_000


class Walk:
    """Sends scans of walkers, an interval every 0.1 s of their own time, and hears the people."""

    def __init__(self, peer: Peer, planner: PlannerPeer) -> None:
        self.planner = planner
        self.robots = [
            PlayedRobot(peer, name, place) for name, place in zip(NAMES, PLACES, strict=True)
        ]
        self.stamp_ns = time.time_ns()
        self.sent: list[dict[str, Any]] = []
        self.heard: list[People] = []

    def step(self, *people: tuple[float, float], stamp_ns: int | None = None) -> People:
        """One interval in which both robots see people at these places."""
        self.stamp_ns = stamp_ns or self.stamp_ns + STEP_NS
        scans = {robot.name: robot.scan(self.stamp_ns, *people) for robot in self.robots}
        for robot in self.robots:
            robot.send(self.stamp_ns, *people)
        self.sent.append(scans)
        self.heard.append(self.planner.people_at(self.stamp_ns))
        return self.heard[-1]


@pytest.fixture(scope="module")
def events(peer: Peer) -> list[String]:
    return peer.hear(String, "/events")


@pytest.fixture(scope="module")
def drawn(peer: Peer) -> list[MarkerArray]:
    return peer.hear(MarkerArray, "/markers")


@pytest.fixture(scope="module")
def walk(team: Team, peer: Peer, events: list[String], drawn: list[MarkerArray]) -> Walk:
    params = {"robots": f"[{','.join(NAMES)}]", **PATIENT}
    process = team.start("planner_node", params=params)
    made = Walk(peer, PlannerPeer(peer, process))
    peer.until_active(made.planner.node)
    # It must hear of nothing before it is heard: what it says depends on all that it was told.
    topics = ("/tracked_people", "/events", "/markers")
    peer.until(lambda: all(map(peer.node.count_publishers, topics)), f"nobody publishes {topics}")
    # And the first scan must arrive: it does when poses do, for `points` was announced before.
    for robot in made.robots:
        robot.announce()
    peer.until(lambda: poses_arrive(made), lambda: process.log)
    made.stamp_ns = time.time_ns()
    return made


def poses_arrive(walk: Walk) -> bool:
    for robot in walk.robots:
        robot.send_pose(pose_of(walk.planner.now(), *robot.place))
    walk.planner.peer.spin(0.1)
    findings = walk.planner.peer.findings(walk.planner.node)
    held = [findings.get(f"robot {name}") for name in NAMES]
    return all(finding is not None and finding.count("poses_held") > 0 for finding in held)


def ids(message: People) -> list[int]:
    return [person.id for person in everybody(message)]


def everybody(message: People) -> list[Person]:
    hidden = [one.person for one in message.hidden]
    return sorted([*message.persons, *hidden], key=lambda person: person.id)


def walkers(t: float) -> list[tuple[float, float]]:
    """Two who walk to the left at 0.5 m/s, and one who stands."""
    return [(2.0, 0.5 * t - 1.0), (2.8, 0.5 * t - 1.0), (3.6, 0.3)]


@pytest.fixture(scope="module")
def walked(walk: Walk) -> Walk:
    for k in range(30):
        walk.step(*walkers(k / 10))
    for k in range(30, 36):  # the one who stands is hidden
        walk.step(*walkers(k / 10)[:2])
    for k in range(36, 40):
        walk.step(*walkers(k / 10))
    return walk


def test_ids_persist_and_velocities_are_those_of_the_walkers(walked: Walk) -> None:
    assert {tuple(ids(message)) for message in walked.heard[:40]} == {(1, 2, 3)}
    message = walked.heard[29]
    by_place = sorted(message.persons, key=lambda p: p.pose.pose.position.x)
    speeds = [p.velocity.twist.linear for p in by_place]
    for got, wanted in zip(speeds, (0.5, 0.5, 0.0), strict=True):
        assert math.hypot(got.x, got.y - wanted) < 0.1
        assert got.z == 0.0
    for person in message.persons:
        covariance = np.reshape(person.velocity.covariance, (6, 6))
        assert 0 < covariance[0, 0] < 0.8**2
        assert np.isnan(covariance[5, 5])
        assert math.isnan(person.velocity.twist.angular.z)
        assert person.age.sec + person.age.nanosec / 1e9 == pytest.approx(2.9)
        assert not person.coasting
        assert list(person.robots) == list(NAMES)


def test_hidden_person_coasts(walked: Walk) -> None:
    for k, message in enumerate(walked.heard[:40]):
        unseen = [p for p in everybody(message) if p.coasting]
        assert len(unseen) == (30 <= k < 36)
        assert len(message.hidden) == (34 <= k < 36)  # last seen at 2.9 s
        for hidden in message.hidden:
            since_ns = stamp_of(message) - messages.stamp_ns_of(hidden.last_seen)
            assert since_ns == (k - 29) * 100_000_000
            assert math.hypot(hidden.last_seen_at.x - 3.6, hidden.last_seen_at.y - 0.3) < 0.2
        for person in unseen:
            assert list(person.robots) == []
            at = person.pose.pose.position
            assert math.hypot(at.x - 3.6, at.y - 0.3) < 0.2


def test_walkers_are_one_group(walked: Walk) -> None:
    for message in walked.heard[:40]:
        (group,) = message.groups
        assert (group.id, group.size, list(group.members)) == (1, 3, [1, 2, 3])
        assert list(group.stragglers) == []
    velocity = walked.heard[29].groups[0].velocity.twist.linear
    assert math.hypot(velocity.x, velocity.y - 1.0 / 3.0) < 0.1


def test_tracks_equal_those_of_a_planner_in_process(walked: Walk) -> None:
    """Every field, given the same inputs from the beginning."""
    planner = Planner(PlannerConfig(robots=NAMES))
    for sent, message in zip(walked.sent, walked.heard, strict=True):
        scans = [messages.read_scan(cloud, robot) for robot, cloud in sent.items()]
        poses = messages.read_people_scans(message)
        wanted = planner.step(scans, poses, stamp_of(message))
        assert ids(message) == [person.id for person in wanted.everybody]
        assert len(message.hidden) == len(wanted.hidden)
        for got, person in zip(everybody(message), wanted.everybody, strict=True):
            at, to = got.pose.pose.position, got.velocity.twist.linear
            np.testing.assert_allclose((at.x, at.y), person.position, rtol=0, atol=1e-9)
            np.testing.assert_allclose((to.x, to.y), person.velocity, rtol=0, atol=1e-9)
            assert got.coasting == person.coasting
        assert [group.id for group in message.groups] == [group.id for group in wanted.groups]


def test_markers_show_velocities_trails_and_coasting_people(
    walked: Walk, peer: Peer, drawn: list[MarkerArray]
) -> None:
    stamp_ns = stamp_of(walked.heard[33])
    peer.until(
        lambda: any(stamp_of(m.markers[0]) == stamp_ns for m in drawn), "markers of an interval"
    )
    markers = next(m for m in drawn if stamp_of(m.markers[0]) == stamp_ns).markers
    of = {name: [m for m in markers if m.ns == name] for name in ("people", "velocities", "trails")}
    assert [m.type for m in of["velocities"]] == [Marker.ARROW] * 3
    assert [m.type for m in of["trails"]] == [Marker.LINE_STRIP] * 3
    assert all(len(m.points) == 2 for m in of["velocities"])
    for trail, person in zip(of["trails"], walked.heard[33].persons, strict=True):
        end, here = trail.points[-1], person.pose.pose.position
        assert (end.x, end.y) == (here.x, here.y)  # and every 0.3 s, from the first interval on
        assert 11 <= len(trail.points) <= 13
    pale = [m.color.a for m in of["people"]]
    hidden = [p.coasting for p in walked.heard[33].persons]
    assert [a == min(pale) for a in pale] == hidden
    assert min(pale) < max(pale)


def until_said(peer: Peer, events: list[String], wanted: str) -> None:
    peer.until(lambda: any(wanted in e.data for e in events), lambda: f"{wanted}; got: {events}")


def test_straggler_is_announced(walked: Walk, peer: Peer, events: list[String]) -> None:
    """Two walk on; the one that stays is a straggler until they come back."""
    for k in range(40, 90):
        message = walked.step(*walkers(k / 10))
    (group,) = [g for g in message.groups if g.id == 1]
    (straggler,) = group.stragglers
    assert straggler not in group.members
    assert group.straggling_for[0].sec >= 1
    until_said(peer, events, f"person {straggler} has fallen behind or left group 1")
    for k in range(90, 20, -1):
        message = walked.step(*walkers(k / 10))
    assert [(g.id, g.size, list(g.stragglers)) for g in message.groups] == [(1, 3, [])]
    until_said(peer, events, f"person {straggler} is back with group 1")
    assert all(set(ids(m)) <= {1, 2, 3} for m in walked.heard)


def test_live_parameters_lose_no_track(walked: Walk) -> None:
    """With another gate, and memory switched off and on."""
    peer, node = walked.planner.peer, walked.planner.node
    places = walkers(2.0)
    for _ in range(30):  # whoever was elsewhere is forgotten
        before = ids(walked.step(*places))
    assert len(before) == 3
    peer.must_set(node, tracking__gate=5.0)
    assert ids(walked.step(*places)) == before
    peer.must_set(node, tracking__enabled=False)
    message = walked.step(*places)
    assert ids(message) == [0, 0, 0]
    assert [math.isnan(p.velocity.twist.linear.x) for p in message.persons] == [True] * 3
    assert [(g.id, g.size) for g in message.groups] == [(0, 3)]
    peer.must_set(node, tracking__enabled=True, tracking__gate=4.0)
    assert ids(walked.step(*places)) == before


def test_unusable_tracking_parameter_is_refused(walked: Walk) -> None:
    (result,) = walked.planner.peer.set(walked.planner.node, tracking__gate=0.0)
    assert not result.successful
    assert "tracking.gate" in result.reason
