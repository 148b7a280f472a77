"""What was seen of a team, as plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mrs_people_loc.config import GUIDE_NODE, PLANNER_NODE, ROBOT_NODE
from mrs_tools.diagnosis.load import Load
from mrs_tools.diagnosis.shared_memory import Memory

OK, WARN, ERROR, STALE = "ok", "warning", "error", "waiting"
#: Levels, as diagnostic_msgs/DiagnosticStatus numbers them.
LEVELS = {b"\x00": OK, b"\x01": WARN, b"\x02": ERROR, b"\x03": STALE}

#: What a node reports on `/diagnostics`: by subject the level, the sentence and the values.
Report = Mapping[str, tuple[str, str, Mapping[str, str]]]


class Endpoint(NamedTuple):
    """A publisher or a subscriber of a topic.

    Attributes:
        type: What it publishes or subscribes to, such as std_msgs/msg/String.
        node: Full name of its node.
        publishes: Whether it is a publisher.
    """

    type: str
    node: str
    publishes: bool


@dataclass
class Facts:
    """What was seen of a team.

    Attributes:
        domain: ROS_DOMAIN_ID.
        nodes: Full names of our nodes on the network.
        reports: By node, its last report.
        mismatches: Topic, and why the QoS of a publisher and a subscriber of it do not fit.
        types: By topic of our nodes that has endpoints of several types, these with their nodes.
        has_clock: Whether somebody publishes `/clock`.
        sim_time: By node, whether it takes its time from `/clock`; None: it did not answer.
        states: By node, its state in the life cycle; None: it did not answer.
        people_from: By topic of mrs_people_msgs/People, the nodes that publish it.
        shared_robots: By robot's topic `points`, the planners that listen to it.
        viewers: Every `mrs people` that runs.
        memory: Shared memory of this machine.
        load: Load of this machine.
    """

    domain: int
    nodes: list[str]
    reports: dict[str, dict[str, tuple[str, str, Mapping[str, str]]]] = field(default_factory=dict)
    mismatches: list[tuple[str, str]] = field(default_factory=list)
    types: dict[str, list[Endpoint]] = field(default_factory=dict)
    has_clock: bool = False
    sim_time: dict[str, bool | None] = field(default_factory=dict)
    states: dict[str, str | None] = field(default_factory=dict)
    people_from: dict[str, list[str]] = field(default_factory=dict)
    shared_robots: dict[str, list[str]] = field(default_factory=dict)
    viewers: list[str] = field(default_factory=list)
    memory: Memory | None = None
    load: Load | None = None


def is_robot(node: str) -> bool:
    """Whether a node of this full name is a robot's."""
    return node.endswith(f"/{ROBOT_NODE}")


def is_planner(node: str) -> bool:
    """Whether a node of this full name is a planner."""
    return node.endswith(f"/{PLANNER_NODE}")


def is_guide(node: str) -> bool:
    """Whether a node of this full name is a guide."""
    return node.endswith(f"/{GUIDE_NODE}")


def robot_node_of(node: str, robot: str) -> str:
    """Full name of the node of a robot that a planner or a guide hears."""
    return f"{node.rpartition('/')[0]}/{robot}/{ROBOT_NODE}"


def figures(facts: Facts) -> list[list[str]]:
    """What the planners and the robots report of each robot, a row each.

    Returns:
        Robot, scans per second, age [s], clock offset [s], processor [%], frame [ms].
    """
    rows = []
    for node, report in sorted(facts.reports.items()):
        for subject, (_, _, values) in report.items():
            if is_planner(node) and subject.startswith("robot "):
                robot = subject.removeprefix("robot ")
                own = facts.reports.get(robot_node_of(node, robot), {})
                rows.append([robot, *_figures(values, own)])
    return rows


def _figures(values: Mapping[str, str], own: Report) -> list[str]:
    state, scan = (own.get(name, ("", "", {}))[2] for name in ("state", "scan"))
    times = [number(ms) for name, ms in scan.items() if name.endswith("_ms")]
    stages_ms = [ms for ms in times if ms is not None]
    return [
        *(values.get(name, "-") for name in ("scan_hz", "age_s", "clock_offset_s")),
        state.get("cpu_percent", "-"),
        f"{sum(stages_ms):.1f}" if stages_ms else "-",
    ]


def number(text: str) -> float | None:
    """A finite number; None if the text is none: everybody may publish on `/diagnostics`."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
