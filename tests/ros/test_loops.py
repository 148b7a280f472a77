"""A bag that is replayed in a loop: each pass begins again."""

from __future__ import annotations

import contextlib
import math
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from mrs_people_msgs.msg import People
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.writer import BagWriter
from ros.harness import DEADLINE_S, Peer, Team
from ros.planner_peer import PlannerPeer, PlayedRobot, pose_of
from ros.recording import stamp_of

pytestmark = pytest.mark.slow

START_NS = 1_700_000_000_000_000_000
STEP_NS, STEPS = 200_000_000, 12
ROBOTS = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (6.0, 0.0, math.pi)}


def walkers(t: float) -> list[tuple[float, float]]:
    """Three who walk 2 m to the left side by side: at the end nobody is where one was."""
    return [(2.0 + 0.8 * k, t - 1.0) for k in range(3)]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, peer: Peer) -> Path:
    """Scans and poses of two robots, of 2 s."""
    path = tmp_path_factory.mktemp("bag") / "walk.mcap"
    robots = [PlayedRobot(peer, name, place) for name, place in ROBOTS.items()]
    with BagWriter(path) as out:
        for robot in robots:
            out.add_topic(f"/{robot.name}/points", "sensor_msgs/msg/PointCloud2")
            out.add_topic(f"/{robot.name}/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
        for k in range(STEPS):
            stamp_ns = START_NS + k * STEP_NS
            for robot in robots:
                pose = serialize_message(pose_of(stamp_ns, *robot.place))
                scan = serialize_message(robot.scan(stamp_ns, *walkers(k * STEP_NS / 1e9)))
                out.write_raw(f"/{robot.name}/pose", stamp_ns, pose)
                out.write_raw(f"/{robot.name}/points", stamp_ns, scan)
    return path


def passes(heard: list[People]) -> list[list[People]]:
    """Messages of each pass: stamps go back where one begins."""
    found: list[list[People]] = []
    for message in heard:
        if not found or stamp_of(message) < stamp_of(found[-1][-1]):
            found.append([])
        found[-1].append(message)
    return found


@contextlib.contextmanager
def mrs(*args: object, **how: Any) -> Iterator[subprocess.Popen[str]]:
    """The command as a process, which is no more at the end."""
    command = [sys.executable, "-m", "mrs_tools", *map(str, args)]
    with subprocess.Popen(command, text=True, **how) as process:
        try:
            yield process
        finally:
            process.kill()


@contextlib.contextmanager
def planning(team: Team, peer: Peer, *, simulated: bool) -> Iterator[PlannerPeer]:
    """A planner that a busy machine does not make leave out anybody."""
    params = {"robots": f"[{', '.join(ROBOTS)}]", "use_sim_time": str(simulated).lower()}
    params |= {"interval.max_clock_offset": "5.0", "interval.max_scan_age": "0.9"}
    planner = PlannerPeer(peer, team.start("planner_node", params=params))
    try:
        peer.until_active(planner.node)
        yield planner
    finally:
        planner.process.stop()


@pytest.mark.parametrize("clock", [True, False], ids=["clock", "no clock"])
def test_each_of_ten_loops_begins_with_new_ids(
    team: Team, peer: Peer, bag: Path, clock: bool
) -> None:
    """From the first interval of each pass on all tracks are new; ids and group ids go on."""
    events = peer.hear(String, "/events")
    reports = peer.hear(DiagnosticArray, "/diagnostics")
    with planning(team, peer, simulated=clock) as planner:
        with mrs("replay", bag, "--loop", "--rate", 2, *(["--clock"] if clock else [])) as replay:
            peer.until(lambda: len(passes(planner.people)) > 11, lambda: planner.process.log)
            replay.send_signal(signal.SIGINT)
            assert replay.wait(DEADLINE_S) == 0
        finding = planner.until_finding("intervals", lambda f: f.count("times_back") >= 11)
        assert finding.count("stragglers") == 0
    # The last pass was cut, and of the first one the beginning may not have arrived.
    whole = passes(planner.people)[:11]
    first = min(person.id for person in whole[0][-1].persons)
    for number, messages in enumerate(whole):
        ids = {person.id for message in messages for person in message.persons}
        assert ids == {first + 3 * number + k for k in range(3)}
        groups = [group for message in messages for group in message.groups]
        assert {group.id for group in groups} == {number + 1}
        assert [list(group.stragglers) for group in groups if group.stragglers] == []
        assert not any(person.coasting for person in messages[0].persons)
        assert stamp_of(messages[-1]) - stamp_of(messages[0]) > STEPS / 2 * STEP_NS
    assert {event.data for event in events} == {"the time jumped back: everybody is new"}
    # What was under way, or refused until the jump was believed, blames no sender.
    reported = [status.message for report in reports for status in report.status]
    assert not [text for text in reported if "dropped; last:" in text or "refused; last:" in text]
    assert planner.process.log.count("starting over") == len(passes(planner.people)) - 1


def test_recording_of_a_team_replays_onto_live_nodes_without_duplicates(
    team: Team, peer: Peer, bag: Path, tmp_path: Path
) -> None:
    """`mrs record` without topics, then `mrs replay`, as documented."""
    out = tmp_path / "out.mcap"
    with planning(team, peer, simulated=True) as planner:
        with mrs("record", out) as recorder:
            peer.until(lambda: peer.node.count_subscribers("/markers"), "nobody records")
            with mrs("replay", bag, "--clock") as replay:
                peer.until(lambda: replay.poll() is not None, "replay does not end")
            peer.spin(1.0)
            recorder.send_signal(signal.SIGINT)
            assert recorder.wait(DEADLINE_S) == 0
        with BagReader(out) as recorded:
            assert recorded.topics["/tracked_people"].count > 3
            assert recorded.topics["/robot_a/points"].count > 3
        before = len(planner.people)
        with mrs("replay", out, "--rate", 3, stderr=subprocess.PIPE) as replay:
            _, reported = replay.communicate(timeout=DEADLINE_S)
        assert replay.returncode == 0, reported
        for topic in ("/tracked_people", "/people_poses", "/diagnostics"):
            assert re.search(
                rf"note: .*{topic}\b.* left out: /planner_node publishes them", reported
            )
        assert "/robot_a/points" not in reported
        peer.spin(1.0)
        assert len(planner.people) > before + 3
        # Whatever came is the planner's own.
        planner.until_finding("intervals", lambda f: f.count("intervals") == len(planner.people))
    assert "share a name" not in planner.process.log
