"""Real node processes, and a peer on the same DDS domain that feeds and hears them."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy

from mrs_people_sim.domain import own_domain as own_domain
from mrs_ros.network import uninterrupted

ROOT = Path(__file__).resolve().parents[2]
#: What a condition is waited for, at most, on a machine that is busy with other things [s].
DEADLINE_S = 40.0
#: Who listens to a new publisher knows it after this, mostly much sooner [s].
_MEETING_S = 0.2
OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))
#: Hears reliable and best-effort publishers, and loses nothing of what a test sends.
HEAR_ALL = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)
SEND_ALL = QoSProfile(depth=2000)

#: Where transitions lead to.
_GOALS = {
    "configure": "inactive",
    "activate": "active",
    "deactivate": "inactive",
    "cleanup": "unconfigured",
    "shutdown": "finalized",
}

#: Of executables that are not their package's only one.
_MODULES = {"guide_node": "planner_node.guide_node"}

_LABELS = {
    Transition.TRANSITION_CONFIGURE: "configure",
    Transition.TRANSITION_ACTIVATE: "activate",
}

T = TypeVar("T")


def ros2_command() -> str:
    """The real `ros2` command; without it the test is skipped, and fails in CI."""
    path = Path(sys.prefix, "bin", "ros2")
    if not path.exists():
        text = "the ros2 tools are not in this environment (../shared/ros2_tools installs them)"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(text)
    return str(path)


# --- processes ------------------------------------------------------------------------------------


def exit_code(process: subprocess.Popen[bytes], name: str, log: Path) -> int:
    """Waits for the end of a process; one that hangs is ended, and says where it was."""
    try:
        return process.wait(DEADLINE_S)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)  # Python writes where it is: PYTHONFAULTHANDLER
        process.wait()
        raise AssertionError(f"{name} did not end:\n{log.read_text(errors='replace')}") from None


class NodeProcess:
    """A node of ours as a process of its own.

    Args:
        executable: `robot_node`, `planner_node` or `guide_node`.
        log: File that takes what it writes.
        namespace: Its namespace with the leading slash.
        params: Parameters by name, as the command line takes them.
        files: Parameter files.
        extra: Further arguments.
    """

    def __init__(
        self,
        executable: str,
        log: Path,
        *,
        namespace: str = "/",
        params: Mapping[str, str] | None = None,
        files: Sequence[Path] = (),
        extra: Sequence[str] = (),
    ) -> None:
        self.name = f"{namespace.rstrip('/')}/{executable}"
        self._log = log
        self._awaited = False
        command = [
            sys.executable,
            "-m",
            _MODULES.get(executable, executable),
            *extra,
            "--ros-args",
            "-r",
            f"__ns:={namespace}",
        ]
        for file in files:
            command += ["--params-file", str(file)]
        for name, value in (params or {}).items():
            command += ["-p", f"{name}:={value}"]
        with log.open("wb") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)

    @property
    def log(self) -> str:
        """What it has written so far."""
        return self._log.read_text(errors="replace")

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    @property
    def died(self) -> bool:
        """Whether it ended and nobody waited for that."""
        return not self.alive and not self._awaited

    def exit_code(self) -> int:
        """Waits for its end."""
        self._awaited = True
        return exit_code(self.process, self.name, self._log)

    def stop(self, number: int = signal.SIGINT) -> float:
        """Ends it as a user does, and holds that it ends cleanly; returns how long it took [s]."""
        assert self.alive, f"{self.name} died: {self.process.returncode}\n{self.log}"
        began = time.monotonic()
        self.process.send_signal(number)
        code = self.exit_code()
        took = time.monotonic() - began
        assert code == 0, f"{self.name} ended with {code}:\n{self.log}"
        assert "Traceback" not in self.log, self.log
        return took


class Team:
    """Processes of one test module; at its end all of them must stop cleanly.

    Args:
        folder: For their logs.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[NodeProcess] = []

    def start(self, executable: str, **how: Any) -> NodeProcess:
        """Starts a process; see `NodeProcess`."""
        log = self.folder / f"{len(self.processes)}-{executable}.log"
        made = NodeProcess(executable, log, **how)
        self.processes.append(made)
        return made

    def end(self) -> None:
        """Stops what still runs, all at once, and holds that it ends cleanly."""
        died = [f"{p.name}: {p.process.returncode}\n{p.log}" for p in self.processes if p.died]
        running = [p for p in self.processes if p.alive]
        for process in running:
            process.process.send_signal(signal.SIGINT)
        codes = {process.name: process.exit_code() for process in running}
        assert not died, "\n".join(died)
        assert set(codes.values()) <= {0}, codes
        for process in running:
            assert "Traceback" not in process.log, process.log


# --- the peer -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Finding:
    """One entry of `/diagnostics`, and the number of the report that it came in."""

    level: bytes
    message: str
    values: Mapping[str, str]
    report: int

    def count(self, key: str) -> int:
        """A figure; 0 if it is not there."""
        return int(self.values.get(key, 0))


class Peer:
    """A ROS node in the test's process: sends, hears, asks; everything waits with a deadline.

    Args:
        domain: ROS_DOMAIN_ID.
        name: The node's name.
    """

    def __init__(self, domain: int, name: str = "peer") -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        with uninterrupted():
            self.node = rclpy.create_node(
                name, context=self.context, start_parameter_services=False, enable_rosout=False
            )
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}
        self._met: set[str] = set()
        self._clients: dict[str, Any] = {}
        self._findings: dict[str, dict[str, Finding]] = defaultdict(dict)
        self._reports: dict[str, int] = defaultdict(int)
        self._report_stamps: dict[str, int] = {}
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 100)

    def close(self) -> None:
        """Leaves the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    # ---- time ----

    def spin(self, seconds: float = 0.0) -> None:
        """Hears for a while; never a proof of anything."""
        end = time.monotonic() + seconds
        while True:
            self._executor.spin_once(timeout_sec=max(0.0, end - time.monotonic()))
            if time.monotonic() >= end:
                return

    def until(
        self,
        condition: Callable[[], T],
        what: str | Callable[[], object],
        deadline: float = DEADLINE_S,
    ) -> T:
        """Hears until a condition holds, and returns its value."""
        end = time.monotonic() + deadline
        while True:
            value = condition()
            if value:
                return value
            if time.monotonic() > end:
                text = what if isinstance(what, str) else what()
                raise AssertionError(f"waited {deadline:g} s in vain: {text}")
            self._executor.spin_once(timeout_sec=0.02)

    # ---- topics ----

    def hear(self, kind: type, topic: str, qos: QoSProfile = HEAR_ALL) -> list[Any]:
        """Subscribes; the list grows as messages arrive."""
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, qos)
        return heard

    def publisher(self, kind: type, topic: str, qos: QoSProfile = SEND_ALL) -> Any:
        """The publisher of a topic, made when it is first asked for and then connected."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(kind, topic, qos)
        return self._publishers[topic]

    def send(self, topic: str, message: Any) -> None:
        """Publishes a message to somebody who listens."""
        publisher = self.publisher(type(message), topic)
        self.until(publisher.get_subscription_count, f"nobody listens to {topic}")
        if topic not in self._met:
            # Who listens learns of us by itself; what comes before, and is not reliable, is lost.
            self.spin(_MEETING_S)
            self._met.add(topic)
        publisher.publish(message)

    def silence(self, topic: str) -> None:
        """Ends the publisher of a topic."""
        self.node.destroy_publisher(self._publishers.pop(topic))
        self._met.discard(topic)

    def published_by(self, node: str) -> dict[str, list[str]]:
        """Topics and types that a node publishes, without those of every node."""
        found = self.node.get_publisher_names_and_types_by_node(*self._in_graph(node))
        everywhere = ("/rosout", "/parameter_events", "/transition_event")
        return {name: types for name, types in found if not name.endswith(everywhere)}

    def heard_by(self, node: str) -> dict[str, list[str]]:
        """Topics and types that a node subscribes to, without those of every node."""
        found = self.node.get_subscriber_names_and_types_by_node(*self._in_graph(node))
        return {name: types for name, types in found if name != "/parameter_events"}

    def _in_graph(self, node: str) -> tuple[str, str]:
        """Name and namespace of a node, once it is known here: its services may be before."""
        namespace, _, name = node.rpartition("/")
        pair = (name, namespace or "/")
        self.until(
            lambda: pair in self.node.get_node_names_and_namespaces(), f"{node} is not there"
        )
        return pair

    # ---- diagnostics ----

    def _on_report(self, message: DiagnosticArray) -> None:
        names = {status.name.partition(": ")[0] for status in message.status}
        for node in names:
            self._reports[node] += 1
            stamp = message.header.stamp
            self._report_stamps[node] = stamp.sec * 1_000_000_000 + stamp.nanosec
            self._findings[node].clear()
        for status in message.status:
            node, _, name = status.name.partition(": ")
            values = {entry.key: entry.value for entry in status.values}
            if node.rpartition("/")[2] in ("robot_node", "planner_node", "guide_node"):
                assert status.level == OK or values.get("code"), status  # tools go by codes
            self._findings[node][name] = Finding(
                status.level, status.message, values, self._reports[node]
            )

    def findings(self, node: str) -> Mapping[str, Finding]:
        """The last report of a node, by what each entry is about."""
        return self._findings[node]

    def next_findings(self, *nodes: str) -> dict[str, Mapping[str, Finding]]:
        """By node, a report that was made from now on.

        A report under way at this moment may hold what was. It is told by its stamp; where that is
        simulated, the second report is taken.
        """
        now, seen = time.time_ns(), {node: self._reports[node] for node in nodes}

        def made_later(node: str) -> bool:
            stamp = self._report_stamps.get(node, 0)
            simulated = abs(stamp - now) > 3600 * 1_000_000_000
            return self._reports[node] - seen[node] >= (2 if simulated else 1) and (
                simulated or stamp >= now
            )

        self.until(lambda: all(map(made_later, nodes)), lambda: f"{nodes} do not all report")
        return {node: dict(self._findings[node]) for node in nodes}

    def has_reported_since(self, node: str, stamp_ns: int) -> bool:
        """Whether a node's last report was made at a (simulated) time or after it."""
        return self._report_stamps.get(node, 0) >= stamp_ns

    def until_report_at(self, node: str, stamp_ns: int) -> None:
        """Waits for a report of a node whose (simulated) time is this."""
        self.until(
            lambda: self._report_stamps.get(node) == stamp_ns,
            lambda: f"{node} reports at {self._report_stamps.get(node)}; wanted: {stamp_ns}",
        )

    def until_finding(
        self,
        node: str,
        name: str,
        wanted: Callable[[Finding], bool],
        what: str = "",
        deadline: float = DEADLINE_S,
    ) -> Finding:
        """Waits until an entry of a node's report is as wanted."""

        def found() -> Finding | None:
            finding = self._findings[node].get(name)
            return finding if finding is not None and wanted(finding) else None

        def now() -> str:
            return f"{what}; {name} of {node} is {self._findings[node].get(name)}"

        result = self.until(found, now, deadline)
        assert result is not None
        return result

    # ---- services ----

    def call(self, kind: type, name: str, request: Any) -> Any:
        """Calls a service, again if need be: what is asked twice must do no harm.

        The first answer may get lost, where the server knows the client for so short a time that
        its answers do not reach it yet.
        """
        for _ in range(3):
            answer = self._ask(kind, name, request)
            if answer is not None:
                return answer
        raise AssertionError(f"no answer from {name}")

    def _ask(self, kind: type, name: str, request: Any) -> Any:
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        self.until(client.service_is_ready, f"no service {name}")
        future = client.call_async(request)
        try:
            self.until(future.done, name, DEADLINE_S / 3)
        except AssertionError:
            client.remove_pending_request(future)
            return None
        return future.result()

    def state(self, node: str) -> str:
        """Lifecycle state of a node."""
        return str(self.call(GetState, f"{node}/get_state", GetState.Request()).current_state.label)

    def until_active(self, *nodes: str) -> None:
        """Waits until nodes are in the state `active`."""
        for node in nodes:
            self.until(lambda n=node: self.state(n) == "active", f"{node} is not active")  # type: ignore[misc]

    def change_state(self, node: str, transition: str | int) -> bool:
        """Asks for a transition: configure, activate, deactivate, cleanup, shutdown; or its id."""
        if isinstance(transition, int):
            asked, label = Transition(id=transition), _LABELS[transition]
        else:
            asked, label = Transition(label=transition), transition
        request = ChangeState.Request(transition=asked)
        answer = self._ask(ChangeState, f"{node}/change_state", request)
        if answer is None:
            return self.state(node) == _GOALS[label]
        return bool(answer.success)

    def set(self, node: str, **params: Any) -> list[Any]:
        """Sets parameters one by one (`__` stands for the dot); returns the results."""
        request = SetParameters.Request(parameters=_parameters(params))
        return list(self.call(SetParameters, f"{node}/set_parameters", request).results)

    def set_together(self, node: str, **params: Any) -> Any:
        """Sets parameters all together or not at all."""
        request = SetParametersAtomically.Request(parameters=_parameters(params))
        return self.call(
            SetParametersAtomically, f"{node}/set_parameters_atomically", request
        ).result

    def must_set(self, node: str, **params: Any) -> None:
        """Sets parameters all together, and holds that they are taken."""
        result = self.set_together(node, **params)
        assert result.successful, result.reason

    def get(self, node: str, *names: str) -> list[Any]:
        """Values of parameters."""
        request = GetParameters.Request(names=list(names))
        answer = self.call(GetParameters, f"{node}/get_parameters", request)
        return [parameter_value_to_python(value) for value in answer.values]

    def describe(self, node: str) -> dict[str, Any]:
        """All parameters of a node, with their descriptors."""
        listed = self.call(ListParameters, f"{node}/list_parameters", ListParameters.Request())
        names = list(listed.result.names)
        request = DescribeParameters.Request(names=names)
        answer = self.call(DescribeParameters, f"{node}/describe_parameters", request)
        return dict(zip(names, answer.descriptors, strict=True))

    def reconfigure(self, node: str, **params: Any) -> None:
        """Takes an active node through cleanup, sets parameters, and activates it again."""
        assert self.change_state(node, "deactivate")
        assert self.change_state(node, "cleanup")
        self.must_set(node, **params)
        assert self.change_state(node, "configure")
        assert self.change_state(node, "activate")


def _parameters(values: Mapping[str, Any]) -> list[Any]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]


def holds(text: str, parts: Sequence[str]) -> bool:
    """Whether a text holds all parts, each a regular expression."""
    return all(re.search(part, text) for part in parts)
