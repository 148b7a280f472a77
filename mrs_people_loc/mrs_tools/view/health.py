"""How a running team is, in the words of `mrs doctor`, looked at again and again."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ConfigError
from mrs_tools.diagnosis import shared_memory
from mrs_tools.diagnosis.diagnose import Check, diagnose
from mrs_tools.diagnosis.facts import ERROR, OK, STALE, WARN, Facts, is_robot
from mrs_tools.diagnosis.load import Load
from mrs_tools.diagnosis.look import ask, ask_nodes, look_at_graph, take_report
from mrs_tools.view.protocol import Finding, Health

if TYPE_CHECKING:
    from rclpy.node import Node

#: A report on /diagnostics, which comes once a second, holds for so long [s].
_REPORT_S = 3.5
#: A node that was discovered only now gets so long for its first one [s].
_NEW_S = 3.0
#: Nodes are asked for their states again after so long [s].
_ASK_S = 15.0
_WORST_FIRST = (ERROR, WARN, STALE, OK)


class HealthWatch:
    """Looks at every node of ours in the ROS domain.

    Args:
        node: The ROS node to look with.
    """

    def __init__(self, node: Node) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self._node = node
        self._reports = Facts(0, nodes=[])
        self._reported_s: dict[str, float] = {}
        self._first_seen_s: dict[str, float] = {}
        self._answers = Facts(0, nodes=[])
        self._asked_s = 0.0
        self._memory = shared_memory.memory()
        node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 100)

    def _take(self, message: Any) -> None:
        take_report(self._reports, message)
        now_s = time.monotonic()
        for status in message.status:
            self._reported_s[status.name.partition(": ")[0]] = now_s

    def look(self, spin: Callable[[], object]) -> list[Check]:
        """What is right and wrong now.

        Args:
            spin: Lets the node work for a moment; called again and again while nodes are asked.
        """
        now_s = time.monotonic()
        facts = Facts(self._node.context.get_domain_id(), nodes=[], memory=self._memory)
        facts.load = Load.now()
        look_at_graph(self._node, facts)
        facts.reports = {
            node: report
            for node, report in self._reports.reports.items()
            if now_s - self._reported_s.get(node, 0.0) < _REPORT_S
        }
        present = set(facts.nodes)
        self._first_seen_s = {
            node: self._first_seen_s.get(node, now_s) for node in present | facts.reports.keys()
        }
        self._ask(facts, spin, now_s)
        # A node that has just come reports in a moment.
        new = {node for node in present if now_s - self._first_seen_s[node] < _NEW_S}
        shown = [
            check for check in diagnose(facts) if check.level == OK or check.subject not in new
        ]
        return sorted(shown, key=lambda check: _WORST_FIRST.index(check.level))

    def _ask(self, facts: Facts, spin: Callable[[], object], now_s: float) -> None:
        """Adds what the nodes answered, not long ago."""
        if set(facts.nodes) != set(self._answers.nodes) or now_s - self._asked_s > _ASK_S:
            self._answers = Facts(0, nodes=list(facts.nodes))
            ask_nodes(self._node, self._answers, spin)
            self._asked_s = time.monotonic()
        facts.states, facts.sim_time = self._answers.states, self._answers.sim_time


def health_of(checks: Iterable[Check], own: Iterable[Finding] = ()) -> Health:
    """What the page says of the team's health.

    Args:
        checks: What was looked at.
        own: What the viewer's server itself has found.
    """
    findings = [
        Finding(
            level=check.level,  # type: ignore[typeddict-item]
            subject=check.subject,
            text=check.text,
            advice=check.advice,
            follows=[f"{one.subject}: {one.text}" for one in check.follows],
        )
        for check in checks
        if check.level != OK
    ]
    findings += own
    findings.sort(key=lambda finding: _WORST_FIRST.index(finding["level"]))
    return Health(
        type="health", level=findings[0]["level"] if findings else "ok", findings=findings
    )


def notes_of_robots(checks: Iterable[Check], namespace: str) -> dict[str, str]:
    """By robot whose node reports an error: what, in words.

    Args:
        checks: What was looked at.
        namespace: The planner's.
    """
    notes: dict[str, str] = {}
    for check in checks:
        node = check.subject.partition(": ")[0]
        if check.level == ERROR and is_robot(node):
            robot = node.rpartition("/")[0].removeprefix(namespace.rstrip("/")).strip("/")
            notes.setdefault(robot, check.text)
    return notes


def ask_head(
    node: Node, robot: str, spin: Callable[[], object]
) -> tuple[bool, float, Mounting] | None:
    """What a robot_node says of its head; None if it does not answer.

    Args:
        node: The ROS node to ask with.
        robot: The robot's name.
        spin: Lets the node work for a moment.

    Returns:
        Whether its images are rectified, how far it finds people [m], and its mounting.
    """
    from rcl_interfaces.srv import GetParameters

    angles = ("height", "forward", "left", "pitch", "roll", "yaw")
    names = ["images.rectified", "bodies.search", "bodies.max_range", "disparity.max_range"]
    request = GetParameters.Request(names=[*names, *(f"mounting.{name}" for name in angles)])
    service = node.resolve_service_name(f"{robot}/robot_node/get_parameters")
    answer = ask(node, GetParameters, service, request, spin)
    if answer is None or len(answer.values) != len(request.names):
        return None
    rectified, search, far_body, far = answer.values[:4]
    reach = far_body.double_value if search.bool_value else far.double_value
    values = (value.double_value for value in answer.values[4:])
    try:
        return rectified.bool_value, reach, Mounting(**dict(zip(angles, values, strict=True)))
    except ConfigError:
        return None
