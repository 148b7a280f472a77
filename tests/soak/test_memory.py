"""No process grows while robots come and go, a tour is led and somebody looks at the page."""

from __future__ import annotations

import itertools
import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest
from mrs_people_msgs.msg import People

pytest.importorskip("aiohttp", reason="the page needs aiohttp")

from mrs_people_loc.config import GUIDE_NODE, PLANNER_NODE
from mrs_ros.processes import NodeProcess, RunningTeam
from ros.guide_peer import GuideWorld, goal_of
from ros.harness import ROOT, Peer
from ros.planner_peer import PlayedRobot
from soak.team import Load, resident_kb
from tools.view.serving import Looker

FILES = (str(ROOT / "config" / "default.yaml"),)
#: Robots that stay, and where each visitor stands: x, y [m] and yaw [rad].
STAY = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (8.0, 0.0, math.pi)}
VISITOR = 4.0, 4.0, -math.pi / 2
#: So many visitors have names of their own; each stays for so many scans, at this rate.
VISITORS, SCANS, RATE_HZ = 200, 5, 5.0
#: Whom all of them see [m].
SEEN = (4.0, 0.3), (4.0, 1.3)
#: Those of the tour, which are in a namespace of their own, and who follows them [m].
GUIDES = {"robot_c": (0.0, 0.0, 0.0), "robot_d": (-3.5, 0.0, 0.0)}
GUESTS = [(-1.5, 0.0), (-1.5, 0.6)]
TOUR = goal_of((0.0, 0.0), (100.0, 0.0))
#: Memory may settle by this in a short run, in which few robots are new to others, and in a long
#: one, of which the first third has seen all of them [kB].
SHORT_SETTLES_KB, LONG_SETTLES_KB = 4096, 4096
START_S = 30.0


@pytest.fixture
def peer() -> Iterator[Peer]:
    made = Peer(int(os.environ["ROS_DOMAIN_ID"]))
    yield made
    made.close()


@contextmanager
def _page(log: Path) -> Iterator[tuple[int, Looker]]:
    """`mrs view` and somebody who looks at it: its process and the viewer."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "mrs_tools", "view", "--port", str(port), "--no-open"]
    with log.open("w") as out, subprocess.Popen(command, stdout=out, stderr=out) as process:
        try:
            end = time.monotonic() + START_S
            while True:
                try:
                    socket.create_connection(("127.0.0.1", port)).close()
                    break
                except OSError:
                    assert time.monotonic() < end, log.read_text()
                    time.sleep(0.1)
            looker = Looker(f"http://127.0.0.1:{port}/")
            yield process.pid, looker
            looker.leave()
        finally:
            process.terminate()


def _visit(peer: Peer, robots: list[PlayedRobot], number: int) -> None:
    """A robot comes, sends some scans as the others do, and goes."""
    visitor = PlayedRobot(peer, f"visitor_{number % VISITORS}", VISITOR)
    for robot in (*robots, visitor):
        robot.announce()
    for _ in range(SCANS):
        stamp_ns = time.time_ns()
        for robot in (*robots, visitor):
            robot.send(stamp_ns, *SEEN)
        peer.spin(1.0 / RATE_HZ)
    for topic in ("points", "pose"):
        peer.silence(f"/{visitor.name}/{topic}")


def _measured(
    peer: Peer, pids: Mapping[str, int], looker: Looker, seconds: float
) -> tuple[Load, set[str]]:
    """Memory each second, and the robots whose scans were used."""
    world = GuideWorld(peer, "/tour/", GUIDES, GUESTS)
    people = peer.hear(People, "/tracked_people")
    robots = [PlayedRobot(peer, name, place) for name, place in STAY.items()]
    load = Load(memory_kb={name: [] for name in pids})
    used: set[str] = set()
    _visit(peer, robots, 0)
    _, tour = world.start(TOUR)
    end = time.monotonic() + seconds
    for number in itertools.count(1):
        if tour.done():
            _, tour = world.start(TOUR)
        _visit(peer, robots, number)
        for name, pid in pids.items():
            load.memory_kb[name].append(resident_kb(pid))
        used.update(scan.robot for message in people for scan in message.scans)
        assert looker.got, "the page shows nothing"
        for grows in (world.commands, people, looker.got, world.statuses[:-1]):
            grows.clear()
        if time.monotonic() > end:
            break
    world.close()
    return load, used


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "settles_kb"),
    [
        pytest.param(20, SHORT_SETTLES_KB, id="short"),
        pytest.param(3600, LONG_SETTLES_KB, id="long", marks=pytest.mark.soak),
    ],
)
@pytest.mark.timeout(4000)
def test_memory_is_flat_while_robots_come_and_go(
    peer: Peer, show: Callable[[str], None], tmp_path: Path, seconds: float, settles_kb: float
) -> None:
    nodes = [
        NodeProcess(PLANNER_NODE, "", FILES, False),
        NodeProcess(PLANNER_NODE, "tour", FILES, False, GUIDE_NODE),
    ]
    with (
        (tmp_path / "nodes").open("w+") as log,
        RunningTeam(nodes, log=log) as running,
        _page(tmp_path / "page") as (page, looker),
    ):
        peer.until_active("/planner_node")
        peer.until_active("/tour/guide_node")
        planner, guide = (running.processes[node].pid for node in nodes)
        pids = {"planner": planner, "guide": guide, "page": page}
        load, used = _measured(peer, pids, looker, seconds)
        assert not running.ended(), (tmp_path / "nodes").read_text()
    rows = [f"  {name:<10}{load.course(name)}" for name in pids]
    show("\n".join([f"{seconds:g} s, {len(used)} robots came and went", *rows]))
    assert len(used) >= min(VISITORS, seconds / (SCANS / RATE_HZ) / 2)
    grew = {name: load.growth_kb(name) for name in pids}
    assert max(grew.values()) < settles_kb, grew
