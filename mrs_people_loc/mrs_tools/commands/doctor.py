"""`mrs doctor`: what is wrong with a running team, and what to do, in words."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE
from mrs_people_loc.health.findings import Code
from mrs_ros.network import node_of
from mrs_tools import shared_memory
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rclpy.node import Node

OK, WARN, ERROR, STALE = "ok", "warning", "error", "waiting"
LEVELS = {b"\x00": OK, b"\x01": WARN, b"\x02": ERROR, b"\x03": STALE}
_COLOURS = {OK: "green", WARN: "yellow", ERROR: "red", STALE: "yellow"}

_NETWORK = "it hangs, or the network lets only discovery pass (firewall, Wi-Fi): docs/network.md"

_STANDS_STILL = (
    "does not answer: it stands still (end it and start it again), or was killed some seconds ago, "
    "or the network lets only discovery pass (firewall, Wi-Fi): docs/network.md"
)

#: What to do about what the nodes report, by its code, where their own words do not say it.
_ADVICE = {
    Code.NO_PUBLISHER: "start what publishes it, or remap it: `ros2 topic list` shows what there "
    "is; docs/cameras.md",
    Code.NO_DATA: "it is announced, but nothing comes: its program stands still, or the network "
    "lets only discovery pass (firewall, Wi-Fi): docs/network.md",
    Code.WRONG_TYPE: "two programs mean different things by this name: remap one",
    Code.WRONG_QOS: "let its publisher offer what is asked for; streams are asked for as best "
    "effort, volatile",
    Code.ALL_REFUSED: "none is used, for the reason that is said: mend their sender, or see "
    "docs/cameras.md",
    Code.SOME_REFUSED: "messages are refused for the reason that is said: mend their sender",
    Code.NO_CALIBRATION: "publish camera_info beside the images: docs/cameras.md",
    Code.OUTDATED: "/clock was set back and its stamps are ahead of it since: its sender does not "
    "follow /clock (use_sim_time), or something else is on this topic besides the replay",
    Code.NO_PAIR: "left and right must come, with stamps of one moment: docs/cameras.md",
    Code.SCAN_SILENT: "its camera, its node or its network has stopped",
    Code.LEFT_OUT_NO_POSE: "its poses come late or not at all: look at <robot>/pose, the load of "
    "its computer, and the network",
    Code.LEFT_OUT_TOO_OLD: "they come late: the network, the load of its computer, its clock",
    Code.NO_POSE: "publish its pose, in the map, or set pose.map_from_odom",
    Code.SLOW: "its computer or the network is too slow: see cpu, and *_ms",
    **dict.fromkeys(
        (Code.NO_VIEW, Code.NO_SCAN, Code.NO_ROBOT, Code.NO_INTERVAL), "wait, or see its inputs"
    ),
}

#: What a node that is not at work says of itself, and how it is set to work.
_STATES = {
    "unconfigured": (
        "hears and sends nothing: it was told to wait (autostart:=false), or could not be "
        "configured, which its log says",
        "ros2 lifecycle set {node} configure && ros2 lifecycle set {node} activate",
    ),
    "inactive": ("hears and sends nothing until activated", "ros2 lifecycle set {node} activate"),
    "finalized": (
        "it was shut down, and hears and sends nothing",
        "end its process; start it anew",
    ),
}

#: What a scan, and a pose, need of the robot's node: subjects of its report, as regular
#: expressions, in the order of the data. "node" is the node itself.
_SIGHT = ("node", "images", r"\w+/image_\w+", r"\w+/camera_info", "pairs", "scan")
_POSE = ("node", "odom|pose_in", "pose")
#: Topics that come from where another does.
_BESIDE = {"camera_info": r"image_\w+", "pose": "points"}
#: Findings that say only that something does not come, or does not go on.
_LACKS = {
    Code.NO_PUBLISHER,
    Code.NO_DATA,
    Code.NO_CALIBRATION,
    Code.NO_PAIR,
    Code.SOME_UNPAIRED,
    Code.NO_VIEW,
    Code.NO_SCAN,
    Code.SCAN_SILENT,
    Code.NO_POSE,
    Code.LEFT_OUT_NO_POSE,
    Code.TWO_PUBLISHERS,
    Code.NO_ROBOT,
    Code.NO_INTERVAL,
}


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        subject: A node and what about it, or a topic.
        level: ok, warning, error or waiting.
        text: What was found.
        advice: What to do; empty where the text says it, or nothing is to be done.
        follows: What else was found that comes of this.
    """

    subject: str
    level: str
    text: str
    advice: str = ""
    follows: tuple[Check, ...] = ()


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
        states: By node, its state in the life cycle; None: it did not answer.
        people_from: By topic of `people`, who publishes it.
        shared_robots: By robot's topic that more than one planner listens to, these planners.
        viewers: Every `mrs people` that runs.
        memory: Shared memory of this machine.
    """

    domain: int
    nodes: list[str]
    reports: dict[str, dict[str, tuple[str, str, Mapping[str, str]]]] = field(default_factory=dict)
    mismatches: list[tuple[str, str]] = field(default_factory=list)
    has_clock: bool = False
    sim_time: dict[str, bool | None] = field(default_factory=dict)
    states: dict[str, str | None] = field(default_factory=dict)
    people_from: dict[str, list[str]] = field(default_factory=dict)
    shared_robots: dict[str, list[str]] = field(default_factory=dict)
    viewers: list[str] = field(default_factory=list)
    memory: shared_memory.Memory | None = None


@dataclass(frozen=True, eq=False)
class _Entry:
    """One finding of a node that is not well."""

    node: str
    subject: str
    level: str
    text: str
    code: Code | None = None
    advice: str = ""

    @property
    def is_standing(self) -> bool:
        """Whether it is of a robot that is known, but does not answer."""
        return self.advice.endswith(_STANDS_STILL)

    @property
    def is_of_robot(self) -> bool:
        return self.node.endswith(f"/{ROBOT_NODE}")

    def check(self, follows: Iterable[_Entry] = ()) -> Check:
        subject = self.node if self.subject == "node" else f"{self.node}: {self.subject}"
        advice = self.advice or (_ADVICE.get(self.code, "") if self.code else "")
        return Check(subject, self.level, self.text, advice, tuple(e.check() for e in follows))


def diagnose(facts: Facts) -> list[Check]:
    """What is right and wrong with a team: the causes first, and what follows from each with it."""
    checks = [*_of_nodes(facts), *_of_time(facts), *_of_planners(facts)]
    checks += [
        Check(topic, ERROR, text, "let both ask for the same; docs/network.md has the table")
        for topic, text in facts.mismatches
    ]
    dead = shared_memory.trouble(facts.memory) if facts.memory else ""
    if dead:
        checks.append(Check(str(shared_memory.MEMORY), WARN, dead, shared_memory.CLEAN))
    nodes = list(dict.fromkeys(facts.nodes))
    entries = [entry for node in nodes for entry in _entries(node, facts)]
    timeless = [entry for entry in entries if entry.code == Code.NO_CLOCK]
    for index, check in enumerate(checks):
        if check.subject == "/clock":
            checks[index] = replace(check, follows=tuple(one.check() for one in timeless))
            entries = [entry for entry in entries if entry not in timeless]
    checks += _folded(sorted(entries, key=lambda entry: not entry.is_of_robot))
    bad = {entry.node for entry in entries}
    checks += [
        Check(node, OK, f"{len(facts.reports[node])} findings, all well")
        for node in nodes
        if node not in bad
    ]
    if len(facts.viewers) > 1:
        text = f"{len(facts.viewers)} run: {', '.join(facts.viewers)}"
        checks.append(Check("mrs people", OK, text))
    return checks


def _entries(node: str, facts: Facts) -> Iterable[_Entry]:
    """What is not well with a node: the node itself, or what it reports."""
    if node == f"/{ROBOT_NODE}":
        yield _Entry(
            node,
            "node",
            ERROR,
            "is a robot without a namespace, which is a robot's name: no planner finds it",
            advice="start it in one: ros2 run robot_node robot_node --ros-args -r __ns:=/robot_a",
        )
    state = facts.states.get(node)
    if state in _STATES:
        text, advice = _STATES[state]
        yield _Entry(node, "node", ERROR, f"is {state}: {text}", advice=advice.format(node=node))
    elif node not in facts.reports:
        text = "is on the network, but reports nothing on /diagnostics"
        if state is None:
            text += ", and does not answer"
        yield _Entry(node, "node", ERROR, text, advice=_NETWORK)
    else:
        doubled = any(len(set(who)) > 1 for who in facts.people_from.values() if node in who)
        for subject, (level, said, values) in facts.reports[node].items():
            if level != OK and not (subject == "people" and doubled):  # that is said by itself
                code, advice = _code(values), ""
                robot = subject.removesuffix("/points").removesuffix("/pose")
                own = f"{node.removesuffix(PLANNER_NODE)}{robot}/{ROBOT_NODE}"
                if robot != subject and own not in facts.nodes:
                    if code == Code.NO_PUBLISHER:
                        advice = f"there is no {own}: start it, or see `robots` in the team's file"
                    elif code == Code.NO_DATA:
                        advice = f"{own} {_STANDS_STILL}"
                yield _Entry(node, subject, level, said, code, advice)
        lost = shared_memory.lost_images(facts.reports[node])
        if lost:
            advice = shared_memory.advice_on_lost_images()
            yield _Entry(node, "images", ERROR, lost, advice=advice)


def causes_in(
    reports: Mapping[str, Mapping[str, tuple[str, str, Mapping[str, str]]]],
) -> list[Check]:
    """What nodes report that is not well, the causes; what follows from each is with it.

    Args:
        reports: By node, its last report: by subject its level, text and values.
    """
    facts = Facts(0, list(reports), {node: dict(report) for node, report in reports.items()})
    entries = [entry for node in facts.nodes for entry in _entries(node, facts)]
    return list(_folded(sorted(entries, key=lambda entry: not entry.is_of_robot)))


def _code(values: Mapping[str, str]) -> Code | None:
    """The code of a finding; None where it has none that is known here."""
    try:
        return Code(values.get("code", ""))
    except ValueError:
        return None


def _folded(entries: Sequence[_Entry]) -> Iterable[Check]:
    """Entries as checks: those that follow from an error that is among them, under it."""
    by_node: dict[str, list[_Entry]] = {}
    for entry in entries:
        by_node.setdefault(entry.node, []).append(entry)
    robots = [node for node, those in by_node.items() if those[0].is_of_robot]
    found: dict[_Entry, _Entry] = {}

    def cause(entry: _Entry) -> _Entry:
        """The error that it follows from, in the end; itself if none."""
        if entry not in found:
            found[entry] = entry  # what leads back here ends here
            found[entry] = next(causes(entry), entry)
        return found[entry]

    def causes(entry: _Entry) -> Iterator[_Entry]:
        for node, pattern in _causes(entry):
            for other in (
                o for n in (robots if node is None else [node]) for o in by_node.get(n, ())
            ):
                if re.fullmatch(pattern, other.subject) and cause(other).level == ERROR:
                    yield cause(other)
        # A camera, or a robot, that is silent altogether is one trouble.
        beside, _, last = entry.subject.rpartition("/")
        if entry.code in _LACKS and last in _BESIDE:
            pattern = f"{re.escape(beside)}/{_BESIDE[last]}"
            for other in by_node[entry.node]:
                same = other.code == entry.code and re.fullmatch(pattern, other.subject)
                if same and other.level == ERROR and cause(other) is other:
                    yield other

    follows: dict[_Entry, list[_Entry]] = {entry: [] for entry in entries}
    for entry in entries:
        first = cause(entry)
        while cause(first) is not first:  # where findings led back to each other
            first = cause(first)
        if first is not entry:
            follows[first].append(entry)
    return [entry.check(those) for entry, those in follows.items() if cause(entry) is entry]


def _causes(entry: _Entry) -> Iterator[tuple[str | None, str]]:
    """What a finding may follow from, the nearest to the sensor first.

    Yields:
        A node (None: any robot's), and a regular expression of subjects.
    """
    if entry.code not in _LACKS:
        return
    node, subject = entry.node, entry.subject
    if entry.is_of_robot:
        if re.fullmatch(r"\w+/image_\w+", subject):
            yield node, "images"
        if entry.code == Code.NO_CALIBRATION:
            yield node, r"\w+/camera_info"
        elif subject in ("pairs", "scan", "head", "pose"):
            chain = _POSE if subject == "pose" else _SIGHT
            yield from ((node, each) for each in takewhile(lambda each: each != subject, chain))
        return
    if subject == "intervals":
        yield from ((None, pattern) for pattern in _SIGHT)
        yield node, ".*/(points|pose)|robot .*"
        return
    robot, _, topic = subject.rpartition("/")
    if subject.startswith("robot "):
        robot = subject.removeprefix("robot ")
        topic = "pose" if entry.code == Code.NO_POSE else ""
        yield node, f"{re.escape(robot)}/(points|pose)"
    if entry.code != Code.TWO_PUBLISHERS:
        chain = _POSE if topic == "pose" else _SIGHT
        own = f"{node.removesuffix(PLANNER_NODE)}{robot}/{ROBOT_NODE}"
        yield from ((own, pattern) for pattern in chain)


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
    standing = any(entry.is_standing for node in facts.nodes for entry in _entries(node, facts))
    for kind, found in kinds.items():
        if not found and not (kind == ROBOT_NODE and standing):
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


def _of_planners(facts: Facts) -> Iterable[Check]:
    """More than one planner, under whatever names."""
    advice = "end one, or give each team a namespace of its own"
    for topic, names in sorted(facts.people_from.items()):
        if len(set(names)) > 1:
            text = f"{len(names)} nodes publish it: {', '.join(names)}"
            yield Check(topic, ERROR, text, advice)
    for planners in sorted({tuple(sorted(set(p))) for p in facts.shared_robots.values()}):
        if len(planners) > 1:
            robots = [t for t, p in facts.shared_robots.items() if set(p) == set(planners)]
            text = f"{' and '.join(planners)} all listen to {', '.join(sorted(robots))}"
            yield Check("planners", WARN, text, advice)


_KINDS = (ROBOT_NODE, PLANNER_NODE)
#: A node that does not answer within this, twice, does not answer [s].
_ANSWER_S = 1.5
_PEOPLE = "mrs_people_msgs/msg/People"
_VIEWER = "mrs_people_"


def look(node: Node, duration_s: float, spin: Any) -> Facts:
    """Listens to a team for a while.

    Args:
        node: The ROS node to listen with.
        duration_s: For how long [s].
        spin: Called again and again; lets the node work for a moment.
    """
    from diagnostic_msgs.msg import DiagnosticArray

    facts = Facts(node.context.get_domain_id(), nodes=[], memory=shared_memory.memory())

    def take(message: Any) -> None:
        # A report is a whole: what is not in it any more is over.
        for full_name in {plain(one.name).partition(": ")[0] for one in message.status}:
            facts.reports.pop(full_name, None)
        for status in message.status:
            full_name, _, subject = plain(status.name).partition(": ")
            if full_name.rpartition("/")[2] in _KINDS:
                values = {plain(entry.key): plain(entry.value) for entry in status.values}
                entry = (LEVELS.get(bytes(status.level), ERROR), plain(status.message), values)
                facts.reports.setdefault(full_name, {})[subject] = entry

    subscription = node.create_subscription(DiagnosticArray, "/diagnostics", take, 100)
    end = time.monotonic() + duration_s
    while time.monotonic() < end:
        spin()
    node.destroy_subscription(subscription)
    names = node.get_node_names_and_namespaces()
    facts.nodes = sorted(f"{ns.rstrip('/')}/{name}" for name, ns in names if name in _KINDS)
    facts.has_clock = node.count_publishers("/clock") > 0
    facts.mismatches = list(_mismatches(node, names))
    facts.viewers = sorted(f"{ns.rstrip('/')}/{name}" for name, ns in names if _is_viewer(name))
    for topic, types in node.get_topic_names_and_types():
        if _PEOPLE in types:
            facts.people_from[topic] = sorted(
                map(node_of, node.get_publishers_info_by_topic(topic))
            )
        elif topic.endswith("/points"):
            heard = map(node_of, node.get_subscriptions_info_by_topic(topic))
            facts.shared_robots[topic] = [h for h in heard if h.endswith(f"/{PLANNER_NODE}")]
    for full in dict.fromkeys(facts.nodes):
        facts.states[full] = _state(node, full, spin)
        facts.sim_time[full] = None if facts.states[full] is None else _sim_time(node, full, spin)
    return facts


def _is_viewer(name: str) -> bool:
    return name.removeprefix(_VIEWER).isdigit() and name.startswith(_VIEWER)


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
                pair = f"{node_of(publisher)} publishes it and {node_of(subscriber)} subscribes"
                if publisher.topic_type != subscriber.topic_type:
                    yield topic, f"{pair}: {publisher.topic_type}, {subscriber.topic_type}"
                    continue
                fits, why = qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)
                if fits == QoSCompatibility.ERROR:
                    yield topic, f"{pair} with incompatible QoS: {why.strip().rstrip(';')}"


def _sim_time(node: Node, full_name: str, spin: Any) -> bool | None:
    from rcl_interfaces.srv import GetParameters

    request = GetParameters.Request(names=["use_sim_time"])
    answer = _ask(node, GetParameters, f"{full_name}/get_parameters", request, spin)
    return bool(answer.values[0].bool_value) if answer is not None and answer.values else None


def _state(node: Node, full_name: str, spin: Any) -> str | None:
    """State of a node in its life cycle."""
    from lifecycle_msgs.srv import GetState

    answer = _ask(node, GetState, f"{full_name}/get_state", GetState.Request(), spin)
    return None if answer is None else str(answer.current_state.label)


def _ask(node: Node, kind: Any, service: str, request: Any, spin: Any) -> Any:
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

    from mrs_ros.network import environment
    from mrs_tools.tool_node import node

    environ = environment()  # as the user made it
    settings = [f"{name}={environ[name]}" for name in _SETTINGS if environ.get(name)]
    with node("mrs_doctor") as made:
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        try:
            facts = look(made, duration, lambda: executor.spin_once(timeout_sec=0.1))
        finally:
            executor.shutdown()

    console = Console(soft_wrap=True, highlight=False)
    console.print(f"ROS domain {facts.domain}; {', '.join(settings) or 'no settings of its own'}")
    checks = diagnose(facts)
    for check in checks:
        line = Text.assemble((f"{check.level:>8}  ", _COLOURS[check.level]), check.subject)
        console.print(line.append(f": {check.text}"))
        if check.advice:
            console.print(Text(f"          -> {check.advice}"))
        for one in check.follows:
            console.print(Text(f"          so: {one.subject}: {one.text}", style="dim"))
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
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "ROS_SECURITY_ENABLE",
)
