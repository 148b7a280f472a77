"""A node that receives a signal while it is busy finishes its callback and ends cleanly."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from mrs_ros.ending import LIFELINE
from ros.harness import DEADLINE_S

pytestmark = pytest.mark.slow

#: A node that tells itself to end where it is told to, and goes on for longer than rclpy's own
#: signal handler takes to shut the context down.
PROGRAM = """
import ctypes, os, signal, sys, time
from std_msgs.msg import String
from mrs_people_loc.config import PlannerConfig
from mrs_ros import ending
from mrs_ros.managed_node import ManagedNode
from mrs_ros.running import run

where, number = sys.argv[1], int(sys.argv[2])
if where == "hang":
    ending._GRACE_S = 0.5
if where == "leave":
    ending._LEAVE_S = 1

class Node(ManagedNode):
    def __init__(self):
        super().__init__("node", PlannerConfig)

    def meet(self, place):
        if place == where:
            print("ready", flush=True)
            if number:
                os.kill(os.getpid(), number)
            time.sleep(1000.0 if place == "hang" else 0.5)

    def set_up(self):
        self.meet("set_up")
        self.out = self.offer(String, "out", 1)

    def start(self):
        self.meet("start")
        self.out.publish(String())
        self.timer = self.create_timer(0.01, self.work)

    def work(self):
        self.meet("hang")
        self.meet("callback")
        self.out.publish(String())
        print("published", flush=True)
        if where == "leave":
            os.kill(os.getpid(), number)

    def destroy_node(self):
        if where == "leave":
            ctypes.CDLL(None).sleep(1000)  # as where a middleware hangs: not in Python
        super().destroy_node()

sys.exit(run(Node, "usage: node", ["node"]))
"""


def program(where: str, number: int, **how: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, where, str(number)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        **how,  # type: ignore[call-overload]
    )


@pytest.mark.parametrize(
    ("where", "number"),
    [
        ("set_up", signal.SIGINT),
        ("start", signal.SIGTERM),
        ("callback", signal.SIGINT),
        ("callback", signal.SIGHUP),
    ],
)
def test_node_finishes_its_callback_on_a_signal(domain: int, where: str, number: int) -> None:
    process = program(where, number)
    reported, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, reported
    assert "ERROR" not in reported
    assert "Traceback" not in reported
    assert reported.count("published") == (where == "callback")


def test_node_ends_when_its_lifeline_closes(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LIFELINE, "1")
    for where, code in [("callback", 0), ("hang", -signal.SIGKILL)]:
        process = program(where, 0, stdin=subprocess.PIPE)
        assert process.stdout is not None
        while process.stdout.readline() != "ready\n":
            assert process.poll() is None
        reported, _ = process.communicate(timeout=DEADLINE_S)  # closes its standard input
        assert process.returncode == code, reported
        assert "Traceback" not in reported


@pytest.mark.parametrize("text", ["abc", "300"])
def test_node_with_a_wrong_domain_names_what_is_allowed(
    domain: int, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    process = program("callback", 0)
    reported, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2, reported
    assert f"error: ROS_DOMAIN_ID is '{text}'; allowed: a whole number from 0 to 232" in reported


def test_second_interrupt_ends_a_node_that_hangs(domain: int) -> None:
    process = program("hang", signal.SIGINT)
    assert process.stdout is not None
    while process.stdout.readline() != "ready\n":
        assert process.poll() is None
    time.sleep(1.0)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=DEADLINE_S)
    assert process.returncode == -signal.SIGINT


def test_node_that_hangs_as_it_leaves_its_network_is_ended_and_says_where(domain: int) -> None:
    process = program("leave", signal.SIGINT)
    reported, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == -signal.SIGALRM, reported
    assert "in destroy_node" in reported


def test_closed_standard_input_ends_a_node_only_with_a_lifeline(domain: int) -> None:
    process = program("callback", 0, stdin=subprocess.DEVNULL)
    assert process.stdout is not None
    heard = 0
    while heard < 5:
        heard += process.stdout.readline() == "published\n"
        assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    reported, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, reported


def test_node_starts_without_standard_streams(domain: int) -> None:
    closed = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh"]
    node = [sys.executable, "-c", PROGRAM, "callback", str(int(signal.SIGINT))]
    assert subprocess.run([*closed, *node], timeout=DEADLINE_S).returncode == 0
