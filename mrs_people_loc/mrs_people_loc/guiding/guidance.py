"""What flows from people and poses to the robots of a tour."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from mrs_people_loc.arrays import Float

#: Events of the change to `State.HALTED`, followed by the reason, and of the end of that state.
HALTS, GOES_ON = "halts: ", "goes on"


class State(IntEnum):
    """State of a tour, numbered as in mrs_people_msgs/GuideStatus."""

    IDLE = 0
    GATHERING = 1
    LEADING = 2
    WAITING = 3
    AT_STOP = 4
    FINISHED = 5
    CANCELLED = 6
    HALTED = 7
    STOPPED = 8


class Role(IntEnum):
    """What a robot is there for, numbered as in mrs_people_msgs/RobotPost."""

    LEADER = 0
    REAR = 1
    SIDE = 2
    FETCHER = 3


@dataclass(frozen=True)
class Post:
    """Where a robot belongs.

    Attributes:
        role: What it is there for.
        xy: Place of its base_link in the map [m], shape (2,).
        yaw: Heading of its base_link there [rad].
        speed: Highest speed on the way there [m/s].
    """

    role: Role
    xy: Float
    yaw: float
    speed: float


@dataclass(frozen=True)
class Guidance:
    """What became of an interval: where the robots are to go, and how the tour goes on.

    Attributes:
        stamp_ns: Of the people [ns].
        state: Of the tour.
        reason: Why it waits, stands or has ended, in words.
        stop: Name of the stop where the group is, or of the next one.
        way_m: How far the group is along the way [m].
        length_m: Length of the way [m].
        speed: Of the leader [m/s].
        people: Ids of those who are guided.
        stragglers: Ids of those who are waited for.
        lost: Ids of those without whom the tour goes on.
        posts: By robot that takes part.
        faults: By robot that takes no part: why.
        events: What has happened, in sentences.
    """

    stamp_ns: int
    state: State
    reason: str = ""
    stop: str = ""
    way_m: float = 0.0
    length_m: float = 0.0
    speed: float = 0.0
    people: tuple[int, ...] = ()
    stragglers: tuple[int, ...] = ()
    lost: tuple[int, ...] = ()
    posts: Mapping[str, Post] = field(default_factory=dict)
    faults: Mapping[str, str] = field(default_factory=dict)
    events: tuple[str, ...] = ()
