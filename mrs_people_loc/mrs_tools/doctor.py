"""`mrs doctor`: what is wrong with a running team, and what to do, in words."""

from __future__ import annotations

import os
import re
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rclpy.node import Node

OK, WARN, ERROR, STALE = "ok", "warning", "error", "waiting"
_LEVELS = {b"\x00": OK, b"\x01": WARN, b"\x02": ERROR, b"\x03": STALE}
_COLOURS = {OK: "green", WARN: "yellow", ERROR: "red", STALE: "yellow"}

#: What to do about what the nodes report, where their own words do not say it; the first that fits.
_ADVICE = (
    (
        r"publishers: 0",
        "start what publishes it, or remap it: `ros2 topic list` shows what there is",
    ),
    (r"published as", "two programs mean different things by this name: remap one"),
    (
        r"incompatible QoS",
        "let its publisher offer what is asked for; streams are asked for as best effort, volatile",
    ),
    (
        r"no data on \S+ for .*publishers: \d",
        "it is announced, but nothing comes: its program stands still, or the network lets only "
        "discovery pass (firewall, Wi-Fi): docs/network.md",
    ),
    (r"found no pair", "trigger the cameras together, or raise images.max_stamp_difference"),
    (r"dropped; last:", "messages are refused for the reason that is said: mend their sender"),
    (
        r"no pose near|scans but no pose",
        "its poses come late or not at all: look at <robot>/pose, the load of its computer, and "
        "the network",
    ),
    (r"older than the newest", "they come late: the network, the load of its computer, its clock"),
    (r"no usable pose", "publish its pose, in the map, or set pose.map_from_odom"),
    (r"scans per second; expected", "its computer or the network is too slow: see cpu, and *_ms"),
    (r"its last scan is", "it has stopped, or is cut off"),
    (r"no robot yet|no scan used yet|no interval yet|no scan yet", "wait, or see its inputs above"),
    (r"inactive", "activate it: ros2 lifecycle set NODE activate"),
)


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        subject: A node and what about it, or a topic.
        level: ok, warning, error or waiting.
        text: What was found.
        advice: What to do; empty where the text says it, or nothing is to be done.
    """

    subject: str
    level: str
    text: str
    advice: str = ""


@dataclass
class Facts:
    """What was seen of a team.

    Attributes:
        domain: ROS_DOMAIN_ID.
        nodes: Full names of our nodes on the network.
        reports: By node, its last report: by subject its level, text and values.
        mismatches: Topic, and why a publisher and a subscriber of it do not meet.
        has_clock: Whether somebody publishes `/clock`.
        sim_time: By node, whether it takes its time from `/clock`; None: it did not answer.
    """

    domain: int
    nodes: list[str]
    reports: dict[str, dict[str, tuple[str, str, Mapping[str, str]]]] = field(default_factory=dict)
    mismatches: list[tuple[str, str]] = field(default_factory=list)
    has_clock: bool = False
    sim_time: dict[str, bool | None] = field(default_factory=dict)


def advice_for(text: str) -> str:
    """What to do about a finding; empty if it says that itself."""
    return next((advice for pattern, advice in _ADVICE if re.search(pattern, text)), "")


def diagnose(facts: Facts) -> list[Check]:
    """What is right and wrong with a team, the causes first."""
    checks = [*_of_nodes(facts), *_of_time(facts)]
    checks += [
        Check(topic, ERROR, text, "let both ask for the same; docs/network.md has the table")
        for topic, text in facts.mismatches
    ]
    for node in dict.fromkeys(facts.nodes):
        if node not in facts.reports:
            checks.append(
                Check(
                    node,
                    ERROR,
                    "is on the network, but reports nothing on /diagnostics",
                    "it hangs, or the network lets only discovery pass: docs/network.md",
                )
            )
            continue
        report = facts.reports[node]
        bad = [(name, *entry) for name, entry in report.items() if entry[0] != OK]
        for name, level, text, _ in bad:
            checks.append(Check(f"{node}: {name}", level, text, advice_for(text)))
        if not bad:
            checks.append(Check(node, OK, f"{len(report)} findings, all well"))
    return checks


def _of_nodes(facts: Facts) -> Iterable[Check]:
    kinds = {kind: [n for n in facts.nodes if n.endswith(f"/{kind}")] for kind in _KINDS}
    if not facts.nodes:
        yield Check(
            "network",
            ERROR,
            f"no {ROBOT_NODE} and no {PLANNER_NODE} in ROS domain {facts.domain}",
            "start them; the same ROS_DOMAIN_ID on all machines; if they run, the network keeps "
            "them apart (multicast, firewall, discovery server): docs/network.md",
        )
        return
    for kind, found in kinds.items():
        if not found:
            yield Check("network", ERROR, f"no {kind} in ROS domain {facts.domain}", "start it")
        for name, count in Counter(found).items():
            if count > 1:
                text = f"{count} nodes have this name"
                what = "rename one" if kind == ROBOT_NODE else "end one, or give it a namespace"
                yield Check(name, ERROR, text, f"it was started twice: {what}")


def _of_time(facts: Facts) -> Iterable[Check]:
    simulated = sorted(node for node, sim in facts.sim_time.items() if sim)
    real = sorted(node for node, sim in facts.sim_time.items() if sim is False)
    if simulated and not facts.has_clock:
        yield Check(
            "/clock",
            ERROR,
            f"{', '.join(simulated)} take their time from it, but nobody publishes it",
            "mrs replay --clock, or use_sim_time:=false",
        )
    if simulated and real:
        yield Check(
            "use_sim_time",
            ERROR,
            f"is true for {', '.join(simulated)} and false for {', '.join(real)}",
            "set it alike for all",
        )


_KINDS = (ROBOT_NODE, PLANNER_NODE)


def look(node: Node, duration_s: float, spin: Any) -> Facts:
    """Listens to a team for a while.

    Args:
        node: The ROS node to listen with.
        duration_s: For how long [s].
        spin: Called again and again; lets the node work for a moment.
    """
    from diagnostic_msgs.msg import DiagnosticArray

    facts = Facts(domain=node.context.get_domain_id(), nodes=[])

    def take(message: Any) -> None:
        for status in message.status:
            full_name, _, subject = status.name.partition(": ")
            if full_name.rpartition("/")[2] in _KINDS:
                values = {plain(entry.key): plain(entry.value) for entry in status.values}
                entry = (_LEVELS.get(bytes(status.level), ERROR), plain(status.message), values)
                facts.reports.setdefault(full_name, {})[plain(subject)] = entry

    subscription = node.create_subscription(DiagnosticArray, "/diagnostics", take, 100)
    end = time.monotonic() + duration_s
    while time.monotonic() < end:
        spin()
    node.destroy_subscription(subscription)
    names = node.get_node_names_and_namespaces()
    facts.nodes = sorted(f"{ns.rstrip('/')}/{name}" for name, ns in names if name in _KINDS)
    facts.has_clock = node.count_publishers("/clock") > 0
    facts.mismatches = list(_mismatches(node, names))
    facts.sim_time = {full: _sim_time(node, full, spin) for full in dict.fromkeys(facts.nodes)}
    return facts


def _mismatches(node: Node, names: Iterable[tuple[str, str]]) -> Iterable[tuple[str, str]]:
    """Publishers that our nodes do not hear, and subscribers that do not hear our nodes."""
    from rclpy.node import NodeNameNonExistentError
    from rclpy.qos import QoSCompatibility, qos_check_compatible

    topics: set[str] = set()
    for name, namespace in names:
        if name in _KINDS:
            with suppress(NodeNameNonExistentError):  # it has just left
                heard = node.get_subscriber_names_and_types_by_node(name, namespace)
                said = node.get_publisher_names_and_types_by_node(name, namespace)
                topics.update(topic for topic, _ in [*heard, *said])
    for topic in sorted(topics):
        for publisher in node.get_publishers_info_by_topic(topic):
            for subscriber in node.get_subscriptions_info_by_topic(topic):
                if not {publisher.node_name, subscriber.node_name} & set(_KINDS):
                    continue
                pair = f"{_name(publisher)} publishes it and {_name(subscriber)} subscribes"
                if publisher.topic_type != subscriber.topic_type:
                    yield topic, f"{pair}: {publisher.topic_type}, {subscriber.topic_type}"
                    continue
                fits, why = qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)
                if fits == QoSCompatibility.ERROR:
                    yield topic, f"{pair} with incompatible QoS: {why.strip().rstrip(';')}"


def _name(end: Any) -> str:
    return f"{end.node_namespace.rstrip('/')}/{end.node_name}"


def _sim_time(node: Node, full_name: str, spin: Any) -> bool | None:
    from rcl_interfaces.srv import GetParameters

    client = node.create_client(GetParameters, f"{full_name}/get_parameters")
    try:
        end = time.monotonic() + 2.0
        while not client.service_is_ready() and time.monotonic() < end:
            spin()
        answer = client.call_async(GetParameters.Request(names=["use_sim_time"]))
        while not answer.done() and time.monotonic() < end:
            spin()
        return bool(answer.result().values[0].bool_value) if answer.done() else None
    finally:
        node.destroy_client(client)


def figures(facts: Facts) -> list[list[str]]:
    """What the planner and the robots say of themselves, a row per robot.

    Returns:
        Robot, scans per second, age [s], clock offset [s], processor [%], frame [ms].
    """
    rows = []
    for node, report in sorted(facts.reports.items()):
        if not node.endswith(f"/{PLANNER_NODE}"):
            continue
        for subject, (_, _, values) in report.items():
            if not subject.startswith("robot "):
                continue
            robot = subject.removeprefix("robot ")
            own = facts.reports.get(f"{node.removesuffix(PLANNER_NODE)}{robot}/{ROBOT_NODE}", {})
            state, scan = (own.get(name, ("", "", {}))[2] for name in ("state", "scan"))
            stages = [
                float(ms)
                for name, ms in scan.items()
                if name.endswith("_ms") and re.fullmatch(r"\d+(\.\d+)?", ms, re.ASCII)
            ]
            rows.append(
                [
                    robot,
                    values.get("scan_hz", "-"),
                    values.get("age_s", "-"),
                    values.get("clock_offset_s", "-"),
                    state.get("cpu_percent", "-"),
                    f"{sum(stages):.1f}" if stages else "-",
                ]
            )
    return rows


def command(
    duration: Annotated[
        float, typer.Option("--duration", min=2.0, help="Listen for so long [s].")
    ] = 4.0,
) -> None:
    """Look at a running team for a few seconds; say what is wrong, and what to do.

    Looks at every robot_node and planner_node in this ROS domain. Exit code 1 if there is an error.
    """
    from rclpy.executors import SingleThreadedExecutor
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from mrs_tools.replay import node

    with node("mrs_doctor") as made:
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        try:
            facts = look(made, duration, lambda: executor.spin_once(timeout_sec=0.1))
        finally:
            executor.shutdown()

    console = Console(soft_wrap=True, highlight=False)
    settings = [f"{name}={os.environ[name]}" for name in _SETTINGS if os.environ.get(name)]
    console.print(f"ROS domain {facts.domain}; {', '.join(settings) or 'no settings of its own'}")
    checks = diagnose(facts)
    for check in checks:
        line = Text.assemble((f"{check.level:>8}  ", _COLOURS[check.level]), check.subject)
        console.print(line.append(f": {check.text}"))
        if check.advice:
            console.print(Text(f"          -> {check.advice}"))
    rows = figures(facts)
    if rows:
        table = Table()
        table.add_column("robot")
        for column in ("scans/s", r"age \[s]", r"clock \[s]", r"CPU \[%]", r"frame \[ms]"):
            table.add_column(column, justify="right")
        for row in rows:
            table.add_row(*map(Text, row))
        console.print(table)
    if any(check.level == ERROR for check in checks):
        raise typer.Exit(1)


#: What decides which nodes find each other.
_SETTINGS = (
    "RMW_IMPLEMENTATION",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "ROS_SUPER_CLIENT",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "ROS_SECURITY_ENABLE",
)
