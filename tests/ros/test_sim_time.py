"""use_sim_time: the nodes' time is that on /clock, whatever the machine's clock shows."""

from __future__ import annotations

import math

import pytest
from mrs_people_msgs.msg import People
from rosgraph_msgs.msg import Clock

from mrs_people_loc.messages import stamp_ns_of
from ros.harness import OK, WARN, Peer, Team
from ros.planner_peer import PlannerPeer, PlayedRobot, places, robots_in
from ros.recording import DEFAULTS, Recording, stamp_of
from ros.robot_peer import RobotPeer

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
#: When the recording was made; the machine's clock is years ahead of it.
START = 1_700_000_000 * SECOND
SOMEBODY = (2.0, 1.0)


class SimTime:
    """What sets /clock."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.now = START

    def to(self, now_ns: int) -> None:
        """Sets the time."""
        self.now = now_ns
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(now_ns, SECOND)
        self.peer.send("/clock", message)


@pytest.fixture(scope="module")
def clock(peer: Peer) -> SimTime:
    return SimTime(peer)


@pytest.fixture(scope="module")
def robot(team: Team, peer: Peer, recording: Recording) -> RobotPeer:
    process = team.start("robot_node", namespace="/robot_r", params={"use_sim_time": "true"})
    return RobotPeer(peer, process, recording, "robot_r")


@pytest.fixture(scope="module")
def planner(robot: RobotPeer, team: Team, peer: Peer, clock: SimTime) -> PlannerPeer:
    params = {"use_sim_time": "true", "robots": "[robot_a, robot_b]"}
    params |= {"interval.max_wait": "1.5", "interval.robot_timeout": "8.0"}
    made = PlannerPeer(peer, team.start("planner_node", params=params))
    peer.until_active(made.node, robot.node)
    return made


@pytest.fixture(scope="module")
def robots(peer: Peer, planner: PlannerPeer, clock: SimTime) -> list[PlayedRobot]:
    made = [
        PlayedRobot(peer, "robot_a", (0.0, 0.0, 0.0)),
        PlayedRobot(peer, "robot_b", (4.0, 0.0, math.pi / 2)),
    ]

    def connected() -> bool:
        # More than max_wait: a scan that is left over from the last try is in no interval of this.
        clock.to(clock.now + 2 * SECOND)
        peer.spin(0.2)
        if not peer.has_reported_since(planner.node, START):
            return False  # its time is not that on /clock yet
        for robot in made:
            robot.send(clock.now, SOMEBODY)
        for _ in range(20):
            peer.spin(0.1)
            last = planner.people[-1] if planner.people else None
            # Both scans of this moment: nothing is on its way any more.
            stamps = [stamp_ns_of(scan.stamp) for scan in last.scans] if last is not None else []
            if stamps == [clock.now] * 2:
                return True
        return False

    peer.until(connected, lambda: planner.process.log)
    return made


def test_interval_waits_in_sim_time(
    planner: PlannerPeer, robots: list[PlayedRobot], clock: SimTime
) -> None:
    """While /clock is stopped an interval stays open; it closes when /clock passes `max_wait`."""
    peer = planner.peer
    robot_a, _ = robots
    clock.to(clock.now + SECOND)
    opened = clock.now
    peer.until_report_at(planner.node, opened)  # the planner's time is that now
    robot_a.send(opened, SOMEBODY)
    # By the machine's clock more than max_wait passes here.
    peer.next_findings(planner.node)
    peer.next_findings(planner.node)
    clock.to(opened + 1_400_000_000)
    peer.next_findings(planner.node)
    assert stamp_of(planner.people[-1]) < opened
    clock.to(opened + 1_500_000_000)
    message = planner.people_at(opened)
    assert robots_in(message) == ["robot_a"]
    assert places(message) == [SOMEBODY]


def test_silence_of_a_robot_is_measured_in_sim_time(
    planner: PlannerPeer, robots: list[PlayedRobot], clock: SimTime
) -> None:
    robot_a, robot_b = robots
    clock.to(clock.now + SECOND)
    for robot in robots:
        robot.send(clock.now, SOMEBODY)
    assert len(robots_in(planner.people_at(clock.now))) == 2
    heard = clock.now
    # Both are waited for, however long it takes the machine, as long as /clock stands.
    clock.to(heard + SECOND)
    robot_a.send(clock.now, SOMEBODY)
    planner.peer.next_findings(planner.node)
    assert stamp_of(planner.people[-1]) == heard
    robot_b.send(clock.now, SOMEBODY)
    assert robots_in(planner.people_at(clock.now)) == ["robot_a", "robot_b"]
    # Nine seconds of /clock later robot_b is not waited for: /clock does not move any more.
    clock.to(heard + 10 * SECOND)
    robot_a.send(clock.now, SOMEBODY)
    assert robots_in(planner.people_at(clock.now)) == ["robot_a"]


def test_ages_are_measured_in_sim_time(
    planner: PlannerPeer, robots: list[PlayedRobot], clock: SimTime
) -> None:
    """Stamps are years behind the machine's clock, which is not reported."""
    clock.to(clock.now + SECOND)
    robot_a, robot_b = robots
    robot_b.send(clock.now, SOMEBODY)  # robot_a was heard a moment ago, so it is waited for
    planner.peer.next_findings(planner.node)
    robot_a.send(clock.now, SOMEBODY)
    assert robots_in(planner.people_at(clock.now)) == ["robot_a", "robot_b"]
    clock.to(clock.now + 250_000_000)
    for name in ("robot_a", "robot_b"):
        finding = planner.until_finding(f"robot {name}", lambda f: f.values.get("age_s") == "0.250")
        assert (finding.level, finding.message) == (OK, "ok")
    # Sixteen seconds later they are old by /clock, and it is said.
    clock.to(clock.now + 16 * SECOND)
    finding = planner.until_finding("robot robot_a", lambda f: f.level == WARN)
    assert finding.message == "no scan for 16.2 s"


def test_nodes_go_on_when_clock_is_set_back(
    planner: PlannerPeer, robots: list[PlayedRobot], clock: SimTime
) -> None:
    """A bag that loops."""
    clock.to(clock.now + SECOND)
    robots[0].send(clock.now, SOMEBODY)
    planner.peer.next_findings(planner.node)
    late, before = clock.now, {person.id for person in planner.people[-1].persons}
    clock.to(START)
    planner.peer.next_findings(planner.node)
    robots[0].send(late, SOMEBODY)  # was under way: it would be of the future now
    finding = planner.until_finding(
        "robot_a/points", lambda f: f.count("dropped.OutdatedError") == 1
    )
    assert f"stamp is {late} ns, of before the time jumped back" in planner.process.log
    assert (finding.level, finding.message) == (OK, "ok")  # its sender is not to blame
    for step in range(3):
        clock.to(START + 50_000_000 + step * SECOND // 5)  # no stamp of before
        for robot in robots:
            robot.send(clock.now, SOMEBODY)
        message = planner.people_at(clock.now)
        assert robots_in(message)[-1] == "robot_b"
    assert robots_in(message) == ["robot_a", "robot_b"]
    assert places(message) == [SOMEBODY]
    assert before.isdisjoint(person.id for person in message.persons)


def test_robot_in_sim_time_accepts_stamps_of_a_recording(
    robot: RobotPeer, planner: PlannerPeer, clock: SimTime
) -> None:
    """Scans have stamps of the recording, and no stamps are reported as behind."""
    robot._last_ns = clock.now

    def answered() -> bool:
        stamp_ns = robot._last_ns + SECOND // 5
        robot._last_ns = stamp_ns
        clock.to(stamp_ns)
        robot.send(robot.view(stamp_ns))
        robot.send_pose(robot.odometry(stamp_ns))
        robot.peer.spin(0.1)
        return bool(robot.points) and bool(robot.poses)

    robot.peer.until(answered, lambda: robot.log)
    stamp_ns = robot._last_ns + SECOND // 5
    clock.to(stamp_ns)
    robot.check(DEFAULTS, robot.view(stamp_ns))
    finding = robot.until_finding("scan", lambda f: f.count("frames") > 0)
    assert (finding.level, finding.message) == (OK, "ok")
    assert "behind this machine" not in robot.log


def test_messages_carry_the_scans_stamps(planner: PlannerPeer) -> None:
    message: People
    for message in planner.people:
        assert START <= stamp_of(message) < START + 1000 * SECOND
