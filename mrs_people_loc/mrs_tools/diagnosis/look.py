"""Listens to a running team, and asks its nodes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from mrs_people_loc.config import GUIDE_NODE, PLANNER_NODE, ROBOT_NODE
from mrs_ros.network import node_of
from mrs_tools.diagnosis import shared_memory
from mrs_tools.diagnosis.facts import ERROR, LEVELS, Endpoint, Facts, is_planner
from mrs_tools.diagnosis.load import Load
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rclpy.node import Node

_KINDS = (ROBOT_NODE, PLANNER_NODE, GUIDE_NODE)
_PEOPLE = "mrs_people_msgs/msg/People"
#: What nodes of `mrs people` are called, before a number.
_VIEWER = "mrs_people_"
#: A node that does not answer within this, twice, does not answer [s].
_ANSWER_S = 1.5


def look(node: Node, duration_s: float, spin: Callable[[], object]) -> Facts:
    """Listens to a team for a while.

    Args:
        node: The ROS node to listen with.
        duration_s: For how long [s].
        spin: Called again and again; lets the node work for a moment.
    """
    facts = Facts(node.context.get_domain_id(), nodes=[], memory=shared_memory.memory())
    facts.load = Load.now()  # before this listens, too
    _hear_reports(node, duration_s, spin, facts)
    look_at_graph(node, facts)
    ask_nodes(node, facts, spin)
    return facts


def look_at_graph(node: Node, facts: Facts) -> None:
    """Adds who is there, and who publishes and subscribes."""
    names = node.get_node_names_and_namespaces()
    facts.nodes = sorted(f"{ns.rstrip('/')}/{name}" for name, ns in names if name in _KINDS)
    facts.viewers = sorted(f"{ns.rstrip('/')}/{name}" for name, ns in names if _is_viewer(name))
    facts.has_clock = node.count_publishers("/clock") > 0
    topics = _topics_of_ours(node, names)
    facts.mismatches = list(_mismatches(node, topics))
    facts.types = {topic: ends for topic in topics if _differ(ends := _endpoints(node, topic))}
    for topic, types in node.get_topic_names_and_types():
        if _PEOPLE in types:
            publishers = node.get_publishers_info_by_topic(topic)
            ours = (one for one in publishers if one.topic_type == _PEOPLE)
            facts.people_from[topic] = sorted(map(node_of, ours))
        elif topic.endswith("/points"):
            listeners = map(node_of, node.get_subscriptions_info_by_topic(topic))
            facts.shared_robots[topic] = list(filter(is_planner, listeners))


def ask_nodes(node: Node, facts: Facts, spin: Callable[[], object]) -> None:
    """Adds what the nodes answer, of their life cycle and their time."""
    for full in dict.fromkeys(facts.nodes):
        facts.states[full] = _state(node, full, spin)
        facts.sim_time[full] = None if facts.states[full] is None else _sim_time(node, full, spin)


def take_report(facts: Facts, message: Any) -> None:
    """Adds a diagnostic_msgs/DiagnosticArray: a node's report, which replaces that before."""
    # A report is complete: what is no longer in it is over.
    for full_name in {plain(one.name).partition(": ")[0] for one in message.status}:
        facts.reports.pop(full_name, None)
    for status in message.status:
        full_name, _, subject = plain(status.name).partition(": ")
        if full_name.rpartition("/")[2] in _KINDS:
            values = {plain(entry.key): plain(entry.value) for entry in status.values}
            level = status.level if isinstance(status.level, bytes) else bytes([status.level])
            entry = (LEVELS.get(level, ERROR), plain(status.message), values)
            facts.reports.setdefault(full_name, {})[subject] = entry


def _hear_reports(node: Node, duration_s: float, spin: Callable[[], object], facts: Facts) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    def take(message: Any) -> None:
        take_report(facts, message)

    subscription = node.create_subscription(DiagnosticArray, "/diagnostics", take, 100)
    end = time.monotonic() + duration_s
    while time.monotonic() < end:
        spin()
    node.destroy_subscription(subscription)


def _is_viewer(name: str) -> bool:
    return name.removeprefix(_VIEWER).isdigit() and name.startswith(_VIEWER)


def _topics_of_ours(node: Node, names: Iterable[tuple[str, str]]) -> list[str]:
    """What our nodes publish and subscribe to."""
    from rclpy.node import NodeNameNonExistentError

    topics: set[str] = set()
    for name, namespace in names:
        if name in _KINDS:
            with suppress(NodeNameNonExistentError):  # it has just left
                inputs = node.get_subscriber_names_and_types_by_node(name, namespace)
                outputs = node.get_publisher_names_and_types_by_node(name, namespace)
                topics.update(topic for topic, _ in [*inputs, *outputs])
    return sorted(topics)


def _endpoints(node: Node, topic: str) -> list[Endpoint]:
    publishers = node.get_publishers_info_by_topic(topic)
    subscribers = node.get_subscriptions_info_by_topic(topic)
    return [
        *(Endpoint(one.topic_type, node_of(one), True) for one in publishers),
        *(Endpoint(one.topic_type, node_of(one), False) for one in subscribers),
    ]


def _differ(endpoints: Iterable[Endpoint]) -> bool:
    return len({one.type for one in endpoints}) > 1


def _mismatches(node: Node, topics: Iterable[str]) -> Iterable[tuple[str, str]]:
    """Publishers and subscribers of our nodes' topics whose QoS does not fit."""
    from rclpy.qos import QoSCompatibility, qos_check_compatible

    for topic in topics:
        for publisher in node.get_publishers_info_by_topic(topic):
            for subscriber in node.get_subscriptions_info_by_topic(topic):
                if not {publisher.node_name, subscriber.node_name} & set(_KINDS):
                    continue
                if publisher.topic_type != subscriber.topic_type:
                    continue  # never connected, whatever the QoS
                pair = f"{node_of(publisher)} publishes it and {node_of(subscriber)} subscribes"
                fits, why = qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)
                if fits == QoSCompatibility.ERROR:
                    yield topic, f"{pair} with incompatible QoS: {why.strip().rstrip(';')}"


def _sim_time(node: Node, full_name: str, spin: Callable[[], object]) -> bool | None:
    from rcl_interfaces.srv import GetParameters

    request = GetParameters.Request(names=["use_sim_time"])
    answer = ask(node, GetParameters, f"{full_name}/get_parameters", request, spin)
    return bool(answer.values[0].bool_value) if answer is not None and answer.values else None


def _state(node: Node, full_name: str, spin: Callable[[], object]) -> str | None:
    """State of a node in its life cycle."""
    from lifecycle_msgs.srv import GetState

    answer = ask(node, GetState, f"{full_name}/get_state", GetState.Request(), spin)
    return None if answer is None else str(answer.current_state.label)


def ask(node: Node, kind: Any, service: str, request: Any, spin: Callable[[], object]) -> Any:
    """Answer of a service; None if none comes. The first may get lost, so it is asked twice."""
    client = node.create_client(kind, service)
    try:
        for _ in range(2):
            end = time.monotonic() + _ANSWER_S
            while not client.service_is_ready() and time.monotonic() < end:
                spin()
            if not client.service_is_ready():
                continue
            answer = client.call_async(request)
            while not answer.done() and time.monotonic() < end:
                spin()
            if answer.done():
                return answer.result()
        return None
    finally:
        node.destroy_client(client)
