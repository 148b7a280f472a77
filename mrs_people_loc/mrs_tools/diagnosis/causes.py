"""Which findings of a team follow from others: a robot without images has no scan either.

A finding follows from an error that is earlier in the order of the data, at the same node or at the
robot's node. It goes by the subjects and the codes of findings, not by their sentences.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property
from itertools import takewhile

from mrs_people_loc.config import PEOPLE_TOPICS, PLANNER_NODE
from mrs_people_loc.health.findings import Code
from mrs_tools.diagnosis.facts import ERROR, is_guide, is_robot, robot_node_of


class Kind(Enum):
    """What a finding is about."""

    NODE = auto()  # the node itself
    LOST_IMAGES = auto()
    IMAGE = auto()
    CAMERA_INFO = auto()
    PAIRS = auto()
    HEAD = auto()
    SCAN = auto()
    POSE_INPUT = auto()
    POSE = auto()
    POINTS = auto()
    ROBOT = auto()
    INTERVALS = auto()
    PEOPLE = auto()
    TOUR = auto()
    OTHER = auto()


#: The subjects of the symptoms that the diagnosis itself makes.
NODE, LOST_IMAGES = "node", "images"
_KINDS = {
    NODE: Kind.NODE,
    LOST_IMAGES: Kind.LOST_IMAGES,
    "camera_info": Kind.CAMERA_INFO,
    "pairs": Kind.PAIRS,
    "head": Kind.HEAD,
    "scan": Kind.SCAN,
    "odom": Kind.POSE_INPUT,
    "pose_in": Kind.POSE_INPUT,
    "pose": Kind.POSE,
    "points": Kind.POINTS,
    "intervals": Kind.INTERVALS,
    **dict.fromkeys(PEOPLE_TOPICS, Kind.PEOPLE),
    "tour": Kind.TOUR,
}

#: What a scan, and a pose, need of the robot's node, in the order of the data.
_FOR_SCANS = (
    Kind.NODE,
    Kind.LOST_IMAGES,
    Kind.IMAGE,
    Kind.CAMERA_INFO,
    Kind.PAIRS,
    Kind.SCAN,
)
_FOR_POSES = (Kind.NODE, Kind.POSE_INPUT, Kind.POSE)
#: Topics that come from the same source as another one.
_SAME_SOURCE = {Kind.CAMERA_INFO: Kind.IMAGE, Kind.POSE: Kind.POINTS}
#: Codes of findings that tell only that something is missing, or has stopped.
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
    Code.TOUR_HALTED,
    Code.TOUR_STOPPED,
}


@dataclass(frozen=True, eq=False)
class Symptom:
    """One thing that is not well with a node.

    Attributes:
        node: Full name of the node that reports it, or that it is about.
        subject: What it is about, as the node names it.
        level: warning, error or waiting.
        text: What was found.
        code: Its code; None where a node gives none that is known here.
        advice: What to do.
        unanswered: Whether it is about a robot that is known, but does not answer.
    """

    node: str
    subject: str
    level: str
    text: str
    code: Code | None = None
    advice: str = ""
    unanswered: bool = False

    @cached_property
    def kind(self) -> Kind:
        """What it is about."""
        if self.subject.startswith("robot "):
            return Kind.ROBOT
        if self.subject.startswith("/"):  # a topic of the team, or of a sensor of walls
            return Kind.OTHER
        last = self.subject.rpartition("/")[2]
        return Kind.IMAGE if last.startswith("image_") else _KINDS.get(last, Kind.OTHER)

    @cached_property
    def part(self) -> str:
        """The camera, or the planner's robot, that it is about; empty: the whole node."""
        if self.kind is Kind.ROBOT:
            return self.subject.removeprefix("robot ")
        return self.subject.rpartition("/")[0]


@dataclass(frozen=True)
class _Place:
    """Where a cause may be: among symptoms of some kinds at a node, or at any robot's node.

    Attributes:
        node: Full name; None: any robot's.
        kinds: Kinds of symptoms.
        part: Their part; None: any.
    """

    node: str | None
    kinds: tuple[Kind, ...]
    part: str | None = None

    def holds(self, symptom: Symptom) -> bool:
        return symptom.kind in self.kinds and self.part in (None, symptom.part)


def by_cause(symptoms: Sequence[Symptom]) -> dict[Symptom, list[Symptom]]:
    """The consequences of each cause: of each symptom that follows from no other.

    A symptom with consequences is an error.
    """
    by_node: dict[str | None, list[Symptom]] = {None: list(filter(_is_of_robot, symptoms))}
    for symptom in symptoms:
        by_node.setdefault(symptom.node, []).append(symptom)
    found: dict[Symptom, Symptom] = {}

    def cause(symptom: Symptom) -> Symptom:
        """The error that it follows from, in the end; itself if none."""
        if symptom not in found:
            found[symptom] = symptom  # what leads back here ends here
            found[symptom] = next(causes(symptom), symptom)
        return found[symptom]

    def causes(symptom: Symptom) -> Iterator[Symptom]:
        for place in _places(symptom):
            for other in filter(place.holds, by_node.get(place.node, ())):
                if cause(other).level == ERROR:
                    yield cause(other)
        # A camera, or a robot, that is completely silent is one problem.
        for other in by_node[symptom.node]:
            if _is_same_problem(symptom, other) and cause(other) is other:
                yield other

    def first_cause(symptom: Symptom) -> Symptom:
        while cause(symptom) is not symptom:  # also where findings led back to each other
            symptom = cause(symptom)
        return symptom

    causes_found: dict[Symptom, list[Symptom]] = {
        symptom: [] for symptom in symptoms if cause(symptom) is symptom
    }
    for symptom in symptoms:
        first = first_cause(symptom)
        if first is not symptom:
            causes_found[first].append(symptom)
    return causes_found


def _is_of_robot(symptom: Symptom) -> bool:
    return is_robot(symptom.node)


def _is_same_problem(symptom: Symptom, other: Symptom) -> bool:
    """Whether another topic of the same source lacks the same, and is an error."""
    return (
        symptom.code in _LACKS
        and other.kind is _SAME_SOURCE.get(symptom.kind)
        and (other.part, other.code) == (symptom.part, symptom.code)
        and other.level == ERROR
    )


def _places(symptom: Symptom) -> Iterable[_Place]:
    """Where the cause of a symptom may be, the nearest to the sensor first."""
    if symptom.code not in _LACKS:
        return ()
    if is_robot(symptom.node):
        return _at_robot(symptom)
    if is_guide(symptom.node) and symptom.kind is not Kind.POSE:
        return _at_guide(symptom)
    return _at_planner(symptom)


def _at_robot(symptom: Symptom) -> Iterator[_Place]:
    node, kind = symptom.node, symptom.kind
    if kind is Kind.IMAGE:
        yield _Place(node, (Kind.LOST_IMAGES,))
    if symptom.code == Code.NO_CALIBRATION:
        yield _Place(node, (Kind.CAMERA_INFO,))
    elif kind in (Kind.PAIRS, Kind.SCAN, Kind.HEAD, Kind.POSE):
        chain = _FOR_POSES if kind is Kind.POSE else _FOR_SCANS
        for earlier in takewhile(lambda each: each is not kind, chain):
            yield _Place(node, (earlier,))


def _at_guide(symptom: Symptom) -> Iterator[_Place]:
    if symptom.kind is Kind.TOUR:
        yield _Place(symptom.node, (Kind.NODE, Kind.PEOPLE, Kind.POSE))
    if symptom.kind is Kind.PEOPLE:
        planner = f"{symptom.node.rpartition('/')[0]}/{PLANNER_NODE}"
        yield _Place(planner, (Kind.NODE, Kind.INTERVALS))


def _at_planner(symptom: Symptom) -> Iterator[_Place]:
    node, kind, code = symptom.node, symptom.kind, symptom.code
    if kind is Kind.INTERVALS:
        for earlier in _FOR_SCANS:
            yield _Place(None, (earlier,))
        yield _Place(node, (Kind.POINTS, Kind.POSE, Kind.ROBOT))
        return
    if kind is Kind.ROBOT:
        yield _Place(node, (Kind.POINTS, Kind.POSE), symptom.part)
    if code != Code.TWO_PUBLISHERS:
        of_pose = kind is Kind.POSE or (kind is Kind.ROBOT and code == Code.NO_POSE)
        for earlier in _FOR_POSES if of_pose else _FOR_SCANS:
            yield _Place(robot_node_of(node, symptom.part), (earlier,))
