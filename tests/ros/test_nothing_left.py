"""Processes end when terminals are closed or parents killed, and restart in any order.

Here each once; `make soak` does each ten times, at any moment.
"""

from __future__ import annotations

import contextlib
import os
import pty
import random
import select
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from mrs_people_msgs.msg import People

from ros.harness import ROOT, NodeProcess, Peer
from ros.harness import Team as Nodes

#: Marks what belongs to a trial, whoever its parent is by now.
MARK = "MRS_TRIAL"
#: Within this all processes are there, on a machine that is busy with other things [s].
START_S = 60.0
#: Within this nothing is left: who does not end in order is killed after 5 s [s].
END_S = 30.0
TEAM = """
/**/planner_node: {ros__parameters: {robots: [robot_a]}}
/robot_a/robot_node: {ros__parameters: {}}
"""
TIMES = [1, pytest.param(10, marks=[pytest.mark.soak, pytest.mark.timeout(1800)])]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


class Trial:
    """A command and all that it starts.

    Args:
        command: The command line.
        terminal: Whether it runs in a terminal of its own.
    """

    def __init__(self, command: Sequence[str], *, terminal: bool) -> None:
        self._mark = uuid.uuid4().hex
        self._written: list[bytes] = []
        self._screen, other = pty.openpty()
        if terminal:  # as the one job of a shell, which leads the session
            command = ["setsid", "--ctty", "sh", "-c", '"$@"; true', "-", *command]
        self.process = subprocess.Popen(
            command,
            env={**os.environ, MARK: self._mark},
            stdin=other,
            stdout=other,
            stderr=other,
            start_new_session=not terminal,
        )
        os.close(other)
        self._reader = Thread(target=self._read)
        self._closed = False
        self._reader.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # EIO: nobody has the other end open any more
            while not self._closed:  # who is still reading keeps a terminal open
                if select.select([self._screen], [], [], 0.05)[0]:
                    self._written.append(os.read(self._screen, 4096))

    @property
    def reported(self) -> str:
        return b"".join(self._written).decode(errors="replace")

    def running(self) -> dict[int, str]:
        """Process ids and command lines of what belongs to it."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # it has ended meanwhile, or is not ours
                if f"{MARK}={self._mark}".encode() in (folder / "environ").read_bytes():
                    words = (folder / "cmdline").read_bytes().decode().split("\0")
                    if words != [""]:  # a zombie
                        found[int(folder.name)] = " ".join(words)
        return found

    def until_nodes(self, count: int) -> None:
        end = time.monotonic() + START_S
        while sum("_node --ros-args" in line for line in self.running().values()) < count:
            assert time.monotonic() < end, f"{self.running()}\n{self.reported}"
            time.sleep(0.05)

    def until_said(self, text: str, count: int) -> None:
        end = time.monotonic() + START_S
        while self.reported.count(text) < count:
            assert time.monotonic() < end, self.reported
            time.sleep(0.05)

    def close(self) -> None:
        """Closes the terminal."""
        self._closed = True
        self._reader.join()
        os.close(self._screen)

    def nothing_is_left(self) -> None:
        """Waits until all of it has ended."""
        end = time.monotonic() + END_S
        while left := self.running():
            if time.monotonic() > end:
                for number in left:
                    os.kill(number, signal.SIGKILL)
                raise AssertionError(f"left behind: {left}\n{self.reported}")
            time.sleep(0.05)
        self.process.wait()
        if not self._closed:
            self._reader.join()
            self.close()
        assert "Traceback" not in self.reported, self.reported


@pytest.fixture
def team(tmp_path: Path) -> str:
    (tmp_path / "team.yaml").write_text(TEAM)
    return str(tmp_path / "team.yaml")


def mrs(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "mrs_tools", *arguments]


def moments(times: int) -> Iterator[float]:
    """How long what was started may work before it is ended [s]; where it is once, not at all."""
    chance = random.Random(times)
    yield from (0.0 if times == 1 else chance.uniform(0.0, 4.0) for _ in range(times))


@pytest.mark.parametrize("times", TIMES)
def test_closed_terminal_ends_a_team(domain: int, team: str, times: int) -> None:
    for moment in moments(times):
        trial = Trial(mrs("up", team), terminal=True)
        trial.until_nodes(2)
        time.sleep(moment)
        trial.close()
        trial.nothing_is_left()


@pytest.mark.parametrize("times", TIMES)
def test_killed_parent_ends_a_team(domain: int, team: str, times: int) -> None:
    for moment in moments(times):
        trial = Trial(mrs("up", team), terminal=False)
        trial.until_nodes(2)
        time.sleep(moment)
        trial.process.kill()
        trial.nothing_is_left()


@pytest.mark.parametrize("times", TIMES)
def test_closed_terminal_ends_the_demo(
    domain: int, tmp_path: Path, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID")
    bag = str(ROOT / "bags" / "paper_formation")
    for moment in moments(times):
        trial = Trial(mrs("demo", bag, "--out", str(tmp_path / "demo.png")), terminal=True)
        trial.until_nodes(4)
        time.sleep(moment)
        assert ", which nobody else uses; to look into it:" in trial.reported
        assert "  ROS_DOMAIN_ID=" in trial.reported
        trial.close()
        trial.nothing_is_left()


@pytest.mark.parametrize("times", TIMES)
def test_closed_terminal_ends_a_launch(ros2: str, team: str, times: int) -> None:
    for moment in moments(times):
        launched = [ros2, "launch", "planner_node", "team.launch.py", f"team:={team}"]
        trial = Trial(launched, terminal=True)
        trial.until_nodes(2)
        time.sleep(moment)
        trial.close()
        trial.nothing_is_left()


@pytest.mark.parametrize("times", TIMES)
def test_interrupted_launch_leaves_no_process(ros2: str, team: str, times: int) -> None:
    """Ctrl-C reaches all processes of the terminal, and `ros2 launch` passes it on.

    Not in the moment in which Python itself starts, which ends with a traceback of its own.
    """
    for moment in moments(times):
        launched = [ros2, "launch", "planner_node", "team.launch.py", f"team:={team}"]
        trial = Trial(launched, terminal=False)
        trial.until_nodes(2)
        trial.until_said(": active; waits for", 2)
        time.sleep(moment)
        os.killpg(trial.process.pid, signal.SIGINT)
        trial.nothing_is_left()


@pytest.mark.parametrize("times", TIMES)
def test_nodes_restart_in_any_order(domain: int, tmp_path: Path, peer: Peer, times: int) -> None:
    """By any signal, while busy: only killed nodes fail, and people are found after it."""
    chance = random.Random(times)
    signals = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL]
    started = {"/robot_a": "robot_node", "/robot_b": "robot_node", "/": "planner_node"}
    bag = ROOT / "bags" / "walking_group"
    how = {"params": {"use_sim_time": "true"}, "files": [bag.with_suffix(".yaml")]}
    people = peer.hear(People, "/tracked_people")
    replay = Trial(mrs("replay", str(bag), "--loop", "--clock"), terminal=False)
    nodes, running = Nodes(tmp_path), dict[str, NodeProcess]()
    try:
        for _ in range(times + 1):
            for namespace in chance.sample(list(started), len(started)):
                if namespace in running:
                    node, number = running[namespace], chance.choice(signals)
                    node.process.send_signal(number)
                    code = node.exit_code()
                    assert code == (-number if number == signal.SIGKILL else 0), node.log
                    for word in ("Traceback", "FATAL", "ERROR", "invalid"):
                        assert word not in node.log, node.log
                running[namespace] = nodes.start(started[namespace], namespace=namespace, **how)
            for node in running.values():
                peer.until(lambda n=node: ": active; waits for" in n.log, "not active")  # type: ignore[misc]
            people.clear()  # of those before
            peer.until(lambda: {"robot_a", "robot_b"} <= _robots_in(people), "no people of both")
    finally:
        replay.process.send_signal(signal.SIGINT)
        nodes.end()
    replay.nothing_is_left()


def _robots_in(people: Sequence[Any]) -> set[str]:
    return {scan.robot for message in people for scan in message.scans}
