"""What is wrong with a team, and what to do: sentences from facts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE
from mrs_people_loc.health.findings import Code
from mrs_tools.diagnosis import lost_images, shared_memory
from mrs_tools.diagnosis.causes import LOST_IMAGES, NODE, Kind, Symptom, by_cause
from mrs_tools.diagnosis.facts import (
    ERROR,
    OK,
    WARN,
    Facts,
    Report,
    is_planner,
    is_robot,
    robot_node_of,
)

_NETWORK = "it hangs, or the network lets only discovery pass (firewall, Wi-Fi): docs/network.md"

_NO_ANSWER = (
    "does not answer: it hangs (end it and start it again), or was killed in the last 20 s, "
    "or the network lets only discovery pass (firewall, Wi-Fi): docs/network.md"
)

#: Advice on what the nodes report, by its code, where their sentence does not contain it.
_ADVICE = {
    Code.NO_PUBLISHER: "start what publishes it, or remap it (where ros2 is installed, `ros2 topic "
    "list` shows what there is)",
    Code.NO_DATA: "it is announced, but nothing comes: its program hangs, or the network "
    "lets only discovery pass (firewall, Wi-Fi): docs/network.md",
    Code.WRONG_TYPE: "two programs mean different things by this name: remap one",
    Code.WRONG_QOS: "let its publisher offer what is asked for; streams are asked for as best "
    "effort, volatile",
    Code.ALL_REFUSED: "none is used, for the reason given: correct their sender, or see "
    "docs/cameras.md",
    Code.SOME_REFUSED: "messages are refused for the reason given: correct their sender",
    Code.NO_CALIBRATION: "publish camera_info beside the images: docs/cameras.md",
    Code.OUTDATED: "/clock was set back and its stamps are ahead of it since: its sender does not "
    "follow /clock (use_sim_time), or something other than the replay publishes this topic, too",
    Code.NO_PAIR: "left and right must come, with stamps of one moment: docs/cameras.md",
    Code.SCAN_SILENT: "its camera, its node or its network has stopped",
    Code.LEFT_OUT_NO_POSE: "its poses come late or not at all: look at <robot>/pose, the load of "
    "its computer, and the network",
    Code.LEFT_OUT_TOO_OLD: "they come late: the network, the load of its computer, its clock",
    Code.NO_POSE: "publish its pose, in the map, or set pose.map_from_odom",
    Code.CARRIED: "let it see walls, team-mates or people of the group, or tell it where it is: a "
    "PoseWithCovarianceStamped on its topic pose_in",
    Code.MATE_DOUBTED: "look at what that robot says of itself: its start (pose.map_from_odom, "
    "localization.start), its mounting, whatever publishes its pose_in",
    Code.MAP_MISFIT: "correct the map or its origin, or the wall in the file that walls.file "
    "names: docs/robots.md",
    Code.MATE_CLOCK: "synchronize the clocks of all computers (chrony or NTP)",
    Code.CORRECTIONS_REFUSED: "look at the sensor: its mounting, its stated errors, its stamps; "
    "for pose_in, at its source",
    Code.NOT_CORRECTED: "normal in a wide hall; else look at the sensors of walls, at the other "
    "robots, and whether the planner runs: docs/robots.md",
    Code.ODOMETRY_NOISY: "look at its wheels, encoders and floor; else state larger covariances on "
    "odom, or raise localization.position_noise, heading_noise, turn_noise",
    Code.SONAR_DEAD: "look at its cable, its driver and what covers it; normal where nothing is "
    "within its range",
    Code.SLOW: "its computer or the network is too slow: see cpu, and *_ms",
    Code.NO_MAP: "publish one (map_server), or see that nothing is in the way: docs/guiding.md",
    Code.TOUR_HALTED: "it goes on by itself once they come again: look at the planner, the robots' "
    "nodes and the load of their computers",
    Code.TOUR_STOPPED: "see that nobody is in danger, then: mrs tour release",
    Code.PEOPLE_LOST: "look for them; see pace.patience",
    Code.TAKES_NO_PART: "look at its node, its computer and the network; it takes part again once "
    "its poses come",
    Code.DRIVEN_BY_OTHERS: "end the other guide, joystick or navigation, or give it another topic",
    **dict.fromkeys(
        (Code.NO_VIEW, Code.NO_SCAN, Code.NO_ROBOT, Code.NO_INTERVAL), "wait, or see its inputs"
    ),
}

#: What comes of a machine that has too much to do, too; and at which share of a processor for each
#: process that is likely.
_LATE = {
    Code.NO_DATA,
    Code.NO_PAIR,
    Code.SCAN_SILENT,
    Code.LEFT_OUT_NO_POSE,
    Code.LEFT_OUT_TOO_OLD,
    Code.SLOW,
}
_BUSY = 0.5

#: Where to read about inputs that nobody publishes.
_DOCS = {
    Kind.IMAGE: "docs/cameras.md",
    Kind.CAMERA_INFO: "docs/cameras.md",
    Kind.POSE_INPUT: "docs/robots.md#poses",
}

#: By lifecycle state in which a node does not work: what that means, and how to change it.
_STATES = {
    "unconfigured": (
        "receives and sends nothing: it waits (autostart:=false), or could not be configured, for "
        "which its log has the reason",
        "ros2 lifecycle set {node} configure && ros2 lifecycle set {node} activate",
    ),
    "inactive": (
        "receives and sends nothing until activated",
        "ros2 lifecycle set {node} activate",
    ),
    "finalized": (
        "it was shut down, and receives and sends nothing",
        "end its process, and start it again",
    ),
}


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        subject: A node and what about it, or a topic.
        level: ok, warning, error or waiting.
        text: What was found.
        advice: What to do; empty where the text has it, or nothing is to be done.
        follows: What else was found that comes of this.
    """

    subject: str
    level: str
    text: str
    advice: str = ""
    follows: tuple[Check, ...] = ()


def diagnose(facts: Facts) -> list[Check]:
    """What is right and wrong with a team: the causes first, and what follows from each with it."""
    nodes = list(dict.fromkeys(facts.nodes))
    symptoms = [symptom for node in nodes for symptom in _symptoms(node, facts)]
    simulated = sorted(node for node, sim in facts.sim_time.items() if sim)
    timeless: list[Symptom] = []
    if simulated and not facts.has_clock:
        timeless = [symptom for symptom in symptoms if symptom.code == Code.NO_CLOCK]
    others = [symptom for symptom in symptoms if symptom not in timeless]
    busy = facts.load is not None and facts.load.share < _BUSY
    checks = [
        *_of_load(facts, symptoms if busy else ()),
        *_of_nodes(facts, unanswered=any(symptom.unanswered for symptom in symptoms)),
        *_of_time(facts, simulated, timeless),
        *_of_planners(facts),
        *_of_types(facts),
        *(
            Check(topic, ERROR, text, "let both ask for the same; docs/network.md has the table")
            for topic, text in facts.mismatches
        ),
        *_of_memory(facts),
        *_with_consequences(others, busy=busy),
    ]
    bad = {symptom.node for symptom in others}
    checks += [Check(node, OK, _all_well(facts.reports[node])) for node in nodes if node not in bad]
    if len(facts.viewers) > 1:
        text = f"{len(facts.viewers)} run: {', '.join(facts.viewers)}"
        checks.append(Check("mrs people", OK, text))
    return checks


def _all_well(report: Report) -> str:
    """That a node has found nothing wrong, and what it says of a mounting that it cannot check."""
    text = f"{len(report)} findings, all well"
    mounting = report["mounting"][1] if "mounting" in report else "ok"
    return text if mounting == "ok" else f"{text}; mounting: {mounting}"


def causes_in(reports: Mapping[str, Report]) -> list[Check]:
    """What nodes report that is not well, the causes; what follows from each is with it.

    Args:
        reports: By node, its last report.
    """
    facts = Facts(0, list(reports), {node: dict(report) for node, report in reports.items()})
    return _with_consequences(
        [symptom for node in facts.nodes for symptom in _symptoms(node, facts)]
    )


def _of_load(facts: Facts, symptoms: Iterable[Symptom]) -> Iterable[Check]:
    """A machine that has too much to do, where that may be why something comes late."""
    if any(symptom.code in _LATE for symptom in symptoms):
        text = f"{facts.load}: what runs here comes late, or not at all"
        yield Check("this machine", WARN, text, "end what else runs here, and look again")


def _with_consequences(symptoms: Sequence[Symptom], *, busy: bool = False) -> list[Check]:
    """Symptoms as checks, those of robots first; those that follow from an error, with it.

    Args:
        symptoms: The symptoms.
        busy: Whether this machine has too much to do.
    """
    in_order = sorted(symptoms, key=lambda symptom: not is_robot(symptom.node))
    return [
        _check(symptom, [_check(one) for one in follows], busy=busy)
        for symptom, follows in by_cause(in_order).items()
    ]


def _check(symptom: Symptom, follows: Iterable[Check] = (), *, busy: bool = False) -> Check:
    subject = symptom.node if symptom.subject == NODE else f"{symptom.node}: {symptom.subject}"
    advice = symptom.advice or (_ADVICE.get(symptom.code, "") if symptom.code else "")
    if symptom.code == Code.NO_PUBLISHER and not symptom.advice and symptom.kind in _DOCS:
        advice += f"; {_DOCS[symptom.kind]}"
    if busy and symptom.code in _LATE:
        advice = f"if it runs on this machine, lower its load first; {advice}"
    return Check(subject, symptom.level, symptom.text, advice, tuple(follows))


def _symptoms(node: str, facts: Facts) -> Iterable[Symptom]:
    """What is not well with a node: the node itself, or what it reports."""
    if node == f"/{ROBOT_NODE}":
        yield Symptom(
            node,
            NODE,
            ERROR,
            "is a robot without a namespace, which is a robot's name: no planner finds it",
            advice="start it in one: ros2 run robot_node robot_node --ros-args -r __ns:=/robot_a",
        )
    state = facts.states.get(node)
    if state in _STATES:
        text, advice = _STATES[state]
        yield Symptom(node, NODE, ERROR, f"is {state}: {text}", advice=advice.format(node=node))
    elif node not in facts.reports:
        text = "is on the network, but reports nothing on /diagnostics"
        if state is None:
            text += ", and does not answer"
        yield Symptom(node, NODE, ERROR, text, advice=_NETWORK)
    else:
        for subject in facts.reports[node]:
            yield from _reported(node, subject, facts)
        lost = lost_images.lost_images(facts.reports[node])
        if lost:
            yield Symptom(node, LOST_IMAGES, ERROR, lost, advice=lost_images.advice())


def _reported(node: str, subject: str, facts: Facts) -> Iterable[Symptom]:
    """What a node reports of a subject, if that is not well."""
    level, text, values = facts.reports[node][subject]
    if level == OK:
        return
    others = (names for names in facts.people_from.values() if node in names)
    if subject == "people" and any(len(set(names)) > 1 for names in others):
        return  # `_of_planners` tells it
    code = _code(values)
    if subject == "people" and code == Code.WRONG_TYPE and facts.types:
        return  # `_of_types` tells it
    robot, _, topic = subject.rpartition("/")
    own = robot_node_of(node, robot)
    if topic in ("points", "pose") and robot and own not in facts.nodes:
        if code == Code.NO_PUBLISHER:
            advice = f"there is no {own}: start it, or see `robots` in the team's file"
            yield Symptom(node, subject, level, text, code, advice)
            return
        if code == Code.NO_DATA:
            yield Symptom(node, subject, level, text, code, f"{own} {_NO_ANSWER}", unanswered=True)
            return
    yield Symptom(node, subject, level, text, code)


def _code(values: Mapping[str, str]) -> Code | None:
    """The code of a finding; None where it has none that is known here."""
    try:
        return Code(values.get("code", ""))
    except ValueError:
        return None


def _of_nodes(facts: Facts, *, unanswered: bool) -> Iterable[Check]:
    """Nodes that are missing, or that are there twice.

    Args:
        facts: What was seen.
        unanswered: Whether there is a robot that does not answer.
    """
    if not facts.nodes:
        yield Check(
            "network",
            ERROR,
            f"no {ROBOT_NODE} and no {PLANNER_NODE} in ROS domain {facts.domain}",
            "start them; the same ROS_DOMAIN_ID on all machines; if they run, the network keeps "
            "them apart (multicast, firewall, discovery server): docs/network.md",
        )
        return
    if not unanswered and not any(map(is_robot, facts.nodes)):
        yield Check("network", ERROR, f"no {ROBOT_NODE} in ROS domain {facts.domain}", "start it")
    if not any(map(is_planner, facts.nodes)):
        yield Check("network", ERROR, f"no {PLANNER_NODE} in ROS domain {facts.domain}", "start it")
    for name, count in Counter(facts.nodes).items():
        if count > 1:
            what = ", or rename it if it is another robot" if is_robot(name) else ""
            text = f"{count} nodes have this name"
            yield Check(name, ERROR, text, f"it was started twice: end one of them{what}")


def _of_time(
    facts: Facts, simulated: Sequence[str], timeless: Iterable[Symptom]
) -> Iterable[Check]:
    """Nodes that wait for `/clock`, and nodes that do not have the time of the others.

    Args:
        facts: What was seen.
        simulated: The nodes that take their time from `/clock`.
        timeless: What they report for want of it.
    """
    if simulated and not facts.has_clock:
        yield Check(
            "/clock",
            ERROR,
            f"{', '.join(simulated)} take their time from it, but nobody publishes it",
            "mrs replay --clock, or use_sim_time:=false",
            tuple(map(_check, timeless)),
        )
    real = sorted(node for node, sim in facts.sim_time.items() if sim is False)
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


def _of_types(facts: Facts) -> Iterable[Check]:
    """Topics with endpoints of several types: these never connect, and DDS does not say so."""
    for topic, ends in sorted(facts.types.items()):
        by_type: dict[str, list[str]] = {}
        for end in sorted(ends):
            does = "publishes" if end.publishes else "subscribes"
            by_type.setdefault(end.type, []).append(f"{end.node} {does}")
        listed = "; ".join(f"{kind} ({', '.join(who)})" for kind, who in by_type.items())
        published = [end.type for end in ends if end.publishes]
        wanted = [end.type for end in ends if not end.publishes]
        level = ERROR if any(one != other for one in published for other in wanted) else WARN
        advice = "remap one of them, or update the older program: docs/topics.md"
        if {kind.rpartition("/")[2] for kind in by_type} == {"People"}:
            advice = (
                "mrs_people_msgs/People belongs on tracked_people (people_topic), "
                "people_msgs/People on people: docs/topics.md"
            )
        text = f"{len(by_type)} types, which never connect: {listed}"
        yield Check(topic, level, text, advice)


def _of_memory(facts: Facts) -> Iterable[Check]:
    """Shared memory that is full of what killed processes left behind."""
    dead = shared_memory.trouble(facts.memory) if facts.memory else ""
    if dead:
        yield Check(str(shared_memory.MEMORY), WARN, dead, shared_memory.CLEAN)
