"""`config/paper_team.yaml`: one file starts the paper's team with its trinocular leader."""

from __future__ import annotations

import dataclasses
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from mrs_people_loc.config import load_team
from mrs_ros.processes import team_processes
from mrs_tools.bags.offline import BagRun
from ros.harness import Peer, own_domain, ros2_command

ROOT = Path(__file__).parents[3]
PAPER, PAPER_TEAM = (ROOT / "config" / name for name in ("paper.yaml", "paper_team.yaml"))
FORMATION = ROOT / "bags" / "paper_formation"
ROBOTS = ("robot_a", "robot_b", "robot_c")


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        yield number


@pytest.fixture
def ros2() -> str:
    """The real `ros2` command."""
    return ros2_command()


def test_method_of_the_team_is_the_papers():
    team, printed = load_team(PAPER_TEAM), load_team(PAPER, robots=ROBOTS)
    assert team.planner == dataclasses.replace(printed.planner, robots=ROBOTS)
    leader = printed.robots["robot_a"]
    images = dataclasses.replace(leader.images, top=True)
    assert team.robots == {**printed.robots, "robot_a": dataclasses.replace(leader, images=images)}


def test_all_started_processes_are_named():
    labels = [process.label for process in team_processes([PAPER_TEAM])]
    assert labels == [*ROBOTS, "planner"]


def test_offline_tools_accept_the_papers_team():
    run = BagRun(FORMATION, [PAPER_TEAM])
    assert {name: robot.images.top for name, robot in run.team.robots.items()} == {
        "robot_a": True, "robot_b": False, "robot_c": False,
    }  # fmt: skip
    assert run.notes == []


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_launch_starts_the_team_with_a_trinocular_leader(ros2: str, domain: int) -> None:
    command = [ros2, "launch", "planner_node", "team.launch.py", f"team:={PAPER_TEAM}"]
    path = f"{Path(ros2).parent}:{os.environ['PATH']}"
    peer = Peer(domain)
    started = subprocess.Popen(
        command,
        env={**os.environ, "PATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        nodes = [f"/{robot}/robot_node" for robot in ROBOTS]
        peer.until_active("/planner_node", *nodes)
        assert peer.get("/planner_node", "robots", "clustering.distance") == [[*ROBOTS], 0.15]
        wanted = ("images.top", "disparity.block_size_px", "bodies.search")
        tops = [peer.get(node, *wanted) for node in nodes]
        assert tops == [[robot == "robot_a", 15, False] for robot in ROBOTS]
    finally:
        peer.close()
        started.send_signal(signal.SIGINT)
        reported, _ = started.communicate(timeout=60)
    assert "Traceback" not in reported, reported


@pytest.mark.soak  # 20 s, most of them for the animation
@pytest.mark.timeout(180)
def test_demo_accepts_the_papers_team(domain: int, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mrs_tools", "demo", str(FORMATION), "--team", str(PAPER_TEAM)]
    command += ["--out", str(tmp_path / "demo.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = re.search(r"found (\d+) of 75 people", done.stdout)
    assert found is not None, done.stdout
    # All of them where the machine keeps up; frames that it leaves out are the demo's own matter.
    assert int(found[1]) >= 70, done.stdout
