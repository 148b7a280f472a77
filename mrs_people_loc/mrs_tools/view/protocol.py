"""The messages between the server of `mrs view` and its page: JSON objects in WebSocket frames.

Every message has a `type`. Metres, seconds and radians; places and headings in the common frame
`map`; times are ROS times [s], in a bag those at which messages were recorded. Numbers are rounded
(`rounded`); what is unknown is null.

From the server: `Hello` first, and again when something else is shown; then in any order the
latest of `Map`, `State`, `Cells`, `Image` (by robot), `Health` and `Time`, and every `Event`. A
viewer that is slow misses messages that a later one replaces. Each command but `Look` is answered
by an `Answer`, and so is what is malformed.

From the page: the commands below, such as `{"type": "look", "cells": true, "robots": ["robot_a"]}`.
`Look` holds for the viewer that sends it, until its next one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, TypedDict

from mrs_people_loc.errors import PeopleLocError

#: Of this protocol; the page refuses another one.
VERSION = 1
#: The page's TCP port: one that no other viewer of robots has.
PORT = 8642
#: A longer command closes the connection.
MAX_COMMAND_BYTES = 4096
#: Events that a viewer is shown when it connects.
EVENTS_KEPT = 50
#: How fast a bag may be played.
MIN_SPEED, MAX_SPEED = 0.1, 20.0
_MAX_ROBOTS = 64
_MAX_NAME = 256


class CommandError(PeopleLocError):
    """A command of a viewer that is malformed, or that is not allowed here."""


# ------------------------------------------------------------------------------ server to page


class Span(TypedDict):
    """First and last stamp of a bag."""

    start: float
    end: float


class Hello(TypedDict):
    """What is shown.

    `control`: tours may be started and cancelled, and stopped robots released. `tours`: their
    names. `bag`: null in mode "live".
    """

    type: Literal["hello"]
    version: int
    mode: Literal["live", "bag"]
    title: str
    control: bool
    bag: Span | None
    tours: list[str]


class Grid(TypedDict):
    """An occupancy grid; x, y, yaw: the pose of its lower left corner.

    `png`: base64, one pixel per cell in shades of grey as map_server writes them: 0 occupied, 254
    free, 205 unknown. The first row of pixels is the last row of cells (the highest y, where yaw is
    0).
    """

    width: int
    height: int
    resolution: float
    x: float
    y: float
    yaw: float
    png: str


class Map(TypedDict):
    """Walls that robots use, each [x1, y1, x2, y2], and the map; sent when one of them changes."""

    type: Literal["map"]
    walls: list[list[float]]
    grid: Grid | None


class Person(TypedDict):
    """One person.

    `id`: 0: not followed. `cov`: of the position, [xx, xy, yy]. `age`: since they were first seen.
    `seen_s`: since they were last seen. `predicted`: they are not seen just now; `seen_at`: where
    who is hidden was last seen, [x, y]. `group`: id of their group, null: none. `straggler`: they
    have fallen behind it, for `straggling_s`.
    """

    id: int
    x: float
    y: float
    vx: float | None
    vy: float | None
    cov: list[float | None]
    height: float | None
    age: float
    seen_s: float | None
    predicted: bool
    seen_at: list[float] | None
    group: int | None
    straggler: bool
    straggling_s: float | None


class Group(TypedDict):
    """A group; x, y: the centre of those who are there. Members and stragglers are ids."""

    id: int
    x: float
    y: float
    members: list[int]
    stragglers: list[int]


class Robot(TypedDict):
    """A robot.

    `cov`: of the position, [xx, xy, yy]; `yaw_sigma`: of the heading. `reach`: how far it sees;
    `view`: its horizontal field of view; `view_yaw`: the direction of its middle in the robot's
    frame (pi: it looks back); all null: unknown. `age`: since its last pose came. `ok`: false when
    it is silent or its node reports an error; `note`: that in words, else empty.
    """

    name: str
    x: float
    y: float
    yaw: float
    cov: list[float | None]
    yaw_sigma: float | None
    reach: float | None
    view: float | None
    view_yaw: float | None
    age: float
    ok: bool
    note: str


class Post(TypedDict):
    """Where a robot belongs in a tour; `role`: leader, rear, side or fetcher."""

    robot: str
    x: float
    y: float
    yaw: float
    role: str


class Tour(TypedDict):
    """A tour.

    `state`: idle, gathering, leading, waiting, at_stop, finished, cancelled, halted or stopped;
    robots may be stopped without a tour, whose `name` is empty then. `leader`: the robot, empty:
    none. `progress`: 0 to 1. `way`, `length`: how far the group is along the way, of how much [m].
    `stop`: where it is or which is next. `message`: why it waits, stands or has ended. `lost`: ids
    of those without whom it goes on. `age`: of the guide's last word [s].
    """

    name: str
    state: str
    leader: str
    progress: float
    way: float
    length: float
    stop: str
    posts: list[Post]
    message: str
    lost: list[int]
    age: float


class OfBag(TypedDict, total=False):
    """What a state of a bag may have in addition.

    `truth`: places of the true people, each [x, y]. `trails`: by id, where people have been in the
    last seconds, each [t, x, y], the oldest first; in the first states after a seek, in place of
    what the page remembers.
    """

    truth: list[list[float]]
    trails: dict[str, list[list[float]]]


class State(OfBag):
    """Everybody and every robot at one moment.

    `t`: stamp of the last people, null before the first. `age`: since they came, by any clock.
    While no people come, a state is sent about twice a second, for the ages.
    """

    type: Literal["state"]
    t: float | None
    age: float | None
    people: list[Person]
    groups: list[Group]
    robots: list[Robot]
    tour: Tour | None


class Cells(TypedDict):
    """Cells of the robots' last scans: by robot x, y, x, y, ...; while a viewer asks for them."""

    type: Literal["cells"]
    t: float
    robots: dict[str, list[float]]


class Image(TypedDict):
    """A robot's view, while a viewer asks for it.

    `image`: its left image with the bodies found drawn into it; `disparity`: in colours, null: none
    comes. Both are base64 of a JPEG. `t`: stamp of the image; `age`: how old that was when it was
    sent. `note`: what is missing, in words, else empty; `image` may be null then.
    """

    type: Literal["image"]
    robot: str
    t: float | None
    age: float | None
    image: str | None
    disparity: str | None
    note: str


class Event(TypedDict):
    """Something that happened, in a sentence.

    Of a bag, those before the player's time come again after a seek.
    """

    type: Literal["event"]
    t: float
    text: str


Level: TypeAlias = Literal["ok", "warning", "error", "waiting"]


class Finding(TypedDict):
    """What `mrs doctor` says of one thing; `follows`: what else was found that comes of it."""

    level: Level
    subject: str
    text: str
    advice: str
    follows: list[str]


class Health(TypedDict):
    """How the team is: the worst level, and what is not well, the causes first."""

    type: Literal["health"]
    level: Level
    findings: list[Finding]


def starting(text: str) -> Health:
    """What the page says while there is no team yet, or not all of it.

    Args:
        text: What is done, a sentence.
    """
    finding = Finding(level="waiting", subject="start", text=text, advice="", follows=[])
    return Health(type="health", level="waiting", findings=[finding])


class Time(TypedDict):
    """Where the player of a bag is, and until where people are known (`ready`).

    They are known everywhere if the bag has them; else they are computed while it is shown.
    """

    type: Literal["time"]
    t: float
    start: float
    end: float
    ready: float
    playing: bool
    speed: float


class Answer(TypedDict):
    """To a command of this viewer."""

    type: Literal["answer"]
    ok: bool
    text: str


Message: TypeAlias = Hello | Map | State | Cells | Image | Event | Health | Time | Answer
#: Takes a message for all viewers; may be called in any thread, and returns at once.
Publish: TypeAlias = Callable[[Message], None]


def rounded(value: float, digits: int = 3) -> float | None:
    """A number to the millimetre or milliradian; None if it is not finite: JSON cannot hold it."""
    return round(float(value), digits) if math.isfinite(value) else None


def encode(message: Message) -> str:
    """A message as compact JSON.

    Raises:
        ValueError: A number is not finite.
    """
    return json.dumps(message, separators=(",", ":"), allow_nan=False, ensure_ascii=False)


# ------------------------------------------------------------------------------ page to server


@dataclass(frozen=True)
class Look:
    """What a viewer looks at: `{"type": "look", "cells": true, "robots": ["robot_a"]}`.

    Attributes:
        robots: The robots whose images it wants.
        cells: Whether it wants cells.
    """

    robots: frozenset[str] = frozenset()
    cells: bool = False


@dataclass(frozen=True)
class Play:
    """Plays a bag, or stops playing: `{"type": "play"}`, `{"type": "pause"}`."""

    playing: bool


@dataclass(frozen=True)
class Speed:
    """How fast a bag is played: `{"type": "speed", "speed": 2}`; 1: as recorded."""

    speed: float


@dataclass(frozen=True)
class Seek:
    """Goes to a time of a bag [s], or to its nearest end: `{"type": "seek", "t": 1700000000.5}`."""

    t: float


@dataclass(frozen=True)
class StartTour:
    """Starts one of the tours of `Hello`: `{"type": "tour", "start": "NAME"}`."""

    name: str


@dataclass(frozen=True)
class CancelTour:
    """Cancels the tour: `{"type": "tour", "cancel": true}`."""


@dataclass(frozen=True)
class StopRobots:
    """Lets the robots of the guide stand until they are released: `{"type": "stop"}`."""


@dataclass(frozen=True)
class ReleaseRobots:
    """Releases robots that were stopped: `{"type": "release"}`."""


#: What a source is asked for; the server itself takes a Look.
Control: TypeAlias = Play | Speed | Seek | StartTour | CancelTour | StopRobots | ReleaseRobots


def read_command(text: str) -> Look | Control:
    """A command of the page.

    Raises:
        CommandError: It is none; says what is allowed.
    """
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError) as err:
        raise CommandError("a command is no JSON") from err
    if not isinstance(entries, dict):
        raise CommandError("a command is no JSON object")
    kind = entries.pop("type", None)
    read = _READERS.get(kind) if isinstance(kind, str) else None
    if read is None:
        raise CommandError(f"type is {_short(kind)}; allowed: {', '.join(_READERS)}")
    return read(entries)


def _look(entries: Mapping[str, Any]) -> Look:
    _only(entries, "look", ("cells", "robots"))
    cells, robots = entries.get("cells", False), entries.get("robots", [])
    if not isinstance(cells, bool):
        raise CommandError(f"look: cells is {_short(cells)}; allowed: true, false")
    if not isinstance(robots, list) or not all(map(_is_name, robots)):
        raise CommandError(f"look: robots is {_short(robots)}; allowed: a list of names")
    if len(robots) > _MAX_ROBOTS:
        raise CommandError(f"look: {len(robots)} robots; allowed: {_MAX_ROBOTS}")
    return Look(frozenset(robots), cells)


def _play(entries: Mapping[str, Any]) -> Play:
    _only(entries, "play")
    return Play(True)


def _pause(entries: Mapping[str, Any]) -> Play:
    _only(entries, "pause")
    return Play(False)


def _speed(entries: Mapping[str, Any]) -> Speed:
    _only(entries, "speed", ("speed",))
    speed = _number("speed", "speed", entries.get("speed"))
    if not MIN_SPEED <= speed <= MAX_SPEED:
        raise CommandError(f"speed is {speed:g}; allowed: {MIN_SPEED:g} to {MAX_SPEED:g}")
    return Speed(speed)


def _seek(entries: Mapping[str, Any]) -> Seek:
    _only(entries, "seek", ("t",))
    return Seek(_number("seek", "t", entries.get("t")))


def _tour(entries: Mapping[str, Any]) -> StartTour | CancelTour:
    _only(entries, "tour", ("start", "cancel"))
    name = entries.get("start")
    if list(entries) == ["start"] and _is_name(name):
        return StartTour(str(name))
    if list(entries) == ["cancel"] and entries["cancel"] is True:
        return CancelTour()
    raise CommandError('tour: wanted: either "start": the name of a tour, or "cancel": true')


def _stop(entries: Mapping[str, Any]) -> StopRobots:
    _only(entries, "stop")
    return StopRobots()


def _release(entries: Mapping[str, Any]) -> ReleaseRobots:
    _only(entries, "release")
    return ReleaseRobots()


_READERS: dict[str, Callable[[Mapping[str, Any]], Look | Control]] = {
    "look": _look,
    "play": _play,
    "pause": _pause,
    "speed": _speed,
    "seek": _seek,
    "tour": _tour,
    "stop": _stop,
    "release": _release,
}


def _only(entries: Mapping[str, Any], kind: str, allowed: Sequence[str] = ()) -> None:
    unknown = sorted(entries.keys() - set(allowed))
    if unknown:
        wanted = ", ".join(allowed) or "none"
        raise CommandError(f"{kind}: unknown entry {_short(unknown[0])}; allowed: {wanted}")


def _number(kind: str, name: str, value: Any) -> float:
    try:
        if isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
            if math.isfinite(number):
                return number
    except OverflowError:
        pass
    raise CommandError(f"{kind}: {name} is {_short(value)}; allowed: a finite number")


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= _MAX_NAME


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
